//! Expected error of the model in use, depending on the time since its datum (zero point) and since the last probing.

use std::time::Duration;

use super::{Axis, ModelChoice};
use crate::compensation::model::Model;
use crate::compensation::reference::Machine;
use crate::quantity::{Micron, Moment};

impl Axis {
    /// Returns the expected residual error of this model: one standard deviation. `None` outside the envelope, while a
    /// stand-in replaces a sensor, or if the profile gives no expected error. The expected error was identified without
    /// stand-ins.
    pub(super) fn expected(&self, chosen: &ModelChoice, now: Moment, machine: &Machine) -> Option<Micron> {
        let is_outside = chosen.coverage.is_some_and(|coverage| coverage.extrapolating.is_some());
        let is_tried = !is_outside && chosen.stood_in.is_none();
        let expected = self.settings.models.get(chosen.model)?.expected.filter(|_| is_tried)?;
        let learned = self.settings.probe.as_ref().zip(self.probe.models.get(chosen.model));
        let touched = learned.and_then(|(settings, learned)| learned.touched(settings));
        let since_touch = touched.map(|touched| now.since(touched));
        expected.after(self.since_datum(chosen.model, now, machine), since_touch)
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
