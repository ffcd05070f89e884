//! What of an axis's models is stood in for, and what cannot be used at all.

use super::Axis;
use crate::compensation::StoodIn;
use crate::compensation::model::{Model, StandIns};
use crate::compensation::stand_in::Watch;
use crate::compensation::{Snapshot, reference::Machine};
use crate::quantity::Moment;
use crate::reading::SignalId;

/// The watch over one model, where it has stand-ins.
#[derive(Clone, Debug)]
pub(in crate::compensation) struct Watched {
    /// The signals that the model reads.
    reads: Vec<SignalId>,
    pub(in crate::compensation) watch: Option<Watch>,
}

impl Watched {
    pub(super) fn all(models: &[Model]) -> Vec<Watched> {
        let one = |model: &Model| Watched {
            reads: model.signals(),
            watch: model.stand_ins.as_ref().map(|settings| Watch::new(model, settings)),
        };
        models.iter().map(one).collect()
    }

    /// The readings as the model sees them.
    pub(super) fn seen<'a>(&'a self, snapshot: &Snapshot<'a>) -> Snapshot<'a> {
        let instead = self.watch.as_ref().map_or(&[][..], Watch::instead);
        Snapshot { instead, ..*snapshot }
    }
}

impl Axis {
    /// The lags go on to this snapshot, those of an axis that is not due or not armed too: its structure does not wait.
    pub(in crate::compensation) fn follow(&mut self, snapshot: &Snapshot<'_>, machine: &Machine) {
        for ((model, lags), watched) in self.settings.models.iter().zip(&mut self.lags).zip(&mut self.watched)
        {
            if let (Some(settings), Some(watch)) = (&model.stand_ins, &mut watched.watch) {
                watch.look(settings, snapshot, machine);
            }
            let seen = watched.seen(snapshot);
            for (input, lag) in model.rises().zip(lags.iter_mut()) {
                lag.follow(input, &seen, machine);
            }
            if let (Some(settings), Some(watch)) = (&model.stand_ins, &mut watched.watch) {
                watch.follow((model, settings), lags, snapshot, machine);
            }
        }
    }

    /// Each watch, with what it goes by.
    fn watches(&self) -> impl Iterator<Item = (&StandIns, &Watch)> {
        let models = self.settings.models.iter().zip(&self.watched);
        models.filter_map(|(model, watched)| model.stand_ins.as_ref().zip(watched.watch.as_ref()))
    }

    /// A signal that a model reads, that one of the axis's watches found frozen, and that nothing stands in for there.
    pub(super) fn frozen_in(&self, place: usize) -> Option<SignalId> {
        let watched = self.watched.get(place)?;
        let instead = watched.watch.as_ref().map_or(&[][..], Watch::instead);
        let is_replaced = |id: &&SignalId| instead.iter().any(|instead| instead.signal == **id);
        let is_frozen =
            |id: &&SignalId| self.watches().any(|(settings, watch)| watch.is_frozen(settings, **id));
        let mut reads = watched.reads.iter();
        reads.find(|id| is_frozen(id) && !is_replaced(id)).copied()
    }

    /// A signal that a model reads and that others stand in for.
    pub(super) fn stood_in(&self, place: usize) -> Option<StoodIn> {
        let (model, watched) = (self.settings.models.get(place)?, self.watched.get(place)?);
        let (settings, watch) = model.stand_ins.as_ref().zip(watched.watch.as_ref())?;
        watch.stood_in(settings, |signal| watched.reads.contains(&signal))
    }

    /// Whether others stand in for this signal of this model.
    pub(in crate::compensation) fn is_stood_in(&self, place: usize, signal: SignalId) -> bool {
        let watch = self.watched.get(place).and_then(|watched| watched.watch.as_ref());
        watch.is_some_and(|watch| watch.instead().iter().any(|instead| instead.signal == signal))
    }

    /// A person has looked: whatever reads something is believed.
    pub(super) fn trust(&mut self, now: Moment) {
        self.watched
            .iter_mut()
            .filter_map(|watched| watched.watch.as_mut())
            .for_each(|watch| watch.trust(now));
    }
}
