//! Time of day for display: counted time, which is independent of the computer's clock, plus a difference. If the
//! computer's clock is set, only this difference changes.

use std::fmt;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use isotherm_core::quantity::{Moment, Shift, Shifted};

/// Largest difference between two checks that is not reported as a correction of the computer's clock.
pub const SMALLEST_CORRECTION: Duration = Duration::from_secs(2);

/// Difference between time of day and counted time in nanoseconds, as measured by the last check.
#[derive(Debug, Default)]
pub(super) struct ClockDifference(AtomicI64);

/// Correction of the computer's clock: it was set to another time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Correction {
    /// Time of day that the clock would show without the correction.
    pub from: Moment,
    /// Time of day that the clock shows after the correction.
    pub to: Moment,
}

/// Formats the expected and the new time of day, with an arrow between them.
impl fmt::Display for Correction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} → {}", self.from, self.to)
    }
}

/// Whether a time service (such as NTP) synchronises the computer's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Synchronised {
    /// The kernel reports a synchronised clock.
    Yes,
    /// The kernel reports an unsynchronised clock. This is normal without a network.
    No,
    /// The kernel does not report whether its clock is synchronised.
    #[default]
    NotKnown,
}

impl ClockDifference {
    pub(super) fn shift(&self) -> Shift {
        Shift::from_nanos(self.0.load(Ordering::Relaxed))
    }

    pub(super) fn follow(&self, shift: Shift) {
        self.0.store(shift.as_nanos(), Ordering::Relaxed);
    }

    /// Sets the difference to the time of day at the counted moment `now`. Returns a correction if the clock was set
    /// since the last check.
    pub(super) fn check(&self, now: Moment, time_of_day: Moment) -> Option<Correction> {
        let from = now.shifted(self.shift());
        self.follow(Shift::between(now, time_of_day));
        let apart = from.since(time_of_day).max(time_of_day.since(from));
        (apart > SMALLEST_CORRECTION).then_some(Correction { from, to: time_of_day })
    }
}

impl Synchronised {
    /// Queries the kernel for its synchronisation state, with `adjtimex(2)`.
    pub fn by_the_kernel() -> Synchronised {
        let mut asked = rtime_clock::adjtime::Timex::new();
        match rtime_clock::adjtime::adjtimex(&mut asked) {
            Ok(_) if asked.0.status & libc::STA_UNSYNC == 0 => Synchronised::Yes,
            Ok(_) => Synchronised::No,
            Err(_) => Synchronised::NotKnown,
        }
    }

    /// Returns the synchronisation state as text for display.
    pub fn display(self) -> &'static str {
        match self {
            Synchronised::Yes => "synchronised",
            Synchronised::No => "not synchronised",
            Synchronised::NotKnown => "not known",
        }
    }
}
