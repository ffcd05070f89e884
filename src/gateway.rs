//! The wiring between fieldbus and compensation, and the log of what they did.

pub mod log;
