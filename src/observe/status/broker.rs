//! How publishing to a broker goes: written by whoever publishes, read with the state of the gateway.

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

/// How it goes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BrokerStatus {
    /// Its address.
    pub broker: String,
    /// There is a connection.
    pub connected: bool,
    /// Why there is none, in words; empty where there is one, or none was tried yet.
    pub fault: String,
    /// Messages that wait for the broker.
    pub queued: u64,
    /// Messages that were given to a connection.
    pub published: u64,
    /// Messages that found no room and never arrive.
    pub dropped: u64,
    /// Connections that the broker has taken.
    pub connections: u64,
}

/// The same, shared; locked for a moment only.
#[derive(Debug, Default)]
pub struct BrokerFigures(Mutex<BrokerStatus>);

impl BrokerFigures {
    /// Nothing has happened yet.
    pub fn of(broker: String) -> BrokerFigures {
        BrokerFigures(Mutex::new(BrokerStatus { broker, ..BrokerStatus::default() }))
    }

    /// As they are now.
    pub fn read(&self) -> BrokerStatus {
        self.get().clone()
    }

    /// Changes them.
    #[cfg(feature = "mqtt")]
    pub(in crate::observe) fn note(&self, change: impl FnOnce(&mut BrokerStatus)) {
        change(&mut self.get());
    }

    fn get(&self) -> MutexGuard<'_, BrokerStatus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
