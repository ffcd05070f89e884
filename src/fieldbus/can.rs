//! One CAN interface of the kernel: frames in both directions, bus errors, and the settings of the interface.
//!
//! - [`socket`] — reads and writes frames; detects that the interface goes down, comes up or is removed.
//! - [`error_frame`] — error frames as text; [`interface`] — state and settings of the interface, if its driver reports
//!   them.
//! - [`link`] — state that outlives a socket; [`image`] — frames that several values share.
//! - [`wire`] — requests and writes on the interface, as on any other line.

pub mod error_frame;
pub mod image;
pub mod interface;
pub mod link;
pub mod socket;
pub mod wire;

pub use error_frame::{ErrorFrame, ErrorSeverity};
pub use image::{Images, Value};
pub use interface::Interface;
pub use link::Link;
pub use socket::{ReceivedFrame, Socket};
pub use wire::CanDial;
