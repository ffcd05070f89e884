//! States of signals, devices, outputs and axes, each in its own type. The code of these types uses no lock and no
//! disk.

pub(super) mod arming;
pub(super) mod causes;
pub(super) mod comparison;
pub(super) mod continuity;
pub(super) mod dependents;
pub(super) mod device_health;
pub(super) mod dirty_vec;
pub(super) mod extrapolation;
mod failed_reads;
pub(super) mod learning;
pub(super) mod output;
pub(super) mod output_faults;
pub(super) mod pause;
pub(super) mod probing;
pub(super) mod reported_conditions;
pub(super) mod restart;
pub(super) mod run_phase;
pub(super) mod scales;
pub(super) mod sign;
pub(super) mod signal_table;
pub(super) mod stand_in;
#[cfg(test)]
pub(super) mod test_profiles;
pub(super) mod units;
