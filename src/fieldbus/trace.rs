//! Log of the frames on a line, while it has a listener.
//!
//! The bytes are copied as they pass a [port](super::port). Their description comes from [`super::line`], which knows
//! the request and the checked answer. An invalid answer is therefore shown as it arrived, with its fault.
//!
//! Without a listener, a port checks one flag per read and write. With a listener, the line still never waits. If the
//! queue of a listener is full, the exchange is counted and left out. A dropped listener is removed at once.

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

/// Capacity of a listener's queue, in exchanges. More are left out.
const UNHEARD: usize = 1024;
/// Maximum number of bytes that are kept for each direction of an exchange: two of the longest frames.
const LONGEST: usize = 520;
/// Maximum number of listeners of one line.
const MOST_LISTENERS: usize = 4;

/// Access to the frames of a line.
#[derive(Clone, Debug)]
pub struct Tap(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    /// Wall clock: under a virtual clock, an answer would take no time.
    clock: Clock,
    is_on: AtomicBool,
    passed: Mutex<PassedBytes>,
    listeners: Mutex<Vec<Listener>>,
}

/// Bytes since the start of the present request.
#[derive(Debug, Default)]
struct PassedBytes {
    sent: Vec<u8>,
    received: Vec<u8>,
    /// Number of bytes that were not kept.
    more: usize,
}

#[derive(Debug)]
struct Listener {
    /// Device to listen to; `None`: all devices on the line.
    device: Option<DeviceId>,
    to: mpsc::Sender<Exchange>,
    dropped: Arc<AtomicU64>,
}

/// Receiver of exchanges, until it is dropped.
#[derive(Debug)]
pub struct ExchangeReceiver {
    tap: Tap,
    heard: mpsc::Receiver<Exchange>,
    dropped: Arc<AtomicU64>,
}

impl Default for Tap {
    fn default() -> Tap {
        Tap(Arc::new(Shared {
            clock: Clock::wall(),
            is_on: AtomicBool::new(false),
            passed: Mutex::default(),
            listeners: Mutex::default(),
        }))
    }
}

impl Tap {
    /// Listens to one device, or to all on the line.
    ///
    /// # Errors
    /// A sentence, if the line already has the maximum number of listeners.
    pub fn listen(&self, device: Option<DeviceId>) -> Result<ExchangeReceiver, String> {
        let mut listeners = locked(&self.0.listeners);
        if listeners.len() >= MOST_LISTENERS {
            return Err(format!("{MOST_LISTENERS} clients listen to this line already; end one of them"));
        }
        let (to, heard) = mpsc::channel(UNHEARD);
        let dropped = Arc::new(AtomicU64::new(0));
        listeners.push(Listener { device, to, dropped: dropped.clone() });
        self.0.is_on.store(true, Ordering::Relaxed);
        Ok(ExchangeReceiver { tap: self.clone(), heard, dropped })
    }

    /// Returns whether there is a listener.
    pub fn is_on(&self) -> bool {
        self.0.is_on.load(Ordering::Relaxed)
    }

    /// Begins an exchange, and returns its time; `None` without a listener.
    pub(super) fn begin(&self) -> Option<Moment> {
        self.is_on().then(|| {
            *self.passed() = PassedBytes::default();
            self.0.clock.now()
        })
    }

    /// Ends an exchange with its result, and sends it to the listeners.
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
        let exchange = Exchange {
            asked_at,
            took,
            unit,
            asked: request.to_string(),
            sent,
            received,
            more,
            answered: exchange::answered(answer),
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

    /// Records bytes that pass.
    pub(super) fn pass(&self, bytes: &[u8], is_sent: bool) {
        if self.is_on() {
            self.passed().keep(bytes, is_sent);
        }
    }

    fn passed(&self) -> MutexGuard<'_, PassedBytes> {
        locked(&self.0.passed)
    }
}

/// Locks a mutex. A panic of another thread leaves its data consistent.
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
    /// Waits for the next exchange.
    pub async fn next(&mut self) -> Option<Exchange> {
        self.heard.recv().await
    }

    /// Returns the next exchange, if there is one.
    pub fn next_now(&mut self) -> Option<Exchange> {
        self.heard.try_recv().ok()
    }

    /// Returns the number of exchanges that were left out because the queue was full.
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
