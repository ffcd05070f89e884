//! Events about publishing to the MQTT broker of `[mqtt]`. The primary host is the program that the profile names in
//! `primary_host`: the gateway publishes only while this host is online.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;
use isotherm_profile::counted;

/// Change of the connection to the broker, or of the data that the gateway publishes to the broker.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Broker {
    /// The connection is lost, or cannot be made. A further failure is reported only if its reason has
    /// changed, or if the connection has worked since.
    Down {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Reason, with a hint if this reason has a specific remedy.
        why: Explained,
    },
    /// The connection to the broker works again.
    Up {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Number of failed attempts before the connection worked.
        attempts: u64,
    },
    /// Messages were dropped, because the broker was not reachable or too slow.
    Dropped {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Number of dropped messages.
        count: u64,
    },
    /// Data that wait for the broker could not be written to disk.
    NotKept {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Error message of the operating system.
        why: String,
    },
    /// The broker refused a subscription. A further refusal is reported only if the broker has accepted the
    /// subscription since.
    SubscriptionRefused {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Topic to which the gateway has tried to subscribe.
        topic: String,
    },
    /// The broker accepts a subscription that it had refused.
    Subscribed {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Topic to which the gateway is subscribed now.
        topic: String,
    },
    /// The broker closed several connections after messages to one topic. The gateway publishes nothing more
    /// to this topic.
    PublishDenied {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Topic to which the gateway no longer publishes.
        topic: String,
    },
    /// The primary host is offline. Until it is online again, the gateway stores its data.
    HostOffline {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Name of the primary host in the profile.
        host: String,
        /// Reason as a part of a sentence: the host is offline, or no message about its state has arrived.
        why: &'static str,
    },
    /// The primary host is online after it was reported as offline.
    HostOnline {
        /// Scheme, host and port of the broker.
        broker: String,
        /// Name of the primary host in the profile.
        host: String,
    },
}

impl Broker {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            Broker::Down { broker, why } => {
                caused(format!("nothing is published to {broker}"), why.clone()).of(EventKind::BrokerDown)
            }
            Broker::Up { broker, attempts } => {
                let attempts = counted(attempts, "attempt");
                plain(format!("{broker}: connected after {attempts} that failed")).of(EventKind::BrokerUp)
            }
            Broker::Dropped { broker, count } => {
                let messages = counted(count, "message");
                caused("", format!("{messages} to {broker} dropped, because the queue was full"))
                    .of(EventKind::BrokerDropped)
            }
            Broker::NotKept { broker, why } => {
                caused(format!("messages for {broker} cannot be saved on disk"), why)
                    .of(EventKind::BrokerNotKept)
            }
            Broker::SubscriptionRefused { broker, topic } => {
                caused(topic, format!("{broker} refuses this subscription; no message of this topic arrives"))
                    .of(EventKind::BrokerSubscriptionRefused)
            }
            Broker::Subscribed { broker, topic } => {
                plain(format!("{topic}: {broker} accepts this subscription now"))
                    .of(EventKind::BrokerSubscribed)
            }
            Broker::PublishDenied { broker, topic } => {
                let why = format!(
                    "{broker} closed the connection three times after a message to this topic; nothing more \
                     is published to this topic"
                );
                caused(topic, why).of(EventKind::BrokerPublishDenied)
            }
            Broker::HostOffline { broker, host, why } => {
                caused(format!("nothing is published to {broker} for the host {host}"), *why)
                    .of(EventKind::HostOffline)
            }
            Broker::HostOnline { broker, host } => {
                plain(format!("the host {host} at {broker} is online: stored values are published"))
                    .of(EventKind::HostOnline)
            }
        }
    }
}
