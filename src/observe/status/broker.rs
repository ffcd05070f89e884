//! State of publishing to the MQTT broker. The publisher changes it, and the status contains it.

use std::sync::{Mutex, MutexGuard, PoisonError};

use schemars::JsonSchema;
use serde::Serialize;

/// State of publishing to the MQTT broker.
#[derive(Clone, Debug, Default, PartialEq, Eq, JsonSchema, Serialize)]
pub struct BrokerStatus {
    /// Address of the broker.
    pub broker: String,
    /// Whether there is a connection to the broker.
    pub connected: bool,
    /// Reason why there is no connection; empty if there is one, or before the first attempt.
    pub fault: String,
    /// Topics that the broker refuses: the gateway may not subscribe or publish to them.
    pub refused: Vec<String>,
    /// State of the primary host: `online`, `offline`, or `unknown` without a message about it. Empty if the profile
    /// names no primary host.
    pub primary_host: String,
    /// Number of messages that wait for the broker.
    pub queued: u64,
    /// Number of messages that were sent to the broker.
    pub published: u64,
    /// Number of messages that were dropped and will never be delivered.
    pub dropped: u64,
    /// Number of connections that the broker has accepted.
    pub connections: u64,
}

/// State of publishing ([`BrokerStatus`]) that several threads share. It is locked only for a short time.
#[derive(Debug, Default)]
pub struct BrokerFigures(Mutex<BrokerStatus>);

impl BrokerFigures {
    /// Creates the state before the first attempt to connect.
    pub fn of(broker: String) -> BrokerFigures {
        BrokerFigures(Mutex::new(BrokerStatus { broker, ..BrokerStatus::default() }))
    }

    /// Returns a copy of the current state.
    pub fn read(&self) -> BrokerStatus {
        self.get().clone()
    }

    /// Lets `change` modify the state while it is locked.
    #[cfg(feature = "mqtt")]
    pub(in crate::observe) fn note(&self, change: impl FnOnce(&mut BrokerStatus)) {
        change(&mut self.get());
    }

    fn get(&self) -> MutexGuard<'_, BrokerStatus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
