//! Thermal lag: a structure expands later than its temperature sensor warms up, `E = K·L·ΔT·(1 − e^(−t/C))`
//! (Janeczko 1989).
//!
//! `1 − e^(−t/C)` is the step response of a first-order lag. Between two readings, the temperature u is assumed to
//! change along a straight line (first-order hold). Then the lagged temperature y has the exact solution, with `a =
//! e^(−dt/C)`,
//!
//! ```text
//! y1 = a·y0 + (1 − a)·u0 + (1 − (1 − a)·C/dt)·(u1 − u0)
//! ```
//!
//! This solution holds for any dt: ten milliseconds, or an hour without the gateway or without a good reading.
//!
//! # Reference of the rise
//! The lag stores the temperature y itself, not its rise. Therefore a reference may change without an effect on the
//! lag.
//! - The lag of a term starts with y at the reference of the term. The rise is then zero, as at t = 0 in the
//!   article.
//! - A fixed reference is subtracted from y.
//! - A machine start resets the term: y becomes the temperature at the start. If that temperature becomes known later,
//!   y is shifted with it, and the rise does not change.
//! - A zero command does not change y. The rise is then measured from the value of y at the zero command. The
//!   rise begins at zero, and then shows the remaining response of the structure. A rise measured from the
//!   sensor's own temperature would jump by this remaining response.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{Input, Inputs};
use crate::compensation::Snapshot;
use crate::compensation::reference::{CapturedReference, Machine, Reference};
use crate::quantity::{Celsius, Moment, shifted};

/// Time constant C of a lag, above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeConstant {
    span: Duration,
    per_nanosecond: f64,
}

impl TimeConstant {
    /// Creates a time constant, which must be above zero.
    pub fn of(span: Duration) -> TimeConstant {
        TimeConstant { span, per_nanosecond: 1e-9 / span.as_secs_f64() }
    }

    /// Returns the time constant C as a duration.
    pub fn span(self) -> Duration {
        self.span
    }

    /// Returns a time in nanoseconds divided by the time constant. The conversion uses a signed number, because
    /// processors have an instruction for it.
    #[inline]
    #[allow(clippy::cast_precision_loss, reason = "a 64-bit float is precise enough for this quotient")]
    fn share(self, nanoseconds: u64) -> f64 {
        i64::try_from(nanoseconds).unwrap_or(i64::MAX) as f64 * self.per_nanosecond
    }
}

/// Absolute reading below which the lagged temperature is always finite.
const LARGE: f64 = 1e300;

/// Lag of one term of a model. Only its temperatures are saved for a restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Option<Lagged>", into = "Option<Lagged>")]
pub struct Lag {
    /// Temperature of the sensor and lagged temperature; `None` before the first reading.
    lagged: Option<Lagged>,
    /// Whether the lag was updated with a reading of its own sensor at the last snapshot.
    is_abreast: bool,
    /// Value of [`Machine::captures`] at the last update. While it is the same, the reference need not be looked up
    /// again.
    captures: u32,
}

/// Temperature of a sensor, and the lagged temperature of the structure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lagged {
    /// Time for which `input` and `follower` are valid.
    at: Moment,
    /// Last usable reading of the sensor. The next step assumes a straight line from this reading to the next reading.
    input: f64,
    /// Lagged temperature y, which follows `input` with the time constant of the lag.
    follower: f64,
    /// Lagged temperature at the reference. The lagged rise is measured from this value.
    from: f64,
    /// Time at which the capture of the reference that gave `from` was complete.
    captured: Moment,
}

/// Restores the lag from its saved temperatures.
impl From<Option<Lagged>> for Lag {
    fn from(lagged: Option<Lagged>) -> Lag {
        Lag { lagged, ..Lag::NONE }
    }
}

impl From<Lag> for Option<Lagged> {
    fn from(lag: Lag) -> Option<Lagged> {
        lag.lagged
    }
}

impl Lag {
    /// Lag before the first reading. It is also used for an input without a time constant.
    pub(super) const NONE: Lag = Lag { lagged: None, is_abreast: false, captures: 0 };

    /// Returns the temperatures that must be saved for a restart; `None` before the first reading.
    pub fn kept(&self) -> Option<Lagged> {
        self.lagged
    }

    /// Handles a machine start. Resets a lag that is measured from machine start, if the reference of the previous
    /// start was never captured. Every other lag that is measured from machine start is reset when the new reference is
    /// captured.
    pub(in crate::compensation) fn started(&mut self, input: &Input) {
        let is_captured = self.lagged.is_some_and(|lagged| lagged.captured != Moment::default());
        if input.reference == Reference::Start && !is_captured {
            *self = Lag::NONE;
        }
    }

    /// Updates the lag with this snapshot. A reading that cannot be used is skipped. The temperature is then assumed to
    /// change along a straight line up to the next usable reading.
    #[allow(clippy::inline_always, reason = "called for each lag of each step; takes most of a step's time")]
    #[inline(always)]
    pub fn follow(&mut self, input: &Input, snapshot: &Snapshot<'_>, machine: &Machine) {
        let Some(constant) = input.lag else { return };
        if self.is_measured_as_before(input, snapshot, machine)
            && let (Some(lagged), Some(value)) =
                (&mut self.lagged, snapshot.reading_below(LARGE, input.signal))
        {
            lagged.advance(value, snapshot.now, constant);
        } else {
            self.restart_following(input, constant, snapshot, machine);
        }
    }

    /// Returns whether the lag can be updated without looking up its reference: reference and sensor are the same as at
    /// the last snapshot.
    #[inline]
    fn is_measured_as_before(&self, input: &Input, snapshot: &Snapshot<'_>, machine: &Machine) -> bool {
        self.is_abreast
            && self.captures == machine.captures()
            && snapshot.substitutions.is_empty()
            && !input.squared
    }

    #[inline(never)]
    fn restart_following(
        &mut self,
        input: &Input,
        constant: TimeConstant,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) {
        self.is_abreast = false;
        let Ok((value, reference)) = input.level(snapshot, machine) else { return };
        let lagged = self.lagged.get_or_insert_with(|| Lagged::begin(value, reference, snapshot.now));
        lagged.begin_from(input.reference, reference);
        lagged.advance(value, snapshot.now, constant);
        lagged.measure_from(input.reference, reference);
        self.is_abreast = snapshot.substitutions.is_empty() && value.abs() < LARGE;
        self.captures = machine.captures();
        // A profile without ranges may accept a reading of 1e308. Its effect must not stay for ever.
        if !lagged.follower.is_finite() {
            *self = Lag::NONE;
        }
    }

    /// Returns the lagged rise after an update with this snapshot; `None` if it is not finite. The lag itself does not
    /// change.
    pub(super) fn rise(mut self, input: &Input, inputs: &Inputs<'_>) -> Option<Celsius> {
        self.follow(input, &inputs.snapshot, inputs.machine);
        self.lagged.as_ref().and_then(Lagged::rise)
    }

    /// Returns the lagged rise if the lag has already been updated with this snapshot; else `None`. Each step updates
    /// the lags before it evaluates the models.
    #[inline]
    pub(super) fn risen(&self, snapshot: &Snapshot<'_>) -> Option<Celsius> {
        self.lagged.as_ref().filter(|_| self.is_abreast && snapshot.is_followed)?.rise()
    }
}

shifted!(Lag: lagged);
shifted!(Lagged: at, captured);

impl Lagged {
    #[cfg(test)]
    pub(in crate::compensation) fn is_finite(&self) -> bool {
        [self.input, self.follower, self.from].iter().all(|value| value.is_finite())
    }

    /// Returns the temperatures with their time moved back by `span`, the time in which the gateway did not run. The
    /// next update then includes this time.
    pub(in crate::compensation) fn away(self, span: Duration) -> Lagged {
        Lagged { at: self.at.before(span), ..self }
    }

    fn begin(input: f64, reference: CapturedReference, at: Moment) -> Lagged {
        let (from, captured) = (reference.value.get(), reference.at);
        Lagged { at, input, follower: from, from, captured }
    }

    #[inline]
    fn rise(&self) -> Option<Celsius> {
        Celsius::new(self.follower - self.from)
    }

    /// Advances the lagged temperature y to `now` by the exact solution. If no time has passed, or if time went back, y
    /// does not change.
    #[inline]
    fn advance(&mut self, input: f64, now: Moment, constant: TimeConstant) {
        let share = constant.share(now.as_nanos().saturating_sub(self.at.as_nanos()));
        if share > 0.0 {
            let (behind, moved) = (self.input - self.follower, input - self.input);
            self.follower +=
                if share < SHORT { short(share, behind, moved) } else { long(share, behind, moved) };
        }
        self.at = now;
        self.input = input;
    }

    /// Takes over a machine-start reference that became known later, or is known better now. The present rise does not
    /// change.
    fn begin_from(&mut self, kind: Reference, reference: CapturedReference) {
        let is_belated = self.captured == Moment::default() || self.captured == reference.at;
        let by = reference.value.get() - self.from;
        if kind == Reference::Start && is_belated && by.abs() > 0.0 {
            (self.input, self.follower) = (self.input + by, self.follower + by);
            (self.from, self.captured) = (reference.value.get(), reference.at);
        }
    }

    fn measure_from(&mut self, kind: Reference, reference: CapturedReference) {
        let anew = reference.at != self.captured;
        self.captured = reference.at;
        match kind {
            Reference::Fixed(_) => self.from = reference.value.get(),
            Reference::Start if anew => {
                (self.follower, self.from) = (reference.value.get(), reference.value.get())
            }
            Reference::Zero if anew => self.from = self.follower,
            Reference::Start | Reference::Zero => {}
        }
    }
}

/// Fraction of a time constant below which a polynomial replaces the exponential function. The polynomial has full
/// double precision there, and is several times as fast.
const SHORT: f64 = 1.0 / 32.0;

/// Returns the change of the lagged temperature y in x = `share` time constants:
/// `(1 − e^−x)·behind + (1 − (1 − e^−x)/x)·moved`. At the start of this time, the input was greater than y by `behind`.
/// Since then the input has changed by `moved` along a straight line.
#[inline(never)]
fn long(share: f64, behind: f64, moved: f64) -> f64 {
    // Computes 1 − e^−x without the loss of digits for a small x.
    let gone = -(-share).exp_m1();
    gone * behind + (1.0 - gone / share) * moved
}

/// Returns the change of y as [`long`] does, for x below [`SHORT`]. With `p = (x − 1 + e^−x)/x²`, the two factors are
/// `x·(1 − x·p)` and `x·p`. In this form, few operations have to wait for each other's results.
#[inline]
fn short(share: f64, behind: f64, moved: f64) -> f64 {
    let straight = share * behind;
    straight + share * (bend(share) * (moved - straight))
}

/// Returns `(x − 1 + e^−x)/x²` = 1/2! − x/3! + x²/4! − …, by a polynomial. The polynomial is exact at the six Chebyshev
/// nodes of 0 to [`SHORT`], and its relative error is at most 2e-17.
#[inline]
fn bend(x: f64) -> f64 {
    let x2 = x * x;
    let first = 0.5 - x * 0.166_666_666_666_640_95;
    let second = 0.041_666_666_657_062_99 - x * 0.008_333_332_021_434_391;
    let third = 0.001_388_807_845_996_645_8 - x * 0.000_196_102_616_077_641_5;
    first + x2 * (second + x2 * third)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the two factors of [`long`] from their power series, with full double precision.
    fn exact(share: f64) -> (f64, f64) {
        let (mut term, mut gone) = (share, share);
        let (mut part, mut along) = (share / 2.0, share / 2.0);
        for order in 2..60 {
            term *= -share / f64::from(order);
            gone += term;
            part *= -share / f64::from(order + 1);
            along += part;
        }
        (gone, along)
    }

    #[test]
    fn a_short_time_is_answered_as_exactly_as_a_long_one() {
        for place in 1..4000 {
            let share = f64::from(place) / 4000.0 * 2.0 * SHORT;
            let (gone, along) = exact(share);
            let way = if share < SHORT { short } else { long };
            let found = (way(share, 1.0, 0.0), way(share, 0.0, 1.0));
            assert!((found.0 / gone - 1.0).abs() < 1e-15, "{share}: {} {gone}", found.0);
            assert!((found.1 / along - 1.0).abs() < 1e-13, "{share}: {} {along}", found.1);
        }
        let tiny = 1e-12;
        assert!((short(tiny, 0.0, 1.0) / 5e-13 - 1.0).abs() < 1e-11);
        assert!((short(tiny, 1.0, 0.0) / 1e-12 - 1.0).abs() < 1e-11);
    }

    #[test]
    fn where_the_polynomial_ends_nothing_jumps() {
        for (behind, moved) in [(1.0, 0.0), (0.0, 1.0), (-3.0, 2.0)] {
            let (below, above) = (short(SHORT.next_down(), behind, moved), long(SHORT, behind, moved));
            assert!((below - above).abs() < 1e-15, "{below} {above}");
        }
    }
}
