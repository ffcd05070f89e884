//! What becomes of what is published to the broker of `[mqtt]`.

use serde::Serialize;

use super::{Described, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::counted;

/// Whether it arrives.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Broker {
    /// There is no connection; reported once, until there is one.
    Down {
        /// Its address.
        broker: String,
        /// A sentence.
        why: String,
    },
    /// There is one again.
    Up {
        /// Its address.
        broker: String,
        /// So often it was tried in vain.
        attempts: u64,
    },
    /// So many messages found no room while it was away, or too slow.
    Dropped {
        /// Its address.
        broker: String,
        /// How many.
        count: u64,
    },
    /// What could not be told because the disk does not take it.
    NotKept {
        /// Its address.
        broker: String,
        /// What the system says.
        why: String,
    },
}

impl Broker {
    pub(super) fn described(&self) -> Described {
        match self {
            Broker::Down { broker, why } => warning(
                "broker-down",
                format!("nothing is published to {broker}"),
                Explained::new(
                    why.as_str(),
                    "does the broker run, are its address, user and certificate those of `[mqtt]`? The gateway tries again, and \
                     the machine is compensated without it",
                ),
            ),
            Broker::Up { broker, attempts } => info(
                "broker-up",
                format!("{broker}: connected after {} in vain", counted(attempts, "attempt")),
            ),
            Broker::Dropped { broker, count } => warning(
                "broker-dropped",
                String::new(),
                Explained::new(
                    format!("{} to {broker} found no room and will not arrive", counted(count, "message")),
                    "`isotherm events` has what happened",
                ),
            ),
            Broker::NotKept { broker, why } => warning(
                "broker-not-kept",
                format!("what {broker} misses is not kept for it"),
                Explained::new(
                    why.as_str(),
                    "make room in the state directory, and let the gateway write there",
                ),
            ),
        }
    }
}
