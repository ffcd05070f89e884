//! Rate of change of one signal, also over a break of its device's continuity and over a start of the gateway.

use std::time::Duration;

use crate::quantity::Moment;

/// Least interval between two values in the calculation, seconds. Noise between two polls in quick succession would
/// otherwise be too fast.
const LEAST_SECONDS: f64 = 1.0;

/// Reason why a value is implausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateFault {
    /// Change faster than `max_rate`.
    TooFast,
    /// The difference from the last value before a break exceeds `max_rate` times the time without a value.
    Jumped,
}

/// Filter of implausible values of one signal. It compares each value with the last good one. It compares the first
/// value after a break of continuity with the last one before it.
///
/// While contact lasts, the allowed change grows with the time since the last good value. Over a break it grows only
/// while no value arrives: a replaced device does not become plausible by waiting. The signal is accepted again when a
/// value is within the allowed change. It is also accepted after [`RateFilter::forget`], when the operator has
/// confirmed the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateFilter {
    /// Last good value with its time. Later values are compared with it.
    good: Option<(f64, Moment)>,
    /// Last value, good or not.
    last: Option<(f64, Moment)>,
    /// Number of breaks of continuity at the last value.
    breaks: u64,
    /// Time without a value before `last`, if `last` has the time of the start.
    away: Duration,
    jump: Option<Jump>,
}

/// Rejected difference from the last value before a break.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Jump {
    /// Last value before the break.
    before: f64,
    /// Largest accepted difference from it.
    allowed: f64,
}

impl RateFilter {
    /// Creates a filter with the result of [`RateFilter::before_stop`] in a former run. `away` is the time without a
    /// value before the start. The first value is compared as after a break.
    pub fn after_start(before: f64, start: Moment, away: Duration) -> RateFilter {
        RateFilter { last: Some((before, start)), breaks: u64::MAX, away, ..RateFilter::default() }
    }

    /// Returns the value with which the first one after a stop is to be compared, and the time since then. This is the
    /// last good value, or the last one before a jump that is not resolved. Waiting does not make a jump plausible.
    /// Returns `None` without any value.
    pub fn before_stop(&self, now: Moment, rate: f64) -> Option<(f64, Duration)> {
        if let Some(Jump { before, allowed }) = self.jump {
            return Some((before, Duration::try_from_secs_f64(allowed / rate).unwrap_or(Duration::MAX)));
        }
        // Without a good value, `last` is the value from the former run.
        let (value, taken) = self.good.or(self.last)?;
        Some((value, now.since(taken).saturating_add(self.away)))
    }

    /// Checks a value of this time against `rate`, the `max_rate` per second. `breaks` is the number of breaks of
    /// continuity so far. A plausible value becomes the last good one.
    ///
    /// # Errors
    /// The reason why the value is implausible. The last good value stays.
    pub fn assess(
        &mut self,
        value: f64,
        at: Moment,
        rate: Option<f64>,
        breaks: u64,
    ) -> Result<(), RateFault> {
        let is_first = std::mem::replace(&mut self.breaks, breaks) != breaks;
        let last = self.last.replace((value, at));
        let Some(rate) = rate else {
            (self.good, self.jump) = (Some((value, at)), None);
            return Ok(());
        };
        let away = std::mem::take(&mut self.away);
        let change_in = |span: Duration| rate * span.as_secs_f64().max(LEAST_SECONDS);
        if let (true, Some((before, taken))) = (is_first, last) {
            let allowed = change_in(at.since(taken).saturating_add(away));
            match &mut self.jump {
                Some(jump) => jump.allowed += allowed,
                None => self.jump = Some(Jump { before, allowed }),
            }
        }
        if self.jump.is_some_and(|jump| (value - jump.before).abs() > jump.allowed) {
            return Err(RateFault::Jumped);
        }
        self.jump = None;
        if self.good.is_some_and(|(good, taken)| (value - good).abs() > change_in(at.since(taken))) {
            return Err(RateFault::TooFast);
        }
        self.good = Some((value, at));
        Ok(())
    }

    /// Returns whether a value was rejected because of a jump over a break, and none has been accepted since.
    pub fn has_jumped(&self) -> bool {
        self.jump.is_some()
    }

    /// Forgets all values. The next value is accepted.
    pub fn forget(&mut self) {
        (self.good, self.last, self.jump) = (None, None, None);
    }
}
