//! The stuck test, and what is used instead of a sensor that is frozen or lost. Pure, and no allocation in a step.
//!
//! x̂ is what the others predict of a sensor, as the mean of a minute; s the moment at which its reading last changed, y
//! the reading then. A machine that rests predicts no motion: a reading that stands is frozen only where
//!
//! ```text
//! D = |x̂(now) − x̂(s)| > θ          0 while the reading changed less than 3 min ago
//! ```
//!
//! From then on its value is `y + x̂ − x̂(s)`, and the lags of its terms are those that have followed this since s: beside
//! each lag runs its shadow, which is the lag at every change of the reading and follows the prediction in between. A sensor that is
//! lost is replaced from its last good reading on, one that was lost when the machine started by x̂ as its rise.
//!
//! # Rules
//! - A stand-in is never an input of another: what is frozen or lost predicts nothing.
//! - A sensor is believed again when it has moved and stayed within θ of the prediction for an hour, and when its axis is
//!   disarmed: a person has looked. Lost for less than 3 min it was the line that was lost, and it is believed at once;
//!   so it is where nobody predicted it.
//! - A machine start begins everything anew. Frozen stays frozen until it has moved.

use std::time::Duration;

use super::Snapshot;
use super::model::stand_ins::StandIns;
use super::model::{Inputs, Lag, Model, Reference};
use super::reference::Machine;
use crate::quantity::{Moment, shifted};
use crate::reading::SignalId;

mod remembered;
mod sensor;

pub(super) use remembered::WatchRemembered;
use sensor::{Sensor, Standing};
use serde::{Deserialize, Serialize};

/// What a prediction is the mean over.
const MINUTE: Duration = Duration::from_secs(60);

/// What others say that a sensor would read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Instead {
    pub(super) signal: SignalId,
    /// In its unit; `None` where nobody knows what it begins from.
    pub(super) value: Option<f64>,
    /// Since the machine's start.
    pub(super) rise: f64,
}

/// A sensor that others stand in for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoodIn {
    /// Which.
    pub signal: SignalId,
    /// Its reading last changed, or was last good, then.
    pub since: Moment,
    /// It reads the same all the time; else it is lost.
    pub frozen: bool,
    /// How many others say what it would read.
    pub others: usize,
}

shifted!(StoodIn: since);

/// The watch over the sensors of one model.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    /// By sensor of the file.
    sensors: Vec<Sensor>,
    /// By place in the bank.
    bank: Vec<Gathered>,
    /// By term of the model.
    shadows: Vec<Lag>,
    /// By term of the model: the sensor that it reads.
    of_terms: Vec<Option<usize>>,
    /// Readings in the minute.
    count: u32,
    /// When the minute ends.
    until: Option<Moment>,
    /// What is used now; it never grows beyond the sensors.
    instead: Vec<Instead>,
}

/// An input of the bank, and the sum of its rises in the minute.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Gathered {
    lag: Lag,
    sum: f64,
    /// There was no rise somewhere in it.
    missed: bool,
}

impl Watch {
    pub(super) fn new(model: &Model, settings: &StandIns) -> Watch {
        let place = |signal| settings.sensors().iter().position(|sensor| sensor.signal == signal);
        Watch {
            sensors: vec![Sensor::default(); settings.sensors().len()],
            bank: vec![Gathered::default(); settings.bank().len()],
            shadows: model.rises().map(|_| Lag::default()).collect(),
            of_terms: model.rises().map(|input| place(input.signal)).collect(),
            count: 0,
            until: None,
            instead: Vec::with_capacity(settings.sensors().len()),
        }
    }

    /// What is used instead of readings.
    pub(super) fn instead(&self) -> &[Instead] {
        &self.instead
    }

    /// Whether this sensor is frozen.
    pub(super) fn is_frozen(&self, settings: &StandIns, signal: SignalId) -> bool {
        let mut sensors = settings.sensors().iter().zip(&self.sensors);
        sensors
            .any(|(known, sensor)| known.signal == signal && matches!(sensor.standing, Standing::Frozen(_)))
    }

    /// The first of these sensors that others stand in for.
    pub(super) fn stood_in(&self, settings: &StandIns, of: impl Fn(SignalId) -> bool) -> Option<StoodIn> {
        let signal = self.instead.iter().map(|instead| instead.signal).find(|signal| of(*signal))?;
        let place = settings.sensors().iter().position(|known| known.signal == signal)?;
        let (since, frozen) = match self.sensors[place].standing {
            Standing::Live => return None,
            Standing::Frozen(since) => (since, true),
            Standing::Lost(since) => (since, false),
        };
        Some(StoodIn { signal, since, frozen, others: settings.sensors()[place].others })
    }

    /// Everything begins anew with the machine.
    pub(super) fn started(&mut self, now: Moment) {
        self.sensors.iter_mut().for_each(|sensor| sensor.started(now));
        self.begin_minute(now);
        self.instead.clear();
    }

    /// A person has looked: every sensor that reads something is believed.
    pub(super) fn trust(&mut self, now: Moment) {
        self.sensors.iter_mut().for_each(|sensor| sensor.trust(now));
        self.instead.clear();
    }

    /// Looks at the readings before the lags go on to them.
    pub(super) fn look(&mut self, settings: &StandIns, snapshot: &Snapshot<'_>, machine: &Machine) {
        for (known, sensor) in settings.sensors().iter().zip(&mut self.sensors) {
            let reading = snapshot.readings.get(known.signal.0).and_then(|reading| reading.usable());
            sensor.look(reading, snapshot.now);
        }
        self.fill(settings, snapshot, machine);
    }

    /// What is used instead, as it is known now.
    fn fill(&mut self, settings: &StandIns, snapshot: &Snapshot<'_>, machine: &Machine) {
        self.instead.clear();
        for (place, known) in settings.sensors().iter().enumerate() {
            let sensor = &self.sensors[place];
            let Some(predicted) = sensor.predicted.filter(|_| known.stands_in && !sensor.is_live()) else {
                continue;
            };
            if !self.is_predicted(settings, place, snapshot) {
                continue;
            }
            let (signal, value) = (known.signal, sensor.value(predicted));
            let start = machine.captured(Reference::Start, signal).filter(|_| sensor.began_before());
            let rise = value.zip(start).map_or(predicted, |(value, start)| value - start.value.get());
            self.instead.push(Instead { signal, value, rise });
        }
    }

    /// Whether all that predict a sensor are good themselves.
    fn is_predicted(&self, settings: &StandIns, place: usize, snapshot: &Snapshot<'_>) -> bool {
        settings.sensors()[place].terms.iter().all(|(place, _)| {
            let predictor = &settings.bank()[*place];
            let reading = snapshot.readings.get(predictor.input.signal.0);
            reading.is_some_and(|reading| reading.usable().is_some())
                && predictor.sensor.is_none_or(|sensor| self.sensors[sensor].is_live())
        })
    }

    /// After the lags of the model have gone on: their shadows and the bank do, and where the minute is over what
    /// it says is looked at. `lags`: of one that is frozen they become their shadows.
    pub(super) fn follow(
        &mut self,
        (model, settings): (&Model, &StandIns),
        lags: &mut [Lag],
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) {
        for (((input, lag), shadow), sensor) in
            model.rises().zip(&*lags).zip(&mut self.shadows).zip(&self.of_terms)
        {
            let Some(sensor) = sensor.map(|place| &self.sensors[place]).filter(|sensor| sensor.is_live())
            else {
                continue;
            };
            let start = machine.captured(Reference::Start, input.signal);
            let Some((value, start)) = sensor.shadowed().zip(start) else {
                *shadow = *lag;
                continue;
            };
            let (signal, rise) = (input.signal, value - start.value.get());
            let instead = [Instead { signal, value: Some(value), rise }];
            shadow.follow(input, &Snapshot { instead: &instead, ..*snapshot }, machine);
        }
        let seen = Snapshot { instead: &self.instead, ..*snapshot };
        let inputs = Inputs { snapshot: seen, machine, lags: &[], splits_slope: false };
        for (predictor, gathered) in settings.bank().iter().zip(&mut self.bank) {
            gathered.lag.follow(&predictor.input, &seen, machine);
            let rise = predictor.input.rise(&inputs, &gathered.lag).map(|rise| rise.get());
            // Readings of 1e308 may be believed by a profile without ranges; their sum is no number.
            match rise.ok().map(|rise| gathered.sum + rise).filter(|sum| sum.is_finite()) {
                Some(sum) => gathered.sum = sum,
                None => gathered.missed = true,
            }
        }
        self.count += 1;
        let now = snapshot.now;
        let until = *self.until.get_or_insert(now.after(MINUTE));
        if now >= until || until.since(now) > MINUTE {
            self.judge(settings, snapshot, machine, lags);
            self.begin_minute(now);
        }
    }

    /// What the minute that is over says of each sensor.
    fn judge(&mut self, settings: &StandIns, snapshot: &Snapshot<'_>, machine: &Machine, lags: &mut [Lag]) {
        let count = f64::from(self.count);
        for (place, known) in settings.sensors().iter().enumerate() {
            let is_whole = known.terms.iter().all(|(place, _)| !self.bank[*place].missed);
            let rises = known.terms.iter().map(|(place, gain)| gain * self.bank[*place].sum / count);
            let predicted = Some(rises.sum::<f64>())
                .filter(|rise| rise.is_finite() && is_whole && self.is_predicted(settings, place, snapshot));
            let sensor = &mut self.sensors[place];
            let reading = snapshot.readings.get(known.signal.0).and_then(|reading| reading.usable());
            if sensor.judge(predicted, reading, known.threshold, snapshot.now) {
                let terms = lags.iter_mut().zip(&self.shadows).zip(&self.of_terms);
                for ((lag, shadow), _) in terms.filter(|(_, of)| **of == Some(place)) {
                    *lag = *shadow;
                }
            }
        }
        self.fill(settings, snapshot, machine);
    }

    fn begin_minute(&mut self, now: Moment) {
        (self.count, self.until) = (0, Some(now.after(MINUTE)));
        for gathered in &mut self.bank {
            (gathered.sum, gathered.missed) = (0.0, false);
        }
    }
}
