//! Rate of change of one signal, also over a break of its device's continuity and over a start of the gateway.

use std::time::Duration;

use crate::quantity::Moment;

/// Two polls close together must not make noise look fast: the time between two values counts as at least this, seconds.
const LEAST_SECONDS: f64 = 1.0;

/// Why a value is implausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateFault {
    /// Change faster than `max_rate`.
    TooFast,
    /// Difference from the last value before a break that is larger than `max_rate` allows for the time without a value.
    Jumped,
}

/// Compares each value of a signal with its last good one, and the first value after a break of its device's continuity with the last
/// one before.
///
/// While contact lasts, the allowed change grows with the time since the last good value. Over a break it grows only while no value
/// comes: another device does not become plausible by waiting. It is accepted when it comes within that change, or when
/// [`RateFilter::forget`] is called because a person has confirmed the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateFilter {
    /// Last good value.
    good: Option<(f64, Moment)>,
    /// Last value, good or not.
    last: Option<(f64, Moment)>,
    /// Breaks of the device's continuity before the last value.
    breaks: u64,
    /// Time without a value before `last`, where that is the time of the start.
    away: Duration,
    jump: Option<Jump>,
}

/// A value that differs too much from the last one before a break.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Jump {
    /// Last value before the break.
    before: f64,
    /// Largest difference from it that is accepted.
    allowed: f64,
}

impl RateFilter {
    /// Begins with what [`RateFilter::before_stop`] has left in a former run, this long before the start. The first value is compared
    /// with it as after a break.
    pub fn after_start(before: f64, start: Moment, away: Duration) -> RateFilter {
        RateFilter { last: Some((before, start)), breaks: u64::MAX, away, ..RateFilter::default() }
    }

    /// Returns the value with which the first one after a stop is to be compared, and for how long none has come: the last good
    /// one, or the one before a jump that lasts. Waiting makes a jump no more plausible than it is.
    pub fn before_stop(&self, now: Moment, rate: f64) -> Option<(f64, Duration)> {
        if let Some(Jump { before, allowed }) = self.jump {
            return Some((before, Duration::try_from_secs_f64(allowed / rate).unwrap_or(Duration::MAX)));
        }
        // Without a good value none has come since the start.
        let (value, taken) = self.good.or(self.last)?;
        Some((value, now.since(taken).saturating_add(self.away)))
    }

    /// Judges a value taken at this time, with `max_rate` per second and the number of breaks of the device so far. A plausible value
    /// becomes the last good one.
    ///
    /// # Errors
    /// The value is implausible. The last good value stays.
    pub fn judge(&mut self, value: f64, at: Moment, rate: Option<f64>, breaks: u64) -> Result<(), RateFault> {
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

    /// Returns whether a value was rejected because it jumped over a break, and none has been accepted since.
    pub fn has_jumped(&self) -> bool {
        self.jump.is_some()
    }

    /// Forgets all values: the next one is accepted.
    pub fn forget(&mut self) {
        (self.good, self.last, self.jump) = (None, None, None);
    }
}
