//! Offline: from the logs of some days to a model that holds on a day it never saw.
//!
//! ```text
//! dataset ── setup ── campaign ── bank ── gram ── method ── validate ── identified ── written
//!  (logs)   (checks,   (profile's  (rises   (X'X)   (learn)    (one run    (JSON)        (TOML)
//!           faults)     view)     and lags)                   left out)
//! ```
//! The rises and lags of the bank are computed by the gateway's own [`compensation`](isotherm_core::compensation): what is
//! found is what runs.
//!
//! [`select`] says which points are worth keeping, without a profile; [`report`] draws both for a customer.
//!
//! # Sign
//! Methods learn the compensation that would leave no error, Cz = −(e − its cold value): a gain is the profile's gain.

pub mod applied;
pub mod balls;
pub mod dataset;
pub mod drift;
pub mod facts;
pub mod faults;
pub mod identified;
pub mod method;
pub mod report;
pub mod select;
pub mod setup;
pub mod written;

mod alike;
mod ambient;
mod bank;
mod campaign;
mod checks;
mod collinear;
mod folds;
mod gram;
mod learn;
mod minutes;
mod region;
mod solve;
mod statistics;
mod uncertainty;
mod validate;

pub use identified::{Identified, identify};
pub use learn::Learned;
