//! List of the connections that have not sent a line yet ("silent" connections). When the limit of connections is
//! reached, the gateway closes the oldest silent connection. Therefore silent connections cannot block a command.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::clock::BootClock;

/// Time for which a connection may stay silent, divided by the maximum number of connections. A client
/// normally sends its line directly after it has connected. If the gateway has closed the connection before
/// that, the client connects again. The time is short, because all connections may be silent, and then a
/// command waits for this time.
const GRACE_OF_A_PLACE: Duration = Duration::from_micros(250);
/// Maximum time from the closing of a connection until its permit is free again.
const RETURNED: Duration = Duration::from_millis(10);

/// List of silent connections, oldest first.
#[derive(Clone)]
pub(super) struct SilentConnections {
    entries: Arc<Mutex<VecDeque<Entry>>>,
    grace: Duration,
    clock: BootClock,
}

struct Entry {
    since: Duration,
    close: oneshot::Sender<()>,
}

/// Future that completes when the connection must be closed. The task of the connection drops the future when it has
/// received a line.
pub(super) type Closed = oneshot::Receiver<()>;

impl SilentConnections {
    /// Creates an empty list. `places` is the maximum number of connections.
    pub(super) fn of(places: usize) -> SilentConnections {
        let grace = GRACE_OF_A_PLACE.saturating_mul(u32::try_from(places).unwrap_or(u32::MAX));
        SilentConnections { entries: Arc::default(), grace, clock: BootClock::default() }
    }

    /// Records a new connection. The connection counts as silent until the returned receiver is dropped.
    pub(super) fn enter(&self) -> Closed {
        let (close, closed) = oneshot::channel();
        let since = self.clock.passed();
        self.with(|entries| entries.push_back(Entry { since, close }));
        closed
    }

    /// Returns a permit for a connection. While no permit is free, closes the oldest silent connection that has
    /// exceeded its time, and waits. Returns `None` if the semaphore is closed, which does not happen while the
    /// command socket is open.
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

    /// Closes the oldest silent connection if it has been silent for too long. Returns the time for which the caller
    /// must wait for a permit before its next attempt.
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

    /// Removes connections that have sent their line, then calls `act` with the list.
    fn with<T>(&self, act: impl FnOnce(&mut VecDeque<Entry>) -> T) -> T {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.retain(|entry| !entry.close.is_closed());
        act(&mut entries)
    }
}
