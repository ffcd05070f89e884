//! Log of a run: CSV with one row per step of the axes. [`replay`](crate::cli::replay) calculates the same decisions
//! from the log.
//!
//! ```text
//! time, <signal>…, then per axis z: z_permit, z_from_um, z_raw_um, z_cz_um, z_model, z_state, z_acted,
//! and at the end: machine_memory, machine_zero, machine_clock
//! ```
//!
//! - `time`: RFC 3339 in UTC with every nanosecond. A log of another program may contain seconds instead.
//! - `<signal>`: value in its engineering unit, with every digit; empty if the reading was rejected or too old.
//! - `z_permit`: off, armed, unverified, held, stopping. `z_from_um`: Cz (compensation value) in the register from
//!   which the axis continued at this row, else empty.
//! - `z_raw_um` … `z_acted`: decision of the axis, from this row or an earlier one.
//! - `z_slope_from_um`, `z_slope_um`: the corresponding values of a slope that the control applies itself, as its
//!   effect at the axis's largest distance from the reference position. Only for such an axis.
//! - `z_measured_um`, `z_acting_um`: measured error that was received at this row, and the Cz that acted
//!   during its measurement. `z_forget`: 1 if the correction from measured errors was discarded. `z_worse`: 1
//!   while probings show that the axis is worse with its model than without compensation. `z_correction_um`:
//!   correction of the model's Cz. Only for an axis with a probe. A log of another program may have only
//!   `z_measured_um`; the acting Cz is then the Cz of the last decision.
//! - `z_expected_um`: expected residual error with the model's Cz, as one standard deviation; empty if it is unknown.
//!   Only for an axis with a model that calculates this error.
//! - `z_stood_in`: sensor of the model in use that a stand-in (value estimated from other sensors) replaces.
//!   `z_trust`: 1 if the operator disarmed the axis, and its sensors are accepted from then on. Only for an
//!   axis whose models have stand-ins.
//! - `z_preferred`: request since the previous row to change the preferred model (JSON): adopt a learned
//!   model, return to the previous model, or withdraw such a request (`null`). Only for an axis that learns.
//! - `z_sign_um`: target of Cz while the sign of the axis is checked with a dial gauge, else empty.
//! - `z_behind_um`: verified Cz of the output that is farthest from the last decision; empty if all outputs
//!   hold the decision. The next decision stays within one step of this Cz.
//! - `z_return_um`: Cz to which an axis on hold returns because the settings of a sensor were changed, else empty.
//!   `z_return_slope_um`: the corresponding value of a slope.
//! - `machine_memory`: saved state with which the run or the file begins (JSON), in its first row.
//! - `machine_zero`: time of a zero command since the previous row.
//! - `machine_clock`: old and new time, in the first row after the computer's clock was set. All times of a file are
//!   shifted equally, so that the differences between them are those of the monotonic clock.
//! - `machine_dry_run`: 1, only in the log of a dry run. No Cz in such a log was written to a device.
//!
//! The actions of the outputs are in [a separate log](outputs) in the same directory, so that all rows of this log have
//! the same columns.
//!
//! A log of another program requires `time` and at least one signal. In such a log, `z_error_um` is the
//! measured error of axis z.

#[cfg(any(feature = "identify", feature = "parquet"))]
mod days;
pub mod outputs;
mod reader;
mod recorder;
#[cfg(test)]
mod tests;

#[cfg(any(feature = "identify", feature = "parquet"))]
pub use days::{days, is_for_replay, is_text};
pub use reader::{LogError, LogReader, LogRow, LoggedDecision, Recording};
pub use recorder::{Recorder, number};
#[cfg(test)]
pub(crate) use tests::sample;
