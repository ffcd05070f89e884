//! Numbers that say what they are.
//!
//! Each constructor refuses NaN and infinity, so arithmetic behind it never meets them. Units are fixed
//! everywhere: temperature °C, displacement µm, position mm, time s.

use std::fmt;
use std::ops::{Add, Neg, Sub};
use std::time::Duration;

use serde::{Deserialize, Serialize};

pub mod time;

/// A displacement or a compensation value in micrometres. Always finite.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Micron(f64);

impl Micron {
    /// No displacement.
    pub const ZERO: Micron = Micron(0.0);

    /// A finite number of micrometres; `None` for NaN or infinity.
    pub fn new(value: f64) -> Option<Micron> {
        value.is_finite().then_some(Micron(value))
    }

    /// The number, in µm.
    pub fn get(self) -> f64 {
        self.0
    }

    /// The distance from zero.
    pub fn abs(self) -> Micron {
        Micron(self.0.abs())
    }

    /// The value inside `±limit`.
    pub fn clamp_to(self, limit: Micron) -> Micron {
        Micron(self.0.clamp(-limit.0.abs(), limit.0.abs()))
    }
}

impl From<Micron> for f64 {
    fn from(micron: Micron) -> f64 {
        micron.0
    }
}

impl TryFrom<f64> for Micron {
    type Error = &'static str;
    fn try_from(value: f64) -> Result<Micron, Self::Error> {
        Micron::new(value).ok_or("a displacement is a finite number")
    }
}

impl Add for Micron {
    type Output = Micron;
    fn add(self, other: Micron) -> Micron {
        Micron((self.0 + other.0).clamp(f64::MIN, f64::MAX))
    }
}

impl Sub for Micron {
    type Output = Micron;
    fn sub(self, other: Micron) -> Micron {
        Micron((self.0 - other.0).clamp(f64::MIN, f64::MAX))
    }
}

impl Neg for Micron {
    type Output = Micron;
    fn neg(self) -> Micron {
        Micron(-self.0)
    }
}

impl fmt::Display for Micron {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} µm", self.0)
    }
}

/// A point on the machine's time line: nanoseconds since the Unix epoch, taken once from the wall at start
/// and advanced monotonically from there, so that a clock adjustment never moves it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Moment(u64);

impl Moment {
    /// No moment is later.
    pub const END: Moment = Moment(u64::MAX);

    /// The moment this many nanoseconds after the Unix epoch.
    pub const fn from_nanos(nanos: u64) -> Moment {
        Moment(nanos)
    }

    /// Nanoseconds since the Unix epoch.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Seconds since the Unix epoch.
    pub fn as_secs_f64(self) -> f64 {
        Duration::from_nanos(self.0).as_secs_f64()
    }

    /// Time passed since `earlier`; zero where `earlier` lies ahead.
    pub fn since(self, earlier: Moment) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The moment `span` later, saturating at the end of time.
    pub fn after(self, span: Duration) -> Moment {
        Moment(self.0.saturating_add(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// The moment `span` earlier, saturating at the beginning of time.
    pub fn before(self, span: Duration) -> Moment {
        Moment(self.0.saturating_sub(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// The next tick of a period counted from `first`, strictly later than `self`: missed ticks are skipped.
    pub fn next_tick(self, first: Moment, period: Duration) -> Moment {
        let period = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX).max(1);
        if self < first {
            return first;
        }
        let passed = (self.0 - first.0) / period;
        Moment(first.0.saturating_add(passed.saturating_add(1).saturating_mul(period)))
    }
}

/// Prints RFC 3339 in UTC, with as many digits as it has.
impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match jiff::Timestamp::from_nanosecond(i128::from(self.0)) {
            Ok(stamp) => write!(f, "{stamp}"),
            Err(_) => write!(f, "{} ns", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_micron_refuses_what_is_not_a_number() {
        assert_eq!(Micron::new(f64::NAN), None);
        assert_eq!(Micron::new(f64::INFINITY), None);
        assert_eq!(Micron::new(8.4).map(Micron::get), Some(8.4));
    }

    #[test]
    fn missed_ticks_are_skipped_never_caught_up() {
        let first = Moment::from_nanos(0);
        let second = Duration::from_secs(1);
        assert_eq!(Moment::from_nanos(0).next_tick(first, second), Moment::from_nanos(1_000_000_000));
        assert_eq!(
            Moment::from_nanos(7_300_000_000).next_tick(first, second),
            Moment::from_nanos(8_000_000_000)
        );
        assert_eq!(Moment::from_nanos(5).next_tick(Moment::from_nanos(9), second), Moment::from_nanos(9));
    }

    #[test]
    fn a_moment_never_runs_before_its_beginning() {
        assert_eq!(Moment::from_nanos(3).since(Moment::from_nanos(9)), Duration::ZERO);
    }
}
