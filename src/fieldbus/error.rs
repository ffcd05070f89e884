//! Faults of the fieldbus, classified by their cause.

use super::kinds::can::canopen::abort::AbortCode;
use super::kinds::modbus::text::TextProtocol;
use super::kinds::opcua::fault::OpcUaFault;
use crate::tls::TlsFault;
use isotherm_core::reading::{Reason, Status, exception};

/// Reason why a request has no valid answer. The type is small, so that comparing two faults is one machine
/// instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Fault {
    /// The gateway did not send a request, because it is not allowed or not possible now.
    #[error("{0}")]
    Caller(CallerFault),
    /// The connection could not be opened, or has failed.
    #[error("{0}")]
    Link(LinkFault),
    /// The device sent an invalid reply.
    #[error("{0}")]
    Peer(PeerFault),
    /// The device refuses the request with this Modbus exception code.
    #[error("exception {0} ({name})", name = exception(*.0))]
    Exception(u8),
    /// The CANopen node refuses the request with this SDO abort code.
    #[error("refused: {0}")]
    Aborted(AbortCode),
    /// The OPC UA server refuses the request with this status.
    #[error("the server answers {0}")]
    Status(Status),
    /// The OPC UA server has written only some of the nodes of one write call.
    #[error(
        "the server has written only some nodes of one call, and refused node {place} of this call: {status}"
    )]
    Part {
        /// Status that the server gave for the first node that was not written.
        status: Status,
        /// Number of this node within the call, counted from 1.
        place: u16,
    },
    /// A read request for several OPC UA nodes got no valid value for one of the nodes.
    #[error("node {place} of the request: {fault}", fault = Fault::of_a_node(*.reason))]
    Unreadable {
        /// Reason why the value is not valid.
        reason: Reason,
        /// Number of this node within the call, counted from 1.
        place: u16,
    },
    /// No answer arrived in time.
    #[error("no answer in time")]
    Timeout,
}

/// Reason why the gateway does not send a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum CallerFault {
    /// The request has no registers, too many registers for one message, or registers beyond the last address.
    #[error("the request exceeds the limits of the protocol")]
    Extent,
    /// A function code that the profile does not allow for this device.
    #[error("function code not allowed by the profile")]
    Function,
    /// The CAN frame contains another value that is not known yet, so the frame cannot be sent.
    #[error("another value in the same frame is not known yet; the frame is sent when that value is known")]
    Incomplete,
    /// An answer to an earlier request may still arrive. The gateway could mistake that earlier answer for the answer
    /// to this request.
    #[error("request not sent: it could receive the late answer to an earlier request")]
    Owed,
    /// The values from which the request was calculated became too old before it was sent.
    #[error("request not sent: the values for it have become too old")]
    TooLate,
    /// The server accepts only this number of nodes in one call. The request has more nodes, which must be written
    /// together.
    #[error(
        "the server accepts {0} nodes in one call (MaxNodesPerWrite), and an output set must be written in \
         one call"
    )]
    TooManyNodes(u32),
}

/// Reason why a connection could not be opened, or has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum LinkFault {
    /// No program listens at the port.
    #[error("no program listens at this port")]
    Refused,
    /// The host name is not known.
    #[error("no such host name")]
    Unresolved,
    /// The host cannot be reached.
    #[error("host not reachable")]
    Unreachable,
    /// The program, or the whole computer, has no free file descriptor for the connection.
    #[error("too many files are open in this program, or on this computer")]
    NoDescriptors,
    /// The connection was closed or broken during a request.
    #[error("connection closed or broken")]
    Broken,
    /// The connection was closed while it was idle: nothing was sent.
    #[error("connection closed while idle")]
    Closed,
    /// The serial port does not exist: the adapter is not plugged in, or has another name.
    #[error("no such serial port")]
    Absent,
    /// This user has no permission for the serial port.
    #[error("no permission for the serial port")]
    Forbidden,
    /// Another program uses the serial port.
    #[error("another program uses the serial port")]
    Busy,
    /// The file is not a serial port, or the port does not support these settings.
    #[error("not a serial port, or the port does not support these settings")]
    Unsuited,
    /// The connection was closed before its first answer.
    #[error("the connection was closed before the first answer")]
    TurnedAway,
    /// The other end closes each connection soon after it was opened.
    #[error("the device repeatedly closes the connection")]
    Contested,
    /// The TLS handshake failed.
    #[error("{0}")]
    Tls(TlsFault),
    /// The CAN interface failed.
    #[error("{0}")]
    Can(CanFault),
    /// The gateway has no session with the OPC UA server, because the server refused the session or a check of the
    /// gateway failed.
    #[error("{0}")]
    OpcUa(OpcUaFault),
    /// The line has no connection now, and waits for its next attempt to connect.
    #[error("no connection")]
    Down,
    /// The request was not sent. The connection was lost, so another device may answer; the checks of the device must
    /// pass first.
    #[error("request not sent: after a lost connection, the checks of the device must pass first")]
    Unverified,
}

/// Reason why a CAN interface cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum CanFault {
    /// The interface does not exist, or was removed.
    #[error("no such interface")]
    NoInterface,
    /// The interface is not a CAN interface.
    #[error("not a CAN interface")]
    NotCan,
    /// The kernel of this computer does not support CAN.
    #[error("the kernel of this computer does not support CAN")]
    NoKernel,
    /// This user has no permission to use the interface.
    #[error("no permission for CAN")]
    Forbidden,
    /// The interface is down.
    #[error("the interface is down")]
    Down,
    /// The send queue is full: no frame leaves the interface.
    #[error("the interface's queue is full")]
    Full,
    /// The interface does not support CAN FD, or the frame is too long for CAN.
    #[error("the interface does not support this frame")]
    TooLong,
}

/// Reason why a reply is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum PeerFault {
    /// Reply with the number of another transaction or unit: a late reply to an earlier request, or a reply to another
    /// master.
    #[error("reply with the wrong transaction number or unit number")]
    Foreign,
    /// Reply over TCP that has the transaction number of the request, but this unit number instead of the requested
    /// one.
    #[error("the reply names unit {0}, which was not requested")]
    Unit(u8),
    /// Reply whose function code differs from the function code of the request.
    #[error("reply with another function code")]
    Function,
    /// Reply with more or fewer registers than requested.
    #[error("reply with the wrong number of registers")]
    Length,
    /// Reply to a write that does not repeat the address, value or count of the request.
    #[error("the reply to a write names another address or value")]
    Echo,
    /// CANopen object whose width in bytes differs from the width of its type in the profile.
    #[error("the length of the object does not match its type in the profile")]
    Width,
    /// OPC UA node whose type differs from its type in the profile.
    #[error("the node has another type than the profile says")]
    Type,
    /// OPC UA node whose value is not a number, although the profile states no type for it.
    #[error("the value of the node is not a number")]
    NotANumber,
    /// OPC UA node for which the server sends no value.
    #[error("the node has no value")]
    NoValue,
    /// Reply that violates the protocol.
    #[error("the reply violates the protocol")]
    Malformed,
    /// Line of text with a wrong checksum.
    #[error("wrong checksum")]
    Checksum,
    /// Modbus exception with this code, with more bytes than an exception has.
    #[error("exception {0} ({name}), with surplus bytes", name = exception(*.0))]
    LongException(u8),
    /// Text of another protocol instead of a Modbus frame.
    #[error("{0}")]
    Text(TextProtocol),
    /// The gateway received its own request instead of a reply.
    #[error("the request itself comes back instead of a reply")]
    Echoed,
    /// Subscription on which no data and no keep-alive messages of the server arrive in time.
    #[error("the subscription is silent: the server sends no values and no keep-alive messages in time")]
    Silent,
    /// Data that arrived while no request was open.
    #[error("data arrived without a request")]
    Unasked,
    /// Reply of a Modbus gateway that answers an earlier request instead of the present one.
    #[error("answers out of order: a request received the answer to the request before it")]
    OutOfOrder,
}

/// Whether the device may have executed a write although the gateway got no valid confirmation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// The device has not executed the write, and will not execute it.
    NotDone,
    /// The device may have executed the write, or may execute it later.
    Unknown,
}

impl Fault {
    pub(super) const BROKEN: Fault = Fault::Link(LinkFault::Broken);
    pub(super) const CLOSED: Fault = Fault::Link(LinkFault::Closed);
    pub(super) const UNVERIFIED: Fault = Fault::Link(LinkFault::Unverified);
    pub(super) const UNASKED: Fault = Fault::Peer(PeerFault::Unasked);

    /// Returns the class of the fault in one word, for counters and for programs.
    pub const fn blame(self) -> &'static str {
        match self {
            Fault::Caller(_) => "caller",
            Fault::Link(_) => "link",
            Fault::Peer(_) => "peer",
            Fault::Exception(_) | Fault::Aborted(_) | Fault::Status(_) | Fault::Part { .. } => "exception",
            Fault::Unreadable { reason, .. } => Fault::of_a_node(reason).blame(),
            Fault::Timeout => "timeout",
        }
    }

    /// All words of [`Fault::blame`].
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];

    /// Returns whether the device answered, but refused the request.
    pub const fn is_refusal(self) -> bool {
        match self {
            Fault::Unreadable { reason, .. } => Fault::of_a_node(reason).is_refusal(),
            _ => matches!(
                self,
                Fault::Exception(_)
                    | Fault::Peer(PeerFault::LongException(_))
                    | Fault::Aborted(_)
                    | Fault::Status(_)
                    | Fault::Part { .. }
            ),
        }
    }

    /// Returns whether the device reports that it does not have the requested register, object or node. Other refusals
    /// may be temporary.
    pub const fn is_absence(self) -> bool {
        match self {
            Fault::Unreadable { reason, .. } => Fault::of_a_node(reason).is_absence(),
            Fault::Exception(code) | Fault::Peer(PeerFault::LongException(code)) => matches!(code, 1..=3),
            Fault::Aborted(AbortCode(code)) => matches!(code, NO_SUCH_OBJECT | NO_SUCH_SUBINDEX),
            Fault::Status(status) => status.is(Status::NO_SUCH_NODE),
            _ => false,
        }
    }

    /// Returns the code of a Modbus exception, with or without surplus bytes; `None` for other faults.
    pub const fn exception_code(self) -> Option<u8> {
        match self {
            Fault::Exception(code) | Fault::Peer(PeerFault::LongException(code)) => Some(code),
            _ => None,
        }
    }

    /// Returns whether the unit has not answered: nothing arrived in time, or only data that another unit or another
    /// program may have sent.
    pub(super) const fn is_missing_answer(self) -> bool {
        match self {
            Fault::Timeout => true,
            Fault::Peer(fault) => matches!(
                fault,
                PeerFault::Malformed
                    | PeerFault::Checksum
                    | PeerFault::Foreign
                    | PeerFault::Unit(_)
                    | PeerFault::Text(_)
                    | PeerFault::Echoed
            ),
            _ => false,
        }
    }

    /// Returns whether a Modbus gateway reports, with exception 10 or 11, that the requested device did not answer.
    pub const fn is_of_a_gateway(self) -> bool {
        matches!(self, Fault::Exception(10 | 11))
    }

    /// Returns the outcome of a write that failed with this fault.
    ///
    /// A refusal counts as [`Outcome::NotDone`] only if its definition excludes that the write was executed. Exceptions
    /// 11 and 5 do not exclude this: a Modbus gateway sends 11 if the device did not answer, even if it executed the
    /// write. Exception 5 means "accepted, takes long". A full queue or bus-off of CAN proves nothing.
    pub const fn outcome(self) -> Outcome {
        match self {
            // The request was not sent.
            Fault::Caller(_) | Fault::Exception(1..=3) => Outcome::NotDone,
            Fault::Aborted(AbortCode(code)) if code >> 24 == 0x06 => Outcome::NotDone,
            Fault::Status(status) if is_not_done(status) => Outcome::NotDone,
            Fault::Link(
                LinkFault::Refused
                | LinkFault::Unresolved
                | LinkFault::Unreachable
                | LinkFault::NoDescriptors
                | LinkFault::Closed
                | LinkFault::Absent
                | LinkFault::Forbidden
                | LinkFault::Busy
                | LinkFault::Unsuited
                | LinkFault::Contested
                | LinkFault::OpcUa(_)
                | LinkFault::Down
                | LinkFault::Unverified,
            ) => Outcome::NotDone,
            _ => Outcome::Unknown,
        }
    }

    /// Returns the fault of an OPC UA node whose value is invalid for this reason.
    pub(crate) const fn of_a_node(reason: Reason) -> Fault {
        match reason {
            Reason::Status(code) => Fault::Status(Status(code)),
            Reason::WrongType => Fault::Peer(PeerFault::Type),
            Reason::NoNumber => Fault::Peer(PeerFault::NotANumber),
            _ => Fault::Peer(PeerFault::NoValue),
        }
    }

    /// Returns whether the gateway did not send the request, although the device has no fault. Possible reasons: the
    /// deadline of the request has passed, an earlier answer may still arrive, or the connection on which the request
    /// depends is lost.
    pub const fn has_lapsed(self) -> bool {
        matches!(
            self,
            Fault::Caller(CallerFault::TooLate | CallerFault::Owed)
                | Fault::Link(LinkFault::Closed | LinkFault::Unverified)
        )
    }

    /// Returns whether the connection is unusable after this fault, because later data on it may answer an earlier
    /// request.
    pub const fn spoils_connection(self) -> bool {
        match self {
            // The answer belongs to the request. Only the value of the node cannot be used, or the device refuses.
            Fault::Peer(
                PeerFault::Type | PeerFault::NotANumber | PeerFault::NoValue | PeerFault::LongException(_),
            ) => false,
            Fault::Link(_) | Fault::Peer(_) | Fault::Timeout => true,
            _ => false,
        }
    }

    /// Returns whether the fault concerns the whole bus line, because the line has no connection. Other faults concern
    /// a single device.
    pub const fn is_of_the_line(self) -> bool {
        matches!(self, Fault::Link(fault) if !matches!(fault, LinkFault::Broken))
    }

    /// Returns whether neither the power nor the cable of the device can be the cause of the fault. Either
    /// the other end answers, or the cause is on this computer.
    pub const fn excludes_wiring(self) -> bool {
        matches!(self, Fault::Link(LinkFault::OpcUa(_) | LinkFault::Tls(_) | LinkFault::NoDescriptors))
    }

    /// Returns the quality reason of a reading whose request failed with this fault.
    pub const fn reason(self) -> Reason {
        match self {
            Fault::Exception(code) | Fault::Peer(PeerFault::LongException(code)) => Reason::Exception(code),
            Fault::Aborted(_) => Reason::Refused,
            Fault::Status(Status(code)) | Fault::Part { status: Status(code), .. } => Reason::Status(code),
            Fault::Peer(PeerFault::Type) => Reason::WrongType,
            Fault::Peer(PeerFault::NotANumber) => Reason::NoNumber,
            Fault::Unreadable { reason, .. } => reason,
            Fault::Timeout => Reason::Timeout,
            Fault::UNVERIFIED => Reason::NotAsExpected,
            Fault::Link(_) => Reason::LinkDown,
            Fault::Peer(_) | Fault::Caller(_) => Reason::BadReply,
        }
    }
}

/// SDO abort codes by which a node reports that it does not have the object. Source: CiA 301, 7.2.4.3.17.
const NO_SUCH_OBJECT: u32 = 0x0602_0000;
const NO_SUCH_SUBINDEX: u32 = 0x0609_0011;

/// Returns whether the OPC UA status proves that the server did not execute a write. With any other status, the server
/// may already have passed the value on to the machine.
const fn is_not_done(status: Status) -> bool {
    status.is(Status::ACCESS_DENIED)
        || status.is(Status::NO_SUCH_NODE)
        || status.is(Status::NOT_WRITABLE)
        || status.is(Status::OUT_OF_RANGE)
        || status.is(Status::TYPE_MISMATCH)
}
