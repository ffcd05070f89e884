//! Points in time, in nanoseconds since the Unix epoch.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Point in time, in nanoseconds since the Unix epoch. The gateway takes the first moment from the wall clock
/// at its start, and advances it monotonically: setting the clock does not change moments. A
/// [`Shift`](super::Shift) converts a moment to the time of a clock that was set after the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Moment(u64);

impl Moment {
    /// Latest possible moment, which stands for "never".
    pub const END: Moment = Moment(u64::MAX);

    /// Creates the moment this many nanoseconds after the Unix epoch.
    pub const fn from_nanos(nanos: u64) -> Moment {
        Moment(nanos)
    }

    /// Returns the nanoseconds since the Unix epoch.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Returns the seconds since the Unix epoch.
    pub fn as_secs_f64(self) -> f64 {
        Duration::from_nanos(self.0).as_secs_f64()
    }

    /// Returns the time since `earlier`. Zero if `earlier` is later than `self`.
    pub fn since(self, earlier: Moment) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// Returns the moment `span` later, at most [`Moment::END`].
    pub fn after(self, span: Duration) -> Moment {
        Moment(self.0.saturating_add(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// Returns the moment `span` earlier, at least the Unix epoch.
    pub fn before(self, span: Duration) -> Moment {
        Moment(self.0.saturating_sub(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)))
    }

    /// Returns the next tick after `self` of a period that starts at `first`. Ticks that were missed are skipped.
    pub fn next_tick(self, first: Moment, period: Duration) -> Moment {
        let period = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX).max(1);
        if self < first {
            return first;
        }
        let passed = (self.0 - first.0) / period;
        Moment(first.0.saturating_add(passed.saturating_add(1).saturating_mul(period)))
    }
}

/// Formats the moment as RFC 3339 in UTC, with as many decimals as necessary.
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
