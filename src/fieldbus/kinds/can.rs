//! One CAN interface of the kernel: frames in both directions, bus errors, and the settings of the interface.
//!
//! - [`socket`] — reads and writes frames; detects that the interface goes down, comes up or is removed.
//! - [`error_frame`] — error frames as text; [`interface`] — state and settings of the interface, if its driver reports
//!   them.
//! - [`link`] — state that outlives a socket; [`image`] — frames that several values share.
//! - [`wire`] — requests and writes on the interface, as on any other line.
//! - [`canopen`] — CANopen master without a socket: it receives frames as arguments, and returns the frames
//!   to send.

pub mod canopen;
pub mod error_frame;
pub mod image;
pub mod interface;
pub mod link;
pub mod request;
pub mod socket;
pub mod wire;

pub use error_frame::{ErrorFrame, ErrorSeverity};
pub use image::{Images, Value};
pub use interface::Interface;
pub use link::Link;
pub use socket::{ReceivedFrame, Socket};
pub use wire::CanDial;

use super::kind::{BusKind, LinePlace, ScanKind, VirtualLine};
use crate::fieldbus::error::CanFault;

/// Description of the bus type CAN: an interface of this computer.
pub const KIND: BusKind = BusKind {
    word: "can",
    address_key: "interface",
    place: |bus| LinePlace::Name(format!("can {}", bus.address)),
    scan: ScanKind::Other {
        is: "a CAN line",
        instead: "`isotherm read PROFILE` reads the signals of the line",
        scan: None,
    },
    virtual_line: VirtualLine::Served("is on the CAN interface"),
    ..BusKind::PLAIN
};

/// Returns what the user can do about a fault of a CAN interface.
pub(in crate::fieldbus) const fn hint(fault: CanFault) -> &'static str {
    match fault {
        CanFault::NoInterface => "is the adapter plugged in? (`ip -details link` lists the interfaces)",
        CanFault::NotCan => "`ip -details link show type can` lists the CAN interfaces",
        CanFault::NoKernel => "run `modprobe can-raw` as root",
        CanFault::Forbidden => "run the gateway as a user who may open raw sockets of CAN",
        CanFault::Down => "`ip link set … up` as root brings the interface up",
        CanFault::Full => {
            "does another node on the bus acknowledge? If yes, `txqueuelen` of the interface is too small"
        }
        CanFault::TooLong => "CAN FD needs an interface with mtu 72",
    }
}
