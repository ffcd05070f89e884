//! Correction of one model from probings (measured errors of the axis). It consists of an offset, its certainty, and
//! corrections of the gains of its terms if the profile allows them.

use serde::{Deserialize, Serialize};

use super::certainty::{Certainty, Occasion};
use super::comparison::{Comparison, Credit, Touch, Worse};
use super::error_scale::ErrorScale;
use super::gains::Gains;
use crate::compensation::model::{Model, Reference};
use crate::compensation::settings::ProbeSettings;
use crate::quantity::{Micron, Moment, shifted};

/// Correction of one model from probings: an offset, corrections of the gains, and their certainty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct Learned {
    /// Name of the model that is corrected.
    model: String,
    /// Offset and gains of the model in the profile for which the correction was found.
    corrects: Vec<f64>,
    /// Offset that corrects the model's Cz, µm, inside ±limit.
    pub(super) offset: f64,
    #[serde(default = "Certainty::uncounted")]
    pub(super) certainty: Certainty,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) gains: Option<Gains>,
    /// Earliest time at which a running capture of a reference of the model is complete; `None` if no capture is
    /// running.
    pub(super) renews: Option<Moment>,
    /// Comparison between the model and no compensation, from the last probings.
    #[serde(default, skip_serializing_if = "Comparison::is_empty")]
    pub(super) comparison: Comparison,
    /// Scale of the expected error of the model, from the last probings.
    #[serde(default, skip_serializing_if = "ErrorScale::is_empty")]
    pub(super) scale: ErrorScale,
}

shifted!(Learned: certainty, renews, comparison);

impl Learned {
    pub(in crate::compensation) fn new(model: &Model, settings: Option<&ProbeSettings>) -> Learned {
        let gains = settings.and_then(|settings| settings.gains.map(|gains| (gains, settings.limit.get())));
        let gains = gains.filter(|_| !model.correctable().is_empty());
        let gains = gains.map(|(gains, limit)| Gains::new(model.correctable().len(), gains.limit, limit));
        let (model, corrects) = (model.name.clone(), model.numbers().collect());
        let comparison = settings.map_or_else(Comparison::default, |_| Comparison::new());
        let scale = settings.map_or_else(ErrorScale::default, |_| ErrorScale::new());
        Learned { model, corrects, gains, comparison, scale, ..Learned::default() }
    }

    /// Restores the saved correction of this model, if its offset and gains in the profile are the same. The correction
    /// is clamped to the present bounds.
    pub(super) fn recall(&mut self, kept: &[Learned], settings: &ProbeSettings) {
        let is_same = |kept: &&Learned| kept.model == self.model && kept.corrects == self.corrects;
        let Some(kept) = kept.iter().find(is_same) else { return };
        let limit = settings.limit.get();
        self.offset = kept.offset.clamp(-limit, limit);
        self.certainty = kept.certainty.under(settings);
        self.renews = kept.renews;
        self.comparison.recall(&kept.comparison);
        self.scale.recall(&kept.scale);
        if let (Some(gains), Some(kept)) = (self.gains.take(), kept.gains.clone()) {
            self.gains = Some(kept.restored(gains));
        }
    }

    /// Returns the correction of the model's Cz, µm, inside ±limit. `parts`: present contribution of each term to the
    /// model's Cz, µm.
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

    /// Checks whether the model accepts a probing that demands a correction of `wanted` µm.
    ///
    /// # Errors
    /// Returns the largest deviation from the present correction that would be accepted at once.
    pub(in crate::compensation) fn assess(
        &self,
        wanted: f64,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
        occasion: Occasion,
    ) -> Result<(), Micron> {
        self.certainty.assess(wanted - self.correction(parts, settings), settings.filter, occasion)
    }

    /// Updates the correction with a probing that demands a correction of `wanted` µm. If the probing is not accepted,
    /// it is only stored as doubted. `expected`: expected variance of the residual before scaling, µm², if known.
    pub(in crate::compensation) fn learn(
        &mut self,
        wanted: f64,
        parts: impl Iterator<Item = f64> + Clone,
        settings: &ProbeSettings,
        (occasion, expected): (Occasion, Option<f64>),
    ) {
        let residual = wanted - self.correction(parts.clone(), settings);
        if self.certainty.assess(residual, settings.filter, occasion).is_err() {
            return self.certainty.doubt(residual);
        }
        if let Some(variance) = expected {
            self.scale.take(residual, variance, settings.filter.repeat());
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

    /// Returns the time of the last accepted probing. `None` if no probing was accepted, or if the offset has reached
    /// its limit and may be too small.
    pub(in crate::compensation) fn touched(&self, settings: &ProbeSettings) -> Option<Moment> {
        self.certainty.touched().filter(|_| self.offset.abs() < settings.limit.get())
    }

    /// Returns the factor φ of the expected variance, and the number of probings from which it is calculated.
    pub(in crate::compensation) fn error_scale(&self) -> (f64, u32) {
        (self.scale.factor(), self.scale.touches())
    }

    /// Records that a reference of the model is being captured again, until `complete` at the earliest.
    pub(in crate::compensation) fn renew(&mut self, complete: Moment) {
        self.renews = Some(complete);
    }

    pub(in crate::compensation) fn renews(&self, now: Moment) -> bool {
        self.renews.is_some_and(|complete| now >= complete)
    }

    /// Returns the earliest time at which a running capture of a reference is complete; `None` if no capture is
    /// running.
    pub(in crate::compensation) fn renewal(&self) -> Option<Moment> {
        self.renews
    }

    /// Makes the correction zero at the present inputs, by a new offset. The corrections of the gains stay.
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

    /// Returns the correction for another model, which replaces this model as the preferred model. The offset keeps Cz
    /// at the change, and the certainty is taken over from this correction. The comparison and the scale of the
    /// expected error start again.
    #[must_use]
    pub(in crate::compensation) fn moved_to(
        &self,
        model: &Model,
        settings: &ProbeSettings,
        offset: f64,
    ) -> Learned {
        let limit = settings.limit.get();
        let offset = offset.clamp(-limit, limit);
        Learned { offset, certainty: self.certainty, ..Learned::new(model, Some(settings)) }
    }

    /// Returns the offset that corrects the model's Cz, µm.
    pub(in crate::compensation) fn offset(&self) -> f64 {
        self.offset
    }

    /// Adds the errors of a probing, without compensation and with the model, to the comparison.
    pub(in crate::compensation) fn compare(
        &mut self,
        touch: Touch,
        credit: Credit,
        settings: &ProbeSettings,
    ) {
        self.comparison.take(touch, credit, settings.scatter());
    }

    /// Returns the comparison between the model and no compensation if the model is worse than no compensation; else
    /// `None`.
    pub(in crate::compensation) fn worse(&self) -> Option<Worse> {
        self.comparison.worse()
    }

    pub(super) fn clear(&mut self) {
        (self.offset, self.certainty) = (0.0, Certainty::default());
        self.comparison.clear();
        self.scale.clear();
        if let Some(gains) = &mut self.gains {
            gains.clear();
        }
    }

    pub(super) fn gains(&self) -> &[f64] {
        self.gains.as_ref().map_or(&[], Gains::factors)
    }
}

impl Model {
    /// Returns whether an input of the model is measured from this kind of reference.
    pub(in crate::compensation) fn is_measured_from(&self, reference: Reference) -> bool {
        self.references().any(|known| known == reference)
    }
}
