//! Events about publishing to the broker of `[mqtt]`.

use serde::Serialize;

use super::{EventDescription, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::counted;

/// State of publishing to the broker.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Broker {
    /// The connection is lost. It is reported once, until there is a connection again.
    Down {
        /// Address of the broker.
        broker: String,
        /// Reason as a sentence.
        why: String,
    },
    /// The connection is back.
    Up {
        /// Address of the broker.
        broker: String,
        /// Number of failed attempts.
        attempts: u64,
    },
    /// Messages were dropped, because the broker was not reachable or too slow.
    Dropped {
        /// Address of the broker.
        broker: String,
        /// Number of dropped messages.
        count: u64,
    },
    /// Data that must be kept for the broker could not be written to disk.
    NotKept {
        /// Address of the broker.
        broker: String,
        /// Error message of the system.
        why: String,
    },
}

impl Broker {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Broker::Down { broker, why } => warning(
                "broker-down",
                format!("nothing is published to {broker}"),
                Explained::new(
                    why.as_str(),
                    "does the broker run, are its address, user and certificate those of `[mqtt]`? The \
                     gateway tries again, and the compensation continues",
                ),
            ),
            Broker::Up { broker, attempts } => info(
                "broker-up",
                format!("{broker}: connected after {} that failed", counted(attempts, "attempt")),
            ),
            Broker::Dropped { broker, count } => warning(
                "broker-dropped",
                String::new(),
                Explained::new(
                    format!("{} to {broker} dropped, because the queue was full", counted(count, "message")),
                    "`isotherm events` shows what happened",
                ),
            ),
            Broker::NotKept { broker, why } => warning(
                "broker-not-kept",
                format!("messages that {broker} misses are not saved"),
                Explained::new(
                    why.as_str(),
                    "free space in the state directory, and allow the gateway to write to it",
                ),
            ),
        }
    }
}
