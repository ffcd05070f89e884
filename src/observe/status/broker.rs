//! State of publishing to a broker. The publisher writes it; the status contains it.

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

/// State of publishing to the MQTT broker.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BrokerStatus {
    /// Address of the broker.
    pub broker: String,
    /// `true` if there is a connection.
    pub connected: bool,
    /// Reason why there is no connection, in words; empty if there is one, or before the first attempt.
    pub fault: String,
    /// Messages that wait for the broker.
    pub queued: u64,
    /// Messages that were given to a connection.
    pub published: u64,
    /// Messages that were dropped and never arrive.
    pub dropped: u64,
    /// Connections that the broker has accepted.
    pub connections: u64,
}

/// Shared [`BrokerStatus`], locked only briefly.
#[derive(Debug, Default)]
pub struct BrokerFigures(Mutex<BrokerStatus>);

impl BrokerFigures {
    /// Makes the state before the first attempt.
    pub fn of(broker: String) -> BrokerFigures {
        BrokerFigures(Mutex::new(BrokerStatus { broker, ..BrokerStatus::default() }))
    }

    /// Copy of the current state.
    pub fn read(&self) -> BrokerStatus {
        self.get().clone()
    }

    /// Changes the state while it is locked.
    #[cfg(feature = "mqtt")]
    pub(in crate::observe) fn note(&self, change: impl FnOnce(&mut BrokerStatus)) {
        change(&mut self.get());
    }

    fn get(&self) -> MutexGuard<'_, BrokerStatus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
