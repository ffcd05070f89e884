//! The fieldbus: one owner per physical line, reads and writes in one order, every fault by its blame.
//!
//! - [`plan`] — pure: the signals of a device become the fewest read requests.
//! - [`wire`] — the border behind which the Modbus library lives; [`modbus`] is the library's side of it.
//! - [`mod@line`] — one request at a time, timeout, breaker per device, reconnection.

pub mod backoff;
mod eager;
pub mod error;
pub mod line;
pub mod modbus;
pub mod plan;
pub mod wire;
