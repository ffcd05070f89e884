//! What predictions rest on: by input of the bank, its lag and the mean of its rise in the minute.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::compensation::Snapshot;
use crate::compensation::model::stand_ins::Predictor;
use crate::compensation::model::{Envelope, Inputs, Lag};
use crate::compensation::reference::{Machine, Reference};
use crate::quantity::{Moment, shifted};

/// After so many of its time constants a lag has forgotten, but for less than a hundredth, that it began at rest on a machine
/// that was warm.
const FORGOTTEN: u32 = 5;
/// So much of its range a predictor may be beyond it: less is the count of a sensor and the rounding of a file.
pub(super) const EDGE: f64 = 0.01;
/// So much of its range a sensor may be beyond it that is predicted, and what follows a predictor: a slow lag comes back long after its
/// sensor. The same of a predictor whose prediction is only what later ones are compared with.
pub(super) const FAR: f64 = 0.10;

/// An input of the bank.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Gathered {
    #[serde(rename = "lagged")]
    pub(super) lag: Lag,
    /// Before this its lag says too little, because it began on a machine that was running.
    #[serde(default)]
    pub(super) ready: Moment,
    /// Of what its sensor read in this minute.
    #[serde(default)]
    pub(super) own: Mean,
    /// Of what others said that it would have read.
    #[serde(default)]
    pub(super) lent: Mean,
    /// It is beyond the range on which the model was identified.
    #[serde(default)]
    pub(super) beyond: bool,
}

shifted!(Gathered: lag, ready);

/// A mean that is still growing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Mean {
    sum: f64,
    count: u32,
}

impl Mean {
    /// `None` where nothing was counted.
    fn get(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }

    /// Readings of 1e308 may be believed by a profile without ranges; a sum that is no number is not taken in.
    fn take(&mut self, value: f64) {
        let sum = self.sum + value;
        if sum.is_finite() {
            *self = Mean { sum, count: self.count + 1 };
        }
    }
}

impl Gathered {
    /// Takes in the readings as the model sees them; one that nobody knows is waited for.
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

    /// Looks whether it is beyond the range that the model's envelope has for it, or what follows it far beyond. That ends when it is
    /// inside.
    pub(super) fn look_at_range(&mut self, predictor: &Predictor, envelope: &Envelope, inputs: &Inputs<'_>) {
        let (now, late) = self.beyond_range(predictor, envelope, inputs);
        let edge = if self.beyond { 0.0 } else { EDGE };
        let is_beyond = now.map_or(self.beyond, |now| now > edge);
        self.beyond = is_beyond || late.is_some_and(|late| late > FAR);
    }

    /// Returns whether neither it nor what follows it is far beyond that range.
    pub(super) fn is_near(&self, predictor: &Predictor, envelope: &Envelope, inputs: &Inputs<'_>) -> bool {
        let (now, late) = self.beyond_range(predictor, envelope, inputs);
        now.into_iter().chain(late).all(|share| share <= FAR)
    }

    /// By which share of that range it is beyond it now, and what follows it in this minute. `None` where that is not known.
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

    /// Its rise in this minute, and whether it is only what others said of it. `frozen`: what it read itself says nothing.
    pub(super) fn rise(&self, frozen: bool, now: Moment) -> Option<(f64, bool)> {
        let own = self.own.get().filter(|_| !frozen).map(|rise| (rise, false));
        own.or_else(|| Some((self.lent.get()?, true))).filter(|_| now >= self.ready)
    }

    pub(super) fn begin_minute(&mut self) {
        (self.own, self.lent) = (Mean::default(), Mean::default());
    }
}
