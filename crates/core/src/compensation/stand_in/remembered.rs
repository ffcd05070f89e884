//! What of a watch is worth keeping: all of it, so that a log goes on in a new file as the gateway did.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::bank::Mean;
use super::{Gathered, PAUSE, Sensor, Watch};
use crate::compensation::model::stand_ins::StandIns;
use crate::compensation::model::{Lag, Lagged, Model};
use crate::quantity::{Moment, shifted};

/// The memory of the watch over one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct WatchRemembered {
    pub(in crate::compensation) model: String,
    /// Of the file; one that is another begins anew.
    pub(in crate::compensation) file: u64,
    /// The gains and the offset that the profile gives the model.
    numbers: Vec<f64>,
    /// What its terms read.
    #[serde(default)]
    terms: Vec<TermOfModel>,
    sensors: Vec<Sensor>,
    bank: Vec<GatheredRemembered>,
    shadows: Vec<Option<Lagged>>,
    until: Option<Moment>,
    #[serde(default)]
    looked: Option<Moment>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct GatheredRemembered {
    lagged: Option<Lagged>,
    #[serde(default)]
    ready: Moment,
    #[serde(default)]
    own: Mean,
    #[serde(default)]
    lent: Mean,
    #[serde(default)]
    beyond: bool,
}

/// By place in the list of signals, with the time constant of its lag.
type TermOfModel = (usize, Option<Duration>);

/// What a model's terms read.
fn terms(model: &Model) -> impl Iterator<Item = TermOfModel> {
    model.rises().map(|input| (input.signal.0, input.time_constant()))
}

shifted!(WatchRemembered: sensors, bank, shadows, until, looked);
shifted!(GatheredRemembered: lagged, ready);

impl WatchRemembered {
    /// The same after the profile has changed: `place` finds a signal's new place by its old one. Whether it has all of them.
    pub(in crate::compensation) fn moves(&mut self, place: impl Fn(usize) -> Option<usize>) -> bool {
        self.terms.iter_mut().all(|(signal, _)| place(*signal).inspect(|new| *signal = *new).is_some())
    }

    /// What follows a temperature goes on over the time that nobody counted; what was predicted before that does not.
    pub(in crate::compensation) fn away(&mut self, span: Duration) {
        if span > PAUSE {
            self.sensors.iter_mut().for_each(Sensor::pause);
            self.until = None;
            self.bank.iter_mut().for_each(|gathered| {
                (gathered.own, gathered.lent) = (Mean::default(), Mean::default());
            });
        }
        let lags = self.bank.iter_mut().map(|gathered| &mut gathered.lagged).chain(&mut self.shadows);
        lags.flatten().for_each(|lagged| *lagged = lagged.away(span));
    }
}

impl Watch {
    pub(in crate::compensation) fn remembered(&self, model: &Model, settings: &StandIns) -> WatchRemembered {
        let bank = self.bank.iter().map(|gathered| GatheredRemembered {
            lagged: gathered.lag.kept(),
            ready: gathered.ready,
            own: gathered.own,
            lent: gathered.lent,
            beyond: gathered.beyond,
        });
        WatchRemembered {
            model: model.name.clone(),
            file: settings.fingerprint(),
            numbers: model.numbers().collect(),
            terms: terms(model).collect(),
            sensors: self.sensors.clone(),
            bank: bank.collect(),
            shadows: self.shadows.iter().map(Lag::kept).collect(),
            until: self.until,
            looked: self.looked,
        }
    }

    /// Takes up what was kept of this model with this file.
    pub(in crate::compensation) fn recall(
        &mut self,
        kept: &WatchRemembered,
        model: &Model,
        settings: &StandIns,
    ) {
        let sizes = (kept.sensors.len(), kept.bank.len(), kept.shadows.len());
        let is_same = kept.file == settings.fingerprint()
            && kept.numbers.iter().copied().eq(model.numbers())
            && kept.terms.iter().copied().eq(terms(model));
        if !is_same || sizes != (self.sensors.len(), self.bank.len(), self.shadows.len()) {
            return;
        }
        let lag = |lagged: Option<Lagged>| lagged.map_or(Lag::default(), Lag::recalled);
        self.sensors.clone_from(&kept.sensors);
        self.shadows = kept.shadows.iter().copied().map(lag).collect();
        let bank = kept.bank.iter();
        self.bank = bank
            .map(|kept| {
                let GatheredRemembered { lagged, ready, own, lent, beyond } = *kept;
                Gathered { lag: lag(lagged), ready, own, lent, beyond }
            })
            .collect();
        (self.until, self.looked) = (kept.until, kept.looked);
    }
}
