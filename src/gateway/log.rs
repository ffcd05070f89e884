//! The log of a run: CSV, one row per step, from which [`replay`](crate::cli::replay) gives the same decisions again.
//!
//! ```text
//! time, <signal>…, then per axis z: z_permit, z_from_um, z_raw_um, z_cz_um, z_model, z_state, z_acted,
//! and at the end: machine_memory, machine_zero, machine_clock
//! ```
//!
//! - `time`: RFC 3339 in UTC with every nanosecond. A log from elsewhere may count seconds.
//! - `<signal>`: the value in its engineering unit, with every digit it has; empty where it could not be used.
//! - `z_permit`: off, armed, unverified, stopping. `z_from_um`: what was taken over from the register, else empty.
//! - `z_raw_um` … `z_acted`: the axis's decision, made at this row or standing since an earlier one.
//! - `z_slope_from_um`, `z_slope_um`: the same of a slope that the control applies itself, as what it comes to at the
//!   axis's reach; only on such an axis.
//! - `z_measured_um`, `z_acting_um`: an error measured at this row, and the Cz that acted; `z_forget`: 1 where what
//!   probings taught was taken back; `z_worse`: 1 while they show that the axis is worse with its model than without
//!   compensation; `z_correction_um`: what they add to the model's Cz. Only on an axis with a probe.
//!   A log from elsewhere may have `z_measured_um` alone: what was decided last acts.
//! - `z_expected_um`: one standard deviation of what is expected to be left of the error where the model's Cz acts, empty
//!   where that is not known; only on an axis with a model that says so.
//! - `z_stood_in`: a sensor of the model in use that others stand in for; `z_trust`: 1 where a person disarmed
//!   the axis, from when on its sensors are believed. Only on an axis whose models have stand-ins.
//! - `z_sign_um`: where Cz is taken while the sign of the axis is checked with a dial gauge, else empty.
//! - `z_behind_um`: the verified Cz of the output farthest behind the decision, while it waits, else empty: what is decided stays
//!   within one step of it.
//! - `z_return_um`: where an axis that keeps its value goes back to, because the settings of a sensor were changed, else empty;
//!   `z_return_slope_um`: the same of a slope.
//! - `machine_memory`: at the first row of a run, what was remembered from before (JSON).
//! - `machine_zero`: the moment of a command to zero that was given since the row before.
//! - `machine_clock`: at the first row after the computer's clock was set, from when to when. All moments of a file are
//!   stamped alike, so that the spans between them are the counted ones.
//! - `machine_dry_run`: 1, and only in the log of a dry run: no Cz in it ever acted.
//!
//! What the outputs make of the decisions stands in [a log of its own](outputs) beside this one, so that this one stays
//! rectangular.
//!
//! A log from elsewhere needs `time` and at least one signal; `z_error_um` is the measured error of axis z.

#[cfg(feature = "parquet")]
mod days;
pub mod outputs;
mod reader;
mod recorder;
#[cfg(test)]
mod tests;

#[cfg(feature = "parquet")]
pub use days::{days, is_for_replay, is_text};
pub use reader::{Decided, LogError, LogReader, LogRow};
pub use recorder::{Recorder, number};
#[cfg(test)]
pub(crate) use tests::sample;

const TIME: &str = "time";
const MEMORY: &str = "machine_memory";
const ZERO: &str = "machine_zero";
/// In the log of a dry run.
/// What the first row of a file says where the computer's clock was set before it.
pub(super) const CLOCK: &str = "machine_clock";
const DRY_RUN: &str = "machine_dry_run";

const PERMIT: &str = "permit";
const FROM: &str = "from_um";
/// Of every axis, behind what was decided.
const SIGN: &str = "sign_um";
const BEHIND: &str = "behind_um";
const RETURN: &str = "return_um";
const RETURN_SLOPE: &str = "return_slope_um";
const ERROR: &str = "error_um";
/// Of a slope that the control applies: what was taken over and what was decided, as its effect at the axis's reach.
const SLOPE_FROM: &str = "slope_from_um";
const SLOPE: &str = "slope_um";
/// Of an axis with a probe.
const MEASURED: &str = "measured_um";
const ACTING: &str = "acting_um";
const FORGET: &str = "forget";
const WORSE: &str = "worse";
const CORRECTION: &str = "correction_um";
/// Of an axis with a model that says how wrong it is expected to be.
const EXPECTED: &str = "expected_um";
/// Of an axis whose sensors are watched.
const STOOD_IN: &str = "stood_in";
/// Of an axis whose models have stand-ins: a person has disarmed it.
const TRUST: &str = "trust";
/// What was decided for an axis, in the order of the columns.
const DECIDED: [&str; 5] = ["raw_um", "cz_um", "model", "state", "acted"];
