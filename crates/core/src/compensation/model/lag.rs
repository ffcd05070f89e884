//! A structure follows its temperature late: `E = K·L·ΔT·(1 − e^(−t/C))`, Janeczko 1989.
//!
//! `1 − e^(−t/C)` is the step response of a first-order lag. For a temperature u that moves in a straight line between
//! two readings (first-order hold) the lagged temperature y has the exact solution, with `a = e^(−dt/C)`,
//!
//! ```text
//! y1 = a·y0 + (1 − a)·u0 + (1 − (1 − a)·C/dt)·(u1 − u0)
//! ```
//!
//! for any dt: ten milliseconds, or the hour in which the gateway was off or the sensor was bad.
//!
//! # What the rise is measured from
//! The temperature y itself is kept, not its rise, so that a reference may move without disturbing what is under way.
//! - A term that begins is at rest on its reference: the article's t = 0.
//! - A fixed reference is subtracted.
//! - A machine start begins the term anew: y is the temperature at the start. Where that was not read, and becomes known
//!   later, y moves with it: the rise goes on.
//! - A zero lets y go on and measures from the y of that moment: the rise is zero there, and what the structure still
//!   has to make up comes afterwards. Measured from the sensor's own temperature, the rise would jump by that rest.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{Input, Inputs};
use crate::compensation::Snapshot;
use crate::compensation::reference::{Captured, Machine, Reference};
use crate::quantity::{Celsius, Moment, shifted};

/// The time constant C of a lag, above zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeConstant {
    span: Duration,
    per_nanosecond: f64,
}

impl TimeConstant {
    /// Of this span.
    pub fn of(span: Duration) -> TimeConstant {
        TimeConstant { span, per_nanosecond: 1e-9 / span.as_secs_f64() }
    }

    /// How long it is.
    pub fn span(self) -> Duration {
        self.span
    }

    /// How much of it so many nanoseconds are. By way of a signed number, for which processors have an instruction.
    #[inline]
    #[allow(clippy::cast_precision_loss, reason = "a share of a time constant needs no more")]
    fn share(self, nanoseconds: u64) -> f64 {
        i64::try_from(nanoseconds).unwrap_or(i64::MAX) as f64 * self.per_nanosecond
    }
}

/// What follows readings that are all less than this is a finite number.
const LARGE: f64 = 1e300;

/// The lag of one term. Only its temperatures are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Option<Lagged>", into = "Option<Lagged>")]
pub struct Lag {
    /// Nothing before its first reading.
    lagged: Option<Lagged>,
    /// It has gone on to a reading of its own sensor at the snapshot that came last.
    is_abreast: bool,
    /// How often references had been captured then: what it is measured from was looked up.
    captures: u32,
}

/// A temperature and the one that follows it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lagged {
    /// When both held.
    at: Moment,
    /// The reading.
    input: f64,
    /// What follows it.
    follower: f64,
    /// What the rise of the follower is measured from.
    from: f64,
    /// When the reference behind it was captured.
    captured: Moment,
}

/// The lag as it was kept.
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
    /// Of what has none.
    pub(super) const NONE: Lag = Lag { lagged: None, is_abreast: false, captures: 0 };

    /// What is worth keeping.
    pub fn kept(&self) -> Option<Lagged> {
        self.lagged
    }

    /// The machine was started. One that is measured from that, and whose start nobody could read, begins anew; every other
    /// one does where its start is captured.
    pub(in crate::compensation) fn started(&mut self, input: &Input) {
        let is_captured = self.lagged.is_some_and(|lagged| lagged.captured != Moment::default());
        if input.reference == Reference::Start && !is_captured {
            *self = Lag::NONE;
        }
    }

    /// Goes on to this snapshot. A reading that cannot be used is waited for: the gap is a straight line to the next.
    #[allow(clippy::inline_always, reason = "called for each lag of each step: most of what that does")]
    #[inline(always)]
    pub fn follow(&mut self, input: &Input, snapshot: &Snapshot<'_>, machine: &Machine) {
        let Some(constant) = input.lag else { return };
        if self.is_measured_as_before(input, snapshot, machine)
            && let (Some(lagged), Some(value)) =
                (&mut self.lagged, snapshot.reading_below(LARGE, input.signal))
        {
            lagged.advance(value, snapshot.now, constant);
        } else {
            self.follow_anew(input, constant, snapshot, machine);
        }
    }

    /// What it is measured from is what it was at the last snapshot, and its own sensor is believed as it was then.
    #[inline]
    fn is_measured_as_before(&self, input: &Input, snapshot: &Snapshot<'_>, machine: &Machine) -> bool {
        self.is_abreast
            && self.captures == machine.captures()
            && snapshot.instead.is_empty()
            && !input.squared
    }

    #[inline(never)]
    fn follow_anew(
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
        self.is_abreast = snapshot.instead.is_empty() && value.abs() < LARGE;
        self.captures = machine.captures();
        // A reading of 1e308 may be believed by a profile without ranges; it must not stay for ever.
        if !lagged.follower.is_finite() {
            *self = Lag::NONE;
        }
    }

    /// The lagged rise at this snapshot; `None` where it is no number.
    pub(super) fn rise(mut self, input: &Input, inputs: &Inputs<'_>) -> Option<Celsius> {
        self.follow(input, &inputs.snapshot, inputs.machine);
        self.lagged.as_ref().and_then(Lagged::rise)
    }

    /// The same where it has gone on to this snapshot already, as in every step.
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

    /// The same where this much more time has passed since both held.
    pub(in crate::compensation) fn away(self, span: Duration) -> Lagged {
        Lagged { at: self.at.before(span), ..self }
    }

    fn begin(input: f64, reference: Captured, at: Moment) -> Lagged {
        let (from, captured) = (reference.value.get(), reference.at);
        Lagged { at, input, follower: from, from, captured }
    }

    #[inline]
    fn rise(&self) -> Option<Celsius> {
        Celsius::new(self.follower - self.from)
    }

    /// The exact solution. Where no time has passed, or it ran back, the follower stays where it is.
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

    /// What was not read at the machine's start is known now, or known better: the rise that is under way stays what it is.
    fn begin_from(&mut self, kind: Reference, reference: Captured) {
        let is_belated = self.captured == Moment::default() || self.captured == reference.at;
        let by = reference.value.get() - self.from;
        if kind == Reference::Start && is_belated && by.abs() > 0.0 {
            (self.input, self.follower) = (self.input + by, self.follower + by);
            (self.from, self.captured) = (reference.value.get(), reference.at);
        }
    }

    fn measure_from(&mut self, kind: Reference, reference: Captured) {
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

/// Below this share of a time constant a polynomial is as exact as a double can be, and several times as fast.
const SHORT: f64 = 1.0 / 32.0;

/// How far a follower goes in a share x of its time constant towards an input that was `behind` it and has `moved` in a
/// straight line: `(1 − e^−x)·behind + (1 − (1 − e^−x)/x)·moved`.
#[inline(never)]
fn long(share: f64, behind: f64, moved: f64) -> f64 {
    // 1 − e^−x, without the digits that this loses for a small x.
    let gone = -(-share).exp_m1();
    gone * behind + (1.0 - gone / share) * moved
}

/// The same below [`SHORT`], where both factors are made of one: with `p = (x − 1 + e^−x)/x²` they are `x·(1 − x·p)` and
/// `x·p`. So few operations wait for each other.
#[inline]
fn short(share: f64, behind: f64, moved: f64) -> f64 {
    let straight = share * behind;
    straight + share * (bend(share) * (moved - straight))
}

/// `(x − 1 + e^−x)/x²` = 1/2! − x/3! + x²/4! − …, by the polynomial that meets it at the six Chebyshev nodes of 0 to [`SHORT`]:
/// nowhere further from it than 2e-17 of it.
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

    /// Both by their own series, to the last digit.
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
