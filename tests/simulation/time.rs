//! Time of a simulated machine: the paused time of the runtime, which advances without waiting, and the time in which
//! the computer slept.

#![allow(clippy::disallowed_types, reason = "this is where the simulation's time comes from")]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::BootClock;
use tokio::time::{Instant, Sleep, sleep_until};

/// Time since the machine was switched on.
#[derive(Clone, Debug)]
pub(crate) struct Passage {
    begun: Instant,
    /// Time in which the computer slept while the machine was running, in nanoseconds.
    slept: Arc<AtomicU64>,
}

impl Passage {
    pub(crate) fn begin() -> Passage {
        Passage { begun: Instant::now(), slept: Arc::default() }
    }

    pub(crate) fn now(&self) -> Duration {
        self.begun.elapsed() + Duration::from_nanos(self.slept.load(Ordering::Relaxed))
    }

    /// Time since the machine was switched on, without the time in which the computer slept.
    pub(crate) fn awake(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Suspends the computer for this time. Its timers do not run meanwhile.
    pub(crate) fn suspend(&self, span: Duration) {
        let span = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        self.slept.fetch_add(span, Ordering::Relaxed);
    }

    /// Time source for the gateway.
    pub(crate) fn passing(&self) -> BootClock {
        let passage = self.clone();
        BootClock::by(move || passage.now())
    }

    /// Timer of the computer that expires at this time, unless the computer sleeps.
    pub(crate) fn timer(&self, at: Duration) -> Sleep {
        sleep_until(Instant::now() + at.saturating_sub(self.now()))
    }
}

/// Real time of the computer that runs the simulation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stopwatch(std::time::Instant);

impl Stopwatch {
    pub(crate) fn begin() -> Stopwatch {
        Stopwatch(std::time::Instant::now())
    }

    pub(crate) fn passed(self) -> Duration {
        self.0.elapsed()
    }
}
