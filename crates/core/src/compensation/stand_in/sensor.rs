//! State of one sensor that a watch checks. A watch detects frozen and lost sensors, and estimates stand-ins for their
//! readings from other sensors, the predictors. x̂ is the rise of the sensor since machine start, as its predictors
//! predict it. A shadow is a copy of a lag that follows the prediction instead of the reading.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Moment, Shift, Shifted, shifted};

/// Shortest time without a change after which a reading may be suspected. After a loss of at least this time, the
/// readings of the sensor are checked before they are accepted.
const SHORT: Duration = Duration::from_secs(3 * 60);
/// Number of consecutive minutes with a predicted change that the reading does not show, after which a sensor is
/// suspected. One minute would not be enough, because other sensors may react one or two minutes earlier.
const MISSED: u8 = 3;
/// Time for which a reading must agree with its prediction before the sensor is accepted again. After a loss, a sensor
/// without a prediction waits equally long.
const AGREES_FOR: Duration = Duration::from_secs(3600);
/// Time for which the last prediction still replaces a frozen sensor while a predictor is missing.
const BRIDGED: Duration = Duration::from_secs(10 * 60);

/// State of one sensor: its reading, its prediction, and whether it is accepted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Sensor {
    standing: SensorState,
    /// Last good reading. `read` is the time of this reading.
    reading: Option<f64>,
    read: Moment,
    /// Time at which the reading last changed.
    changed: Moment,
    /// Reading y to which the predicted change is added; `None` if it is unknown.
    from: Option<f64>,
    /// Predicted rise x̂ at the time of the reading `from`.
    base: Option<f64>,
    /// Whether `from` and `base` belong to a reading that is not accepted yet. This is the case if the sensor had no
    /// reading when the machine started.
    #[serde(default)]
    tentative: bool,
    /// Predicted rise x̂ of the last minute; `None` if there was no prediction.
    predicted: Option<Predicted>,
    /// Whether the last prediction is not used, because a sensor was beyond its range.
    #[serde(default)]
    outside: bool,
    /// Last predicted rise x̂ that could be used as a stand-in; `None` if there is none.
    #[serde(default)]
    last: Option<TimedPrediction>,
    #[serde(flatten)]
    recovery: Recovery,
    /// Number of consecutive minutes with a predicted change that the reading does not show.
    #[serde(default)]
    missed: u8,
    /// Whether the reading has changed and the shadows have not been set to the lags yet.
    #[serde(default)]
    pub(super) renewed: bool,
}

/// Recovery of a sensor that was frozen or lost. In the serialised form, the fields of the recovery are fields of the
/// sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Recovery {
    /// Whether the reading has changed since the sensor froze, or readings are back after a loss.
    moved: bool,
    /// Time since which the reading agrees with the prediction again; `None` if the reading does not agree.
    agrees: Option<Moment>,
    /// Whether there was a prediction during the loss of the sensor, after its first three minutes.
    #[serde(default)]
    was_predicted: bool,
    /// Time since which the sensor has had readings again, but no prediction to check them. `None` in all other cases.
    #[serde(default)]
    unproven: Option<Moment>,
}

/// Prediction of a sensor from its predictors (other sensors), and whether the prediction may be used as a stand-in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Predicted {
    /// Predicted rise since machine start.
    pub(super) rise: f64,
    /// Whether at least one predictor is itself replaced by a stand-in. Such a prediction is only used to detect a
    /// frozen sensor.
    pub(super) lent: bool,
    /// Whether all predictors have an accepted reading now.
    pub(super) present: bool,
    /// Whether the value that would replace the reading is inside the range of the sensor.
    #[serde(default = "yes")]
    pub(super) inside: bool,
}

/// Returns `true`: value of the field `inside` for a saved state without this field.
fn yes() -> bool {
    true
}

/// Prediction of a sensor for the minute that has ended, or why there is no usable prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Prediction {
    /// All predictors had a value. Contains the prediction.
    Known(Predicted),
    /// At least one predictor had no value.
    Missing,
    /// A predictor is beyond the range on which the model was identified, or the sensor is far beyond its range.
    /// Contains the predicted rise if the sensor and all predictors are inside their ranges, or only slightly beyond.
    Outside(Option<f64>),
}

/// Predicted rise that could be used as a stand-in, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct TimedPrediction {
    rise: f64,
    at: Moment,
}

/// Result of the detection of frozen and lost sensors, for one sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SensorState {
    /// The sensor works, and its reading is accepted.
    #[default]
    Live,
    /// The reading has been constant since this time, although a change was predicted. The reading is still used.
    Suspected(Moment),
    /// The reading has been constant since this time, and a stand-in replaces it.
    Frozen(Moment),
    /// The sensor has had no good reading since this time.
    Lost(Moment),
}

/// Result of judging a sensor at the end of a minute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// The sensor is not accepted again at the end of this minute.
    AsBefore,
    /// The sensor is accepted again. Contains the estimate of its reading at machine start, if there is one.
    Accepted(Option<StartEstimate>),
}

/// Estimated reading of a sensor at a machine start at which it could not be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::compensation) struct StartEstimate {
    pub(in crate::compensation) value: f64,
    /// Time since which the sensor was rejected. References that were captured after it are invalid.
    pub(in crate::compensation) rejected_since: Moment,
}

shifted!(TimedPrediction: at);
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

    /// Returns the time since which the sensor is rejected, and `true` if it is suspected or frozen, `false` if it is
    /// lost. `None` if the sensor is accepted.
    pub(super) fn rejected(&self) -> Option<(Moment, bool)> {
        match self.standing {
            SensorState::Live => None,
            SensorState::Suspected(since) | SensorState::Frozen(since) => Some((since, true)),
            SensorState::Lost(since) => Some((since, false)),
        }
    }

    /// Returns whether the sensor is suspected: its reading has been constant for too long, and is still used.
    pub(super) fn is_suspected(&self) -> bool {
        matches!(self.standing, SensorState::Suspected(_))
    }

    /// Returns whether the sensor is frozen: its reading has been constant for too long, and a stand-in replaces it.
    pub(super) fn is_frozen(&self) -> bool {
        matches!(self.standing, SensorState::Frozen(_))
    }

    /// Returns whether the sensor is suspected or frozen. Its reading is then not used to predict another sensor.
    pub(super) fn is_doubted(&self) -> bool {
        self.is_suspected() || self.is_frozen()
    }

    /// Marks a suspected sensor as frozen: from now on, its stand-in replaces it.
    pub(super) fn substitute(&mut self) {
        if let SensorState::Suspected(since) = self.standing {
            self.standing = SensorState::Frozen(since);
        }
    }

    /// Marks a frozen sensor as suspected, because it no longer has a stand-in (value estimated from other sensors).
    /// Its reading is used again.
    pub(super) fn suspect(&mut self) {
        if let SensorState::Frozen(since) = self.standing {
            (self.standing, self.recovery.moved, self.recovery.agrees) =
                (SensorState::Suspected(since), false, None);
        }
    }

    /// Returns whether the last prediction is not used, because a sensor was beyond its range.
    pub(super) fn is_outside(&self) -> bool {
        self.outside
    }

    /// Returns whether the sensor has a good reading at `now`. `check` must have processed the reading before.
    pub(super) fn reads(&self, now: Moment) -> bool {
        self.reading.is_some() && self.read == now
    }

    /// Returns the time at which the reading last changed.
    pub(super) fn changed(&self) -> Moment {
        self.changed
    }

    /// Returns the predicted rise that the stand-in uses; `None` if there is no stand-in. For a frozen sensor, the last
    /// prediction is used while a sensor is beyond its range. The last prediction is also used for ten minutes while a
    /// predictor is missing.
    pub(super) fn stand_in(&self, now: Moment) -> Option<f64> {
        let serves =
            |last: &TimedPrediction| self.is_frozen() && (self.outside || now.since(last.at) < BRIDGED);
        self.said().or_else(|| Some(self.last.filter(serves)?.rise))
    }

    /// Returns the rise that was predicted in the last minute, if it may be used as a stand-in; else `None`.
    pub(super) fn said(&self) -> Option<f64> {
        self.predicted.and_then(Predicted::fit)
    }

    /// Returns the value of the sensor for this predicted rise; `None` if the reading from which the change is counted
    /// is unknown or not accepted.
    pub(super) fn value(&self, rise: f64) -> Option<f64> {
        self.expected(rise).filter(|_| !self.tentative)
    }

    fn expected(&self, rise: f64) -> Option<f64> {
        self.from.zip(self.base).map(|(from, base)| from + rise - base)
    }

    /// Returns the estimated present value of the sensor: the last reading plus the predicted change since then. `None`
    /// if there is no prediction. The copy of each lag that is kept for a stand-in (its shadow) follows this value.
    pub(super) fn shadowed(&self) -> Option<f64> {
        self.value(self.predicted?.rise)
    }

    /// Discards the present prediction after a pause of the checks.
    pub(super) fn pause(&mut self) {
        (self.predicted, self.recovery.agrees) = (None, None);
    }

    /// Discards all predictions after a time in which the gateway did not run.
    pub(super) fn away(&mut self) {
        self.pause();
        self.last = None;
    }

    pub(super) fn check(&mut self, reading: Option<f64>, now: Moment) {
        let Some(value) = reading else {
            if self.is_live() || self.is_suspected() {
                let since = if self.reading.is_some() { self.read } else { now };
                // The prediction for a suspected sensor is counted from the reading in use.
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
            // The line was lost, or there was no prediction meanwhile.
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

    /// Marks the sensor as accepted. Predicted changes are counted from this reading.
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

    /// Processes the prediction of the last minute. Returns whether the sensor is accepted again. `threshold`: largest
    /// difference of reading and prediction that agree, °C.
    pub(super) fn assess(
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
            return self.assess_unpredicted(reading, now);
        };
        self.predicted = Some(predicted);
        self.last = predicted.fit().map(|rise| TimedPrediction { rise, at: now }).or(self.last);
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
            // The beginning is unknown: the motion is compared from here on.
            if let Some(reading) = reading.filter(|_| self.tentative) {
                (self.from, self.base) = (Some(reading), Some(rise));
            }
        } else if now.since(*self.recovery.agrees.get_or_insert(now)) >= AGREES_FOR
            && let Some(reading) = reading
        {
            return Verdict::Accepted(self.accept(reading, now));
        }
        Verdict::AsBefore
    }

    /// Judges a sensor without a prediction. A lost sensor is accepted after it has had readings for an hour.
    fn assess_unpredicted(&mut self, reading: Option<f64>, now: Moment) -> Verdict {
        let back = reading.filter(|_| self.is_lost() && self.recovery.moved);
        let Some(reading) = back else {
            self.recovery.unproven = None;
            return Verdict::AsBefore;
        };
        if now.since(*self.recovery.unproven.get_or_insert(now)) < AGREES_FOR {
            return Verdict::AsBefore;
        }
        Verdict::Accepted(self.accept(reading, now))
    }

    /// Accepts the sensor because the operator has checked it. Returns `None`, and does nothing, if it was accepted
    /// already or has no reading now.
    pub(super) fn trust(&mut self, now: Moment) -> Option<Verdict> {
        let reading = self.reading.filter(|_| !self.is_live() && self.reads(now))?;
        Some(Verdict::Accepted(self.accept(reading, now)))
    }

    /// Accepts the sensor again. Returns the estimate of its reading at machine start; `None` if its reading has not
    /// changed since it was rejected, or is not predicted.
    fn accept(&mut self, reading: f64, now: Moment) -> Option<StartEstimate> {
        let (since, _) = self.rejected()?;
        let rise = self.said().filter(|_| self.recovery.moved);
        self.begin(reading, now);
        Some(StartEstimate { value: reading - rise?, rejected_since: since })
    }

    /// Handles a machine start, from which all rises are counted. The start reading of a sensor that is not accepted is
    /// unknown.
    pub(super) fn started(&mut self, now: Moment) {
        let is_accepted = match self.standing {
            SensorState::Live | SensorState::Suspected(_) => true,
            SensorState::Frozen(_) => self.recovery.moved,
            SensorState::Lost(_) => self.reads(now),
        };
        (self.predicted, self.last) = (None, None);
        match self.reading.filter(|_| is_accepted) {
            Some(reading) => self.begin(reading, now),
            None => (self.from, self.base, self.tentative, self.recovery.agrees) = (None, None, false, None),
        }
    }

    pub(super) fn is_lost(&self) -> bool {
        matches!(self.standing, SensorState::Lost(_))
    }
}

impl Predicted {
    /// Returns the predicted rise if it may replace the reading; else `None`.
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
