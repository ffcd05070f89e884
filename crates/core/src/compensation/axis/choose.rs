//! Which model an axis follows, and how much of what that asks for.

use super::Axis;
use crate::compensation::model::envelope::agreed;
use crate::compensation::model::{
    CLEARLY_INSIDE, Coverage, Evaluated, Inputs, Model, Outputs, Outside, Unusable,
};
use crate::compensation::reference::Machine;
use crate::compensation::{Snapshot, StoodIn};
use crate::quantity::Micron;

/// What the first usable model asks for.
#[derive(Clone, Copy, Debug)]
pub(in crate::compensation) struct Chosen {
    /// Its place in the profile's list.
    pub(in crate::compensation) model: usize,
    /// Cz; where the slope is split off, K0.
    pub(in crate::compensation) raw: Micron,
    /// What of it probings have added.
    pub(super) correction: Micron,
    /// What the slope comes to at the reach.
    pub(super) slope: Micron,
    /// Where the machine is in or outside what the model was identified on.
    pub(super) coverage: Option<Coverage>,
    /// A sensor of it that others stand in for.
    pub(super) stood_in: Option<StoodIn>,
}

/// What a model asks for from its datum on, µm and µm/mm.
pub(super) struct Asked {
    pub(super) cz: f64,
    slope: f64,
    /// What all of it, with its correction, is still to be multiplied with.
    gain: f64,
    coverage: Option<Coverage>,
}

impl Axis {
    pub(super) fn evaluate(
        &self,
        place: usize,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> Result<Evaluated, Unusable> {
        if let Some(unknown) = self.unknown_in(place) {
            return Err(unknown.into());
        }
        let (model, inputs) = self.model(place, snapshot, machine).ok_or(Unusable::NotANumber)?;
        model.evaluate(&inputs)
    }

    /// A model, and what it is evaluated from.
    pub(super) fn model<'a>(
        &'a self,
        place: usize,
        snapshot: &'a Snapshot<'a>,
        machine: &'a Machine,
    ) -> Option<(&'a Model, Inputs<'a>)> {
        let lags = self.lags.get(place).map(Vec::as_slice).unwrap_or_default();
        let snapshot = self.watched.get(place)?.seen(snapshot);
        let inputs =
            Inputs { snapshot, machine, lags, splits_slope: self.settings.intercept_slope.is_some() };
        Some((self.settings.models.get(place)?, inputs))
    }

    /// The first model whose signals are all good, with its value, what the preferred one lacks, and the first fallback model that is
    /// outside its own envelope, which is not used there. One that only waits for a reference or for the machine's start is waited for:
    /// fallback models stand in for broken sensors.
    pub(in crate::compensation) fn choose(
        &self,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> (Option<Chosen>, Option<Unusable>, Option<usize>) {
        let (mut lacks, mut outside) = (None, None);
        for place in 0..self.settings.models.len() {
            match self.evaluate(place, snapshot, machine) {
                Ok(evaluated) if self.is_fallback_outside(place, &evaluated) => {
                    outside = outside.or(Some(place));
                }
                Ok(evaluated) => {
                    let correction = self.correction(place, snapshot, machine);
                    return (self.chosen(place, evaluated, correction), lacks, outside);
                }
                Err(reason @ (Unusable::Reference(_) | Unusable::MachineOff)) => {
                    return (None, lacks.or(Some(reason)), outside);
                }
                Err(reason) => lacks = lacks.or(Some(reason)),
            }
        }
        (None, lacks, outside)
    }

    /// Returns whether this is a fallback model outside its own envelope. One that was outside is until it is clearly inside.
    fn is_fallback_outside(&self, place: usize, evaluated: &Evaluated) -> bool {
        let has_envelope = self.settings.models.get(place).is_some_and(|model| model.envelope.is_some());
        let edge = if self.fallback_outside == Some(place) { CLEARLY_INSIDE } else { 0.0 };
        place > 0 && has_envelope && evaluated.coverage.is_some_and(|coverage| coverage.excess > edge)
    }

    /// What it asks for from its datum on. Where its envelope shrinks it, what is left of the datum and of the correction
    /// shrinks with it: far outside Cz goes to zero. What its halves agree on is the model's own; a correction was measured.
    pub(super) fn chosen(&self, model: usize, evaluated: Evaluated, correction: f64) -> Option<Chosen> {
        let asked = self.asked(model, evaluated);
        let reach = self.settings.intercept_slope.map_or(0.0, |line| line.reach.get());
        let (raw, slope) = asked.target(correction, reach)?;
        Some(Chosen {
            model,
            raw,
            correction: Micron::new(correction * asked.gain)?,
            slope,
            coverage: asked.coverage,
            stood_in: self.stood_in(model),
        })
    }

    /// What a model asks for from its datum on, as far as its halves agree where they have to.
    pub(super) fn asked(&self, model: usize, evaluated: Evaluated) -> Asked {
        Asked::of(evaluated, self.zeroing.of(model))
    }
}

impl Asked {
    /// What a model asks for from this datum on, as far as its halves agree where they have to.
    pub(super) fn of(evaluated: Evaluated, datum: Outputs) -> Asked {
        let Evaluated { outputs, mut coverage } = evaluated;
        let cz = outputs.cz.get() - datum.cz.get();
        let slope = outputs.slope.get() - datum.slope.get();
        let Some(Coverage { excess, extrapolating: Some(found) }) = &mut coverage else {
            return Asked { cz, slope, gain: 1.0, coverage };
        };
        if found.outside != Outside::Agree {
            return Asked { cz, slope, gain: found.gain, coverage };
        }
        let apart = outputs.apart - datum.apart;
        found.gain = agreed(*excess, cz, apart.get());
        found.apart = Some(apart);
        Asked { cz: cz * found.gain, slope: slope * found.gain, gain: 1.0, coverage }
    }

    /// Cz with this correction, and what the slope comes to at the reach, mm; `None` where one is no finite number.
    pub(super) fn target(&self, correction: f64, reach: f64) -> Option<(Micron, Micron)> {
        let cz = Micron::new((self.cz + correction) * self.gain)?;
        Some((cz, Micron::new(self.slope * self.gain * reach)?))
    }
}
