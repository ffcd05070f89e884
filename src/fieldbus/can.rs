//! One CAN interface of the kernel: its frames in both directions, bus errors, and settings.
//!
//! - [`socket`] — reads and writes frames; detects when the interface goes down, comes up or is removed.
//! - [`error_frame`] — text of error frames; [`interface`] — state and settings of the interface, if its driver reports
//!   them.
//! - [`link`] — state that is kept when the socket is replaced; [`image`] — frames that contain several values.
//! - [`wire`] — requests and writes on the interface, with the same trait as on any other line.

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
