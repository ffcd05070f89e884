//! What of a watch is worth keeping: all of it, so that a log goes on in a new file as the gateway did.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{Gathered, Sensor, Watch};
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
    sensors: Vec<Sensor>,
    bank: Vec<GatheredRemembered>,
    shadows: Vec<Option<Lagged>>,
    count: u32,
    until: Option<Moment>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct GatheredRemembered {
    lagged: Option<Lagged>,
    sum: f64,
    missed: bool,
}

shifted!(WatchRemembered: sensors, bank, shadows, until);
shifted!(GatheredRemembered: lagged);

impl WatchRemembered {
    /// What follows a temperature goes on over the time that nobody counted.
    pub(in crate::compensation) fn away(&mut self, span: Duration) {
        let lags = self.bank.iter_mut().map(|gathered| &mut gathered.lagged).chain(&mut self.shadows);
        lags.flatten().for_each(|lagged| *lagged = lagged.away(span));
    }
}

impl Watch {
    pub(in crate::compensation) fn remembered(&self, model: &Model, settings: &StandIns) -> WatchRemembered {
        let bank = self.bank.iter().map(|gathered| GatheredRemembered {
            lagged: gathered.lag.kept(),
            sum: gathered.sum,
            missed: gathered.missed,
        });
        WatchRemembered {
            model: model.name.clone(),
            file: settings.fingerprint(),
            numbers: model.numbers().collect(),
            sensors: self.sensors.clone(),
            bank: bank.collect(),
            shadows: self.shadows.iter().map(Lag::kept).collect(),
            count: self.count,
            until: self.until,
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
        let is_same = kept.file == settings.fingerprint() && kept.numbers.iter().copied().eq(model.numbers());
        if !is_same || sizes != (self.sensors.len(), self.bank.len(), self.shadows.len()) {
            return;
        }
        let lag = |lagged: Option<Lagged>| lagged.map_or(Lag::default(), Lag::recalled);
        self.sensors.clone_from(&kept.sensors);
        self.shadows = kept.shadows.iter().copied().map(lag).collect();
        let bank = kept.bank.iter();
        self.bank =
            bank.map(|kept| Gathered { lag: lag(kept.lagged), sum: kept.sum, missed: kept.missed }).collect();
        (self.count, self.until) = (kept.count, kept.until);
    }
}
