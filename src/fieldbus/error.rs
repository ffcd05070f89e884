//! What went wrong on the fieldbus, by who is to blame.

use super::canopen::abort::AbortCode;
use super::opcua_fault::OpcUaFault;
use crate::tls::TlsFault;
use isotherm_core::reading::{Reason, Status, exception};

/// Why a request has no answer. Small, so that a test is one comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Fault {
    /// We asked for something that cannot be asked.
    #[error("{0}")]
    Caller(CallerFault),
    /// The connection.
    #[error("{0}")]
    Link(LinkFault),
    /// The device answered something else than what was asked.
    #[error("{0}")]
    Peer(PeerFault),
    /// The device says no, with this Modbus exception code.
    #[error("exception {0} ({name})", name = exception(*.0))]
    Exception(u8),
    /// The device says no, with this SDO abort code.
    #[error("refused: {0}")]
    Aborted(AbortCode),
    /// The server says no, with this status of OPC UA.
    #[error("the server answers {0}")]
    Status(Status),
    /// The server has written some of the nodes of one call, and says this of another.
    #[error(
        "the server answers {status} to node {place} of those that are written together, and has written others"
    )]
    Part {
        /// What it says of the first that was not written.
        status: Status,
        /// Which of them that is, counted from 1.
        place: u16,
    },
    /// Of the nodes that are read together this one cannot be believed.
    #[error("node {place} of those that are read together: {fault}", fault = Fault::of_a_node(*.reason))]
    Unreadable {
        /// Why not.
        reason: Reason,
        /// Which of them that is, counted from 1.
        place: u16,
    },
    /// No answer in time.
    #[error("no answer in time")]
    Timeout,
}

/// A request that must not leave the house.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum CallerFault {
    /// Zero registers, more than a request carries, or beyond the last address.
    #[error("request outside what the protocol allows")]
    Extent,
    /// A function code that the profile does not allow for this device.
    #[error("function code not allowed by the profile")]
    Function,
    /// Of a frame that several values share, another is not known yet.
    #[error("another value in the same frame is not known yet; sent as soon as it is")]
    Incomplete,
    /// An answer that would look like its own may still come, to a question before it.
    #[error("waits: the answer to a question before it may still come, and would look like its own")]
    Owed,
    /// What it rests on has become too old before it could be sent.
    #[error("too late: what it rests on is too old by now")]
    TooLate,
    /// More nodes than the server takes in one call, of which none may be written without the others.
    #[error("the server takes {0} in one call (MaxNodesPerWrite), and a set is written in one or not at all")]
    TooManyNodes(u32),
}

/// How a connection fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum LinkFault {
    /// Nobody listens there.
    #[error("nothing listens there")]
    Refused,
    /// There is no host of this name.
    #[error("no such host name")]
    Unresolved,
    /// The host cannot be reached.
    #[error("host not reachable")]
    Unreachable,
    /// It was closed or broke in the middle.
    #[error("connection closed or broken")]
    Broken,
    /// It was closed while nothing was under way: nothing has been sent.
    #[error("connection closed while idle")]
    Closed,
    /// There is no such serial port: not plugged in, or under another name.
    #[error("no such serial port")]
    Absent,
    /// The serial port may not be opened by this user.
    #[error("no permission for the serial port")]
    Forbidden,
    /// Another program has the serial port.
    #[error("another program has the serial port")]
    Busy,
    /// The port is no serial port, or cannot do these settings.
    #[error("no serial port, or one that cannot do these settings")]
    Unsuited,
    /// It was closed before it brought a single answer.
    #[error("closed before the first answer")]
    TurnedAway,
    /// It is closed again and again, soon after it was made.
    #[error("closed again and again")]
    Contested,
    /// TLS did not come about.
    #[error("{0}")]
    Tls(TlsFault),
    /// The CAN interface.
    #[error("{0}")]
    Can(CanFault),
    /// An OPC UA server lets nobody in, or is not let in.
    #[error("{0}")]
    OpcUa(OpcUaFault),
    /// It is down, and not yet time to try again.
    #[error("no connection")]
    Down,
    /// Nothing was sent: the device may have been exchanged, and must pass its checks first.
    #[error("the checks of the device come first: its connection was lost, and another device may answer")]
    Unverified,
}

/// What is wrong with a CAN interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum CanFault {
    /// There is none of this name, or it has been taken away.
    #[error("no such interface")]
    NoInterface,
    /// It is another kind of interface.
    #[error("no CAN interface")]
    NotCan,
    /// This computer's kernel has no CAN.
    #[error("this computer's kernel has no CAN")]
    NoKernel,
    /// It may not be used by this user.
    #[error("no permission for CAN")]
    Forbidden,
    /// It is down.
    #[error("the interface is down")]
    Down,
    /// Its queue is full: nothing leaves it.
    #[error("the interface's queue is full")]
    Full,
    /// It does not carry CAN FD, or the frame is none that CAN can carry.
    #[error("a frame that the interface cannot carry")]
    TooLong,
}

/// How an answer is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum PeerFault {
    /// Another transaction or another unit: a late reply to an older question, or somebody else's.
    #[error("reply of another transaction or unit")]
    Foreign,
    /// Another function code.
    #[error("reply with another function code")]
    Function,
    /// More or fewer registers than asked for.
    #[error("reply with the wrong number of registers")]
    Length,
    /// A write answered with another address, value or count.
    #[error("write answered with another address or value")]
    Echo,
    /// An object of another width than its type.
    #[error("the object has another width than its type in the profile")]
    Width,
    /// A node of another type than in the profile.
    #[error("the node has another type than the profile says")]
    Type,
    /// Nothing that the protocol knows.
    #[error("reply is none that the protocol knows")]
    Malformed,
    /// A server sends nothing of a subscription, and no sign of life.
    #[error(
        "its subscription is silent: the server sends neither values nor a sign of life as often as it promised"
    )]
    Silent,
    /// Something that nobody had asked for.
    #[error("it sends what nobody asked for")]
    Unasked,
    /// A gateway gives the answer to an earlier question.
    #[error("out of order: a question got the answer to the question before it")]
    OutOfOrder,
}

/// What is known of a write that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// It was not done, and will not be.
    NotDone,
    /// It may have been done, or may still be.
    Unknown,
}

impl Fault {
    pub(super) const BROKEN: Fault = Fault::Link(LinkFault::Broken);
    pub(super) const CLOSED: Fault = Fault::Link(LinkFault::Closed);
    pub(super) const UNVERIFIED: Fault = Fault::Link(LinkFault::Unverified);
    pub(super) const UNASKED: Fault = Fault::Peer(PeerFault::Unasked);

    /// One word for counters and programs.
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

    /// Every word of [`Fault::blame`].
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];

    /// The device has answered, and it says no.
    pub const fn is_refusal(self) -> bool {
        match self {
            Fault::Unreadable { reason, .. } => Fault::of_a_node(reason).is_refusal(),
            _ => matches!(
                self,
                Fault::Exception(_) | Fault::Aborted(_) | Fault::Status(_) | Fault::Part { .. }
            ),
        }
    }

    /// The device says that it does not have what was asked for. Another refusal only means that it does not answer this now.
    pub const fn is_absence(self) -> bool {
        match self {
            Fault::Unreadable { reason, .. } => Fault::of_a_node(reason).is_absence(),
            Fault::Exception(code) => matches!(code, 1..=3),
            Fault::Aborted(AbortCode(code)) => matches!(code, NO_SUCH_OBJECT | NO_SUCH_SUBINDEX),
            Fault::Status(status) => status.is(Status::NO_SUCH_NODE),
            _ => false,
        }
    }

    /// A gateway in between has answered for a device that does not.
    pub const fn is_of_a_gateway(self) -> bool {
        matches!(self, Fault::Exception(10 | 11))
    }

    /// What it says of a write: whether that may have been done all the same.
    ///
    /// Only a device that refuses in words which mean "not done" is believed: a TCP-to-RTU gateway says 11 of a write that
    /// its slave has carried out, 5 means "accepted, takes long", and a full queue or bus-off of CAN says nothing.
    pub const fn outcome(self) -> Outcome {
        match self {
            // It never left the house.
            Fault::Caller(_) | Fault::Exception(1..=3) => Outcome::NotDone,
            Fault::Aborted(AbortCode(code)) if code >> 24 == 0x06 => Outcome::NotDone,
            Fault::Status(status) if is_not_done(status) => Outcome::NotDone,
            Fault::Link(
                LinkFault::Refused
                | LinkFault::Unresolved
                | LinkFault::Unreachable
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

    /// Why the value of a node cannot be believed.
    pub(crate) const fn of_a_node(reason: Reason) -> Fault {
        match reason {
            Reason::Status(code) => Fault::Status(Status(code)),
            _ => Fault::Peer(PeerFault::Type),
        }
    }

    /// Nothing was sent, and nobody is to blame: its moment was over or has not come, or the connection on which it was
    /// decided is lost.
    pub const fn has_lapsed(self) -> bool {
        matches!(
            self,
            Fault::Caller(CallerFault::TooLate | CallerFault::Owed)
                | Fault::Link(LinkFault::Closed | LinkFault::Unverified)
        )
    }

    /// Whether the connection can no longer be trusted: what still arrives on it may answer an older question.
    pub const fn spoils_connection(self) -> bool {
        match self {
            // The answer is the one to the question; it is the profile that is wrong.
            Fault::Peer(PeerFault::Type) => false,
            Fault::Link(_) | Fault::Peer(_) | Fault::Timeout => true,
            _ => false,
        }
    }

    /// There is no connection at all: what is wrong is the line, not one of its devices.
    pub const fn is_of_the_line(self) -> bool {
        matches!(self, Fault::Link(fault) if !matches!(fault, LinkFault::Broken))
    }

    /// What it means for a reading.
    pub const fn reason(self) -> Reason {
        match self {
            Fault::Exception(code) => Reason::Exception(code),
            Fault::Aborted(_) => Reason::Refused,
            Fault::Status(Status(code)) | Fault::Part { status: Status(code), .. } => Reason::Status(code),
            Fault::Peer(PeerFault::Type) => Reason::WrongType,
            Fault::Unreadable { reason, .. } => reason,
            Fault::Timeout => Reason::Timeout,
            Fault::UNVERIFIED => Reason::NotAsExpected,
            Fault::Link(_) => Reason::LinkDown,
            Fault::Peer(_) | Fault::Caller(_) => Reason::BadReply,
        }
    }
}

/// SDO abort codes of an object that the node does not have. Source: CiA 301, 7.2.4.3.17.
const NO_SUCH_OBJECT: u32 = 0x0602_0000;
const NO_SUCH_SUBINDEX: u32 = 0x0609_0011;

/// The answers to a write that say it was not done. Any other may come of a server that has handed the value on already.
const fn is_not_done(status: Status) -> bool {
    status.is(Status::ACCESS_DENIED)
        || status.is(Status::NO_SUCH_NODE)
        || status.is(Status::NOT_WRITABLE)
        || status.is(Status::OUT_OF_RANGE)
        || status.is(Status::TYPE_MISMATCH)
}
