//! The gateway.
pub mod log;
