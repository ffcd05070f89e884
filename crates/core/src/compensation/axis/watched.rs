//! What of an axis's models is stood in for, and what cannot be used at all.

use super::Axis;
use super::choose::Asked;
use crate::compensation::instead::{Instead, Says};
use crate::compensation::model::{Inputs, Model, StandIns};
use crate::compensation::stand_in::{Beginning, Bounds, Watch};
use crate::compensation::{Distrusted, StoodIn};
use crate::compensation::{Snapshot, reference::Machine};
use crate::quantity::Moment;
use crate::reading::SignalId;

/// The watch over one model, where it has stand-ins.
#[derive(Clone, Debug)]
pub(in crate::compensation) struct Watched {
    /// The signals that the model reads.
    reads: Vec<SignalId>,
    pub(in crate::compensation) watch: Option<Watch>,
    /// What is used instead of readings: what its own watch does not believe, and what another one of the axis knows to be lost.
    /// It never grows beyond the sensors of all of them.
    instead: Vec<Instead>,
}

impl Watched {
    pub(super) fn all(models: &[Model]) -> Vec<Watched> {
        let sensors = models.iter().filter_map(|model| model.stand_ins.as_ref()).flat_map(StandIns::watched);
        let sensors = sensors.count();
        let one = |model: &Model| Watched {
            reads: model.signals(),
            watch: model.stand_ins.as_ref().map(|settings| Watch::new(model, settings)),
            instead: Vec::with_capacity(sensors),
        };
        models.iter().map(one).collect()
    }

    /// The readings as the model sees them.
    pub(super) fn seen<'a>(&'a self, snapshot: &Snapshot<'a>) -> Snapshot<'a> {
        let is_followed = snapshot.is_followed && self.instead.is_empty();
        Snapshot { instead: &self.instead, is_followed, ..*snapshot }
    }
}

impl Axis {
    /// Looks at the readings, before anything goes on to them.
    pub(in crate::compensation) fn look(&mut self, snapshot: &Snapshot<'_>, machine: &Machine) {
        let every = self.settings.every;
        for (settings, model, watch) in self.watches_mut() {
            watch.look((model, settings), snapshot, machine, every);
        }
        self.present();
    }

    /// The lags go on to this snapshot, those of an axis that is not due or not armed too: its structure does not wait.
    pub(in crate::compensation) fn follow(&mut self, snapshot: &Snapshot<'_>, machine: &Machine) {
        let line = self.settings.intercept_slope;
        let reach = line.map_or(0.0, |line| line.reach.get());
        let (zeroing, taught, probe) = (&self.zeroing, &self.probe.models, self.settings.probe.as_ref());
        let models = self.settings.models.iter().enumerate();
        for (((place, model), lags), watched) in models.zip(&mut self.lags).zip(&mut self.watched) {
            let seen = Snapshot { instead: &watched.instead, ..*snapshot };
            // By `for_each`, which takes the parts of a chain one after the other: this is most of what a step does.
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
                    Asked::of(evaluated, zeroing.of(place)).target(correction, reach)
                };
                let (step, splits_slope) = (self.settings.guard.step, line.is_some());
                let bounds = Bounds { step, splits_slope, target: &target };
                watch.follow((model, settings, bounds), lags, &seen, machine);
            }
        }
        self.present();
    }

    /// Every model sees what its own watch says, and uses nothing that another watch of the axis knows to be lost. Of one that is frozen
    /// each watch decides for its own model.
    fn present(&mut self) {
        for place in 0..self.watched.len() {
            let mut instead = std::mem::take(&mut self.watched[place].instead);
            instead.clear();
            instead.extend(self.watched[place].watch.iter().flat_map(Watch::instead));
            for watch in self.watched.iter().filter_map(|watched| watched.watch.as_ref()) {
                for other in watch.instead().iter().filter(|other| !other.frozen) {
                    if !instead.iter().any(|known| known.signal == other.signal) {
                        instead.push(Instead { says: Says::Nobody, ..*other });
                    }
                }
            }
            self.watched[place].instead = instead;
        }
    }

    fn watches_mut(&mut self) -> impl Iterator<Item = (&StandIns, &Model, &mut Watch)> {
        let models = self.settings.models.iter().zip(&mut self.watched);
        models
            .filter_map(|(model, watched)| Some((model.stand_ins.as_ref()?, model, watched.watch.as_mut()?)))
    }

    /// Each watch, with what it goes by.
    fn watches(&self) -> impl Iterator<Item = (&StandIns, &Watch)> {
        let models = self.settings.models.iter().zip(&self.watched);
        models.filter_map(|(model, watched)| model.stand_ins.as_ref().zip(watched.watch.as_ref()))
    }

    /// A sensor that a model reads, that one of the axis's watches does not believe, and that nothing stands in for there.
    pub(super) fn unknown_in(&self, place: usize) -> Option<&Instead> {
        let watched = self.watched.get(place)?;
        let mut unknown = watched.instead.iter().filter(|instead| !instead.is_stood_in());
        unknown.find(|instead| watched.reads.contains(&instead.signal))
    }

    /// A signal that a model reads and that others stand in for.
    pub(super) fn stood_in(&self, place: usize) -> Option<StoodIn> {
        let reads = &self.watched.get(place)?.reads;
        let mut found = self.distrusted_in(place).filter(|found| reads.contains(&found.signal));
        found.find_map(|Distrusted { signal, since, frozen, others }| {
            Some(StoodIn { signal, since, frozen, others: others? })
        })
    }

    /// What the watch over a model does not believe.
    fn distrusted_in(&self, place: usize) -> impl Iterator<Item = Distrusted> {
        let watch = self.watched.get(place).and_then(|watched| watched.watch.as_ref());
        let settings = self.settings.models.get(place).and_then(|model| model.stand_ins.as_ref());
        settings.zip(watch).into_iter().flat_map(|(settings, watch)| watch.distrusted(settings))
    }

    /// The sensors that the axis does not believe, each once: as the model in use has it, else as the first that watches it.
    /// What the model in use does not take from others is taken from nobody.
    pub(in crate::compensation) fn distrusted(&self) -> impl Iterator<Item = Distrusted> {
        let used = self.decision.model;
        let places =
            move || used.into_iter().chain((0..self.watched.len()).filter(move |place| Some(*place) != used));
        places().enumerate().flat_map(move |(turn, place)| {
            let is_new = move |found: &Distrusted| {
                let before = places().take(turn).flat_map(|place| self.distrusted_in(place));
                !before.map(|known| known.signal).any(|signal| signal == found.signal)
            };
            let others = move |found: Distrusted| {
                let others = found.others.filter(|_| used.is_none_or(|used| used == place));
                Distrusted { others, ..found }
            };
            self.distrusted_in(place).filter(is_new).map(others)
        })
    }

    /// Whether one of its watches does not believe this signal.
    pub(in crate::compensation) fn distrusts(&self, signal: SignalId) -> bool {
        self.watches().any(|(_, watch)| watch.instead().iter().any(|instead| instead.signal == signal))
    }

    /// Those whose readings a model's value for this signal comes from; none where it is its own reading.
    pub(in crate::compensation) fn predictors(
        &self,
        place: usize,
        signal: SignalId,
    ) -> Option<impl Iterator<Item = SignalId>> {
        let watched = self.watched.get(place)?;
        let is_it = |instead: &Instead| instead.signal == signal && instead.is_stood_in();
        watched.instead.iter().any(is_it).then_some(())?;
        Some(self.settings.models.get(place)?.stand_ins.as_ref()?.predictors(signal))
    }

    /// The machine was started: what was watched begins anew.
    pub(super) fn watch_anew(&mut self, now: Moment) {
        for (model, lags) in self.settings.models.iter().zip(&mut self.lags) {
            model.rises().zip(lags).for_each(|(input, lag)| lag.started(input));
        }
        for (settings, model, watch) in self.watches_mut() {
            watch.started(model, settings, now);
        }
        self.present();
    }

    /// A person has looked: whatever reads something is believed.
    pub(in crate::compensation) fn trust(&mut self, machine: &Machine, now: Moment) {
        for (settings, model, watch) in self.watches_mut() {
            watch.trust((model, settings), machine, now);
        }
        self.present();
    }

    /// Of each sensor that was believed again since this was asked: what it began from.
    pub(in crate::compensation) fn take_beginnings(&mut self, mut take: impl FnMut(SignalId, Beginning)) {
        for (settings, _, watch) in self.watches_mut() {
            watch.take_beginnings(settings, &mut take);
        }
    }
}
