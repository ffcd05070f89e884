//! Time of the plant: whole steps from the start.

use std::time::Duration;

/// Time step of the plant. The time constants of a machine are minutes and hours.
pub const STEP: Duration = Duration::from_secs(1);

/// Converts steps to seconds. A run of 2^53 steps does not occur.
#[allow(clippy::cast_precision_loss)]
pub(super) fn seconds(steps: u64) -> f64 {
    steps as f64 * STEP.as_secs_f64()
}
