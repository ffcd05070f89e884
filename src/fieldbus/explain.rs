//! Causes and remedies of faults. The commands `scan`, `read` and `check --online`, the events, the log and the web
//! page take these texts from this module.
//!
//! The `Display` text of a [`Fault`] is its cause. [`remedy`] returns what the user can do, and [`explain`] joins the
//! two. The advice is more specific if more is known about the failed request, see [`Seen`].

use std::borrow::Cow;
use std::io::{Error, ErrorKind};

use isotherm_core::explained::Explained;
use isotherm_core::reading::Reason;
use isotherm_profile::Transport;
use isotherm_profile::safe_file::without_numbers;

use super::error::{CallerFault, Fault, LinkFault, PeerFault};
use super::kinds::{self, can, modbus, opcua};
use super::seen::{Advice, Seen};
use crate::net::is_out_of_files;

/// Remedy for an OPC UA node whose value is not a number.
const NOT_A_NUMBER: &str = "write another node: `isotherm read --browse` shows which nodes hold a number. A date is \
                            not a number. A text may contain only a number, with a decimal point. For an \
                            array, write `element`";

/// Remedy if a program has reached its limit of open files.
const MORE_FILES: &str =
    "raise the limit: `ulimit -n 4096` in a shell, `LimitNOFILE=4096` in the systemd unit";

/// Returns what the user can do about a fault. Returns `None` if the text of the cause is sufficient, or if the advice
/// is in the table of `kinds/modbus/hint.rs`.
pub const fn remedy(fault: Fault) -> Option<&'static str> {
    Some(match fault {
        Fault::Timeout => modbus::hint::SILENT,
        Fault::Exception(code) | Fault::Peer(PeerFault::LongException(code)) => modbus::hint::exception(code),
        Fault::Link(LinkFault::Refused) => {
            "is the port right (Modbus TCP: 502, OPC UA: 4840)? Is the protocol switched on in the device? \
             Does another master use the only connection of the device?"
        }
        Fault::Link(LinkFault::Unresolved) => {
            "is the host name written right, and does this computer know it (`getent hosts NAME`)? \
             Or write the IP address, for example 192.168.0.10"
        }
        Fault::Link(LinkFault::Unreachable) => {
            "is the address right, is the device powered and on this network, does a firewall block the \
             connection?"
        }
        Fault::Link(LinkFault::NoDescriptors) => MORE_FILES,
        Fault::Link(LinkFault::Broken) => {
            "many devices accept one client at a time: is another master connected? Some devices close the \
             connection if the unit number is wrong"
        }
        Fault::Link(LinkFault::Absent) => {
            "is the adapter plugged in? Its permanent name is below /dev/serial/by-id"
        }
        Fault::Link(LinkFault::Forbidden) => "the user must be in the group of the port, often `dialout`",
        Fault::Link(LinkFault::Busy) => {
            "end the other program. It may be a gateway that is running (`isotherm status` shows it)"
        }
        Fault::Link(LinkFault::Unsuited) => "does the adapter support this baud rate?",
        Fault::Link(LinkFault::TurnedAway) => {
            "the device may accept one client only: is another master connected?"
        }
        Fault::Link(LinkFault::Contested) => {
            "the device may accept one client only: does another master use the connection? The gateway \
             waits longer each time. With quirks.close_after_each both masters can use the device"
        }
        Fault::Link(LinkFault::Can(fault)) => can::hint(fault),
        Fault::Link(LinkFault::OpcUa(fault)) => fault.hint(),
        Fault::Link(LinkFault::Tls(fault)) => return modbus::hint::inside_tls(fault),
        Fault::Peer(PeerFault::Malformed) => {
            "on a serial line, check baud rate and parity, and that no two units have the same number. Over TCP: \
             does the device use RTU over TCP?"
        }
        Fault::Peer(PeerFault::Foreign) => "is another master on the line?",
        Fault::Peer(PeerFault::Unasked) => "is it a late reply, or is another master on the same line?",
        Fault::Peer(PeerFault::OutOfOrder) => {
            "does the Modbus gateway in front of the device keep late answers? Set the Modbus gateway to \
             discard them, and restart it"
        }
        Fault::Peer(PeerFault::Silent) => {
            "write read = \"poll\" at the device: the gateway then polls the nodes"
        }
        Fault::Caller(CallerFault::TooManyNodes(_)) => {
            "set the server to accept more nodes in one call, or divide the outputs over several output sets"
        }
        Fault::Peer(PeerFault::Type) => {
            "write the `type` that the node has at the server. Without `type`, a signal accepts any number"
        }
        Fault::Peer(PeerFault::NotANumber) => NOT_A_NUMBER,
        Fault::Peer(PeerFault::NoValue) => {
            "does the server have a value for this node now? `isotherm read --browse` shows it"
        }
        Fault::Status(status) | Fault::Part { status, .. } => opcua::status_hint(status),
        Fault::Unreadable { reason, .. } => return remedy(Fault::of_a_node(reason)),
        _ => return None,
    })
}

/// Returns the remedy for a reading that is not valid for this reason.
pub const fn remedy_of_a_reading(reason: Reason) -> &'static str {
    match reason {
        Reason::OpenCircuit => "look for a broken wire or an unplugged connector",
        Reason::ShortCircuit => "look for a short at the sensor, its cable and its plug",
        Reason::Sentinel | Reason::SensorFault | Reason::NotAvailable | Reason::FaultBit => {
            "the device itself reports this: check the sensor, and see the display or manual of the device"
        }
        Reason::SwitchedOff => "switch the channel on in the device, or take the signal out of the profile",
        Reason::AboveRange | Reason::BelowRange | Reason::OutOfRange => {
            "is the sensor broken, or are `range`, `scale` or `word_order` wrong?"
        }
        Reason::TooFast => {
            "is a contact loose, does a drive disturb the signal? If not, `max_rate` is too small"
        }
        Reason::Jumped => {
            "is it the same device with the same settings? If so: `isotherm confirm PROFILE DEVICE`"
        }
        Reason::ScaleChanged => {
            "has the resolution or the decimal point been set in the device? If the value is right: `isotherm confirm \
             PROFILE DEVICE`"
        }
        Reason::NoScale => {
            "is `scale_from` or `decimals_from` the right register, does the device have this value?"
        }
        Reason::ShortFrame => {
            "the node sends fewer bytes than the profile reads: is it another variant of the node?"
        }
        Reason::NotANumber => "do `type` and `word_order` match the device?",
        Reason::WrongType => "write the `type` that the node has at the server",
        Reason::NoNumber => NOT_A_NUMBER,
        Reason::NoElement => {
            "is `element` counted from 0, with one index for each dimension? `isotherm read --browse` shows the node"
        }
        Reason::SourceClock => "correct the clock of the server, or the clock of this computer",
        Reason::NotFound | Reason::SeveralFound => {
            "is the sensor plugged in? Write its name as `isotherm scan` shows it"
        }
        Reason::Unreadable => {
            "`dmesg` says more. Does the gateway's user have permission to read the sensor?"
        }
        Reason::Checksum => {
            "check the cable: its length, its shield, and the pull-up resistor of a 1-Wire sensor"
        }
        Reason::PowerOnValue | Reason::AllZero => {
            "is the sensor's supply steady, are all its wires connected?"
        }
        Reason::Stale => {
            "is the device slow, is the line of the device overloaded? `isotherm check` shows the load"
        }
        Reason::Refused | Reason::Status(_) | Reason::Exception(_) => {
            "the log or display of the server or device says why"
        }
        Reason::NeverRead | Reason::Timeout | Reason::LinkDown | Reason::BadReply | Reason::NotInLog => {
            "check the device and the line of the signal"
        }
        Reason::NotAsExpected => "the alarm of the signal's device says which setting to correct",
    }
}

/// Returns cause and remedy of a failed request as one text. The remedy is the advice for Modbus, if only Modbus has
/// this fault.
pub fn explain(seen: impl Into<Seen>) -> String {
    let seen = seen.into();
    let general = || remedy(seen.fault).map(Cow::Borrowed);
    let hint = modbus::hint::advice(seen).map(Advice::text).or_else(general);
    Explained { cause: seen.fault.to_string(), hint }.to_string()
}

/// Returns cause and remedy of a failed request. The remedy depends on the transport of the line.
pub fn explain_on(line: Transport, seen: impl Into<Seen>) -> Explained {
    let seen = seen.into();
    advised_on(line, seen, seen.fault.to_string())
}

/// Returns the text `cause`, together with the remedy for a failed request. The remedy depends on the transport of the
/// line.
pub fn advised_on(line: Transport, seen: impl Into<Seen>, cause: String) -> Explained {
    let (seen, kind) = (seen.into(), kinds::of(line));
    let general = || (kind.hint)(seen.fault).or_else(|| remedy(seen.fault)).map(Cow::Borrowed);
    Explained { cause, hint: (kind.advice)(seen).map(Advice::text).or_else(general) }
}

/// Describes an error of a file, a socket or a port in one sentence, with a remedy and without the error number. An
/// error that has its own text keeps that text.
pub fn system(error: &Error) -> String {
    explain_system(error).to_string()
}

/// Returns cause and remedy of an error of a file, a socket or a port.
pub fn explain_system(error: &Error) -> Explained {
    match error.kind() {
        _ if error.get_ref().is_some() => without_numbers(&error.to_string()).into(),
        _ if is_out_of_files(error) => Explained::new(LinkFault::NoDescriptors.to_string(), MORE_FILES),
        ErrorKind::PermissionDenied => Explained::new(
            "this user has no permission",
            "use another directory (`--state`), port or user, or ask the owner for access",
        ),
        ErrorKind::AddrInUse => Explained::new(
            "another program has this port, perhaps a gateway that is running",
            "end that program, or choose another port (`ss -ltnp` shows which program has the port)",
        ),
        ErrorKind::AddrNotAvailable => Explained::new(
            "this computer has no such address",
            "`ip address` lists the addresses of this computer",
        ),
        ErrorKind::StorageFull => "the disk is full".into(),
        ErrorKind::FileTooLarge => Explained::new(
            "a file has reached the largest size that this process may write",
            "raise the limit: `ulimit -f unlimited` in a shell, `LimitFSIZE=infinity` in the systemd unit",
        ),
        ErrorKind::ReadOnlyFilesystem => {
            Explained::new("the disk is read-only", "use another directory (`--state`)")
        }
        _ => without_numbers(&error.to_string()).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::error::CanFault;
    use crate::fieldbus::kinds::modbus::text::TextProtocol;
    use crate::tls::TlsFault;
    use isotherm_core::reading::Status;

    /// Each remedy asks a question, names a command, or says what to do.
    #[test]
    fn every_fault_is_shown_with_what_to_do() {
        let link = [
            LinkFault::Refused,
            LinkFault::Unresolved,
            LinkFault::Unreachable,
            LinkFault::NoDescriptors,
            LinkFault::Broken,
            LinkFault::Absent,
            LinkFault::Forbidden,
            LinkFault::Busy,
            LinkFault::Unsuited,
            LinkFault::TurnedAway,
            LinkFault::Contested,
            LinkFault::Tls(TlsFault::Expired),
            LinkFault::Can(CanFault::Down),
        ];
        let codes = [1, 2, 3, 4, 5, 6, 8, 10, 11].map(Fault::Exception);
        let peer = [
            PeerFault::Malformed,
            PeerFault::Foreign,
            PeerFault::Unit(1),
            PeerFault::Unasked,
            PeerFault::OutOfOrder,
            PeerFault::LongException(2),
            PeerFault::Text(TextProtocol::ModbusAscii),
            PeerFault::Text(TextProtocol::Dcon),
            PeerFault::Text(TextProtocol::Other),
            PeerFault::Echoed,
        ]
        .map(Fault::Peer);
        for fault in link.map(Fault::Link).into_iter().chain(codes).chain(peer).chain([Fault::Timeout]) {
            let said = explain(fault);
            let is_advised = said.len() > fault.to_string().len();
            assert!(is_advised || said.contains(", or "), "{fault:?}: {said}");
            assert!(said.starts_with(&fault.to_string()), "{said}");
            assert!(!said.contains("unknown"), "{said}");
        }
        for code in [1, 2, 3, 4, 5, 6, 8, 10, 11] {
            assert!(explain(Fault::Exception(code)).starts_with(&format!("exception {code} (")));
        }
        assert!(explain(Fault::Link(LinkFault::Forbidden)).contains("dialout"));
    }

    #[test]
    fn what_a_server_says_of_a_write_has_a_remedy_of_its_own() {
        let said = explain_on(Transport::OpcUa, Fault::Status(Status::WRITE_NOT_SUPPORTED)).to_string();
        assert!(said.contains("BadWriteNotSupported: the server does not accept a value without"), "{said}");
        let unreadable = Fault::Unreadable { reason: Reason::Status(Status::NO_SUCH_NODE.0), place: 2 };
        assert!(explain_on(Transport::OpcUa, unreadable).to_string().contains("there is no such node"));
        assert_eq!((unreadable.blame(), unreadable.is_refusal()), ("exception", true));
    }

    #[test]
    fn a_refused_session_or_handshake_excludes_power_and_cable_as_the_cause() {
        use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
        let refused = LinkFault::OpcUa(OpcUaFault::Refused(Status(0x8083_0000)));
        let session =
            [OpcUaFault::UserRefused, OpcUaFault::NotTrusted, OpcUaFault::NoSession, OpcUaFault::Clock];
        let answered: Vec<Fault> =
            session.map(LinkFault::OpcUa).into_iter().chain([refused]).map(Fault::Link).collect();
        for fault in answered.iter().copied().chain([Fault::Link(LinkFault::Tls(TlsFault::Expired))]) {
            assert!(fault.excludes_wiring(), "{fault:?}");
        }
        for fault in [LinkFault::Refused, LinkFault::Unreachable, LinkFault::Broken, LinkFault::Absent] {
            assert!(!Fault::Link(fault).excludes_wiring(), "{fault:?}");
        }
        assert!(!Fault::Timeout.excludes_wiring());
        for fault in answered {
            let Explained { cause, hint } = explain_on(Transport::OpcUa, fault);
            let hint = hint.unwrap_or_default();
            assert!(!hint.is_empty() && !cause.contains(&*hint), "{cause}; {hint}");
        }
        for (status, hint) in
            [(0x8083_0000, "the path of the server"), (0x8002_0000, "own log or display says why")]
        {
            let refused = Fault::Link(LinkFault::OpcUa(OpcUaFault::Refused(Status(status))));
            let said = explain_on(Transport::OpcUa, refused).to_string();
            assert!(said.contains(hint), "{said}");
        }
    }

    #[test]
    fn of_an_opc_ua_server_nobody_is_sent_to_look_at_what_only_modbus_has() {
        let link = [LinkFault::Refused, LinkFault::Unreachable, LinkFault::Broken].map(Fault::Link);
        let status = [Status::ACCESS_DENIED, Status(0x808b_0000)].map(Fault::Status);
        let part = Fault::Part { status: Status::NOT_WRITABLE, place: 2 };
        let others = [Fault::Timeout, Fault::Peer(PeerFault::Malformed), part];
        for fault in link.into_iter().chain(status).chain(others) {
            let said = explain_on(Transport::OpcUa, fault).to_string();
            assert!(said.starts_with(&format!("{fault}")) && said.len() > fault.to_string().len(), "{said}");
            for word in ["Modbus", "unit", "scan", "baud", "serial", "register"] {
                assert!(!said.contains(word), "{said}");
            }
            assert_eq!(explain_on(Transport::Tcp, fault).to_string(), explain(fault));
            let said = explain_on(Transport::Sysfs, fault).to_string();
            assert!(said.contains("dmesg") && !said.contains("register"), "{said}");
        }
    }

    #[test]
    fn what_the_system_says_is_said_without_its_numbers() {
        for code in [13, 98, 99, 28, 30, 23, 24] {
            let said = system(&Error::from_raw_os_error(code));
            assert!(!said.contains("os error"), "{said}");
            assert_eq!(said.contains("ulimit -n"), matches!(code, 23 | 24), "{said}");
        }
    }
}
