//! One CAN interface of the kernel: frames in and out, what the bus says of itself, what the interface is set to.
//!
//! - [`socket`] — reads and writes frames; notices that the interface goes down, comes up, is gone.
//! - [`trouble`] — error frames, in words; [`interface`] — whether it is up and how it is set, where its driver says so.
//! - [`link`] — what outlives a socket; [`image`] — frames that several values share.
//! - [`wire`] — the interface as a line that is asked and written to.

pub mod image;
pub mod interface;
pub mod link;
pub mod socket;
pub mod trouble;
pub mod wire;

pub use image::{Images, Value};
pub use interface::Interface;
pub use link::Link;
pub use socket::{Heard, Socket};
pub use trouble::{Gravity, Trouble};
pub use wire::CanDial;
