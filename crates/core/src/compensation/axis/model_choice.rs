//! Selection of the model that an axis follows, and of the value that the model requests. The models after the
//! preferred model are its fallbacks.

use super::Axis;
use crate::compensation::model::envelope::agreed;
use crate::compensation::model::{
    CLEARLY_INSIDE, Coverage, Evaluated, Inputs, Model, Outputs, Outside, Unusable,
};
use crate::compensation::reference::Machine;
use crate::compensation::{Snapshot, SubstitutedSensor};
use crate::quantity::Micron;

/// Values that the first usable model of an axis requests.
#[derive(Clone, Copy, Debug)]
pub(in crate::compensation) struct ModelChoice {
    /// Index of the model in the profile's list.
    pub(in crate::compensation) model: usize,
    /// Requested Cz with the correction. It is K0 (Cz at the reference position P0, where the slope has no effect) if
    /// the control applies the slope itself.
    pub(in crate::compensation) raw: Micron,
    /// Correction from probings, which `raw` contains.
    pub(super) correction: Micron,
    /// Part of the compensation that depends on the position (slope times distance), at the axis's largest distance
    /// from the reference position.
    pub(super) slope: Micron,
    /// Position of the inputs: inside the envelope (region on which the model was identified), or how far outside.
    pub(super) coverage: Option<Coverage>,
    /// Sensor of the model that a stand-in (estimate from other sensors) replaces; `None` if no sensor is replaced.
    pub(super) stood_in: Option<SubstitutedSensor>,
}

/// Values that a model requests, measured from its datum (zero point), in µm and µm/mm.
pub(super) struct ModelRequest {
    pub(super) cz: f64,
    slope: f64,
    /// Factor of the envelope for the sum of Cz and correction, and for the slope. It is 1 if the envelope does not
    /// reduce this sum.
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

    /// Returns the model with this index and its inputs; `None` if there is no such model.
    pub(in crate::compensation) fn model<'a>(
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

    /// Returns the first model in the order of preference whose signals are all good, with its value. Also
    /// returns why the preferred model cannot be used, and the first fallback model that was skipped because
    /// its inputs are outside its own envelope. If a model only waits for a reference or for the machine
    /// start, no fallback model is used: fallback models are for failed sensors.
    pub(in crate::compensation) fn choose(
        &self,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> (Option<ModelChoice>, Option<Unusable>, Option<usize>) {
        let (mut lacks, mut outside) = (None, None);
        for place in self.ranked() {
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

    /// Returns whether this is a fallback model whose inputs are outside its own envelope. After inputs were outside,
    /// they count as inside again only when they are clearly inside.
    fn is_fallback_outside(&self, place: usize, evaluated: &Evaluated) -> bool {
        let has_envelope = self.settings.models.get(place).is_some_and(|model| model.envelope.is_some());
        let edge = if self.fallback_outside == Some(place) { CLEARLY_INSIDE } else { 0.0 };
        let is_fallback = self.preferred() != Some(place);
        is_fallback && has_envelope && evaluated.coverage.is_some_and(|coverage| coverage.excess > edge)
    }

    /// Returns the values that a model requests, measured from its datum (zero point), with the correction. With
    /// `Outside::Shrink`, the envelope reduces datum and correction together with the value: far outside, Cz goes to
    /// zero. With `Outside::Agree`, the envelope reduces only the value of the model, because the correction was
    /// measured.
    pub(super) fn chosen(&self, model: usize, evaluated: Evaluated, correction: f64) -> Option<ModelChoice> {
        let asked = self.asked(model, evaluated);
        let reach = self.settings.intercept_slope.map_or(0.0, |line| line.reach.get());
        let (raw, slope) = asked.target(correction, reach)?;
        Some(ModelChoice {
            model,
            raw,
            correction: Micron::new(correction * asked.gain)?,
            slope,
            coverage: asked.coverage,
            stood_in: self.substituted(model),
        })
    }

    /// Returns the values that a model requests, measured from its datum (zero point). With `Outside::Agree`,
    /// the values are reduced if the model's two halves differ. The halves are the two models whose mean is
    /// this model.
    pub(super) fn asked(&self, model: usize, evaluated: Evaluated) -> ModelRequest {
        ModelRequest::of(evaluated, self.zeroing.of(model))
    }
}

impl ModelRequest {
    /// Returns the values that a model requests, measured from the zero point `datum`. With `Outside::Agree`,
    /// the values are reduced if the model's two halves differ. The halves are the two models whose mean is
    /// this model.
    pub(super) fn of(evaluated: Evaluated, datum: Outputs) -> ModelRequest {
        let Evaluated { outputs, mut coverage } = evaluated;
        let cz = outputs.cz.get() - datum.cz.get();
        let slope = outputs.slope.get() - datum.slope.get();
        let Some(Coverage { excess, extrapolating: Some(found) }) = &mut coverage else {
            return ModelRequest { cz, slope, gain: 1.0, coverage };
        };
        if found.outside != Outside::Agree {
            return ModelRequest { cz, slope, gain: found.gain, coverage };
        }
        let apart = outputs.apart - datum.apart;
        found.gain = agreed(*excess, cz, apart.get());
        found.apart = Some(apart);
        ModelRequest { cz: cz * found.gain, slope: slope * found.gain, gain: 1.0, coverage }
    }

    /// Returns Cz with this correction, and the position-dependent part of the compensation: the slope times the
    /// distance `reach`, mm. `None` if a result is not finite.
    pub(super) fn target(&self, correction: f64, reach: f64) -> Option<(Micron, Micron)> {
        let cz = Micron::new((self.cz + correction) * self.gain)?;
        Some((cz, Micron::new(self.slope * self.gain * reach)?))
    }
}
