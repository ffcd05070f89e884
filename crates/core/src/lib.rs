//! Decisions of isotherm, with the units and codecs that they use. Nothing in this crate reads a clock, a file or a
//! socket. Time is an argument, so a replay of a machine's log gives the same decisions bit for bit.
//!
//! ```text
//! quantity ← reading ← { codec, compensation }      units, values with their age and quality
//! { quantity, events } ← output                     from a decision to the next action on a register
//! quantity ← candidate                              whether a learned model replaces the model in use
//! ```
//!
//! - [`border`] — catches panics of code from outside the project.
//! - [`quantity`] — units as types: µm, mm, °C, gains, counts of a register, points in time.
//! - [`reading`] — a value, its time of measurement, and its quality.
//! - [`codec`] — converts registers and bits of CAN frames to values, and back.
//! - [`compensation`] — the first pure step: it computes a decision for each axis from a snapshot of readings.
//! - [`output`] — the second pure step: it computes the next exchange from a decision and the register value.
//! - [`candidate`] — whether a model that was learned from touches replaces the model in use.
//! - [`continuity`] — whether the device that answers is the device that passed its checks.
//! - [`events`] — the catalogue of events: kinds, levels, alarms, meanings and hints.
//! - [`explained`] — cause and hint of a fault.
//! - [`namespaces`] — the OPC UA namespaces that a profile names by index, and their current index on the server.
//! - [`place`] — places (addresses and scales) of outputs and signals, and their changes since the last run.
//! - [`display`] — the displayed state of an axis, from its decision and the last verified Cz.

pub mod border;
pub mod candidate;
pub mod codec;
pub mod compensation;
pub mod continuity;
pub mod display;
pub mod events;
pub mod explained;
pub mod namespaces;
pub mod output;
pub mod place;
pub mod quantity;
pub mod reading;
