//! What one model has learned: an offset, and where the profile allows it the gains of its terms.

use super::gains::Gains;
use crate::compensation::model::{Model, Reference};
use crate::compensation::settings::ProbeSettings;
use crate::quantity::Moment;

/// What probings have taught one model.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::compensation) struct Learned {
    /// µm, inside ±limit.
    pub(super) offset: f64,
    pub(super) gains: Option<Gains>,
    /// What the model is measured from is being captured anew, and that is complete here at the earliest.
    pub(super) renews: Option<Moment>,
}

impl Learned {
    pub(super) fn new(model: &Model, settings: Option<&ProbeSettings>) -> Learned {
        let gains = settings.and_then(|settings| settings.gains.map(|gains| (gains, settings.limit.get())));
        let gains = gains.filter(|_| !model.correctable().is_empty());
        let gains = gains.map(|(gains, limit)| Gains::new(model.correctable().len(), gains.limit, limit));
        Learned { offset: 0.0, gains, renews: None }
    }

    /// What it adds to the model's Cz, µm, inside ±limit. `parts`: what each gain contributes to the model's Cz now.
    pub(in crate::compensation) fn correction(
        &self,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
    ) -> f64 {
        let limit = settings.limit.get();
        let total = self.offset + self.gains.as_ref().map_or(0.0, |gains| gains.change(parts));
        // Only parts that are no numbers themselves, of which the model makes none either, come to NaN.
        if total.is_nan() { 0.0 } else { total.clamp(-limit, limit) }
    }

    /// Learns that the correction should have been `wanted` µm.
    pub(in crate::compensation) fn learn(
        &mut self,
        wanted: f64,
        parts: impl Iterator<Item = f64> + Clone,
        settings: &ProbeSettings,
    ) {
        if let (Some(gains), Some(bounds)) = (&mut self.gains, &settings.gains) {
            gains.learn(wanted, parts.clone(), bounds.forgetting);
        }
        let rest = wanted - self.correction(parts, settings);
        let limit = settings.limit.get();
        let offset = (self.offset + settings.filter * rest).clamp(-limit, limit);
        self.offset = if offset.is_nan() { self.offset } else { offset };
    }

    /// What the model is measured from is captured anew, if this is what it is measured from.
    pub(in crate::compensation) fn renew(&mut self, complete: Moment) {
        self.renews = Some(complete);
    }

    pub(in crate::compensation) fn renews(&self, now: Moment) -> bool {
        self.renews.is_some_and(|complete| now >= complete)
    }

    /// The correction begins at nothing here; the gains go on from this point.
    pub(in crate::compensation) fn begin_here(
        &mut self,
        parts: impl Iterator<Item = f64>,
        settings: &ProbeSettings,
    ) {
        self.renews = None;
        let limit = settings.limit.get();
        let change = self.gains.as_ref().map_or(0.0, |gains| gains.change(parts));
        self.offset = if change.is_nan() { 0.0 } else { (-change).clamp(-limit, limit) };
        if let Some(gains) = &mut self.gains {
            gains.begin_at(self.offset);
        }
    }

    pub(super) fn clear(&mut self) {
        self.offset = 0.0;
        if let Some(gains) = &mut self.gains {
            gains.clear();
        }
    }

    pub(super) fn gains(&self) -> &[f64] {
        self.gains.as_ref().map_or(&[], Gains::factors)
    }
}

impl Model {
    /// Some rise of it is measured from this captured reference.
    pub(in crate::compensation) fn is_measured_from(&self, reference: Reference) -> bool {
        self.references().any(|known| known == reference)
    }
}
