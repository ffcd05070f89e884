//! Snapshot: the readings of the machine at one moment, from which a step computes its decisions.

use super::substitution::Substitution;
use crate::quantity::{Millimetre, Moment};
use crate::reading::{Quality, Reading, SignalId};

/// Readings of the machine at one moment, one for each signal of the profile. Readings that are too old have been
/// marked as stale.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// Time of the snapshot.
    pub now: Moment,
    /// Readings, indexed by [`SignalId`].
    pub readings: &'a [Reading],
    /// Substitutes for the readings of rejected sensors.
    pub(super) substitutions: &'a [Substitution],
    /// Whether the snapshot has already updated the lags of all models, and no reference was captured after that.
    pub(super) is_followed: bool,
}

impl<'a> Snapshot<'a> {
    /// Creates a snapshot without substitutes.
    pub fn new(now: Moment, readings: &'a [Reading]) -> Snapshot<'a> {
        Snapshot { now, readings, substitutions: &[], is_followed: false }
    }

    /// Returns the snapshot, marked as followed: the lags of all models have already been updated with this
    /// snapshot.
    #[must_use]
    pub fn followed(self) -> Snapshot<'a> {
        Snapshot { is_followed: true, ..self }
    }

    /// Returns the value of a signal, or the substitute that replaces it; `None` if there is no value that may be used.
    pub fn value(&self, id: SignalId) -> Option<f64> {
        match self.instead_of(id) {
            Some(substitution) => substitution.value(),
            None => self.reading(id),
        }
    }

    /// Returns the sensor's own reading, even if a substitute replaces it; `None` if the reading is not good.
    #[inline]
    pub(super) fn reading(&self, id: SignalId) -> Option<f64> {
        self.readings.get(id.0)?.usable()
    }

    /// Returns the sensor's own reading if it is good and its absolute value is less than `limit`; else `None`.
    #[inline]
    pub(super) fn reading_below(&self, limit: f64, id: SignalId) -> Option<f64> {
        let Reading { value, quality, .. } = self.readings.get(id.0)?;
        (*quality == Quality::Good && value.abs() < limit).then_some(*value)
    }

    /// Returns the substitute for the reading of this sensor; `None` if the sensor's own reading is used.
    #[inline]
    pub(super) fn instead_of(&self, id: SignalId) -> Option<&'a Substitution> {
        self.substitutions.iter().find(|substitution| substitution.signal == id)
    }

    /// Returns the value of a signal that is the position of an axis; `None` if it must not be used.
    pub fn position(&self, id: SignalId) -> Option<Millimetre> {
        Millimetre::new(self.value(id)?)
    }

    /// Returns whether the snapshot has at least one reading that may be used.
    pub fn has_usable(&self) -> bool {
        self.readings.iter().any(|reading| reading.usable().is_some())
    }
}
