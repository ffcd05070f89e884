//! What is known of one sensor that is watched.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted, shifted};

/// A reading that changed less long ago is not frozen; a sensor that was lost for less was not.
const SHORT: Duration = Duration::from_secs(3 * 60);
/// How long a sensor has to agree before it is believed again.
const AGREES_FOR: Duration = Duration::from_secs(3600);

/// One sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Sensor {
    pub(super) standing: Standing,
    /// The last good reading, and when it was there.
    reading: Option<f64>,
    read: Moment,
    /// When it last changed.
    changed: Moment,
    /// y: what the value is counted from; `None` where nobody knows.
    from: Option<f64>,
    /// x̂ there.
    base: Option<f64>,
    /// x̂ of the last minute; `None` where some other sensor was missing.
    pub(super) predicted: Option<f64>,
    /// It has moved since it was frozen or lost.
    moved: bool,
    /// Since when it agrees with the prediction again.
    agrees: Option<Moment>,
}

/// How a sensor stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Standing {
    /// It is believed.
    #[default]
    Live,
    /// It has read the same since then, and should not have.
    Frozen(Moment),
    /// It had no good reading after this.
    Lost(Moment),
}

shifted!(Sensor: standing, read, changed, agrees);

impl Shifted for Standing {
    fn shift(&mut self, by: Shift) {
        if let Standing::Frozen(since) | Standing::Lost(since) = self {
            since.shift(by);
        }
    }
}

impl Sensor {
    pub(super) fn is_live(&self) -> bool {
        self.standing == Standing::Live
    }

    /// What it would read, where others predict this.
    pub(super) fn value(&self, predicted: f64) -> Option<f64> {
        self.from.zip(self.base).map(|(from, base)| from + predicted - base)
    }

    /// It was there when the machine started: what was captured then is the beginning of its rise.
    pub(super) fn began_before(&self) -> bool {
        self.from.is_some()
    }

    /// What a shadow follows: the prediction since the reading last changed; `None` where it is the reading.
    pub(super) fn shadowed(&self) -> Option<f64> {
        self.value(self.predicted?)
    }

    pub(super) fn look(&mut self, reading: Option<f64>, now: Moment) {
        let Some(value) = reading else {
            if self.is_live() {
                let since = if self.reading.is_some() { self.read } else { now };
                (self.standing, self.from) = (Standing::Lost(since), self.reading);
                self.base = self.predicted.or(self.base).filter(|_| self.reading.is_some());
            }
            (self.moved, self.agrees) = (self.moved && !self.is_lost(), None);
            return;
        };
        let has_changed = self.reading.is_none_or(|last| last.to_bits() != value.to_bits());
        (self.reading, self.read) = (Some(value), now);
        match self.standing {
            Standing::Live if has_changed => self.begin(value, now),
            Standing::Live => {}
            Standing::Lost(since) if now.since(since) < SHORT || self.predicted.is_none() => {
                self.begin(value, now);
            }
            Standing::Frozen(_) | Standing::Lost(_) => self.moved |= has_changed,
        }
    }

    /// It is believed, and its reading is counted from here.
    fn begin(&mut self, value: f64, now: Moment) {
        *self = Sensor {
            reading: Some(value),
            read: now,
            changed: now,
            from: Some(value),
            predicted: self.predicted,
            ..Sensor::default()
        };
    }

    /// Takes in what was predicted of the minute that is over; whether it is frozen from now on.
    pub(super) fn judge(
        &mut self,
        predicted: Option<f64>,
        reading: Option<f64>,
        threshold: f64,
        now: Moment,
    ) -> bool {
        self.predicted = predicted;
        let Some(predicted) = predicted else {
            self.agrees = None;
            return false;
        };
        let base = *self.base.get_or_insert(predicted);
        if self.is_live() {
            let is_frozen = now.since(self.changed) >= SHORT && (predicted - base).abs() > threshold;
            if is_frozen {
                (self.standing, self.moved, self.agrees) = (Standing::Frozen(self.changed), false, None);
            }
            return is_frozen;
        }
        let apart = reading.zip(self.value(predicted)).map(|(reading, value)| (reading - value).abs());
        if !(self.moved && apart.is_some_and(|apart| apart <= threshold)) {
            self.agrees = None;
        } else if now.since(*self.agrees.get_or_insert(now)) >= AGREES_FOR
            && let Some(reading) = reading
        {
            self.begin(reading, now);
        }
        false
    }

    pub(super) fn trust(&mut self, now: Moment) {
        if let Some(reading) = self.reading.filter(|_| !self.is_live() && self.read == now) {
            self.begin(reading, now);
        }
    }

    /// The machine was started: rises are counted from nothing. Where a sensor that is not believed begins, nobody knows.
    pub(super) fn started(&mut self, now: Moment) {
        let is_there = self.reading.is_some() && self.read == now;
        let is_believed = match self.standing {
            Standing::Live => true,
            Standing::Frozen(_) => self.moved,
            Standing::Lost(_) => is_there,
        };
        self.predicted = None;
        match self.reading.filter(|_| is_believed) {
            Some(reading) => self.begin(reading, now),
            None => (self.from, self.base, self.agrees) = (None, Some(0.0), None),
        }
    }

    fn is_lost(&self) -> bool {
        matches!(self.standing, Standing::Lost(_))
    }
}
