//! Discovery on a line without a profile: which units answer, and which values their registers hold. It only reads.
//!
//! - [`bus`] — address of a line as one word: `tcp://192.168.0.10:502`.
//! - [`unit_reader`] — one request at a time, on the same [`crate::fieldbus::line`] that the gateway uses.
//! - [`can`] — state of a CAN interface, as the kernel reports it.
//! - [`sysfs`] — sensors of this computer that a profile names and that are missing.
//! - `opcua` — an OPC UA server, by feature: its endpoints, its certificate, its nodes.
//! - [`mod@pipeline`] — whether a device supports two requests at a time.
//! - [`scan`] — units that answer; [`register_search`] — registers of a unit.
//! - [`values`] — decoded values of registers, in each word order if none is given.
//! - [`remedy`] — advice for a fault.

pub mod bus;
pub mod can;
#[cfg(feature = "opcua")]
pub mod opcua;
pub mod pipeline;
pub mod register_search;
pub mod remedy;
pub mod scan;
pub mod sysfs;
pub mod unit_reader;
pub mod values;

pub use crate::fieldbus::error::Fault;
pub use crate::fieldbus::trace::Exchange;
pub use crate::fieldbus::wire::Answer;
pub use isotherm_core::codec::{DataType, Register, Table, WordOrder};
