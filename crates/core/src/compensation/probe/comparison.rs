//! Comparison of a model with no compensation, from the errors at probings. The functions are pure, and allocate no
//! memory after the creation.
//!
//! Each touch (one probing) gives two errors: e₀ without compensation, and e₁ with the model. e₀ is the measured error
//! minus the Cz that acted, and e₁ = e₀ + Cz of the model. e₁ does not depend on the Cz that acted. Therefore a model
//! is also compared while the axis does not follow it. The comparison uses the last eight touches since the datum (zero
//! point of Cz), none of them older than a week:
//!
//! | the model was | and is now | if |
//! |---|---|---|
//! | not worse | worse | both conditions below are true |
//! | worse | not worse | there are two touches or more, and Σe₁² < Σe₀² |
//!
//! - Over all touches: Σe₁² > 1.1·Σe₀² and Σe₁² − Σe₀² > 8·4σ². σ is the standard deviation of a touch.
//! - Over the n ≥ 1 other touches, without the touch of the largest e₁² − e₀²: Σe₁² > 1.1·Σe₀² and
//!   Σe₁² − Σe₀² > n·4σ².
//!
//! # Rules
//! - A single touch never changes the verdict. If only one touch differs, the next touches show whether a
//!   chip under the probe was the cause.
//! - A touch that the model does not accept waits for the next touch. Both touches are used if their errors
//!   e₁ differ by at most 4·√2·σ. Both are also used if the next touch is not accepted either, and both
//!   errors e₁ have the same sign. Otherwise the waiting touch is discarded.
//! - A new datum discards the touches. The verdict stays until new touches give another verdict.
//! - When the correction of the model is discarded, the verdict is discarded too.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Micron, Moment, shifted};

/// Maximum number of touches in a comparison. A touch is the result of one probing.
const WINDOW: usize = 8;
/// Maximum number of touches in a comparison, as a floating-point number.
const FULL: f64 = 8.0;
/// Maximum age of a touch in a comparison.
const OLDEST: Duration = Duration::from_hours(7 * 24);
/// Factor by which the sum of the squared errors with the model must exceed the sum without compensation.
const CLEARLY: f64 = 1.1;
/// Required excess, for each touch, of the sum of the squared errors with the model over the sum without
/// compensation. The unit is the variance σ² of a touch.
const FOR_EACH: f64 = 4.0;
/// Largest difference of two touches that agree, in standard deviations of the difference.
const AGREES: f64 = 4.0;

/// Result of a comparison in which a model was worse than no compensation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Worse {
    /// Number of touches (probings) in the comparison; 0 directly after a new datum (zero point).
    pub touches: usize,
    /// Root mean square of the error without compensation.
    pub without: Micron,
    /// Root mean square of the error with the Cz of the model.
    pub with: Micron,
}

/// Errors of one touch, the result of one probing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct Touch {
    /// Time at which the axis received the probing.
    pub(in crate::compensation) at: Moment,
    /// e₀: error without compensation, µm.
    pub(in crate::compensation) without: f64,
    /// e₁: error with the Cz of the model, µm.
    pub(in crate::compensation) with: f64,
}

/// Whether a model accepts a touch (the result of one probing).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::compensation) enum Credit {
    /// The model accepts the touch and is corrected with it.
    Accepted,
    /// The touch is implausible, or waits for another touch that agrees with it.
    Doubted,
}

/// Result of the comparison of a model with no compensation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Verdict {
    /// The touches do not show that the model is worse than no compensation.
    #[default]
    NotWorse,
    /// The touches have shown that the model is worse than no compensation, and later touches have not shown the
    /// opposite.
    Worse,
}

/// Errors of one model at the last touches, and the verdict about the model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct Comparison {
    /// Touches of the comparison, oldest first.
    touches: Vec<Touch>,
    /// Touch that was not accepted and waits for the next touch; `None` if no touch waits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    waiting: Option<Touch>,
    verdict: Verdict,
}

shifted!(Touch: at);
shifted!(Comparison: touches, waiting);

/// Sums of the squared errors of some touches, µm²: without compensation, and with the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sums {
    without: f64,
    with: f64,
}

impl Comparison {
    /// Creates a comparison with room for the maximum number of touches.
    pub(super) fn new() -> Comparison {
        Comparison { touches: Vec::with_capacity(WINDOW), ..Comparison::default() }
    }

    /// Returns whether the comparison has no touches and no verdict. An empty comparison is not saved.
    pub(super) fn is_empty(&self) -> bool {
        self.touches.is_empty() && self.waiting.is_none() && self.verdict == Verdict::NotWorse
    }

    /// Restores the saved touches and verdict.
    pub(super) fn recall(&mut self, kept: &Comparison) {
        self.touches.clear();
        self.touches.extend(kept.touches.iter().skip(kept.touches.len().saturating_sub(WINDOW)));
        (self.waiting, self.verdict) = (kept.waiting, kept.verdict);
    }

    /// Discards the touches, because they were measured with an older datum (zero point).
    pub(super) fn begin(&mut self) {
        self.touches.clear();
        self.waiting = None;
    }

    /// Discards the touches and the verdict.
    pub(super) fn clear(&mut self) {
        self.begin();
        self.verdict = Verdict::NotWorse;
    }

    /// Returns the mean errors of a model that is worse than no compensation; `None` if the model is not worse.
    pub(super) fn worse(&self) -> Option<Worse> {
        if self.verdict == Verdict::NotWorse {
            return None;
        }
        let (count, sums) = (number(&self.touches).max(1.0), Sums::of(&self.touches));
        let rms = |sum: f64| Micron::new((sum / count).sqrt()).unwrap_or_default();
        Some(Worse { touches: self.touches.len(), without: rms(sums.without), with: rms(sums.with) })
    }

    /// Adds a touch, and updates the verdict. `scatter`: standard deviation σ of a touch, µm. Errors whose squares are
    /// not finite are discarded.
    pub(super) fn take(&mut self, touch: Touch, credit: Credit, scatter: f64) {
        if ![touch.without, touch.with].iter().all(|error| (error * error).is_finite()) {
            return;
        }
        let confirmed = self.waiting.take().filter(|waiting| confirms(&touch, credit, waiting, scatter));
        if confirmed.is_none() && credit == Credit::Doubted {
            self.waiting = Some(touch);
            return;
        }
        self.touches.retain(|known| touch.at.since(known.at) <= OLDEST);
        let waited = confirmed.filter(|waiting| touch.at.since(waiting.at) <= OLDEST);
        for counted in waited.into_iter().chain([touch]) {
            if self.touches.len() >= WINDOW {
                self.touches.remove(0);
            }
            self.touches.push(counted);
        }
        self.verdict = self.decide(scatter * scatter);
    }

    fn decide(&self, variance: f64) -> Verdict {
        let all = Sums::of(&self.touches);
        match self.verdict {
            Verdict::NotWorse if self.is_worse(all, variance) => Verdict::Worse,
            Verdict::Worse if self.touches.len() >= 2 && all.with < all.without => Verdict::NotWorse,
            as_before => as_before,
        }
    }

    fn is_worse(&self, all: Sums, variance: f64) -> bool {
        if !all.exceed(FULL * FOR_EACH * variance) {
            return false;
        }
        let larger = |one: Sums, other: Sums| if other.difference() > one.difference() { other } else { one };
        let most = self.touches.iter().map(Sums::of_one).reduce(larger);
        let others = number(&self.touches) - 1.0;
        let rest = most.map(|most| Sums { without: all.without - most.without, with: all.with - most.with });
        others > 0.0 && rest.is_some_and(|rest| rest.exceed(others * FOR_EACH * variance))
    }
}

impl Sums {
    fn of(touches: &[Touch]) -> Sums {
        touches.iter().map(Sums::of_one).fold(Sums::default(), |sums, one| Sums {
            without: sums.without + one.without,
            with: sums.with + one.with,
        })
    }

    fn of_one(touch: &Touch) -> Sums {
        Sums { without: touch.without * touch.without, with: touch.with * touch.with }
    }

    fn difference(&self) -> f64 {
        self.with - self.without
    }

    /// Returns whether the sum with the model, Σe₁², exceeds the sum without compensation, Σe₀², by 10 % and by more
    /// than `by`, µm².
    fn exceed(&self, by: f64) -> bool {
        self.with > CLEARLY * self.without && self.difference() > by
    }
}

/// Returns whether this touch confirms the waiting touch. A touch confirms if the two touches agree, or if
/// this touch is not accepted either and has the same sign. The waiting touch was then not caused by a chip
/// under the probe.
fn confirms(touch: &Touch, credit: Credit, waiting: &Touch, scatter: f64) -> bool {
    let agrees = (touch.with - waiting.with).abs() <= AGREES * std::f64::consts::SQRT_2 * scatter;
    agrees || (credit == Credit::Doubted && touch.with * waiting.with > 0.0)
}

/// Returns the number of touches as a float.
#[allow(clippy::cast_precision_loss, reason = "at most eight")]
fn number(touches: &[Touch]) -> f64 {
    touches.len() as f64
}

#[cfg(test)]
mod tests;
