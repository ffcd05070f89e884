//! Causes and remedies of faults. All texts for users take them from here: `scan`, `read`, `check --online`, events,
//! the log and the page.
//!
//! The text of a [`Fault`] is its cause. [`remedy`] has what to do, and [`explain`] joins both.

use std::io::{Error, ErrorKind};

use isotherm_core::explained::Explained;
use isotherm_core::reading::{Reason, Status};
use isotherm_profile::Transport;
use isotherm_profile::regular::without_numbers;

use super::error::{CallerFault, CanFault, Fault, LinkFault, PeerFault};
use crate::tls::TlsFault;

/// Returns what to do about a fault; `None` if the text of its cause is sufficient.
pub const fn remedy(fault: Fault) -> Option<&'static str> {
    Some(match fault {
        Fault::Timeout => {
            "is the unit number right (`isotherm scan` finds it), is the device powered? On a serial line also baud rate \
             and parity, A and B exchanged, termination. Some devices answer nothing at all for a register they do not have"
        }
        Fault::Exception(1) => {
            "the device does not know this function: is the register in another table (input, holding)?"
        }
        Fault::Exception(2) => {
            "the device has no such register: is the number in its manual one-based? Then it is one less here"
        }
        Fault::Exception(3) => "the device does not take this value, or not so many registers at once",
        Fault::Exception(4) => "the device could not do it: its own display or log says why",
        Fault::Exception(5) => "the device has taken it and needs long for it: ask again later",
        Fault::Exception(6) => "the device is busy with something else: ask again later, or less often",
        Fault::Exception(8) => "the device's memory is faulty: switch it off and on, then have it repaired",
        Fault::Exception(10 | 11) => {
            "the gateway answers, but not the device behind it: is the unit number right (`isotherm scan` finds it), is it \
             powered, are baud rate and wiring behind the gateway right?"
        }
        Fault::Exception(_) => "the device's manual says what it means",
        Fault::Link(LinkFault::Refused) => {
            "is the port right (Modbus TCP has 502, OPC UA 4840), is it switched on in the device, is another master holding \
             its only connection?"
        }
        Fault::Link(LinkFault::Unresolved) => {
            "is it written right, and does this computer know it (`getent hosts NAME`)? An address such as 192.168.0.10 \
             needs no name"
        }
        Fault::Link(LinkFault::Unreachable) => {
            "is the address right, is the device powered and on this network, is a firewall between?"
        }
        Fault::Link(LinkFault::Broken) => {
            "many devices take one client at a time: is another master connected? Some close it for a unit number that is \
             not theirs"
        }
        Fault::Link(LinkFault::Absent) => {
            "is the adapter plugged in? Its lasting name is below /dev/serial/by-id"
        }
        Fault::Link(LinkFault::Forbidden) => "the user must be in its group, often `dialout`",
        Fault::Link(LinkFault::Busy) => {
            "end it, a gateway that is running included (`isotherm status` shows it)"
        }
        Fault::Link(LinkFault::Unsuited) => "does the adapter know this speed?",
        Fault::Link(LinkFault::TurnedAway) => {
            "it accepts one client perhaps: does another master have its connection?"
        }
        Fault::Link(LinkFault::Contested) => {
            "it accepts one client perhaps: does another master take it? This one waits longer each time \
             (quirks.close_after_each leaves room for both)"
        }
        Fault::Link(LinkFault::Can(fault)) => return remedy_of_an_interface(fault),
        Fault::Link(LinkFault::Tls(fault)) => return remedy_inside_tls(fault),
        Fault::Peer(PeerFault::Malformed) => {
            "on a serial line: baud rate, parity, or two units with one number; over TCP: is it RTU over TCP?"
        }
        Fault::Peer(PeerFault::Foreign) => "is another master on the line?",
        Fault::Peer(PeerFault::Unasked) => "is it a late reply, or another master on the same line?",
        Fault::Peer(PeerFault::OutOfOrder) => {
            "does the gateway before the unit keep late answers? Set it to discard them, and restart it"
        }
        Fault::Peer(PeerFault::Silent) => "`read = \"poll\"` asks for the nodes instead",
        Fault::Caller(CallerFault::TooManyNodes(_)) => "let it take more, or make the set smaller",
        Fault::Peer(PeerFault::Type) => {
            "write the node's own `type`; of a signal it may be left out, and any number is taken"
        }
        Fault::Status(status) if status.is(Status::ACCESS_DENIED) => {
            "the user of the line lacks the right: give it that at the server, or write another `user`"
        }
        Fault::Status(status) if status.is(Status::NOT_WRITABLE) => {
            "the server lets nobody write it: is it the right node, is writing switched on there?"
        }
        Fault::Status(status) if status.is(Status::WRITE_NOT_SUPPORTED) => {
            "the server does not let this node be written as it is sent, the value alone without a time and a quality: is it \
             the right node, is writing it over OPC UA switched on at the server?"
        }
        Fault::Status(status) if status.is(Status::TYPE_MISMATCH) => {
            "the node has another type: write its own at the output; a browser of the server shows it"
        }
        Fault::Status(status) if status.is(Status::NO_SUCH_NODE) => {
            "there is no such node: is its name right, is its namespace still the same after an update of the server (`isotherm read --browse` shows the namespaces)?"
        }
        Fault::Status(status) if status.is(Status::OUT_OF_RANGE) => {
            "the server takes no such value there: is the scale right, are the axis's limit and the node's range?"
        }
        Fault::Status(_) => "the server's own log or display says why",
        Fault::Part { status, .. } => return remedy(Fault::Status(status)),
        Fault::Unreadable { reason, .. } => return remedy(Fault::of_a_node(reason)),
        _ => return None,
    })
}

/// Returns what to do about a fault of a CAN interface.
const fn remedy_of_an_interface(fault: CanFault) -> Option<&'static str> {
    Some(match fault {
        CanFault::NoInterface => "is the adapter plugged in? (`ip -details link` lists them)",
        CanFault::NotCan => "`ip -details link show type can` lists those that are",
        CanFault::NoKernel => "`modprobe can-raw` as root",
        CanFault::Forbidden => "run the gateway as a user who may open raw sockets of CAN",
        CanFault::Down => "`ip link set … up` as root brings it up",
        CanFault::Full => "does anybody on the bus acknowledge? Else its txqueuelen is too small",
        CanFault::TooLong => "CAN FD wants its mtu to be 72",
    })
}

/// Returns what to do about a reading that is not good.
pub const fn remedy_of_a_reading(reason: Reason) -> &'static str {
    match reason {
        Reason::OpenCircuit => "look for a broken wire, or a plug that is out",
        Reason::ShortCircuit => "look for a short at the sensor, its cable and its plug",
        Reason::Sentinel | Reason::SensorFault | Reason::NotAvailable | Reason::FaultBit => {
            "the device says so itself: look at the sensor, and at the display or manual of the device"
        }
        Reason::SwitchedOff => "switch the channel on in the device, or take the signal out of the profile",
        Reason::AboveRange | Reason::BelowRange | Reason::OutOfRange => {
            "is the sensor broken, or are `range`, `scale` or `word_order` wrong?"
        }
        Reason::TooFast => "is a contact loose, does a drive disturb it? Else `max_rate` is too small",
        Reason::Jumped => {
            "is it the same device with the same settings? If so: `isotherm confirm PROFILE DEVICE`"
        }
        Reason::ShortFrame => "the node sends less than the profile reads: is it another variant of it?",
        Reason::NotANumber => "are `type` and `word_order` those of the device?",
        Reason::WrongType => "write the node's own `type`",
        Reason::SourceClock => "set the clock of the server right, or that of this computer",
        Reason::NotFound | Reason::SeveralFound => {
            "write the name by which `isotherm scan` finds it; is it plugged in?"
        }
        Reason::Unreadable => "`dmesg` says more; may the user of the gateway read it?",
        Reason::Checksum => "look at the cable: its length, its shield, the pull-up",
        Reason::PowerOnValue | Reason::AllZero => {
            "is the sensor's supply steady, are all its wires connected?"
        }
        Reason::Stale => "is the device slow, is its line full? `isotherm check` shows the load",
        Reason::Refused | Reason::Status(_) | Reason::Exception(_) => {
            "its server's or device's own log or display says why"
        }
        Reason::NeverRead | Reason::Timeout | Reason::LinkDown | Reason::BadReply | Reason::NotInLog => {
            "look at its device and its line"
        }
        Reason::NotAsExpected => "the alarm of its device says what to set",
    }
}

/// Returns what to do about a fault of Modbus inside TLS.
const fn remedy_inside_tls(fault: TlsFault) -> Option<&'static str> {
    Some(match fault {
        TlsFault::OtherName => {
            "put the one it has into `tls.name`, or the certificate itself into the file of `tls.ca`"
        }
        TlsFault::UnknownAuthority => "put whoever has into the file of `tls.ca`",
        TlsFault::BadCertificate => {
            "one that a device has signed itself is trusted by putting that very certificate into the file of `tls.ca`"
        }
        TlsFault::OursExpired => "renew the one in `tls.cert`",
        TlsFault::OursMissing | TlsFault::OursRefused => {
            "does it know who signed the one in `tls.cert`, and its role?"
        }
        TlsFault::NoTls => "its secured port is usually 802",
        TlsFault::Silent => "does it speak TLS, and does it let in another client?",
        TlsFault::TurnedAway => {
            "does it take the certificate in `tls.cert`, and does it let in another client?"
        }
        TlsFault::OurFiles => "`isotherm check` says why",
        TlsFault::Expired | TlsFault::NotYetValid | TlsFault::NothingInCommon | TlsFault::Refused => {
            return None;
        }
    })
}

/// Returns what to do about a fault of an OPC UA server, where some faults have other remedies.
const fn remedy_at_a_server(fault: Fault) -> Option<&'static str> {
    Some(match fault {
        Fault::Timeout => {
            "is the server busy, or its computer? Then a longer `timeout` of the bus helps, or fewer nodes, less often. Is the \
             control powered, is the way to it cut?"
        }
        Fault::Link(LinkFault::Refused) => {
            "is the port right (OPC UA has usually 4840), is the control's OPC UA server switched on, and does it run?"
        }
        Fault::Link(LinkFault::Broken) => {
            "the server or something on the way has closed it: was the server restarted? Its own log says why"
        }
        Fault::Peer(PeerFault::Malformed) => {
            "it is no answer of OPC UA: is something between that changes it? The server's own log may say more"
        }
        _ => return remedy(fault),
    })
}

/// Remedy for the sensors of this computer, where only the drivers as a whole can fail.
const AT_THIS_COMPUTER: &str = "their driver does not come back: is an adapter or a cable unplugged, does a 1-Wire sensor answer with a wrong \
                                checksum, which the kernel repeats for seconds? `dmesg` says more; each is asked again once it is back";

/// Returns cause and remedy of a fault in one sentence.
pub fn explain(fault: Fault) -> String {
    Explained { cause: fault.to_string(), hint: remedy(fault).map(Into::into) }.to_string()
}

/// Returns cause and remedy of a fault. The remedy fits the kind of line.
pub fn explain_on(line: Transport, fault: Fault) -> Explained {
    advised_on(line, fault, fault.to_string())
}

/// Returns `cause` with the remedy of a fault. The remedy fits the kind of line.
pub fn advised_on(line: Transport, fault: Fault, cause: String) -> Explained {
    let hint = match line {
        Transport::OpcUa => remedy_at_a_server(fault),
        Transport::Sysfs => Some(AT_THIS_COMPUTER),
        _ => remedy(fault),
    };
    Explained { cause, hint: hint.map(Into::into) }
}

/// Describes an error of a file, a socket or a port, without its number, with a remedy. Errors with a text of their own
/// keep it.
pub fn system(error: &Error) -> String {
    explain_system(error).to_string()
}

/// Returns cause and remedy of an error of a file, a socket or a port.
pub fn explain_system(error: &Error) -> Explained {
    match error.kind() {
        _ if error.get_ref().is_some() => without_numbers(&error.to_string()).into(),
        ErrorKind::PermissionDenied => Explained::new(
            "this user may not",
            "take another directory (`--state`), port or user, or let its owner give access",
        ),
        ErrorKind::AddrInUse => Explained::new(
            "another program has this port, perhaps a gateway that is running",
            "end it, or choose another (`ss -ltnp` shows who has it)",
        ),
        ErrorKind::AddrNotAvailable => {
            Explained::new("this computer has no such address", "`ip address` lists its own")
        }
        ErrorKind::StorageFull => "the disk is full".into(),
        ErrorKind::ReadOnlyFilesystem => {
            Explained::new("the disk is read-only", "take another directory (`--state`)")
        }
        _ => without_numbers(&error.to_string()).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::error::CanFault;
    use isotherm_core::reading::Reason;

    /// Each remedy asks a question, names a command, or says what to do.
    #[test]
    fn every_fault_is_shown_with_what_to_do() {
        let link = [
            LinkFault::Refused,
            LinkFault::Unresolved,
            LinkFault::Unreachable,
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
        let peer = [PeerFault::Malformed, PeerFault::Foreign, PeerFault::Unasked, PeerFault::OutOfOrder]
            .map(Fault::Peer);
        for fault in link.map(Fault::Link).into_iter().chain(codes).chain(peer).chain([Fault::Timeout]) {
            let said = explain(fault);
            assert!(remedy(fault).is_some() || said.contains(", or "), "{fault:?}: {said}");
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
        assert!(
            said.contains("BadWriteNotSupported: the server does not let this node be written"),
            "{said}"
        );
        let unreadable = Fault::Unreadable { reason: Reason::Status(Status::NO_SUCH_NODE.0), place: 2 };
        assert!(explain_on(Transport::OpcUa, unreadable).to_string().contains("there is no such node"));
        assert_eq!((unreadable.blame(), unreadable.is_refusal()), ("exception", true));
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
        for code in [13, 98, 99, 28, 30] {
            let said = system(&Error::from_raw_os_error(code));
            assert!(!said.contains("os error"), "{said}");
        }
    }
}
