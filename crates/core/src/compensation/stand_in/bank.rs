//! Inputs of the predictions of sensors: for each input its lag, and the mean of its rise in the current minute.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::compensation::Snapshot;
use crate::compensation::model::stand_ins::Predictor;
use crate::compensation::model::{Envelope, Inputs, Lag};
use crate::compensation::reference::{Machine, Reference};
use crate::quantity::{Moment, shifted};

/// Number of time constants after which the start value of a lag has a weight of less than a hundredth. A lag that
/// began on a warm machine is then settled.
const FORGOTTEN: u32 = 5;
/// Tolerated distance of a predictor from its range, as a fraction of the range's width. The tolerance is larger than
/// one count of a sensor and the rounding of a file.
pub(super) const EDGE: f64 = 0.01;
/// Tolerated distance of a predicted sensor, and of the rise of a lagged predictor, from its range, as a fraction of
/// the range's width. The tolerance is large because a slow lag returns long after its sensor. It also applies to the
/// predictors of a prediction that only serves as the start value of later comparisons.
pub(super) const FAR: f64 = 0.10;

/// State of one input of the predictions: its lag, and the mean of its rise in the current minute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct BankInput {
    #[serde(rename = "lagged")]
    pub(super) lag: Lag,
    /// Time at which the lag is settled. The lag is not used before this time, because its start value on a warm
    /// machine was unknown.
    #[serde(default)]
    pub(super) ready: Moment,
    /// Mean of the rise from the sensor's own readings in this minute.
    #[serde(default)]
    pub(super) own: Mean,
    /// Mean of the rise of the sensor's stand-in in this minute.
    #[serde(default)]
    pub(super) lent: Mean,
    /// Whether the input is beyond its range in the envelope of the model.
    #[serde(default)]
    pub(super) beyond: bool,
}

shifted!(BankInput: lag, ready);

/// Mean of the values added so far, stored as their sum and their number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    /// Returns the mean; `None` if there are no values.
    fn get(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }

    /// Adds a value. A value that makes the sum infinite is ignored: a profile without ranges may accept readings of
    /// 1e308.
    fn take(&mut self, value: f64) {
        let sum = self.sum + value;
        if sum.is_finite() {
            *self = Mean { sum, count: self.count + 1 };
        }
    }
}

impl BankInput {
    /// Updates the lag and the means with the snapshot as the model uses it. An unknown reading changes nothing.
    pub(super) fn follow(&mut self, predictor: &Predictor, seen: &Snapshot<'_>, machine: &Machine) {
        let input = &predictor.input;
        let was_there = self.lag.kept().is_some();
        self.lag.follow(input, seen, machine);
        if let Some(constant) = input.lag.filter(|_| !was_there && self.lag.kept().is_some()) {
            let captured = machine.captured(Reference::Start, input.signal);
            let begins_at_rest = captured.is_some_and(|captured| captured.at == seen.now);
            let settles =
                if begins_at_rest { Duration::ZERO } else { constant.span().saturating_mul(FORGOTTEN) };
            self.ready = seen.now.after(settles);
        }
        let inputs = Inputs { snapshot: seen.followed(), machine, lags: &[], splits_slope: false };
        let Ok(rise) = input.rise(&inputs, &self.lag) else { return };
        let is_own = seen.instead_of(input.signal).is_none();
        (if is_own { &mut self.own } else { &mut self.lent }).take(rise.get());
    }

    /// Updates `beyond`. It becomes true if the input is beyond its range in the model's envelope. It also becomes true
    /// if the rise in this minute is beyond this range by more than [`FAR`]. It becomes false when the input and its
    /// rise are inside.
    pub(super) fn check_bank_range(
        &mut self,
        predictor: &Predictor,
        envelope: &Envelope,
        inputs: &Inputs<'_>,
    ) {
        let (now, late) = self.beyond_range(predictor, envelope, inputs);
        let edge = if self.beyond { 0.0 } else { EDGE };
        let is_beyond = now.map_or(self.beyond, |now| now > edge);
        self.beyond = is_beyond || late.is_some_and(|late| late > FAR);
    }

    /// Returns whether the input and its rise in this minute are both inside the range, or beyond it by at most
    /// [`FAR`]. An unknown value counts as inside.
    pub(super) fn is_near(&self, predictor: &Predictor, envelope: &Envelope, inputs: &Inputs<'_>) -> bool {
        let (now, late) = self.beyond_range(predictor, envelope, inputs);
        now.into_iter().chain(late).all(|share| share <= FAR)
    }

    /// Returns the distances of the input, and of its rise in this minute, from the range, as fractions of the range's
    /// width. `None` if a distance is unknown.
    fn beyond_range(
        &self,
        predictor: &Predictor,
        envelope: &Envelope,
        inputs: &Inputs<'_>,
    ) -> (Option<f64>, Option<f64>) {
        let late = self.own.get().or_else(|| self.lent.get());
        let late = late.and_then(|rise| envelope.rise_beyond_range(&predictor.input, rise));
        (envelope.beyond_range(predictor.input.signal, inputs), late)
    }

    /// Returns the mean rise in this minute, and `true` if the rise comes from a stand-in. `None` if there was no rise,
    /// or the lag is not settled. `frozen`: the sensor's own readings are not used.
    pub(super) fn rise(&self, frozen: bool, now: Moment) -> Option<(f64, bool)> {
        let own = self.own.get().filter(|_| !frozen).map(|rise| (rise, false));
        own.or_else(|| Some((self.lent.get()?, true))).filter(|_| now >= self.ready)
    }

    pub(super) fn begin_minute(&mut self) {
        (self.own, self.lent) = (Mean::default(), Mean::default());
    }
}
