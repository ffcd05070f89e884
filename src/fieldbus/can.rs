//! One CAN interface of the kernel: frames in and out, what the bus says of itself, what the interface is set to.
//!
//! - [`socket`] — reads and writes frames; notices that the interface goes down, comes up, is gone.
//! - [`trouble`] — error frames, in words.
//! - [`interface`] — whether it is up, and how it is set, where its driver says so.

pub mod interface;
pub mod socket;
pub mod trouble;

pub use interface::Interface;
pub use socket::{Heard, Socket};
pub use trouble::Trouble;
