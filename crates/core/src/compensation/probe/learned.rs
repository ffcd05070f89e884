//! Learned correction of one model: an offset, its certainty, and the gains of its terms if the profile allows it.

use serde::{Deserialize, Serialize};

use super::certainty::{Certainty, Occasion};
use super::comparison::{Comparison, Credit, Touch, Worse};
use super::gains::Gains;
use crate::compensation::model::{Model, Reference};
use crate::compensation::settings::ProbeSettings;
use crate::quantity::{Micron, Moment, shifted};

/// Learned correction of one model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct Learned {
    /// Name of the model.
    model: String,
    /// Offset and gains of the model in the profile.
    corrects: Vec<f64>,
    /// Learned offset, µm, inside ±limit.
    pub(super) offset: f64,
    #[serde(default = "Certainty::uncounted")]
    pub(super) certainty: Certainty,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) gains: Option<Gains>,
    /// Earliest time at which a running capture of the model's reference is complete; `None` if none is running.
    pub(super) renews: Option<Moment>,
    /// Comparison of the model with no compensation.
    #[serde(default, skip_serializing_if = "Comparison::is_empty")]
    pub(super) comparison: Comparison,
}

shifted!(Learned: certainty, renews, comparison);

impl Learned {
    pub(super) fn new(model: &Model, settings: Option<&ProbeSettings>) -> Learned {
        let gains = settings.and_then(|settings| settings.gains.map(|gains| (gains, settings.limit.get())));
        let gains = gains.filter(|_| !model.correctable().is_empty());
        let gains = gains.map(|(gains, limit)| Gains::new(model.correctable().len(), gains.limit, limit));
        let (model, corrects) = (model.name.clone(), model.numbers().collect());
        let comparison = settings.map_or_else(Comparison::default, |_| Comparison::new());
        Learned { model, corrects, gains, comparison, ..Learned::default() }
    }

    /// Restores what was kept of this model with these gains, within the present bounds.
    pub(super) fn recall(&mut self, kept: &[Learned], settings: &ProbeSettings) {
        let is_same = |kept: &&Learned| kept.model == self.model && kept.corrects == self.corrects;
        let Some(kept) = kept.iter().find(is_same) else { return };
        let limit = settings.limit.get();
        self.offset = kept.offset.clamp(-limit, limit);
        self.certainty = kept.certainty.under(settings);
        self.renews = kept.renews;
        self.comparison.recall(&kept.comparison);
        if let (Some(gains), Some(kept)) = (self.gains.take(), kept.gains.clone()) {
            self.gains = Some(kept.restored(gains));
        }
    }

    /// Returns the correction of the model's Cz, µm, inside ±limit. `parts`: contribution of each gain to the model's
    /// Cz now.
    pub(in crate::compensation) fn correction(
        &self,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
    ) -> f64 {
        let limit = settings.limit.get();
        let total = self.offset + self.gains.as_ref().map_or(0.0, |gains| gains.change(parts));
        // The sum is only NaN if a part is NaN. Then the model has no value either.
        if total.is_nan() { 0.0 } else { total.clamp(-limit, limit) }
    }

    /// Checks whether a correction of `wanted` µm is accepted.
    ///
    /// # Errors
    /// Returns the largest deviation that would be accepted at once.
    pub(in crate::compensation) fn assess(
        &self,
        wanted: f64,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
        occasion: Occasion,
    ) -> Result<(), Micron> {
        self.certainty.assess(wanted - self.correction(parts, settings), settings.filter, occasion)
    }

    /// Learns that the correction should have been `wanted` µm, or doubts it.
    pub(in crate::compensation) fn learn(
        &mut self,
        wanted: f64,
        parts: impl Iterator<Item = f64> + Clone,
        settings: &ProbeSettings,
        occasion: Occasion,
    ) {
        let residual = wanted - self.correction(parts.clone(), settings);
        if self.certainty.assess(residual, settings.filter, occasion).is_err() {
            return self.certainty.doubt(residual);
        }
        let share = self.certainty.learn(residual, settings.filter, occasion);
        if let (Some(gains), Some(bounds)) = (&mut self.gains, &settings.gains) {
            gains.learn(wanted, parts.clone(), bounds.forgetting);
        }
        let rest = wanted - self.correction(parts, settings);
        let limit = settings.limit.get();
        let offset = (self.offset + share * rest).clamp(-limit, limit);
        self.offset = if offset.is_nan() { self.offset } else { offset };
    }

    /// Returns the time of the last accepted probing. `None` if there is none, or if the limit keeps the offset from
    /// its learned value.
    pub(in crate::compensation) fn touched(&self, settings: &ProbeSettings) -> Option<Moment> {
        self.certainty.touched().filter(|_| self.offset.abs() < settings.limit.get())
    }

    /// Notes that a reference of the model is captured again.
    pub(in crate::compensation) fn renew(&mut self, complete: Moment) {
        self.renews = Some(complete);
    }

    pub(in crate::compensation) fn renews(&self, now: Moment) -> bool {
        self.renews.is_some_and(|complete| now >= complete)
    }

    /// Returns the earliest time at which a running capture is complete; `None` if none is running.
    pub(in crate::compensation) fn renewal(&self) -> Option<Moment> {
        self.renews
    }

    /// Sets the correction to zero at this point. The gains are kept.
    pub(in crate::compensation) fn begin_here(
        &mut self,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
    ) {
        (self.renews, self.certainty) = (None, Certainty::default());
        self.comparison.begin();
        let limit = settings.limit.get();
        let change = self.gains.as_ref().map_or(0.0, |gains| gains.change(parts));
        self.offset = if change.is_nan() { 0.0 } else { (-change).clamp(-limit, limit) };
        if let Some(gains) = &mut self.gains {
            gains.begin_at(self.offset);
        }
    }

    /// Adds the errors of a probing to the comparison: without compensation, and with the model.
    pub(in crate::compensation) fn compare(
        &mut self,
        touch: Touch,
        credit: Credit,
        settings: &ProbeSettings,
    ) {
        self.comparison.take(touch, credit, settings.scatter());
    }

    /// Returns the comparison of a model that is worse than no compensation; `None` if it is not worse.
    pub(in crate::compensation) fn worse(&self) -> Option<Worse> {
        self.comparison.worse()
    }

    pub(super) fn clear(&mut self) {
        (self.offset, self.certainty) = (0.0, Certainty::default());
        self.comparison.clear();
        if let Some(gains) = &mut self.gains {
            gains.clear();
        }
    }

    pub(super) fn gains(&self) -> &[f64] {
        self.gains.as_ref().map_or(&[], Gains::factors)
    }
}

impl Model {
    /// Returns whether a rise of the model is measured from this captured reference.
    pub(in crate::compensation) fn is_measured_from(&self, reference: Reference) -> bool {
        self.references().any(|known| known == reference)
    }
}
