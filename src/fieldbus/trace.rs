//! Log of the frames on a line. A tap (recorder) copies the frames while at least one listener receives the log.
//!
//! The bytes are copied when they pass a [port](super::port). Their description comes from [`super::line`], which knows
//! the request and the checked answer. An invalid answer is therefore logged as it arrived, with its fault.
//!
//! Without a listener, a port only checks one flag per read and write. With a listener, the line still never waits: if
//! the queue of a listener is full, the exchange is left out and counted. A listener that was dropped is removed at
//! once.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::mpsc;

use super::error::{Fault, LinkFault};
use super::request::{Answer, Request};
use crate::clock::Clock;
use isotherm_core::codec::Frame;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

mod exchange;

pub use exchange::Exchange;

/// Capacity of a listener's queue, in exchanges (requests with answers). If the queue is full, further exchanges are
/// left out.
const UNHEARD: usize = 1024;
/// Maximum number of bytes that are stored for each direction of an exchange: two of the longest frames.
const LONGEST: usize = 520;
/// Maximum number of listeners of one line.
const MOST_LISTENERS: usize = 4;

/// Tap (recorder) of a line: copies the frames on the line to the listeners. Clones have the same listeners.
#[derive(Clone, Debug)]
pub struct Tap(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    /// Real clock for the times in the log. Under a virtual clock every answer would take no time.
    clock: Clock,
    is_on: AtomicBool,
    passed: Mutex<PassedBytes>,
    listeners: Mutex<Vec<Listener>>,
}

/// Bytes that were sent and received since the start of the present request.
#[derive(Debug, Default)]
struct PassedBytes {
    sent: Vec<u8>,
    received: Vec<u8>,
    /// Number of further bytes, beyond [`LONGEST`], that were not stored.
    more: usize,
}

#[derive(Debug)]
struct Listener {
    /// Device whose exchanges the listener receives; `None`: all devices on the line.
    device: Option<DeviceId>,
    to: mpsc::Sender<Exchange>,
    dropped: Arc<AtomicU64>,
}

/// Receiver of the exchanges (requests with answers) of a line. Dropping the receiver ends the listening.
#[derive(Debug)]
pub struct ExchangeReceiver {
    tap: Tap,
    heard: mpsc::Receiver<Exchange>,
    dropped: Arc<AtomicU64>,
}

impl Default for Tap {
    fn default() -> Tap {
        Tap::by(Clock::wall())
    }
}

impl Tap {
    fn by(clock: Clock) -> Tap {
        let is_on = AtomicBool::new(false);
        Tap(Arc::new(Shared { clock, is_on, passed: Mutex::default(), listeners: Mutex::default() }))
    }

    /// Returns a new tap (recorder) for another line, with the same wall clock.
    pub fn of_another_line(&self) -> Tap {
        Tap::by(self.0.clock.clone())
    }

    /// Starts listening to the exchanges of one device; with `None`, of all devices on the line.
    ///
    /// # Errors
    /// A sentence for the user, if the line already has the maximum number of listeners.
    pub fn listen(&self, device: Option<DeviceId>) -> Result<ExchangeReceiver, String> {
        let mut listeners = locked(&self.0.listeners);
        if listeners.len() >= MOST_LISTENERS {
            return Err(format!(
                "{MOST_LISTENERS} clients already trace this bus line; end one of these clients"
            ));
        }
        let (to, heard) = mpsc::channel(UNHEARD);
        let dropped = Arc::new(AtomicU64::new(0));
        listeners.push(Listener { device, to, dropped: dropped.clone() });
        self.0.is_on.store(true, Ordering::Relaxed);
        Ok(ExchangeReceiver { tap: self.clone(), heard, dropped })
    }

    /// Returns whether the line has a listener.
    pub fn is_on(&self) -> bool {
        self.0.is_on.load(Ordering::Relaxed)
    }

    /// Begins to record an exchange, and returns the time of its start; `None` if there is no listener.
    pub(super) fn begin(&self) -> Option<Moment> {
        self.is_on().then(|| {
            *self.passed() = PassedBytes::default();
            self.0.clock.now()
        })
    }

    /// Ends the recording of an exchange, and sends the exchange with its result to the listeners.
    pub(super) fn tell(
        &self,
        asked_at: Moment,
        (device, unit): (DeviceId, u8),
        request: Request<'_>,
        answer: &Result<Answer, Fault>,
    ) {
        // No attempt was made.
        if *answer == Err(Fault::Link(LinkFault::Down)) {
            return;
        }
        let took = self.0.clock.now().since(asked_at);
        let PassedBytes { sent, received, more } = std::mem::take(&mut *self.passed());
        let answered = match request {
            Request::Texts(_) => exchange::answered_text(&received, answer),
            _ => exchange::answered(answer),
        };
        let exchange = Exchange {
            asked_at,
            took,
            unit,
            asked: request.to_string(),
            sent,
            received,
            more,
            answered,
            is_good: answer.is_ok(),
        };
        self.show(device, &exchange);
    }

    /// Reports a CAN frame that a device sent without a request.
    pub fn heard(&self, (device, unit): (DeviceId, u8), frame: &Frame) {
        if self.is_on() {
            self.show(device, &Exchange::heard(unit, frame, self.0.clock.now()));
        }
    }

    fn show(&self, device: DeviceId, exchange: &Exchange) {
        let exchange = Exchange { asked_at: self.0.clock.stamp(exchange.asked_at), ..exchange.clone() };
        let listeners = locked(&self.0.listeners);
        for listener in listeners.iter().filter(|listener| listener.device.is_none_or(|one| one == device)) {
            if listener.to.try_send(exchange.clone()).is_err() {
                listener.dropped.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    /// Records bytes that were sent (`is_sent`) or received, if the line has a listener.
    pub(super) fn pass(&self, bytes: &[u8], is_sent: bool) {
        if self.is_on() {
            self.passed().keep(bytes, is_sent);
        }
    }

    fn passed(&self) -> MutexGuard<'_, PassedBytes> {
        locked(&self.0.passed)
    }
}

/// Locks a mutex. The lock is also used after another thread has panicked, because the data stays consistent.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PassedBytes {
    fn keep(&mut self, bytes: &[u8], is_sent: bool) {
        let kept = if is_sent { &mut self.sent } else { &mut self.received };
        let room = LONGEST.saturating_sub(kept.len()).min(bytes.len());
        kept.extend_from_slice(&bytes[..room]);
        self.more += bytes.len() - room;
    }
}

impl ExchangeReceiver {
    /// Waits for the next exchange; returns `None` if the line logs no further exchange.
    pub async fn next(&mut self) -> Option<Exchange> {
        self.heard.recv().await
    }

    /// Returns the next exchange in the queue; `None` if the queue is empty.
    pub fn next_now(&mut self) -> Option<Exchange> {
        self.heard.try_recv().ok()
    }

    /// Returns the number of exchanges that were left out because the queue of this receiver was full.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

impl Drop for ExchangeReceiver {
    fn drop(&mut self) {
        self.heard.close();
        let mut listeners = locked(&self.tap.0.listeners);
        listeners.retain(|listener| !listener.to.is_closed());
        self.tap.0.is_on.store(!listeners.is_empty(), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests;
