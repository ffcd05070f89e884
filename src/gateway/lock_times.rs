//! How long the lock is held: a histogram, since nobody who waits for it can be late by less.

use std::ops::{Deref, DerefMut};
use std::sync::MutexGuard;
use std::sync::atomic::{AtomicU64, Ordering};

use super::core::Core;
use crate::clock::Clock;
use isotherm_core::quantity::Moment;

/// Upper bounds of the buckets, µs.
const BOUNDS_US: [u64; 8] = [2, 5, 10, 20, 50, 100, 500, 5000];

/// How often it was held for how long.
#[derive(Debug, Default)]
pub(super) struct LockTimes([AtomicU64; BOUNDS_US.len() + 1]);

impl LockTimes {
    /// The upper bound of each bucket in seconds, the last one without end, and how often it was held for no longer than
    /// that but longer than the bound before.
    pub(super) fn read(&self) -> Vec<(f64, u64)> {
        #[allow(clippy::cast_precision_loss, reason = "a few thousand at most")]
        let bounds = BOUNDS_US.iter().map(|bound| *bound as f64 * 1e-6).chain([f64::INFINITY]);
        bounds.zip(&self.0).map(|(bound, count)| (bound, count.load(Ordering::Relaxed))).collect()
    }

    fn note(&self, span: std::time::Duration) {
        let micros = span.as_micros();
        let bucket =
            BOUNDS_US.iter().position(|bound| micros < u128::from(*bound)).unwrap_or(BOUNDS_US.len());
        self.0[bucket].fetch_add(1, Ordering::Relaxed);
    }
}

/// The lock, held.
pub(super) struct Held<'a> {
    core: MutexGuard<'a, Core>,
    clock: &'a Clock,
    since: Moment,
    times: &'a LockTimes,
}

impl<'a> Held<'a> {
    pub(super) fn new(core: MutexGuard<'a, Core>, clock: &'a Clock, times: &'a LockTimes) -> Held<'a> {
        Held { core, clock, since: clock.now(), times }
    }
}

impl Deref for Held<'_> {
    type Target = Core;

    fn deref(&self) -> &Core {
        &self.core
    }
}

impl DerefMut for Held<'_> {
    fn deref_mut(&mut self) -> &mut Core {
        &mut self.core
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.times.note(self.clock.now().since(self.since));
    }
}
