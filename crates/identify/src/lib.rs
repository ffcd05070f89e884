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
//! Methods learn the compensation that is wanted, Cz = −(e − its cold value): a gain is the profile's gain.

pub mod alike;
pub mod ambient;
pub mod applied;
pub mod balls;
pub mod bank;
pub mod campaign;
pub mod collinear;
pub mod dataset;
pub mod drift;
pub mod facts;
pub mod faults;
pub mod gram;
pub mod identified;
pub mod learn;
pub mod method;
pub mod region;
pub mod report;
pub mod select;
pub mod setup;
pub mod statistics;
pub mod validate;
pub mod written;

mod checks;
mod folds;
mod solve;
mod uncertainty;

pub use identified::{Identified, identify};
