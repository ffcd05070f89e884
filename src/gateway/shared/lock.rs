//! Lock guard of the shared state (value that releases the lock when it is dropped). The guard measures how long the
//! lock is held. After the release, it reports the events that were added under the lock.

use std::ops::{Deref, DerefMut};
use std::sync::MutexGuard;

use super::shared_state::Shared;
use super::state::GatewayState;
use crate::observe::events::Event;
use isotherm_core::quantity::Moment;

/// Upper bounds of the histogram's buckets, in µs.
const BOUNDS_US: [u64; 8] = [2, 5, 10, 20, 50, 100, 500, 5000];

/// Sampling interval of the measurement, in locks. The gateway measures only one lock in each interval,
/// because the two clock samples of a measurement cost more time than most locks. The number is prime, so
/// that each lock of a repeated sequence is measured at some time.
const SAMPLED: u64 = 17;

/// Histogram of the times for which the lock was held. Another task may have to wait equally long for the
/// lock.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::gateway) struct LockTimes {
    taken: u64,
    counts: [u64; BOUNDS_US.len() + 1],
}

impl LockTimes {
    /// Returns the upper bound of each bucket in seconds, and the number of measured locks in the bucket. The last
    /// bound is infinite.
    pub(in crate::gateway) fn read(&self) -> Vec<(f64, u64)> {
        #[allow(clippy::cast_precision_loss, reason = "a few thousand at most")]
        let bounds = BOUNDS_US.iter().map(|bound| *bound as f64 * 1e-6).chain([f64::INFINITY]);
        bounds.zip(self.counts).collect()
    }

    /// Counts a lock. Returns whether this lock must be measured.
    fn take(&mut self) -> bool {
        self.taken += 1;
        self.taken.is_multiple_of(SAMPLED)
    }

    fn note(&mut self, span: std::time::Duration) {
        let micros = span.as_micros();
        let bucket = BOUNDS_US.iter().position(|bound| micros < u128::from(*bound));
        self.counts[bucket.unwrap_or(BOUNDS_US.len())] += 1;
    }
}

/// Lock guard of the shared state: the lock is released when the guard is dropped. The events in
/// [`GatewayState::events`] are reported directly after the release.
pub(in crate::gateway) struct StateGuard<'a> {
    core: MutexGuard<'a, GatewayState>,
    /// Start of the measurement; `None` if this lock is not measured.
    since: Option<Moment>,
    /// Events to report. The order of the fields is important: this field is dropped after the lock, and reports its
    /// events when it is dropped.
    after: Unreported<'a>,
}

/// Events that have not been reported yet.
struct Unreported<'a> {
    shared: &'a Shared,
    events: Vec<Event>,
}

impl<'a> StateGuard<'a> {
    pub(super) fn new(mut core: MutexGuard<'a, GatewayState>, shared: &'a Shared) -> StateGuard<'a> {
        let since = core.lock_times.take().then(|| shared.clock.now());
        StateGuard { core, since, after: Unreported { shared, events: Vec::new() } }
    }
}

impl Deref for StateGuard<'_> {
    type Target = GatewayState;

    fn deref(&self) -> &GatewayState {
        &self.core
    }
}

impl DerefMut for StateGuard<'_> {
    fn deref_mut(&mut self) -> &mut GatewayState {
        &mut self.core
    }
}

impl Drop for StateGuard<'_> {
    fn drop(&mut self) {
        self.after.events = std::mem::take(&mut self.core.events);
        if let Some(since) = self.since {
            let span = self.after.shared.clock.now().since(since);
            self.core.lock_times.note(span);
        }
    }
}

impl Drop for Unreported<'_> {
    fn drop(&mut self) {
        self.events.iter().for_each(|event| self.shared.report(event));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn one_lock_of_so_many_is_measured_and_only_that_is_counted() {
        let mut times = LockTimes::default();
        for _ in 0..10 * SAMPLED {
            if times.take() {
                times.note(Duration::from_micros(7));
            }
        }
        let counts: Vec<u64> = times.read().iter().map(|(_, count)| *count).collect();
        assert_eq!(counts, [0, 0, 10, 0, 0, 0, 0, 0, 0]);
    }
}
