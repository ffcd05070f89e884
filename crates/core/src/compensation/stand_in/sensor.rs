//! What is known of one sensor that is watched.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted, shifted};

/// A reading that changed less long ago is not frozen; a sensor that was lost for less was not.
const SHORT: Duration = Duration::from_secs(3 * 60);
/// A sensor is suspected when so many minutes in a row say that it should have moved: others may be ahead of it for one or two.
const MISSED: u8 = 3;
/// How long a sensor has to agree before it is believed again, and how long one that is back waits for others who could say so.
const AGREES_FOR: Duration = Duration::from_secs(3600);
/// How long the last prediction stands in for a frozen sensor while its predictors are missing.
const BRIDGED: Duration = Duration::from_secs(10 * 60);

/// One sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Sensor {
    standing: SensorState,
    /// The last good reading, and when it was there.
    reading: Option<f64>,
    read: Moment,
    /// When it last changed.
    changed: Moment,
    /// y: what the value is counted from; `None` where nobody knows.
    from: Option<f64>,
    /// x̂ there.
    base: Option<f64>,
    /// Both are of a reading that is to be proven, because the machine had started without one.
    #[serde(default)]
    tentative: bool,
    /// x̂ of the last minute; `None` where nobody could say.
    predicted: Option<Predicted>,
    /// What the last minute said is not used because something was beyond its range.
    #[serde(default)]
    outside: bool,
    /// The last x̂ that could stand in.
    #[serde(default)]
    last: Option<Said>,
    #[serde(flatten)]
    recovery: Recovery,
    /// How many minutes in a row have said that it should have moved.
    #[serde(default)]
    missed: u8,
    /// Its reading is counted anew, and its shadows do not know yet.
    #[serde(default)]
    pub(super) renewed: bool,
}

/// Recovery of a sensor that was frozen or lost. Its keys are those of the sensor in the serialised form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Recovery {
    /// Whether the reading has moved since the sensor was frozen, or is back since the sensor was lost.
    moved: bool,
    /// Time since when the reading agrees with the prediction again.
    agrees: Option<Moment>,
    /// Whether others predicted the reading for minutes while the sensor was lost.
    #[serde(default)]
    was_predicted: bool,
    /// Time since when the reading is back and no other sensor can confirm it.
    #[serde(default)]
    unproven: Option<Moment>,
}

/// What others say of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Predicted {
    /// Its rise since the machine's start.
    pub(super) rise: f64,
    /// Some of them are stood in for themselves: good enough to find a frozen sensor, and for nothing else.
    pub(super) lent: bool,
    /// All of them read something now, and are believed.
    pub(super) present: bool,
    /// What would be used for the reading is inside the range of the sensor.
    #[serde(default = "yes")]
    pub(super) inside: bool,
}

/// What was kept without saying so was inside.
fn yes() -> bool {
    true
}

/// What the minute that is over says of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Prediction {
    /// Others say this.
    Known(Predicted),
    /// One of them is missing.
    Missing,
    /// One of them is beyond the range on which the model was identified, or the sensor far beyond. Their prediction, if nothing is far
    /// beyond.
    Outside(Option<f64>),
}

/// A prediction that could stand in, and when it was made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Said {
    rise: f64,
    at: Moment,
}

/// State of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SensorState {
    /// It is believed.
    #[default]
    Live,
    /// It has read the same since then, and should not have. Its reading is used all the same.
    Suspected(Moment),
    /// The same, and others stand in for it.
    Frozen(Moment),
    /// It had no good reading after this.
    Lost(Moment),
}

/// What a minute has shown of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// Nothing new.
    AsBefore,
    /// It is believed again.
    Believed(Option<Beginning>),
}

/// What a sensor would have read when the machine started, which nobody could read then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::compensation) struct Beginning {
    pub(in crate::compensation) value: f64,
    /// What was captured since then is not to be believed.
    pub(in crate::compensation) distrusted_since: Moment,
}

shifted!(Said: at);
shifted!(Recovery: agrees, unproven);
shifted!(Sensor: standing, read, changed, last, recovery);

impl Shifted for SensorState {
    fn shift(&mut self, by: Shift) {
        if let SensorState::Suspected(since) | SensorState::Frozen(since) | SensorState::Lost(since) = self {
            since.shift(by);
        }
    }
}

impl Sensor {
    pub(super) fn is_live(&self) -> bool {
        self.standing == SensorState::Live
    }

    /// Since when it is not believed, and whether it is frozen; else it was lost.
    pub(super) fn distrusted(&self) -> Option<(Moment, bool)> {
        match self.standing {
            SensorState::Live => None,
            SensorState::Suspected(since) | SensorState::Frozen(since) => Some((since, true)),
            SensorState::Lost(since) => Some((since, false)),
        }
    }

    /// It has read the same for too long, and its reading is used all the same.
    pub(super) fn is_suspected(&self) -> bool {
        matches!(self.standing, SensorState::Suspected(_))
    }

    /// It has read the same for too long, and others stand in for it.
    pub(super) fn is_frozen(&self) -> bool {
        matches!(self.standing, SensorState::Frozen(_))
    }

    /// It has read the same for too long: its reading says nothing of the other sensors.
    pub(super) fn is_doubted(&self) -> bool {
        self.is_suspected() || self.is_frozen()
    }

    /// Others stand in for it from now on.
    pub(super) fn substitute(&mut self) {
        if let SensorState::Suspected(since) = self.standing {
            self.standing = SensorState::Frozen(since);
        }
    }

    /// Nobody stands in for it any more: its reading is used.
    pub(super) fn suspect(&mut self) {
        if let SensorState::Frozen(since) = self.standing {
            (self.standing, self.recovery.moved, self.recovery.agrees) =
                (SensorState::Suspected(since), false, None);
        }
    }

    /// What the last minute said of it is not used because something was beyond its range.
    pub(super) fn is_outside(&self) -> bool {
        self.outside
    }

    /// It reads something at this moment, which it was shown already.
    pub(super) fn reads(&self, now: Moment) -> bool {
        self.reading.is_some() && self.read == now
    }

    /// When it last changed.
    pub(super) fn changed(&self) -> Moment {
        self.changed
    }

    /// Its rise, where others say it who are good themselves. For a frozen one the last they said serves while something is beyond its
    /// range, and for some minutes while one of them is missing.
    pub(super) fn stand_in(&self, now: Moment) -> Option<f64> {
        let serves = |last: &Said| self.is_frozen() && (self.outside || now.since(last.at) < BRIDGED);
        self.said().or_else(|| Some(self.last.filter(serves)?.rise))
    }

    /// The same of the last minute.
    pub(super) fn said(&self) -> Option<f64> {
        self.predicted.and_then(Predicted::fit)
    }

    /// What it would read where others predict this rise, as far as what it begins from is certain.
    pub(super) fn value(&self, rise: f64) -> Option<f64> {
        self.expected(rise).filter(|_| !self.tentative)
    }

    fn expected(&self, rise: f64) -> Option<f64> {
        self.from.zip(self.base).map(|(from, base)| from + rise - base)
    }

    /// What a shadow follows: the prediction since the reading last changed; `None` where there is none.
    pub(super) fn shadowed(&self) -> Option<f64> {
        self.value(self.predicted?.rise)
    }

    /// Nobody looked for a while: what was predicted before says nothing of now.
    pub(super) fn pause(&mut self) {
        (self.predicted, self.recovery.agrees) = (None, None);
    }

    /// The gateway was away for a while: not even the last prediction serves.
    pub(super) fn away(&mut self) {
        self.pause();
        self.last = None;
    }

    pub(super) fn look(&mut self, reading: Option<f64>, now: Moment) {
        let Some(value) = reading else {
            if self.is_live() || self.is_suspected() {
                let since = if self.reading.is_some() { self.read } else { now };
                // What others say of a suspected one is counted from the reading that was used.
                let known = self.base.filter(|_| self.is_live());
                let base = self.predicted.map(|predicted| predicted.rise).or(known);
                (self.standing, self.from) = (SensorState::Lost(since), self.reading);
                (self.base, self.recovery.was_predicted) = (base.filter(|_| self.reading.is_some()), false);
            }
            if self.is_lost() && self.tentative {
                (self.from, self.base, self.tentative) = (None, None, false);
            }
            (self.recovery.moved, self.recovery.agrees, self.recovery.unproven) =
                (self.recovery.moved && !self.is_lost(), None, None);
            return;
        };
        let has_changed = self.reading.is_none_or(|last| last.to_bits() != value.to_bits());
        (self.reading, self.read) = (Some(value), now);
        match self.standing {
            SensorState::Live | SensorState::Suspected(_) if has_changed => self.begin(value, now),
            SensorState::Live | SensorState::Suspected(_) => {}
            // It was the line that was lost, or all that could have said what it reads with it.
            SensorState::Lost(since) if now.since(since) < SHORT || !self.recovery.was_predicted => {
                self.begin(value, now);
            }
            SensorState::Lost(_) => self.recovery.moved = true,
            SensorState::Frozen(_) => self.recovery.moved |= has_changed,
        }
        if self.recovery.moved && !self.is_live() && self.from.is_none() {
            (self.from, self.base, self.tentative) = (Some(value), None, true);
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
            renewed: true,
            ..Sensor::default()
        };
    }

    /// Takes in what was predicted of the minute that is over.
    pub(super) fn judge(
        &mut self,
        prediction: Prediction,
        reading: Option<f64>,
        threshold: f64,
        now: Moment,
    ) -> Verdict {
        self.outside = match prediction {
            Prediction::Known(predicted) => !predicted.inside,
            Prediction::Missing => false,
            Prediction::Outside(_) => true,
        };
        let Prediction::Known(predicted @ Predicted { rise, lent, present, .. }) = prediction else {
            (self.predicted, self.recovery.agrees, self.missed) = (None, None, 0);
            if let Prediction::Outside(Some(rise)) = prediction
                && self.is_live()
            {
                self.base.get_or_insert(rise);
            }
            return self.judge_unpredicted(reading, now);
        };
        self.predicted = Some(predicted);
        self.last = predicted.fit().map(|rise| Said { rise, at: now }).or(self.last);
        self.recovery.unproven = None;
        if self.is_suspected() {
            return Verdict::AsBefore;
        }
        if self.is_live() {
            let base = *self.base.get_or_insert(rise);
            let misses = now.since(self.changed) >= SHORT && (rise - base).abs() > threshold;
            self.missed = if misses { self.missed.saturating_add(1) } else { 0 };
            if self.missed < MISSED {
                return Verdict::AsBefore;
            }
            (self.standing, self.recovery.moved, self.recovery.agrees) =
                (SensorState::Suspected(self.changed), false, None);
            return Verdict::AsBefore;
        }
        if lent {
            self.recovery.agrees = None;
            return Verdict::AsBefore;
        }
        if let SensorState::Lost(since) = self.standing {
            self.recovery.was_predicted |= present && now.since(since) >= SHORT;
        }
        self.base.get_or_insert(rise);
        let apart = reading.zip(self.expected(rise)).map(|(reading, value)| (reading - value).abs());
        if !(self.recovery.moved && apart.is_some_and(|apart| apart <= threshold)) {
            self.recovery.agrees = None;
            // Where it begins is not known: its way is compared from here.
            if let Some(reading) = reading.filter(|_| self.tentative) {
                (self.from, self.base) = (Some(reading), Some(rise));
            }
        } else if now.since(*self.recovery.agrees.get_or_insert(now)) >= AGREES_FOR
            && let Some(reading) = reading
        {
            return Verdict::Believed(self.believe(reading, now));
        }
        Verdict::AsBefore
    }

    /// Nobody can say what it reads: one that was lost is believed if it has been back for long.
    fn judge_unpredicted(&mut self, reading: Option<f64>, now: Moment) -> Verdict {
        let back = reading.filter(|_| self.is_lost() && self.recovery.moved);
        let Some(reading) = back else {
            self.recovery.unproven = None;
            return Verdict::AsBefore;
        };
        if now.since(*self.recovery.unproven.get_or_insert(now)) < AGREES_FOR {
            return Verdict::AsBefore;
        }
        Verdict::Believed(self.believe(reading, now))
    }

    /// A person has looked: what it reads is believed; `None` where nothing is new.
    pub(super) fn trust(&mut self, now: Moment) -> Option<Verdict> {
        let reading = self.reading.filter(|_| !self.is_live() && self.reads(now))?;
        Some(Verdict::Believed(self.believe(reading, now)))
    }

    /// Believes it again; what it began from, as the others have it, unless it has read the same ever since.
    fn believe(&mut self, reading: f64, now: Moment) -> Option<Beginning> {
        let (since, _) = self.distrusted()?;
        let rise = self.said().filter(|_| self.recovery.moved);
        self.begin(reading, now);
        Some(Beginning { value: reading - rise?, distrusted_since: since })
    }

    /// The machine was started: rises are counted from nothing. Where a sensor that is not believed begins, nobody knows.
    pub(super) fn started(&mut self, now: Moment) {
        let is_believed = match self.standing {
            SensorState::Live | SensorState::Suspected(_) => true,
            SensorState::Frozen(_) => self.recovery.moved,
            SensorState::Lost(_) => self.reads(now),
        };
        (self.predicted, self.last) = (None, None);
        match self.reading.filter(|_| is_believed) {
            Some(reading) => self.begin(reading, now),
            None => (self.from, self.base, self.tentative, self.recovery.agrees) = (None, None, false, None),
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        matches!(self.standing, SensorState::Lost(_))
    }
}

impl Predicted {
    /// The rise, if it is good enough to be used for the reading.
    fn fit(self) -> Option<f64> {
        (!self.lent && self.inside).then_some(self.rise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_has_the_keys_of_earlier_state_files() {
        let mut kept = serde_json::to_value(Sensor::default()).unwrap();
        let mut keys: Vec<&str> = kept.as_object().unwrap().keys().map(String::as_str).collect();
        keys.sort_unstable();
        let keys = keys.join(" ");
        assert_eq!(
            keys,
            "agrees base changed from last missed moved outside predicted read reading renewed standing tentative \
             unproven was_predicted"
        );
        for later in ["tentative", "outside", "last", "missed", "was_predicted", "unproven", "renewed"] {
            kept.as_object_mut().unwrap().remove(later);
        }
        assert_eq!(serde_json::from_value::<Sensor>(kept).unwrap(), Sensor::default());
    }
}
