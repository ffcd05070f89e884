//! Events about messages to the servers of `[[notify]]`.

use serde::Serialize;

use super::{EventDescription, info, warning};
use isotherm_core::explained::Explained;
use isotherm_profile::counted;

/// State of the messages to one server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Delivery {
    /// A message could not be delivered. Further failures are not reported until a message arrives.
    Failed {
        /// Entry of the profile: `notify[0]`.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// Reason as a sentence.
        why: String,
    },
    /// A message has arrived after failures.
    Back {
        /// Entry of the profile.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// Number of failed attempts.
        attempts: u64,
    },
    /// Messages were given up, or the queue had no room for them.
    Dropped {
        /// Entry of the profile.
        notify: String,
        /// Scheme, host and port.
        to: String,
        /// Number of dropped messages.
        count: u64,
    },
}

impl Delivery {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Delivery::Failed { notify, to, why } => warning(
                "notify-failed",
                format!("{notify}: a message to {to} has not arrived"),
                Explained::new(
                    why.as_str(),
                    "does the server run, are `url` and token right? The gateway tries a few times more, and \
                     the compensation continues",
                ),
            ),
            Delivery::Back { notify, to, attempts } => info(
                "notify-back",
                format!(
                    "{notify}: messages to {to} arrive again, after {} that failed",
                    counted(attempts, "attempt")
                ),
            ),
            Delivery::Dropped { notify, to, count } => warning(
                "notify-dropped",
                notify.as_str(),
                Explained::new(
                    format!("dropped {} to {to}", counted(count, "message")),
                    "`isotherm events` shows what happened",
                ),
            ),
        }
    }

    /// Entry of the profile with the failed server. This event is not sent to that server.
    #[must_use]
    pub fn notify(&self) -> &str {
        match self {
            Delivery::Failed { notify, .. }
            | Delivery::Back { notify, .. }
            | Delivery::Dropped { notify, .. } => notify,
        }
    }
}
