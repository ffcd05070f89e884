//! OPC UA server as a line, that is, a bus with its devices.
//!
//! - `client` — connections to a server; requires the feature `opcua`.
//! - [`check`] — check of such a line in a profile; [`fault`] — faults of a connection.
//! - [`namespaces`] — namespaces that a profile names by index.
//! - `conversion` — conversion of numbers and node identifiers between the library and the profile; requires
//!   the feature `opcua`.

pub mod check;
#[cfg(feature = "opcua")]
pub mod client;
#[cfg(feature = "opcua")]
pub mod conversion;
pub mod fault;
pub mod namespaces;
pub mod request;

use super::kind::{BusKind, LinePlace, ScanKind, VirtualLine};
use super::target::host_of_url;
use crate::fieldbus::connection::Dial;
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use isotherm_core::reading::Status;
use isotherm_profile::{Bus, Transport, server_url};

/// Description of the bus type OPC UA server.
pub const KIND: BusKind = BusKind {
    word: "opcua",
    example: Some("opc.tcp://192.168.0.12:4840"),
    parse: |text| {
        let url = text.starts_with("opc.tcp://").then(|| server_url(text))?;
        Some(url.map(|url| (Transport::OpcUa, url)).map_err(|(why, help)| format!("{why}; {help}")))
    },
    dial,
    hint,
    place: |bus| LinePlace::Host(host_of_url(&bus.address).to_owned()),
    has_namespaces: true,
    is_closed_in_order: true,
    scan: ScanKind::Other {
        is: "an OPC UA server",
        instead: if cfg!(feature = "opcua") {
            "`isotherm read --browse` shows the nodes of the server"
        } else {
            "this program was built without OPC UA: use a packaged program, or build one with \
             `cargo build --release --features opcua`"
        },
        #[cfg(feature = "opcua")]
        scan: Some(client::scan::report),
        #[cfg(not(feature = "opcua"))]
        scan: None,
    },
    virtual_line: if cfg!(feature = "opcua") {
        VirtualLine::Served("listens on")
    } else {
        VirtualLine::Absent(|bus| {
            format!("bus {} is an OPC UA server, and this program was built without OPC UA", bus.name)
        })
    },
    ..BusKind::PLAIN
};

#[cfg(feature = "opcua")]
fn dial(bus: &Bus) -> Option<Box<dyn Dial>> {
    Some(Box::new(client::OpcUaDial::new(bus)?))
}

#[cfg(not(feature = "opcua"))]
fn dial(_: &Bus) -> Option<Box<dyn Dial>> {
    Some(Box::new(not_built_in::NotBuiltIn))
}

#[cfg(not(feature = "opcua"))]
mod not_built_in;

/// Returns the remedy for a fault of an OPC UA line; `None` if the general remedy for all types of bus applies.
const fn hint(fault: Fault) -> Option<&'static str> {
    Some(match fault {
        Fault::Timeout => {
            "is the server or its computer busy? If so, write a longer `timeout` of the bus, or read fewer \
             nodes less often. Is the control powered and connected to the network?"
        }
        Fault::Link(LinkFault::Refused) => {
            "is the port right (usually 4840)? Is the OPC UA server of the control switched on and running?"
        }
        Fault::Link(LinkFault::Broken) => {
            "the server or a network device has closed the connection: was the server restarted? The \
             server's own log says why"
        }
        Fault::Peer(PeerFault::Malformed) => {
            "the answer is not OPC UA: does a network device change it? The server's own log may say more"
        }
        _ => return None,
    })
}

/// Returns what the user can do if the server refuses a request with this OPC UA status.
pub(in crate::fieldbus) const fn status_hint(status: Status) -> &'static str {
    match status {
        _ if status.is(Status::ACCESS_DENIED) => {
            "the user of the line lacks the permission: grant it at the server, or write another `user` for the bus"
        }
        _ if status.is(Status::NOT_WRITABLE) => {
            "the server does not allow clients to write this node. Is it the right node? Is writing \
             switched on at the server?"
        }
        _ if status.is(Status::WRITE_NOT_SUPPORTED) => {
            "the server does not accept a value without time stamp and quality for this node. \
             Is it the right node? Is writing this node over OPC UA switched on at the server?"
        }
        _ if status.is(Status::TYPE_MISMATCH) => {
            "the node and the output have different types: write the type of the node \
             into `type` of the output. An OPC UA browser shows the type"
        }
        _ if status.is(Status::NO_SUCH_NODE) => {
            "there is no such node at the server: `isotherm read --browse` shows its nodes and namespaces. Is the name \
             of the node right? Is its namespace still the same after an update of the server?"
        }
        _ if status.is(Status::TOO_MANY_OPERATIONS)
            || status.is(Status::REQUEST_TOO_LARGE)
            || status.is(Status::RESPONSE_TOO_LARGE)
            || status.is(Status::ENCODING_LIMITS) =>
        {
            "the call is too large for the server, even in its smallest form: set the server to accept more nodes \
             and longer messages. An output set is written in one call: make the set smaller"
        }
        _ if status.is(Status::OUT_OF_RANGE) => {
            "the server does not accept this value for the node: are `scale`, the `limit` of the axis and \
             the range of the node right?"
        }
        _ => "the server's own log or display says why",
    }
}
