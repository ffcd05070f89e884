//! Deadband of the guard: small changes of the target are not followed.

use crate::quantity::Micron;

/// Returns whether a change is smaller than the deadband, and therefore not made. Small changes add up: the next change
/// counts from the same value.
pub(super) fn suppresses(change: Micron, deadband: Micron) -> bool {
    change != Micron::ZERO && change.abs() < deadband
}
