//! The way to the devices: what is asked for, in how many requests, and what is written.
//!
//! - [`plan`] — pure: the signals of a device become the fewest read requests.

pub mod plan;
