//! The time of a simulated machine: the runtime's own, which is paused and runs ahead, and what the computer slept.

#![allow(clippy::disallowed_types, reason = "this is where the simulation's time comes from")]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use isotherm::clock::Passing;
use tokio::time::{Instant, Sleep, sleep_until};

/// What has passed since the machine was switched on.
#[derive(Clone, Debug)]
pub(crate) struct Passage {
    begun: Instant,
    /// Nanoseconds in which the computer slept while the machine went on.
    slept: Arc<AtomicU64>,
}

impl Passage {
    pub(crate) fn begin() -> Passage {
        Passage { begun: Instant::now(), slept: Arc::default() }
    }

    pub(crate) fn now(&self) -> Duration {
        self.begun.elapsed() + Duration::from_nanos(self.slept.load(Ordering::Relaxed))
    }

    /// The same without what the computer slept.
    pub(crate) fn awake(&self) -> Duration {
        self.begun.elapsed()
    }

    /// The computer is suspended for so long: no timer of it runs meanwhile.
    pub(crate) fn suspend(&self, span: Duration) {
        let span = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        self.slept.fetch_add(span, Ordering::Relaxed);
    }

    /// The same as the gateway counts it.
    pub(crate) fn passing(&self) -> Passing {
        let passage = self.clone();
        Passing::by(move || passage.now())
    }

    /// A timer of the computer that is over then, if it does not sleep.
    pub(crate) fn timer(&self, at: Duration) -> Sleep {
        sleep_until(Instant::now() + at.saturating_sub(self.now()))
    }
}

/// Time of the computer that simulates.
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
