//! Sensors of an axis's models that are rejected, and the stand-ins that replace them. A stand-in is an estimate from
//! other sensors. A watch checks the sensors of one model.

use super::Axis;
use super::model_choice::ModelRequest;
use crate::compensation::model::{Inputs, Model, StandIns};
use crate::compensation::stand_in::{Bounds, StartEstimate, Watch};
use crate::compensation::substitution::{SubstituteSource, Substitution};
use crate::compensation::{RejectedSensor, SubstitutedSensor};
use crate::compensation::{Snapshot, reference::Machine};
use crate::quantity::Moment;
use crate::reading::SignalId;

/// Check of one model's sensors. `watch` is `None` for a model without stand-ins (estimates from other sensors).
#[derive(Clone, Debug)]
pub(in crate::compensation) struct ModelWatch {
    /// Signals that the model reads.
    reads: Vec<SignalId>,
    pub(in crate::compensation) watch: Option<Watch>,
    /// Substitutes for rejected readings. A sensor in this list was rejected by the watch (sensor check) of
    /// this model, or was found lost by the watch of another model. The list has room for the sensors of all
    /// watches.
    substitutions: Vec<Substitution>,
}

impl ModelWatch {
    pub(super) fn all(models: &[Model]) -> Vec<ModelWatch> {
        let sensors = models.iter().filter_map(|model| model.stand_ins.as_ref()).flat_map(StandIns::watched);
        let sensors = sensors.count();
        let one = |model: &Model| ModelWatch {
            reads: model.signals(),
            watch: model.stand_ins.as_ref().map(|settings| Watch::new(model, settings)),
            substitutions: Vec::with_capacity(sensors),
        };
        models.iter().map(one).collect()
    }

    /// Returns the snapshot as the model uses it: with substitutes for the rejected readings.
    pub(super) fn seen<'a>(&'a self, snapshot: &Snapshot<'a>) -> Snapshot<'a> {
        let is_followed = snapshot.is_followed && self.substitutions.is_empty();
        Snapshot { substitutions: &self.substitutions, is_followed, ..*snapshot }
    }
}

impl Axis {
    /// Checks the readings of the sensors before lags and references use them.
    pub(in crate::compensation) fn check(&mut self, snapshot: &Snapshot<'_>, machine: &Machine) {
        let every = self.settings.every;
        for (settings, model, watch) in self.watches_mut() {
            watch.check((model, settings), snapshot, machine, every);
        }
        self.present();
    }

    /// Updates the lags of the models with this snapshot, even if the axis is not due or not armed. The temperature of
    /// the machine's structure changes anyway.
    pub(in crate::compensation) fn follow(&mut self, snapshot: &Snapshot<'_>, machine: &Machine) {
        let line = self.settings.intercept_slope;
        let reach = line.map_or(0.0, |line| line.reach.get());
        let (zeroing, taught, probe) = (&self.zeroing, &self.probe.models, self.settings.probe.as_ref());
        let models = self.settings.models.iter().enumerate();
        for (((place, model), lags), watched) in models.zip(&mut self.lags).zip(&mut self.watched) {
            let seen = Snapshot { substitutions: &watched.substitutions, ..*snapshot };
            // `for_each` handles the parts of a chain one after the other. This loop takes most of the time of a step.
            let mut all = lags.iter_mut();
            model.rises().for_each(|input| {
                all.next().into_iter().for_each(|lag| lag.follow(input, &seen, machine));
            });
            if let (Some(settings), Some(watch)) = (&model.stand_ins, &mut watched.watch) {
                let target = |inputs: &Inputs<'_>| {
                    let evaluated = model.evaluate(inputs).ok()?;
                    let correction = taught.get(place).zip(probe).map_or(0.0, |(learned, settings)| {
                        learned.correction(model.parts(*inputs), settings)
                    });
                    ModelRequest::of(evaluated, zeroing.of(place)).target(correction, reach)
                };
                let (step, splits_slope) = (self.settings.guard.step, line.is_some());
                let bounds = Bounds { step, splits_slope, target: &target };
                watch.follow((model, settings, bounds), lags, &seen, machine);
            }
        }
        self.present();
    }

    /// Collects the substitutes for each model. The model's own watch (sensor check) gives the substitutes for its
    /// rejected sensors. A sensor that only the watch of another model has found lost gets a substitute without a
    /// value. A watch decides about a frozen sensor for its own model only.
    fn present(&mut self) {
        for place in 0..self.watched.len() {
            let mut substitution = std::mem::take(&mut self.watched[place].substitutions);
            substitution.clear();
            substitution.extend(self.watched[place].watch.iter().flat_map(Watch::substitutions));
            for watch in self.watched.iter().filter_map(|watched| watched.watch.as_ref()) {
                for other in watch.substitutions().iter().filter(|other| !other.frozen) {
                    if !substitution.iter().any(|known| known.signal == other.signal) {
                        substitution.push(Substitution { source: SubstituteSource::None, ..*other });
                    }
                }
            }
            self.watched[place].substitutions = substitution;
        }
    }

    fn watches_mut(&mut self) -> impl Iterator<Item = (&StandIns, &Model, &mut Watch)> {
        let models = self.settings.models.iter().zip(&mut self.watched);
        models
            .filter_map(|(model, watched)| Some((model.stand_ins.as_ref()?, model, watched.watch.as_mut()?)))
    }

    /// Returns the watch (sensor check) of each model that has one, together with the model's virtual sensors.
    fn watches(&self) -> impl Iterator<Item = (&StandIns, &Watch)> {
        let models = self.settings.models.iter().zip(&self.watched);
        models.filter_map(|(model, watched)| model.stand_ins.as_ref().zip(watched.watch.as_ref()))
    }

    /// Returns a sensor that this model requires and whose reading is rejected without a stand-in. `None` if there is
    /// no such sensor.
    pub(super) fn unknown_in(&self, place: usize) -> Option<&Substitution> {
        let watched = self.watched.get(place)?;
        let mut unknown = watched.substitutions.iter().filter(|substitution| !substitution.has_source());
        unknown.find(|substitution| watched.reads.contains(&substitution.signal))
    }

    /// Returns a sensor of the model that a stand-in (estimate from other sensors) replaces; `None` if no sensor is
    /// replaced.
    pub(super) fn substituted(&self, place: usize) -> Option<SubstitutedSensor> {
        let reads = &self.watched.get(place)?.reads;
        let mut found = self.rejected_in(place).filter(|found| reads.contains(&found.signal));
        found.find_map(|RejectedSensor { signal, since, frozen, others }| {
            Some(SubstitutedSensor { signal, since, frozen, others: others? })
        })
    }

    /// Returns the sensors that the watch (sensor check) of this model rejects; no sensors if the model has no watch.
    fn rejected_in(&self, place: usize) -> impl Iterator<Item = RejectedSensor> {
        let watch = self.watched.get(place).and_then(|watched| watched.watch.as_ref());
        let settings = self.settings.models.get(place).and_then(|model| model.stand_ins.as_ref());
        settings.zip(watch).into_iter().flat_map(|(settings, watch)| watch.rejected(settings))
    }

    /// Returns the rejected sensors of the axis, without duplicates. Sensors of the model in use come first,
    /// then sensors of the other models in order. If the model in use has no stand-in for a sensor, the
    /// sensor is returned without a stand-in.
    pub(in crate::compensation) fn rejected(&self) -> impl Iterator<Item = RejectedSensor> {
        let used = self.decision.model;
        let places =
            move || used.into_iter().chain((0..self.watched.len()).filter(move |place| Some(*place) != used));
        places().enumerate().flat_map(move |(turn, place)| {
            let is_new = move |found: &RejectedSensor| {
                let before = places().take(turn).flat_map(|place| self.rejected_in(place));
                !before.map(|known| known.signal).any(|signal| signal == found.signal)
            };
            let others = move |found: RejectedSensor| {
                let others = found.others.filter(|_| used.is_none_or(|used| used == place));
                RejectedSensor { others, ..found }
            };
            self.rejected_in(place).filter(is_new).map(others)
        })
    }

    /// Returns whether the watch (sensor check) of at least one model of the axis rejects the reading of this signal.
    pub(in crate::compensation) fn rejects(&self, signal: SignalId) -> bool {
        self.watches()
            .any(|(_, watch)| watch.substitutions().iter().any(|substitution| substitution.signal == signal))
    }

    /// Returns the sensors from which the stand-in of this signal is estimated, for a model of the axis. `None` if the
    /// model uses the signal's own reading.
    pub(in crate::compensation) fn predictors(
        &self,
        place: usize,
        signal: SignalId,
    ) -> Option<impl Iterator<Item = SignalId>> {
        let watched = self.watched.get(place)?;
        let is_it = |substitution: &Substitution| substitution.signal == signal && substitution.has_source();
        watched.substitutions.iter().any(is_it).then_some(())?;
        Some(self.settings.models.get(place)?.stand_ins.as_ref()?.predictors(signal))
    }

    /// Resets the lags and the checks of the sensors after a machine start.
    pub(super) fn restart_watches(&mut self, now: Moment) {
        for (model, lags) in self.settings.models.iter().zip(&mut self.lags) {
            model.rises().zip(lags).for_each(|(input, lag)| lag.started(input));
        }
        for (settings, model, watch) in self.watches_mut() {
            watch.started(model, settings, now);
        }
        self.present();
    }

    /// Accepts every sensor that has a reading, because the operator has checked the sensors.
    pub(in crate::compensation) fn trust(&mut self, machine: &Machine, now: Moment) {
        for (settings, model, watch) in self.watches_mut() {
            watch.trust((model, settings), machine, now);
        }
        self.present();
    }

    /// Calls `take` for each sensor that was accepted again since the last call, with the estimate of its reading at
    /// machine start. Then discards the estimates.
    pub(in crate::compensation) fn take_beginnings(&mut self, mut take: impl FnMut(SignalId, StartEstimate)) {
        for (settings, _, watch) in self.watches_mut() {
            watch.take_beginnings(settings, &mut take);
        }
    }
}
