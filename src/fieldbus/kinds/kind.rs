//! Description of a type of bus: its name, addresses, settings and functions. Code for all types of bus uses this
//! description, and depends on no single type.

use std::time::Duration;

use crate::fieldbus::connection::Dial;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::seen::{Advice, Seen};
use crate::fieldbus::wire::Boxed;
use isotherm_profile::{Bus, Transport};

/// Type of bus, for example Modbus TCP: how lines of this type are opened, addressed, scanned and explained.
pub struct BusKind {
    /// Word that names the type in a profile, for example `modbus-tcp`.
    pub word: &'static str,
    /// Key of the address in a profile, for example `address` or `port`.
    pub address_key: &'static str,
    /// Returns the profile lines with the further settings of a bus, for example the baud rate.
    pub settings: fn(Transport) -> String,
    /// Example of an address as users type it; `None` if no command accepts an address of this type.
    pub example: Option<&'static str>,
    /// Parses an address as users type it; `None` if the text has the form of another type.
    pub parse: fn(&str) -> Option<Parsed>,
    /// Formats an address for messages to users.
    pub shown: fn(Transport, &str) -> String,
    /// Returns the object that opens the connections of a bus. Returns `None` for a CAN interface, because the task
    /// that receives its frames opens the interface.
    pub dial: fn(&Bus) -> Option<Box<dyn Dial>>,
    /// Returns the remedy for a fault; `None` if the general remedy for all types of bus applies.
    pub hint: fn(Fault) -> Option<&'static str>,
    /// Returns advice that depends on the details of the failed request, and replaces the advice of `hint`;
    /// `None` if there is no such advice.
    pub advice: fn(Seen) -> Option<Advice>,
    /// Returns the identification of the physical line, which shows that two addresses belong to the same line.
    pub place: fn(&Bus) -> LinePlace,
    /// Whether answers may be missing although no device is faulty. Single answers may get lost on the line,
    /// or missing answers are the only sign of a lost connection.
    pub is_lossy: bool,
    /// Whether the other end is an OPC UA server, whose namespaces identify its devices.
    pub has_namespaces: bool,
    /// Whether the other end keeps a session until the connection is closed in an orderly way.
    pub is_closed_in_order: bool,
    /// Way in which the command `scan` searches a line of this type, with the texts for its results.
    pub scan: ScanKind,
    /// How a simulated machine replaces the devices of the line.
    pub virtual_line: VirtualLine,
}

/// Result of parsing an address: transport and address, or a sentence with the mistake and the correct form.
pub type Parsed = Result<(Transport, String), String>;

/// Identification of a physical line, by which two addresses of the same line are recognised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinePlace {
    /// Host and port. Two different host names may mean the same host.
    Host(String),
    /// Name that is the same for each address of the line.
    Name(String),
}

/// Way in which a line is scanned, which depends on whether its devices have registers.
#[derive(Clone, Copy)]
pub enum ScanKind {
    /// Line of units with registers. The scan reads registers of each unit number.
    Units {
        /// Advice to the user if no unit answers.
        unanswered: &'static str,
        /// Advice after an answer that violates the protocol. The text begins with a space.
        malformed: &'static str,
    },
    /// Line whose devices have no registers, for example a CAN line.
    Other {
        /// Description of the line for a message, for example "a CAN line".
        is: &'static str,
        /// Advice for the user: the command to use on this line, because commands that read registers do not support
        /// this line.
        instead: &'static str,
        /// Function that scans the line; `None` if no scan is possible.
        scan: Option<ScanFunction>,
    },
}

/// Function that scans a line. The second argument is the timeout that the user has chosen; `None` if the user has
/// chosen none.
pub type ScanFunction = for<'a> fn(&'a Bus, Option<Duration>) -> Boxed<'a, Result<ScanReport, Fault>>;

/// Result of a scan.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanReport {
    /// Whether the scan found no device on the line.
    pub is_empty: bool,
    /// Result as JSON, for programs.
    pub json: serde_json::Value,
    /// Result as text, for users; empty if the scan found no device.
    pub text: String,
    /// Bus for a profile: its name, and the text lines that follow the address in the profile. The error is the reason
    /// why the gateway cannot use the bus.
    pub profile: Result<(&'static str, String), String>,
}

/// How a simulated machine replaces the devices of a line.
#[derive(Clone, Copy)]
pub enum VirtualLine {
    /// The simulated machine answers on the line. The text precedes the address in a message, for example "listens on".
    Served(&'static str),
    /// The simulated machine does not simulate the line. The function returns a sentence with the reason.
    Absent(fn(&Bus) -> String),
}

/// Returns the remedy for a fault of the connection to a serial server; `None` if the general advice fits.
pub(super) fn serial_server_hint(fault: Fault) -> Option<&'static str> {
    match fault {
        Fault::Link(LinkFault::Refused) => Some(
            "is this the port of the serial server (often 4001)? Does the serial server wait for connections, as a \
             TCP server without telnet? Does another program use its only connection?",
        ),
        _ => None,
    }
}

impl BusKind {
    /// Default values for the fields that a type of bus does not set.
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
