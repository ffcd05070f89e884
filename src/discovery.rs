//! Discovery on a bus line without a profile: which units answer, and which values their registers contain. It only
//! reads.
//!
//! - [`bus`] — address of a line as one word, for example `tcp://192.168.0.10:502`.
//! - [`unit_reader`] — reads with one request at a time, through the same [`crate::fieldbus::line`] that the gateway
//!   uses.
//! - [`can`] — state of the CAN interfaces of a profile, as the kernel reports it.
//! - [`sysfs`] — temperature sensors of this computer, and sensors of a profile that this computer does not have.
//! - `opcua` — endpoints, certificate and nodes of an OPC UA server. This module requires the feature `opcua`.
//! - [`merged_reads`] — test of a device that does not serve a planned read of several values: which quirks (profile
//!   settings for peculiar devices) help.
//! - [`mod@pipeline`] — whether a device supports two requests at a time.
//! - [`new_connection`] — whether a device that does not answer needs a pause after connecting, or loses the first
//!   request.
//! - [`scan`] — search for units that answer; [`register_search`] — search for the registers of a unit.
//! - [`values`] — decoded values of registers. If the word order is unknown, the values are decoded in both word
//!   orders.
//! - [`remedy`] — advice to the user on a fault.

pub mod bus;
pub mod can;
pub mod merged_reads;
pub mod new_connection;
#[cfg(feature = "opcua")]
pub mod opcua;
pub mod pipeline;
pub mod register_search;
pub mod remedy;
pub mod scan;
pub mod sysfs;
pub mod unit_reader;
pub mod values;

pub use crate::fieldbus::error::{Fault, PeerFault};
pub use crate::fieldbus::trace::Exchange;
pub use crate::fieldbus::wire::Answer;
pub use isotherm_core::codec::{DataType, Register, Table, WordOrder};
