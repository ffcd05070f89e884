//! The virtual nodes of a CAN interface.

pub mod dictionary;
