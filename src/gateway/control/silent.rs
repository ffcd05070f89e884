//! Connections that have not sent a line yet. When every place is taken, the one that has been silent longest loses its own, so
//! that no number of silent connections keeps a command waiting.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::clock::Passing;

/// Time for each place that a new connection may stay silent. A client sends its line as soon as it is connected, and connects again
/// if it has lost its place before. The more silent connections are closed in a second, the shorter a command waits behind them.
const GRACE_OF_A_PLACE: Duration = Duration::from_micros(250);
/// Time for a closed connection to return its place.
const RETURNED: Duration = Duration::from_millis(10);

/// The silent connections, the oldest first.
#[derive(Clone)]
pub(super) struct Silent {
    entries: Arc<Mutex<VecDeque<Entry>>>,
    grace: Duration,
    clock: Passing,
}

struct Entry {
    since: Duration,
    close: oneshot::Sender<()>,
}

/// Completes when the connection has lost its place. Dropped when its line has come.
pub(super) type Closed = oneshot::Receiver<()>;

impl Silent {
    /// For this number of places.
    pub(super) fn of(places: usize) -> Silent {
        let grace = GRACE_OF_A_PLACE.saturating_mul(u32::try_from(places).unwrap_or(u32::MAX));
        Silent { entries: Arc::default(), grace, clock: Passing::default() }
    }

    /// Notes a new connection, which is silent until the returned receiver is dropped.
    pub(super) fn enter(&self) -> Closed {
        let (close, closed) = oneshot::channel();
        let since = self.clock.passed();
        self.with(|entries| entries.push_back(Entry { since, close }));
        closed
    }

    /// Returns a place; closes the oldest silent connection if no place is free. Waits while no connection is silent. `None` if the
    /// semaphore is closed, which does not happen while connections are served.
    pub(super) async fn place(&self, places: &Arc<Semaphore>) -> Option<OwnedSemaphorePermit> {
        loop {
            if let Ok(place) = places.clone().try_acquire_owned() {
                return Some(place);
            }
            let wait = self.close_oldest();
            if let Ok(place) = tokio::time::timeout(wait, places.clone().acquire_owned()).await {
                return place.ok();
            }
        }
    }

    /// Closes the oldest one that may be closed. Returns how long to wait for a place before the next attempt.
    fn close_oldest(&self) -> Duration {
        let now = self.clock.passed();
        self.with(|entries| {
            let Some(oldest) = entries.front() else { return self.grace };
            let left = (oldest.since + self.grace).saturating_sub(now);
            if !left.is_zero() {
                return left;
            }
            if let Some(entry) = entries.pop_front() {
                let _ = entry.close.send(());
            }
            RETURNED
        })
    }

    /// Removes connections whose line has come, then calls `act`.
    fn with<T>(&self, act: impl FnOnce(&mut VecDeque<Entry>) -> T) -> T {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|entry| !entry.close.is_closed());
        act(&mut entries)
    }
}
