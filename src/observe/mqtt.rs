//! Publisher of the state of a machine to the MQTT broker of `[mqtt]`, as JSON messages or as Sparkplug B.
//!
//! A separate thread reads the state that the web page shows, at the interval `every`. The crate `isotherm-plant` makes
//! messages from the changes. Neither a bus line nor a web page waits for this thread. The queues for a slow or
//! unreachable broker are bounded. Messages that do not fit are dropped, counted and reported.
//!
//! # Layout
//! - `snapshot`: conversion of the state to metrics. `event_queue`: queue of the events.
//! - `run`: connects, publishes and waits. `record_queue`: queue for an unreachable broker. `commands`:
//!   received messages. `memory`: topics and death number that earlier runs have published. `denials`: topics
//!   that the broker refuses. `host_report`: reports about the primary host.
//! - `broker`: interface of a broker. `client`: its implementation.

use std::collections::VecDeque;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::sync::{oneshot, watch};
use tokio_rustls::rustls::ClientConfig;

use super::events::{Broker as BrokerEvent, Event};
use super::status::{BrokerFigures, GatewayApi};
use crate::clock::Clock;
use broker::{Broker, Connection, SubscriptionAnswer};
use client::Client;
use commands::Commands;
use denials::Denials;
use event_queue::EventQueue;
use host_report::HostReport;
use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::{Address, Sparkplug};
use isotherm_plant::{Json, JsonSettings, Publisher, Subscription};
use isotherm_profile::{Mqtt, MqttFormat, Profile, stop};
use memory::Memory;
use record_queue::RecordQueue;
use run::{Outage, Runner};

mod broker;
mod client;
mod commands;
mod denials;
mod event_queue;
mod host_report;
mod memory;
mod record_queue;
mod run;
mod snapshot;

pub use broker::Fault;

/// Maximum number of threads that resolve the host name of the broker.
const LOOKUPS: usize = 1;

/// TLS configuration for the broker: trusted certificates, and the gateway's own certificate. `None` for a broker
/// without TLS.
pub type Trust = Option<Arc<ClientConfig>>;

/// Running thread that publishes the state.
#[derive(Debug)]
pub struct Publishing {
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Handle of the thread. Nothing joins the thread, because [`Publishing::finish`] limits the wait for it.
    _thread: JoinHandle<()>,
}

impl Publishing {
    /// Starts the thread that publishes the state of a machine. `state` is the state directory.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(
        (profile, mqtt): (&Profile, &Mqtt),
        trust: Trust,
        source: &Arc<dyn GatewayApi>,
        figures: &Arc<BrokerFigures>,
        state: &Path,
    ) -> std::io::Result<Publishing> {
        let clock = Clock::wall();
        let address = mqtt.broker.to_string();
        let (publisher, memory, kept) = publisher(profile, mqtt, state, source.as_ref());
        let id = format!("isotherm-{}", profile.name);
        let broker = Client::of(mqtt, id, trust, &clock);
        let runner = Runner {
            publisher,
            memory,
            source: source.clone(),
            figures: figures.clone(),
            clock,
            commands: Commands::from(&address),
            address,
            every: mqtt.every,
            resolutions: snapshot::resolutions(profile),
            happenings: EventQueue::default(),
            seen: Default::default(),
            kept,
            outbox: VecDeque::new(),
            denials: Denials::default(),
            outage: Outage::default(),
            host: mqtt.primary_host.clone().unwrap_or_default(),
            host_report: HostReport::default(),
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(LOOKUPS)
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name("mqtt".to_owned()).spawn(move || {
            runtime.block_on(runner.run(broker, stopped));
            // A name lookup that has not ended must not delay the end.
            runtime.shutdown_background();
            // The receiver may be gone already.
            let _ = over.send(());
        })?;
        Ok(Publishing { stop, ended, _thread: thread })
    }

    /// Publishes the last state, and a message that the gateway has ended. Returns when the broker has received both,
    /// after [`stop::BROKER`] at the latest, or as soon as `hurry` is ready.
    pub async fn finish(self, hurry: impl Future<Output = ()>) {
        self.stop.send_replace(true);
        tokio::select! {
            _ = self.ended => {}
            () = tokio::time::sleep(stop::BROKER) => {}
            () = hurry => {}
        }
    }
}

/// Creates the message format, its memory of earlier runs, and the queue of unpublished records. `state` is the state
/// directory.
fn publisher(
    profile: &Profile,
    mqtt: &Mqtt,
    state: &Path,
    source: &dyn GatewayApi,
) -> (Box<dyn Publisher>, Memory, RecordQueue) {
    let directory = kept_in(state, &profile.name);
    if mqtt.format == MqttFormat::SparkplugB {
        let (memory, last) = Memory::of_deaths(&directory);
        if let Some(node) = sparkplug(profile, mqtt, last) {
            return (Box::new(node), memory, on_disk(mqtt, &directory, source));
        }
    }
    (Box::new(json(profile, mqtt)), Memory::of_topics(&directory), RecordQueue::in_memory())
}

/// Creates the Sparkplug node. `last` is the death number (bdSeq) that the previous run has used last. Returns `None`
/// if a name cannot be part of a topic. This does not happen, because the profile reader rejects such names.
fn sparkplug(profile: &Profile, mqtt: &Mqtt, last: Option<u8>) -> Option<Sparkplug> {
    let address = Address::new(&mqtt.group, &profile.name).ok()?;
    let node = Sparkplug::new(address, last, mqtt.takes_measured);
    let Some(host) = &mqtt.primary_host else { return Some(node) };
    Some(node.waiting_for(Address::state_topic(host).ok()?))
}

fn json(profile: &Profile, mqtt: &Mqtt) -> Json {
    Json::new(JsonSettings {
        group: mqtt.group.clone(),
        machine: profile.name.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        refresh: mqtt.refresh,
        takes_measured: mqtt.takes_measured,
        home_assistant: mqtt.home_assistant,
    })
}

/// Opens the queue of unpublished records on disk. If this fails, an event reports the error, and the queue is in
/// memory.
fn on_disk(mqtt: &Mqtt, directory: &Path, source: &dyn GatewayApi) -> RecordQueue {
    RecordQueue::on_disk(directory, mqtt.buffer).unwrap_or_else(|error| {
        let (broker, why) = (mqtt.broker.to_string(), error.to_string());
        source.report(&Event::Broker(BrokerEvent::NotKept { broker, why }));
        RecordQueue::in_memory()
    })
}

/// Returns the MQTT subscriptions that the gateway needs with this profile.
fn subscriptions(profile: &Profile, mqtt: &Mqtt) -> Vec<Subscription> {
    let node = (mqtt.format == MqttFormat::SparkplugB).then(|| sparkplug(profile, mqtt, None)).flatten();
    node.map_or_else(|| json(profile, mqtt).subscriptions(), |node| node.subscriptions())
}

/// Connects to the broker, subscribes to the topics of the gateway, and disconnects. Publishes nothing.
///
/// # Errors
/// The connection fails, or the broker does not accept the gateway or one of its subscriptions.
pub async fn probe(profile: &Profile, mqtt: &Mqtt, trust: Trust) -> Result<(), Fault> {
    // A second client with the gateway's identifier would disconnect the running gateway.
    let id = format!("isotherm-{}-check-{}", profile.name, std::process::id());
    let client = Client::of(mqtt, id, trust, &Clock::wall());
    let mut connection = client.connect(None).await?;
    let mut refused = None;
    for subscription in subscriptions(profile, mqtt) {
        if connection.subscribe(&subscription).await? == SubscriptionAnswer::Refused {
            refused.get_or_insert(Fault::NotSubscribed(subscription.filter));
        }
    }
    connection.close().await;
    refused.map_or(Ok(()), Err)
}

/// Returns the directory for the unpublished records of a machine.
pub fn kept_in(state: &Path, machine: &str) -> PathBuf {
    state.join(format!("{machine}-mqtt"))
}

/// Parses a time in the format of the status (RFC 3339). Returns `None` if the text is invalid.
fn moment(text: &str) -> Option<Moment> {
    let stamp: jiff::Timestamp = text.parse().ok()?;
    u64::try_from(stamp.as_nanosecond()).ok().map(Moment::from_nanos)
}
