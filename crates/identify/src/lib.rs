//! Offline identification of models from the logs of some days. A model calculates Cz, the compensation value of an
//! axis, and must also be valid on other days.
//!
//! ```text
//! dataset ── setup ── campaign ── bank ── gram ── method ── validate ── identified ── written
//!  (logs)   (checks,   (profile's  (rises   (X'X)   (learn)    (one run    (JSON)        (TOML)
//!           faults)     view)     and lags)                   left out)
//! ```
//! The rises and lags in the matrix of candidate terms (`bank`) are computed by the gateway's own
//! [`compensation`](isotherm_core::compensation). Therefore an identified model gives the same values in the gateway.
//!
//! [`learning`] learns the model of an axis from touches (measurements with a probe), one run after the other.
//! [`fleet`] stores the Gram products of each run, so that the products of several machines can be added. [`select`]
//! selects measuring points without a profile. [`report`] renders HTML reports of models and of selections.
//!
//! # Sign
//! e is the measured error. Methods identify the Cz that would leave no error: Cz = −(e − cold value of e).
//! Gains have the same sign as in the profile.

pub mod applied;
pub mod balls;
pub mod dataset;
pub mod drift;
pub mod expected;
pub mod facts;
pub mod faults;
pub mod fleet;
pub mod identified;
pub mod learning;
pub mod method;
pub mod repaired_runs;
pub mod report;
pub mod select;
pub mod setup;
pub mod stand_in;
pub mod uses;
pub mod written;

mod ambient;
mod bank;
mod campaign;
mod checks;
mod collinear;
mod coverage;
mod folds;
mod gram;
mod incomplete;
mod learn;
mod minutes;
mod omission;
mod products;
mod pruning;
mod region;
mod resolution;
mod sensors;
mod similarity;
mod solve;
mod statistics;
mod touches;
mod uncertainty;
mod validate;
mod wander;
mod whiten;

pub use identified::{Identified, assessed_on_others, identify};
pub use learn::Learned;
pub use validate::{OVER_TOUCHES, RunScore};
