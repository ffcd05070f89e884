//! Rate of change of one signal, also over a break of its device's continuity.

use crate::quantity::Moment;

/// Two polls close together must not make noise look fast: the time between two values counts as at least this, seconds.
const LEAST_SECONDS: f64 = 1.0;

/// Why a value is implausible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateFault {
    /// It changed faster than `max_rate`.
    TooFast,
    /// It differs from the last good value by more than `max_rate` allowed when the device answered again.
    Jumped,
}

/// Compares each value of a signal with its last good one.
///
/// While contact lasts, the allowed change grows with the time since the last good value. The first value after a break fixes it:
/// another device does not become plausible by waiting. It is accepted when it comes within the fixed change, or when
/// [`RateFilter::forget`] is called because a person has confirmed the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateFilter {
    last: Option<(f64, Moment)>,
    /// Breaks of the device's continuity that the last value was judged with.
    breaks: u64,
    /// Largest change that is accepted after a break, in the unit of the signal.
    allowed: Option<f64>,
}

impl RateFilter {
    /// Judges a value taken at this time, with `max_rate` per second and the number of breaks of the device so far. A plausible value
    /// becomes the last good one.
    ///
    /// # Errors
    /// The value is implausible. The last good value stays.
    pub fn judge(&mut self, value: f64, at: Moment, rate: Option<f64>, breaks: u64) -> Result<(), RateFault> {
        let is_first = std::mem::replace(&mut self.breaks, breaks) != breaks;
        if let (Some(rate), Some((last, taken))) = (rate, self.last) {
            let grown = rate * at.since(taken).as_secs_f64().max(LEAST_SECONDS);
            if is_first && self.allowed.is_none() {
                self.allowed = Some(grown);
            }
            if (value - last).abs() > self.allowed.unwrap_or(grown) {
                return Err(if self.allowed.is_some() { RateFault::Jumped } else { RateFault::TooFast });
            }
        }
        (self.last, self.allowed) = (Some((value, at)), None);
        Ok(())
    }

    /// Returns whether a value was rejected because it jumped over a break, and none has been accepted since.
    pub fn has_jumped(&self) -> bool {
        self.allowed.is_some()
    }

    /// Forgets the last good value: the next value is accepted.
    pub fn forget(&mut self) {
        (self.last, self.allowed) = (None, None);
    }
}
