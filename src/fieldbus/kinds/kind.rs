//! Description of a type of bus. Common code asks it, and depends on no type.

use std::time::Duration;

use crate::fieldbus::connection::Dial;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::seen::{Advice, Seen};
use crate::fieldbus::wire::Boxed;
use isotherm_profile::{Bus, Transport};

/// Type of bus: how its lines are opened, addressed, scanned and explained.
pub struct BusKind {
    /// Word that names the type in a profile, for example `modbus-tcp`.
    pub word: &'static str,
    /// Key of the address in a profile, for example `address` or `port`.
    pub address_key: &'static str,
    /// Further lines of a profile that describe a line of the type.
    pub settings: fn(Transport) -> String,
    /// Example of an address as users type it; `None` if no verb accepts an address of the type.
    pub example: Option<&'static str>,
    /// Parses an address as users type it; `None` if the text has the form of another type.
    pub parse: fn(&str) -> Option<Parsed>,
    /// Formats an address for messages.
    pub shown: fn(Transport, &str) -> String,
    /// Returns what opens the connections of a bus. `None` for a CAN interface, because the task that receives its
    /// frames opens it.
    pub dial: fn(&Bus) -> Option<Box<dyn Dial>>,
    /// Returns what to do about a fault, if the advice for other types does not fit.
    pub hint: fn(Fault) -> Option<&'static str>,
    /// Returns the advice on a failed request, if more is known about it than its fault. This advice replaces that of
    /// `hint`.
    pub advice: fn(Seen) -> Option<Advice>,
    /// Returns the place of a line, by which two addresses of one line are recognised.
    pub place: fn(&Bus) -> LinePlace,
    /// Whether answers may be missing without a fault of a device: single ones get lost, or the line finds out only by
    /// missing answers that its connection is lost.
    pub is_lossy: bool,
    /// Whether the other end is a server with namespaces (OPC UA), which identify its devices.
    pub has_namespaces: bool,
    /// Whether the other end keeps a state for a connection until it is closed in order.
    pub is_closed_in_order: bool,
    /// Way in which a scan searches a line of this type, and the results that it can have.
    pub scan: ScanKind,
    /// Part of the virtual machine that takes the place of the line's devices.
    pub virtual_line: VirtualLine,
}

/// Transport and address of a line; or the mistake in one sentence, with the correct form.
pub type Parsed = Result<(Transport, String), String>;

/// Place of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinePlace {
    /// Host and port. A host may have several names.
    Host(String),
    /// Name that is the same for each address of the line.
    Name(String),
}

/// Way in which a line is scanned, which depends on whether its devices have registers.
#[derive(Clone, Copy)]
pub enum ScanKind {
    /// Units with registers.
    Units {
        /// Advice if no unit answers.
        unanswered: &'static str,
        /// Advice after an answer that violates the protocol, with a space before it.
        malformed: &'static str,
    },
    /// Line whose devices have no registers, such as a CAN line.
    Other {
        /// Kind of line: "a CAN line".
        is: &'static str,
        /// Alternative to a verb that reads registers.
        instead: &'static str,
        /// Scan of the line, if there is one.
        scan: Option<ScanFunction>,
    },
}

/// Function that scans a line, with the timeout that the user has chosen, if any.
pub type ScanFunction = for<'a> fn(&'a Bus, Option<Duration>) -> Boxed<'a, Result<ScanReport, Fault>>;

/// Result of a scan.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanReport {
    /// Whether the scan found nothing on the line.
    pub is_empty: bool,
    /// Result for programs.
    pub json: serde_json::Value,
    /// Result for users; empty if the scan found nothing.
    pub text: String,
    /// Name of a bus for a profile, and the lines after those of its address. Or the reason why the gateway cannot use
    /// the line.
    pub profile: Result<(&'static str, String), String>,
}

/// Part of the virtual machine that takes the place of a line's devices.
#[derive(Clone, Copy)]
pub enum VirtualLine {
    /// The virtual machine serves the line; the words come before its address: "listens on".
    Served(&'static str),
    /// The virtual machine does not serve the line; the sentence says why.
    Absent(fn(&Bus) -> String),
}

/// Returns what to do about a fault of the connection to a serial server.
pub(super) fn serial_server_hint(fault: Fault) -> Option<&'static str> {
    match fault {
        Fault::Link(LinkFault::Refused) => Some(
            "is the port that of the serial server (often 4001)? Does the serial server wait for connections, as a \
             TCP server without telnet? Does another program use its only connection?",
        ),
        _ => None,
    }
}

impl BusKind {
    /// Type without peculiarities, for the fields that a type does not set.
    pub(super) const PLAIN: BusKind = BusKind {
        word: "",
        address_key: "address",
        settings: |_| String::new(),
        example: None,
        parse: |_| None,
        shown: |_, address| address.to_owned(),
        dial: |_| None,
        hint: |_| None,
        advice: |_| None,
        place: |bus| LinePlace::Name(bus.address.clone()),
        is_lossy: false,
        has_namespaces: false,
        is_closed_in_order: false,
        scan: ScanKind::Other { is: "", instead: "", scan: None },
        virtual_line: VirtualLine::Absent(|bus| format!("bus {} is not simulated", bus.name)),
    };
}
