//! What isotherm decides, and the units and codes it decides in. Nothing here reads a clock, a file or a socket: time is
//! an argument, so what ran at a machine runs again from its log, bit for bit.
//!
//! ```text
//! quantity ← reading ← { codec, compensation }      units, values with their age and quality
//! quantity ← output                                 from a decision to the next action on a register
//! ```
//!
//! - [`border`] — where the code of others begins: its panics end there.
//! - [`quantity`] — units as types: µm, mm, °C, gains, counts of a register, moments.
//! - [`reading`] — a value, when it was measured, and whether it may be believed.
//! - [`codec`] — registers and the bits of CAN frames become values, and values become registers.
//! - [`compensation`] — the first pure step: from a snapshot of readings to a decision per axis.
//! - [`output`] — the second: from a decision, and what the register said, to what is sent next.
//! - [`continuity`] — whether the device that answers is the one that was verified.
//! - [`explained`] — cause and hint of a fault.
//! - [`namespaces`] — the namespaces that a profile names by index, and where an OPC UA server has them now.
//! - [`place`] — where outputs and signals lie, and what has changed of that since the last run.
//! - [`display`] — the state of an axis as people see it, from its decision and the verified value.

pub mod border;
pub mod codec;
pub mod compensation;
pub mod continuity;
pub mod display;
pub mod explained;
pub mod namespaces;
pub mod output;
pub mod place;
pub mod quantity;
pub mod reading;
