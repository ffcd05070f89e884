//! What went wrong on the fieldbus, by who is to blame.

use std::fmt;

use super::canopen::abort::AbortCode;
use isotherm_core::reading::Reason;

/// Why a request has no answer. Small, so that a test is one comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fault {
    /// We asked for something that cannot be asked.
    Caller(CallerFault),
    /// The connection.
    Link(LinkFault),
    /// The device answered something else than what was asked.
    Peer(PeerFault),
    /// The device says no, with this Modbus exception code.
    Exception(u8),
    /// The device says no, with this SDO abort code.
    Aborted(AbortCode),
    /// No answer in time.
    Timeout,
}

/// A request that must not leave the house.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CallerFault {
    /// Zero registers, more than a request carries, or beyond the last address.
    Extent,
    /// A function code that the profile does not allow for this device.
    Function,
    /// Of a frame that several values share, another is not known yet.
    Incomplete,
    /// What it rests on has become too old before it could be sent.
    TooLate,
}

/// How a connection fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LinkFault {
    /// Nobody listens there.
    Refused,
    /// The host cannot be reached, or has no such name.
    Unreachable,
    /// It was closed or broke in the middle.
    Broken,
    /// It was closed while nothing was under way: nothing has been sent.
    Closed,
    /// There is no such serial port: not plugged in, or under another name.
    Absent,
    /// The serial port may not be opened by this user.
    Forbidden,
    /// Another program has the serial port.
    Busy,
    /// The port is no serial port, or cannot do these settings.
    Unsuited,
    /// It was closed before it brought a single answer.
    TurnedAway,
    /// It is closed again and again, soon after it was made.
    Contested,
    /// TLS did not come about.
    Tls(TlsFault),
    /// The CAN interface.
    Can(CanFault),
    /// It is down, and not yet time to try again.
    Down,
}

/// Why a connection cannot be secured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TlsFault {
    /// The device's certificate is too old.
    Expired,
    /// It will be valid later.
    NotYetValid,
    /// It is for another name.
    OtherName,
    /// Nobody whom we trust has signed it.
    UnknownAuthority,
    /// It is wrong in another way.
    BadCertificate,
    /// The device finds the gateway's certificate too old.
    OursExpired,
    /// The device does not take the gateway's certificate.
    OursRefused,
    /// No version, cipher or signature that both ends know.
    NothingInCommon,
    /// Whoever listens there does not speak TLS.
    NoTls,
    /// It closed the connection in the middle of the handshake, without a word.
    Silent,
    /// It closed the connection after the handshake, before its first answer.
    TurnedAway,
    /// It ended the handshake for another reason.
    Refused,
    /// What the profile names for the gateway's own end is of no use.
    OurFiles,
}

/// What is wrong with a CAN interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CanFault {
    /// There is none of this name, or it has been taken away.
    NoInterface,
    /// It is another kind of interface.
    NotCan,
    /// This computer's kernel has no CAN.
    NoKernel,
    /// It may not be used by this user.
    Forbidden,
    /// It is down.
    Down,
    /// Its queue is full: nothing leaves it.
    Full,
    /// It does not carry CAN FD, or the frame is none that CAN can carry.
    TooLong,
}

/// How an answer is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PeerFault {
    /// Another transaction or another unit: a late reply to an older question, or somebody else's.
    Foreign,
    /// Another function code.
    Function,
    /// More or fewer registers than asked for.
    Length,
    /// A write answered with another address, value or count.
    Echo,
    /// An object of another width than its type.
    Width,
    /// Nothing that the protocol knows.
    Malformed,
    /// Something that nobody had asked for.
    Unasked,
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
    /// One word for counters and programs.
    pub const fn blame(self) -> &'static str {
        match self {
            Fault::Caller(_) => "caller",
            Fault::Link(_) => "link",
            Fault::Peer(_) => "peer",
            Fault::Exception(_) | Fault::Aborted(_) => "exception",
            Fault::Timeout => "timeout",
        }
    }

    /// Every word of [`Fault::blame`].
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];

    /// The device has answered, and it says no.
    pub const fn is_refusal(self) -> bool {
        matches!(self, Fault::Exception(_) | Fault::Aborted(_))
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
            Fault::Link(
                LinkFault::Refused
                | LinkFault::Unreachable
                | LinkFault::Closed
                | LinkFault::Absent
                | LinkFault::Forbidden
                | LinkFault::Busy
                | LinkFault::Unsuited
                | LinkFault::Contested
                | LinkFault::Down,
            ) => Outcome::NotDone,
            Fault::Exception(_)
            | Fault::Aborted(_)
            | Fault::Timeout
            | Fault::Peer(_)
            | Fault::Link(
                LinkFault::Broken | LinkFault::TurnedAway | LinkFault::Tls(_) | LinkFault::Can(_),
            ) => Outcome::Unknown,
        }
    }

    /// Nothing was sent, and nobody is to blame: its moment was over, or the connection on which it was decided is lost.
    pub const fn has_lapsed(self) -> bool {
        matches!(self, Fault::Caller(CallerFault::TooLate) | Fault::Link(LinkFault::Closed))
    }

    /// Whether the connection can no longer be trusted: what still arrives on it may answer an older question.
    pub const fn spoils_connection(self) -> bool {
        matches!(self, Fault::Link(_) | Fault::Peer(_) | Fault::Timeout)
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
            Fault::Timeout => Reason::Timeout,
            Fault::Link(_) => Reason::LinkDown,
            Fault::Peer(_) | Fault::Caller(_) => Reason::BadReply,
        }
    }
}

impl std::error::Error for Fault {}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fault::Caller(CallerFault::Extent) => "request outside what Modbus allows",
            Fault::Caller(CallerFault::Incomplete) => {
                "another value in the same frame is not known yet; sent as soon as it is"
            }
            Fault::Caller(CallerFault::TooLate) => "too late: what it rests on is too old by now",
            Fault::Caller(CallerFault::Function) => "function code not allowed by the profile",
            Fault::Link(LinkFault::Refused) => "connection refused: nobody listens there",
            Fault::Link(LinkFault::Unreachable) => "host not reachable",
            Fault::Link(LinkFault::Broken) => "connection closed or broken",
            Fault::Link(LinkFault::Closed) => "connection closed while idle",
            Fault::Link(LinkFault::Absent) => "no such serial port: is the adapter plugged in?",
            Fault::Link(LinkFault::Forbidden) => {
                "no permission for the serial port: the user must be in its group, often `dialout`"
            }
            Fault::Link(LinkFault::Busy) => "another program uses the serial port",
            Fault::Link(LinkFault::Unsuited) => "no serial port, or one that cannot do these settings",
            Fault::Link(LinkFault::TurnedAway) => {
                "closed before the first answer: it accepts one client perhaps, and another master holds it"
            }
            Fault::Link(LinkFault::Contested) => {
                "closed again and again: it accepts one client perhaps, and another master takes it; this one waits \
                 longer each time (quirks.close_after_each leaves room for both)"
            }
            Fault::Link(LinkFault::Tls(fault)) => fault.words(),
            Fault::Link(LinkFault::Can(fault)) => fault.words(),
            Fault::Link(LinkFault::Down) => "no connection",
            Fault::Peer(PeerFault::Foreign) => "reply of another transaction or unit",
            Fault::Peer(PeerFault::Function) => "reply with another function code",
            Fault::Peer(PeerFault::Length) => "reply with the wrong number of registers",
            Fault::Peer(PeerFault::Echo) => "write answered with another address or value",
            Fault::Peer(PeerFault::Width) => "the object has another width than its type in the profile",
            Fault::Peer(PeerFault::Malformed) => "reply is none that the protocol knows",
            Fault::Peer(PeerFault::Unasked) => {
                "it sends what nobody asked for: a late reply, or another master on the same line"
            }
            Fault::Exception(code) => return write!(f, "exception {code} ({})", exception_name(*code)),
            Fault::Aborted(code) => return write!(f, "refused: {code}"),
            Fault::Timeout => "no answer in time",
        })
    }
}

impl TlsFault {
    const fn words(self) -> &'static str {
        match self {
            TlsFault::Expired => "the device's certificate has expired, or this computer's clock is wrong",
            TlsFault::NotYetValid => {
                "the device's certificate is not valid yet, or this computer's clock is wrong"
            }
            TlsFault::OtherName => {
                "the device's certificate is for another name: put the one it has into `tls.name`, or the certificate \
                 itself into the file of `tls.ca`"
            }
            TlsFault::UnknownAuthority => {
                "nobody in the file of `tls.ca` has signed the device's certificate"
            }
            TlsFault::BadCertificate => {
                "the device's certificate is of no use as a device's; one that it has signed itself is trusted by putting \
                 that very certificate into the file of `tls.ca`"
            }
            TlsFault::OursExpired => {
                "the device finds that the certificate in `tls.cert` has expired: renew it"
            }
            TlsFault::OursRefused => {
                "the device does not take the certificate in `tls.cert`: does it know who signed it, and its role?"
            }
            TlsFault::NothingInCommon => {
                "no TLS version or cipher in common: this end speaks 1.2 with ECDHE, and 1.3"
            }
            TlsFault::NoTls => "whoever listens there does not speak TLS: its secured port is usually 802",
            TlsFault::Silent => {
                "closed in the middle of the TLS handshake: does it speak TLS, and does it let in another client?"
            }
            TlsFault::TurnedAway => {
                "closed before the first answer: does the device take the certificate in `tls.cert`, and does it let in \
                 another client?"
            }
            TlsFault::OurFiles => "the files in `tls` are of no use: `isotherm check` says why",
            TlsFault::Refused => "the device ended the TLS handshake",
        }
    }
}

impl CanFault {
    const fn words(self) -> &'static str {
        match self {
            CanFault::NoInterface => {
                "no such interface: is the adapter plugged in? (`ip -details link` lists them)"
            }
            CanFault::NotCan => "no CAN interface",
            CanFault::NoKernel => "this computer's kernel has no CAN: `modprobe can-raw` as root",
            CanFault::Forbidden => "no permission for CAN",
            CanFault::Down => "the interface is down: `ip link set … up` as root brings it up",
            CanFault::Full => {
                "the interface's queue is full: nobody on the bus acknowledges, or its txqueuelen is too small"
            }
            CanFault::TooLong => "a frame that the interface cannot carry: CAN FD wants its mtu to be 72",
        }
    }
}

/// The names of the Modbus specification.
const fn exception_name(code: u8) -> &'static str {
    match code {
        1 => "illegal function",
        2 => "illegal data address",
        3 => "illegal data value",
        4 => "device failure",
        5 => "acknowledge",
        6 => "device busy",
        8 => "memory parity error",
        10 => "gateway path unavailable",
        11 => "gateway target does not respond",
        _ => "unknown code",
    }
}
