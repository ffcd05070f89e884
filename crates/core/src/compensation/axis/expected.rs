//! Expected error of the model in use. This error depends on the time since the datum (zero point) of the
//! model, on the time since the last probing, and on the residuals of the last probings. A probing measures
//! the error that remains. The envelope is the region of inputs on which the model was identified.

use std::time::Duration;

use super::{Axis, ModelChoice};
use crate::compensation::model::Model;
use crate::compensation::probe::Learned;
use crate::compensation::reference::Machine;
use crate::quantity::{Micron, Moment};

impl Axis {
    /// Returns the expected residual error of this model: one standard deviation, and the number of probings
    /// whose residuals scale this error. `None` outside the envelope, while a stand-in replaces a sensor, or
    /// if the profile gives no expected error. The expected error was identified without stand-ins.
    pub(super) fn expected(
        &self,
        chosen: &ModelChoice,
        now: Moment,
        machine: &Machine,
    ) -> Option<(Micron, u32)> {
        let is_outside = chosen.coverage.is_some_and(|coverage| coverage.extrapolating.is_some());
        let is_tried = !is_outside && chosen.stood_in.is_none();
        let learned = self.probe.models.get(chosen.model).filter(|_| is_tried)?;
        let expected = self.unscaled(chosen.model, learned, now, machine)?;
        let (factor, touches) = learned.error_scale();
        Some((Micron::new(expected.get() * factor.sqrt())?, touches))
    }

    /// Returns the expected variance of a model, µm², before the residuals of probings scale it; `None` if the profile
    /// gives no expected error.
    pub(super) fn expected_variance(
        &self,
        place: usize,
        learned: &Learned,
        now: Moment,
        machine: &Machine,
    ) -> Option<f64> {
        let expected = self.unscaled(place, learned, now, machine)?.get();
        Some(expected * expected)
    }

    /// Returns the expected error of a model before the residuals of probings scale it. `learned` is the correction of
    /// the model. `None` if the profile gives no expected error.
    fn unscaled(&self, place: usize, learned: &Learned, now: Moment, machine: &Machine) -> Option<Micron> {
        let expected = self.settings.models.get(place)?.expected?;
        let touched = self.settings.probe.as_ref().and_then(|settings| learned.touched(settings));
        let since_touch = touched.map(|touched| now.since(touched));
        expected.after(self.since_datum(place, now, machine), since_touch)
    }

    /// Returns the time since the datum of a model: since its references or the axis's datum were captured. For a model
    /// with fixed references, returns the time since machine start.
    pub(super) fn since_datum(&self, place: usize, now: Moment, machine: &Machine) -> Duration {
        let rises = self.settings.models.get(place).into_iter().flat_map(Model::rises);
        let ages = rises.filter_map(|input| machine.age(input.reference, input.signal, now));
        let own = self.zeroing.at().map(|at| now.since(at));
        ages.chain(own).min().or_else(|| machine.on_time_at_most(now)).unwrap_or_default()
    }
}
