//! Probings of an axis: measurements of the error that remains. The axis checks each measured error and corrects its
//! models with it, or discards all corrections on demand. With a new datum (zero point of Cz), the corrections start
//! again from zero. The envelope of a model is the region of inputs on which the model was identified.

use std::time::Duration;

use super::Axis;
use crate::compensation::model::{Coverage, Model, Outside, Reference};
use crate::compensation::probe::{Credit, Measured, Occasion, Probed, Refused, Touch};
use crate::compensation::reference::Machine;
use crate::compensation::settings::{Datum, ProbeSettings};
use crate::compensation::{Control, Snapshot};
use crate::quantity::{Micron, Moment};

impl Axis {
    /// Returns the correction of a model's Cz at the present inputs, from probings, µm. `place`: index of the model.
    pub(super) fn correction(&self, place: usize, snapshot: &Snapshot<'_>, machine: &Machine) -> f64 {
        let (Some(settings), Some(learned)) = (&self.settings.probe, self.probe.models.get(place)) else {
            return 0.0;
        };
        let Some((model, inputs)) = self.model(place, snapshot, machine) else { return 0.0 };
        learned.correction(model.parts(inputs), settings)
    }

    /// Records that a reference of the models is being captured again. The capture is complete at `complete` at the
    /// earliest.
    pub(super) fn renew(&mut self, reference: Reference, complete: Moment) {
        let by_datum = reference == Reference::Zero && self.settings.datum == Datum::Zero;
        for (model, learned) in self.settings.models.iter().zip(&mut self.probe.models) {
            if by_datum || model.is_measured_from(reference) {
                learned.renew(complete);
            }
        }
    }

    /// Returns the time at which the last reference or datum (zero point of Cz) of the models was captured. While a
    /// capture is running, returns its start, which is `settle` before its end. `None` if all references of the models
    /// are fixed numbers.
    pub(in crate::compensation) fn datum(
        &self,
        now: Moment,
        machine: &Machine,
        settle: Duration,
    ) -> Option<Moment> {
        let ranked = self.ranked().filter_map(|place| self.settings.models.get(place));
        let rises = ranked.flat_map(Model::rises);
        let ages = rises.filter_map(|input| machine.age(input.reference, input.signal, now));
        let corrections = self.ranked().filter_map(|place| self.probe.models.get(place));
        let begun = corrections.filter_map(|learned| learned.renewal());
        let begun = begun.map(|complete| complete.before(settle));
        ages.map(|age| now.before(age)).chain(self.zeroing.at()).chain(begun).max()
    }

    /// Applies the demands of `control` about probings: discards the corrections, or corrects the models with a
    /// measured error. Returns `true` if the references of the preferred or of the learned model have just been
    /// captured. On an axis with the datum (zero point of Cz) "zero", returns `false`.
    pub(super) fn be_taught(&mut self, snapshot: &Snapshot<'_>, machine: &Machine, control: Control) -> bool {
        let Some(settings) = self.settings.probe else { return false };
        let at_datum = self.restart(snapshot, machine, &settings);
        if control.forget {
            self.probe.clear();
            self.decision.worse = None;
        }
        let Some(measured) = control.measured else { return at_datum };
        let probed = self.assess(snapshot, machine, measured);
        self.compare(&probed, snapshot, machine, &settings);
        if matches!(probed.refused, None | Some(Refused::Doubted(_))) {
            self.learn(&probed, snapshot, machine, &settings);
        }
        self.probe.note(probed);
        at_datum
    }

    /// Resets the correction of each model whose datum or references have just been captured completely. Returns
    /// whether the preferred or the learned model is among them. On an axis with the datum "zero", returns `false`,
    /// because only a zero command sets that datum.
    fn restart(&mut self, snapshot: &Snapshot<'_>, machine: &Machine, settings: &ProbeSettings) -> bool {
        if self.zeroing.is_open() {
            return false;
        }
        let (preferred, mut at_datum) = (self.preferred(), false);
        let mut models = std::mem::take(&mut self.probe.models);
        for (place, learned) in models.iter_mut().enumerate() {
            let Some((model, inputs)) = self.model(place, snapshot, machine) else { continue };
            if learned.renews(snapshot.now) && model.outputs(&inputs).is_ok() {
                learned.begin_here(model.parts(inputs), settings);
                at_datum |= preferred == Some(place) || self.is_slot(place);
            }
        }
        self.probe.models = models;
        at_datum && self.settings.datum != Datum::Zero
    }

    /// Returns the result that a probing with this measured error would have for the model in use. The axis does not
    /// change.
    pub(in crate::compensation) fn assess(
        &self,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
        measured: Measured,
    ) -> Probed {
        let acting = measured.acting.unwrap_or(self.decision.cz);
        let chosen = self.choose(snapshot, machine).0;
        let residual = chosen.map(|chosen| measured.error - acting + chosen.raw);
        let max_error = self.settings.probe.map_or(Micron::ZERO, |settings| settings.max_error);
        let refused = match (chosen, residual) {
            (Some(_), _) if self.tripped => Some(Refused::Tripped),
            (Some(chosen), _) if is_left(chosen.coverage) => Some(Refused::Outside),
            (Some(_), Some(residual)) if residual.abs() > max_error => Some(Refused::Implausible),
            (Some(chosen), Some(_)) => self.doubts(chosen.model, acting - measured.error, snapshot, machine),
            _ => Some(Refused::NoModel),
        };
        Probed { at: snapshot.now, error: measured.error, acting, residual, refused }
    }

    /// Returns why a model does not accept a probing at once. `None` if the model accepts the probing, or if the model
    /// is not corrected with it. `cz`: value of Cz that would have left no error, according to the probing.
    fn doubts(
        &self,
        place: usize,
        cz: Micron,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> Option<Refused> {
        let (settings, learned) = (self.settings.probe?, self.probe.models.get(place)?);
        let (model, inputs) = self.model(place, snapshot, machine)?;
        let missing = self.missing(place, cz, snapshot, machine)?;
        let occasion = self.occasion(place, snapshot.now, machine);
        learned.assess(missing, model.parts(inputs), &settings, occasion).err().map(Refused::Doubted)
    }

    /// Compares the error with and without compensation, for each model that has a value now and that the axis may
    /// follow.
    fn compare(
        &mut self,
        probed: &Probed,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
        settings: &ProbeSettings,
    ) {
        // A model beyond its error level has another alarm, and the axis does not follow it.
        if probed.refused == Some(Refused::Tripped) {
            return;
        }
        for place in 0..self.probe.models.len() {
            if let Some((touch, credit)) = self.touch(place, probed, snapshot, machine) {
                self.probe.models[place].compare(touch, credit, settings);
            }
        }
    }

    /// Returns the errors of a probing, without compensation and with this model, and whether the model accepts the
    /// probing. `None` while a reference of the model is being captured. Also `None` if the axis would keep its value,
    /// because the inputs are outside the envelope.
    fn touch(
        &self,
        place: usize,
        probed: &Probed,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> Option<(Touch, Credit)> {
        let (settings, learned) = (self.settings.probe?, self.probe.models.get(place)?);
        if learned.renewal().is_some() || !self.is_ranked(place) {
            return None;
        }
        let evaluated = self.evaluate(place, snapshot, machine).ok()?;
        let chosen = self.chosen(place, evaluated, self.correction(place, snapshot, machine))?;
        let extrapolating = chosen.coverage.and_then(|coverage| coverage.extrapolating);
        if extrapolating.is_some_and(|found| found.outside == Outside::Hold) {
            return None;
        }
        let without = probed.error - probed.acting;
        let is_plausible = (without + chosen.raw).abs() <= settings.max_error;
        let cz = probed.acting - probed.error;
        let is_accepted = self.doubts(place, cz, snapshot, machine).is_none();
        let credit = if is_plausible && is_accepted { Credit::Accepted } else { Credit::Doubted };
        let with = without + chosen.raw.clamp_to(self.settings.guard.limit);
        Some((Touch { at: snapshot.now, without: without.get(), with: with.get() }, credit))
    }

    /// Corrects each model that has a value now and that the axis may follow. A model whose residual error is beyond
    /// `max_error` is not corrected.
    fn learn(
        &mut self,
        probed: &Probed,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
        settings: &ProbeSettings,
    ) {
        let cz = probed.acting - probed.error;
        let mut models = std::mem::take(&mut self.probe.models);
        for (place, learned) in models.iter_mut().enumerate() {
            let Some((model, inputs)) = self.model(place, snapshot, machine) else { continue };
            let Some(missing) = self.missing(place, cz, snapshot, machine) else { continue };
            let residual = missing - learned.correction(model.parts(inputs), settings);
            if residual.abs() <= settings.max_error.get() {
                let occasion = self.occasion(place, snapshot.now, machine);
                let expected = self.expected_variance(place, learned, snapshot.now, machine);
                learned.learn(missing, model.parts(inputs), settings, (occasion, expected));
            }
        }
        self.probe.models = models;
    }

    /// Returns the correction with which the model would request the value `cz`, µm. `None` if the model has no value,
    /// or if the axis does not follow the model.
    fn missing(&self, place: usize, cz: Micron, snapshot: &Snapshot<'_>, machine: &Machine) -> Option<f64> {
        if !self.is_ranked(place) {
            return None;
        }
        let evaluated = self.evaluate(place, snapshot, machine).ok()?;
        (!is_left(evaluated.coverage)).then(|| cz.get() - self.asked(place, evaluated).cz)
    }

    fn occasion(&self, place: usize, now: Moment, machine: &Machine) -> Occasion {
        Occasion { now, since_datum: self.since_datum(place, now, machine) }
    }
}

/// Returns whether the inputs are outside the envelope and the axis does not fully follow the model there.
/// With `Outside::Agree`, returns `false`: the axis counts as following the model.
fn is_left(coverage: Option<Coverage>) -> bool {
    let found = coverage.and_then(|coverage| coverage.extrapolating);
    let found = found.filter(|found| found.outside != Outside::Agree);
    found.is_some_and(|found| found.outside == Outside::Hold || found.gain < 1.0)
}
