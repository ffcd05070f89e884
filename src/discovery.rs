//! A line looked at without a profile: which units answer, what stands in a register. Reads, and never writes.
//!
//! - [`bus`] — a line in one word: `tcp://192.168.0.10:502`.
//! - [`ask`] — one question at a time, on the same [`crate::fieldbus::line`] that the gateway uses.
//! - [`can`] — the interface of a CAN line, as the kernel has it.
//! - [`sysfs`] — the sensors of this computer: which there are, and which of a profile there are not.
//! - `opcua` — an OPC UA server, by feature: what it offers, its certificate, its nodes.
//! - [`mod@pipeline`] — whether a device bears two questions at a time.
//! - [`scan`] — which units answer; [`walk`] — which registers a unit has.
//! - [`values`] — what registers mean, in each order where none was given.
//! - [`remedy`] — what to do about a fault.

pub mod ask;
pub mod bus;
pub mod can;
#[cfg(feature = "opcua")]
pub mod opcua;
pub mod pipeline;
pub mod remedy;
pub mod scan;
pub mod sysfs;
pub mod values;
pub mod walk;

pub use crate::fieldbus::error::Fault;
pub use crate::fieldbus::trace::Exchange;
pub use crate::fieldbus::wire::Answer;
pub use isotherm_core::codec::{DataType, Register, Table, WordOrder};
