//! The fieldbus: one owner per physical line, reads and writes in one order, every fault by its blame.

pub mod backoff;
pub mod error;
pub mod line;
pub mod modbus;
pub mod wire;
