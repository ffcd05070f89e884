//! Check of the rate of change of one signal, also across a break of its device's continuity and a start of the
//! gateway.

use std::time::Duration;

use crate::quantity::Moment;

/// Shortest interval between two values that the calculation uses, seconds. With a shorter interval, noise between two
/// polls would count as too fast a change.
const LEAST_SECONDS: f64 = 1.0;

/// Reason why a value is implausible: its rate of change, or its jump across a break of continuity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateFault {
    /// The value changed faster than the `max_rate` of the profile.
    TooFast,
    /// The value differs too much from the last value before a break. The limit is `max_rate` times the time without a
    /// value.
    Jumped,
}

/// Filter that rejects implausible values of one signal. It compares each value with the last good value. After a break
/// of continuity, it compares the first value with the last value before the break.
///
/// While contact lasts, the allowed change grows with the time since the last good value. Over a break, the allowed
/// change grows only while no value arrives: a replaced device does not become plausible by waiting. A device may send
/// a wrong value before it fails. Therefore the first value after a break may also agree with the last good value. The
/// signal is accepted again when a value is within the allowed change, or after [`RateFilter::forget`], when the
/// operator has confirmed the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateFilter {
    /// Last good value with its time, with which later values are compared. `None` before the first good value.
    good: Option<(f64, Moment)>,
    /// Last value with its time, even if the value was rejected. `None` before the first value.
    last: Option<(f64, Moment)>,
    /// Number of breaks of the device's continuity when the last value arrived.
    breaks: u64,
    /// Time without a value before the gateway started, if `last` is a value of the former run; else zero.
    away: Duration,
    jump: Option<Jump>,
}

/// Jump across a break of continuity: no value has been accepted since the break.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Jump {
    /// Last value before the break of continuity.
    before: f64,
    /// Largest accepted difference from `before`.
    allowed: f64,
}

impl RateFilter {
    /// Creates a filter after a start of the gateway. `before` is the value from [`RateFilter::before_stop`] of the
    /// former run, and `away` the time without a value before the start. The first new value is checked as after a
    /// break.
    pub fn after_start(before: f64, start: Moment, away: Duration) -> RateFilter {
        RateFilter { last: Some((before, start)), breaks: u64::MAX, away, ..RateFilter::default() }
    }

    /// Returns the value with which the first value of the next run must be compared, and its age. This is the last
    /// good value, or the value before an unresolved jump. For a jump, the age is the time in which `rate` gives the
    /// allowed difference, because waiting does not make a jump plausible. `None` if there is no value.
    pub fn before_stop(&self, now: Moment, rate: f64) -> Option<(f64, Duration)> {
        if let Some(Jump { before, allowed }) = self.jump {
            return Some((before, Duration::try_from_secs_f64(allowed / rate).unwrap_or(Duration::MAX)));
        }
        // Without a good value, `last` is the value from the former run.
        let (value, taken) = self.good.or(self.last)?;
        Some((value, now.since(taken).saturating_add(self.away)))
    }

    /// Checks a value that was measured at `at` against `rate`, the `max_rate` per second (`None`: no limit). `breaks`
    /// is the number of breaks of continuity so far. A plausible value becomes the last good value.
    ///
    /// # Errors
    /// Returns why the value is implausible. The last good value does not change.
    pub fn assess(
        &mut self,
        value: f64,
        at: Moment,
        rate: Option<f64>,
        breaks: u64,
    ) -> Result<(), RateFault> {
        let Some(rate) = rate else {
            (self.breaks, self.last) = (breaks, Some((value, at)));
            (self.good, self.jump) = (Some((value, at)), None);
            return Ok(());
        };
        self.note((value, at), rate, breaks);
        let good = self.good.map(|(good, _)| good);
        let is_near = |jump: Jump, before: f64| (value - before).abs() <= jump.allowed;
        let fits = |jump: Jump| is_near(jump, jump.before) || good.is_some_and(|good| is_near(jump, good));
        if self.jump.is_some_and(|jump| !fits(jump)) {
            return Err(RateFault::Jumped);
        }
        self.jump = None;
        if self.good.is_some_and(|(good, taken)| (value - good).abs() > change_in(rate, at.since(taken))) {
            return Err(RateFault::TooFast);
        }
        self.good = Some((value, at));
        Ok(())
    }

    /// Records a value that is rejected for another reason, for example because it is out of range. After a break, the
    /// value ends the time without a value: from now on, waiting does not make a later value plausible.
    pub fn reject(&mut self, value: f64, at: Moment, rate: f64, breaks: u64) {
        if self.last.is_some() {
            self.note((value, at), rate, breaks);
        }
    }

    /// Records a value that is not used yet, because it may be a value of another device. The first value
    /// after a break ends the time without a value, as a rejected value does. Later values change nothing.
    pub fn hold_back(&mut self, value: f64, at: Moment, rate: f64, breaks: u64) {
        if self.breaks != breaks {
            self.reject(value, at, rate, breaks);
        }
    }

    /// Records a value. For the first value after a break, also calculates the allowed difference from the last value.
    fn note(&mut self, (value, at): (f64, Moment), rate: f64, breaks: u64) {
        let is_first = std::mem::replace(&mut self.breaks, breaks) != breaks;
        let last = self.last.replace((value, at));
        let away = std::mem::take(&mut self.away);
        if let (true, Some((before, taken))) = (is_first, last) {
            let allowed = change_in(rate, at.since(taken).saturating_add(away));
            match &mut self.jump {
                Some(jump) => jump.allowed += allowed,
                None => self.jump = Some(Jump { before, allowed }),
            }
        }
    }

    /// Returns the age of the last good value of this run of the gateway. `None` before the first good value.
    pub fn age_of_good(&self, now: Moment) -> Option<Duration> {
        self.good.map(|(_, taken)| now.since(taken))
    }

    /// Returns whether a value was rejected because of a jump across a break, and no value has been accepted since.
    pub fn has_jumped(&self) -> bool {
        self.jump.is_some()
    }

    /// Discards the last good value of this run, because it may be a value of another device. The next value
    /// is then accepted without a comparison. A jump across a break is kept: later values are still compared
    /// with the value before the break.
    pub fn forget_good(&mut self) {
        if self.good.take().is_some() && self.jump.is_none() {
            self.last = None;
        }
    }

    /// Discards all stored values, so that the next value is accepted.
    pub fn forget(&mut self) {
        (self.good, self.last, self.jump) = (None, None, None);
    }
}

/// Returns the largest plausible change of a value in the time `span`.
fn change_in(rate: f64, span: Duration) -> f64 {
    rate * span.as_secs_f64().max(LEAST_SECONDS)
}
