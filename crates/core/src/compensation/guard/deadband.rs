//! Deadband: Cz does not follow small changes of its target.

use crate::quantity::Micron;

/// Returns whether a change is smaller than the deadband and is therefore not made. Small changes still add up, because
/// the next change is measured from the same value.
pub(super) fn suppresses(change: Micron, deadband: Micron) -> bool {
    change != Micron::ZERO && change.abs() < deadband
}
