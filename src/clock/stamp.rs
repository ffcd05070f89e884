//! The time of day beside the counted time: where the computer's clock is set, stamps follow, and nothing else.

use std::fmt;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use isotherm_core::quantity::{Moment, Shift, Shifted};

/// Clocks that drift apart by less are not worth a word.
pub const SMALLEST_CORRECTION: Duration = Duration::from_secs(2);

/// How far the time of day is from the counted one, as it was seen last.
#[derive(Debug, Default)]
pub(super) struct Followed(AtomicI64);

/// The computer's clock was set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Correction {
    /// What it would say.
    pub from: Moment,
    /// What it says.
    pub to: Moment,
}

/// From when to when.
impl fmt::Display for Correction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} → {}", self.from, self.to)
    }
}

/// Whether something holds the computer's clock to the right time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Synchronised {
    /// The kernel says so.
    Yes,
    /// It says that nobody does: normal where there is no network.
    No,
    /// It does not say.
    #[default]
    NotKnown,
}

impl Followed {
    pub(super) fn shift(&self) -> Shift {
        Shift::from_nanos(self.0.load(Ordering::Relaxed))
    }

    pub(super) fn follow(&self, shift: Shift) {
        self.0.store(shift.as_nanos(), Ordering::Relaxed);
    }

    /// Follows what the time of day is at this counted moment. Whether it was set since the last look.
    pub(super) fn look(&self, now: Moment, time_of_day: Moment) -> Option<Correction> {
        let from = now.shifted(self.shift());
        self.follow(Shift::between(now, time_of_day));
        let apart = from.since(time_of_day).max(time_of_day.since(from));
        (apart > SMALLEST_CORRECTION).then_some(Correction { from, to: time_of_day })
    }
}

impl Synchronised {
    /// What the kernel says, by adjtimex(2).
    pub fn by_the_kernel() -> Synchronised {
        let mut asked = rtime_clock::adjtime::Timex::new();
        match rtime_clock::adjtime::adjtimex(&mut asked) {
            Ok(_) if asked.0.status & libc::STA_UNSYNC == 0 => Synchronised::Yes,
            Ok(_) => Synchronised::No,
            Err(_) => Synchronised::NotKnown,
        }
    }

    /// The words for it.
    pub fn display(self) -> &'static str {
        match self {
            Synchronised::Yes => "synchronised",
            Synchronised::No => "not synchronised",
            Synchronised::NotKnown => "not known",
        }
    }
}
