//! What becomes of the messages that are posted to the servers of `[[notify]]`.

use serde::Serialize;

use super::{Described, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::counted;

/// Whether messages arrive.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Delivery {
    /// One did not; what follows is told when one has.
    Failed {
        /// Whose messages: `notify[0]`.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// A sentence.
        why: String,
    },
    /// They arrive again.
    Back {
        /// Whose messages.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// So often it was tried in vain.
        attempts: u64,
    },
    /// So many were given up, or had no room.
    Dropped {
        /// Whose messages.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// How many.
        count: u64,
    },
}

impl Delivery {
    pub(super) fn described(&self) -> Described {
        match self {
            Delivery::Failed { notify, to, why } => warning(
                "notify-failed",
                format!("{notify}: a message to {to} has not arrived"),
                Explained::new(
                    why.as_str(),
                    "does the server run, are `url` and token right? The gateway tries a few times more, and the machine is \
                     compensated without it",
                ),
            ),
            Delivery::Back { notify, to, attempts } => info(
                "notify-back",
                format!(
                    "{notify}: messages to {to} arrive again after {} in vain",
                    counted(attempts, "attempt")
                ),
            ),
            Delivery::Dropped { notify, to, count } => warning(
                "notify-dropped",
                notify.as_str(),
                Explained::new(
                    format!("dropped {} to {to}, which will not arrive", counted(count, "message")),
                    "`isotherm events` has what happened",
                ),
            ),
        }
    }

    /// Whose messages: to him it is not posted, who does not get any.
    #[must_use]
    pub fn notify(&self) -> &str {
        match self {
            Delivery::Failed { notify, .. }
            | Delivery::Back { notify, .. }
            | Delivery::Dropped { notify, .. } => notify,
        }
    }
}
