//! Time of the plant, counted in whole steps from the start of the run.

use std::time::Duration;

/// Time step of the plant. It is short enough because the time constants of a machine are minutes and hours.
pub const STEP: Duration = Duration::from_secs(1);

/// Converts a number of steps to seconds. A run never has 2^53 steps, so the result is exact.
#[allow(clippy::cast_precision_loss)]
pub(super) fn seconds(steps: u64) -> f64 {
    steps as f64 * STEP.as_secs_f64()
}
