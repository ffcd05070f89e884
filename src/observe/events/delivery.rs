//! Events about the messages to the servers of `[[notify]]`.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_profile::counted;

/// Change in the delivery of messages to one server.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Delivery {
    /// A message could not be delivered. A further failure is reported only if its reason has changed, or if
    /// a message was delivered since.
    Failed {
        /// Name of the profile entry, for example `notify[0]`.
        notify: String,
        /// Scheme, host and port of the server to which a message could not be delivered.
        to: String,
        /// Reason for the failure, as a sentence.
        why: String,
    },
    /// A message was delivered after failures.
    Back {
        /// Name of the profile entry, for example `notify[0]`.
        notify: String,
        /// Scheme, host and port of the server to which messages are delivered again.
        to: String,
        /// Number of failed attempts before this delivery.
        attempts: u64,
    },
    /// Messages were given up after several attempts, or dropped because the queue was full.
    Dropped {
        /// Name of the profile entry, for example `notify[0]`.
        notify: String,
        /// Scheme, host and port of the server to which the messages were addressed.
        to: String,
        /// Number of dropped messages.
        count: u64,
    },
}

impl Delivery {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Delivery::Failed { notify, to, why } => {
                caused(format!("{notify}: a message to {to} has not arrived"), why)
                    .of(EventKind::NotifyFailed)
            }
            Delivery::Back { notify, to, attempts } => {
                let attempts = counted(attempts, "attempt");
                plain(format!("{notify}: messages to {to} arrive again, after {attempts} that failed"))
                    .of(EventKind::NotifyBack)
            }
            Delivery::Dropped { notify, to, count } => {
                caused(notify, format!("dropped {} to {to}", counted(count, "message")))
                    .of(EventKind::NotifyDropped)
            }
        }
    }

    /// Returns the name of the `[[notify]]` entry whose server this event is about. The event is not sent to that
    /// server, because its delivery could fail too.
    #[must_use]
    pub fn notify(&self) -> &str {
        match self {
            Delivery::Failed { notify, .. }
            | Delivery::Back { notify, .. }
            | Delivery::Dropped { notify, .. } => notify,
        }
    }
}
