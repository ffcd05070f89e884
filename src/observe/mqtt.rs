//! What a machine does is published to a broker, as `[mqtt]` says: by MQTT, readably or as Sparkplug B.
//!
//! A thread of its own looks at the state that the page shows, once in `every`, and has the crate `isotherm-plant` make messages of
//! what is new. No line, no step and no page ever waits for it, and it holds nothing that they want but the state's lock, as the page
//! does. Everything that waits for a slow broker or one that is away is bounded, and what finds no room is counted and reported.
//!
//! # Layout
//! - `snapshot`, `happenings`: the state and the events, as figures.
//! - `run`: connecting, publishing, waiting. `kept`: what waits for a broker that is away. `commands`: what arrives. `node`: a Sparkplug
//!   node over restarts. `readable`: readable messages over restarts.
//! - `broker`: what a broker is. `client`: the library behind it. `stream`: TCP and TLS.

use std::collections::VecDeque;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::sync::{oneshot, watch};
use tokio_rustls::rustls::ClientConfig;

use super::events::{Broker as BrokerEvent, Event};
use super::status::{BrokerFigures, Source};
use crate::clock::Clock;
use broker::{Broker, Connection};
use client::Client;
use commands::Commands;
use happenings::Happenings;
use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::Address;
use isotherm_plant::{Json, JsonSettings, Publisher};
use isotherm_profile::{Mqtt, MqttFormat, Profile, stop};
use kept::Kept;
use node::Node;
use readable::Readable;
use run::Runner;

mod broker;
mod client;
mod commands;
mod happenings;
mod kept;
mod node;
mod readable;
mod run;
mod snapshot;
mod stream;

pub use broker::Fault;

/// Names that are looked up wait in a thread each.
const LOOKUPS: usize = 1;

/// Whom the broker's certificate is compared with, and what it is shown; `None` for a broker without TLS.
pub type Trust = Option<Arc<ClientConfig>>;

/// The thread that publishes.
#[derive(Debug)]
pub struct Publishing {
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Nobody waits for it longer than [`Publishing::finish`] does.
    _thread: JoinHandle<()>,
}

impl Publishing {
    /// Begins to publish the state of a machine.
    ///
    /// # Errors
    /// The system has no thread for it.
    pub fn start(
        (profile, mqtt): (&Profile, &Mqtt),
        trust: Trust,
        source: &Arc<dyn Source>,
        figures: &Arc<BrokerFigures>,
        state: &Path,
    ) -> std::io::Result<Publishing> {
        let clock = Clock::wall();
        let address = mqtt.broker.to_string();
        let (publisher, kept) = publisher(profile, mqtt, state, source.as_ref());
        let id = format!("isotherm-{}", profile.name);
        let broker = Client::of(mqtt, id, trust, &clock);
        let runner = Runner {
            publisher,
            source: source.clone(),
            figures: figures.clone(),
            clock,
            commands: Commands::from(&address),
            address,
            every: mqtt.every,
            resolutions: snapshot::resolutions(profile),
            happenings: Happenings::default(),
            seen: Default::default(),
            kept,
            outbox: VecDeque::new(),
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(LOOKUPS)
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name("mqtt".to_owned()).spawn(move || {
            runtime.block_on(runner.run(broker, stopped));
            // A name that is still looked up holds up nobody.
            runtime.shutdown_background();
            // Nobody may wait for it any more.
            let _ = over.send(());
        })?;
        Ok(Publishing { stop, ended, _thread: thread })
    }

    /// The gateway has ended: the last state and that it is gone are published, for at most [`stop::BROKER`], or until `hurry` is ready.
    pub async fn finish(self, hurry: impl Future<Output = ()>) {
        self.stop.send_replace(true);
        tokio::select! {
            _ = self.ended => {}
            () = tokio::time::sleep(stop::BROKER) => {}
            () = hurry => {}
        }
    }
}

/// What makes the messages, and where those wait that could not be told. `state` is the state directory.
fn publisher(
    profile: &Profile,
    mqtt: &Mqtt,
    state: &Path,
    source: &dyn Source,
) -> (Box<dyn Publisher>, Kept) {
    let directory = kept_in(state, &profile.name);
    // The profile has refused a group that can be none.
    if let (MqttFormat::SparkplugB, Ok(address)) = (mqtt.format, Address::new(&mqtt.group, &profile.name)) {
        let kept = Kept::on_disk(&directory, mqtt.buffer);
        let node = Box::new(Node::new(address, &directory, mqtt.takes_measured));
        return match kept {
            Ok(kept) => (node, kept),
            Err(error) => {
                let (broker, why) = (mqtt.broker.to_string(), error.to_string());
                source.report(&Event::Broker(BrokerEvent::NotKept { broker, why }));
                (node, Kept::in_memory())
            }
        };
    }
    let json = Json::new(JsonSettings {
        group: mqtt.group.clone(),
        machine: profile.name.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        refresh: mqtt.refresh,
        takes_measured: mqtt.takes_measured,
        home_assistant: mqtt.home_assistant,
    });
    (Box::new(Readable::new(json, &directory)), Kept::in_memory())
}

/// Connects once, publishes nothing, and leaves.
///
/// # Errors
/// Why the broker does not take the gateway.
pub async fn probe(profile: &Profile, mqtt: &Mqtt, trust: Trust) -> Result<(), Fault> {
    // Under the gateway's own name the broker would send the one away that runs.
    let id = format!("isotherm-{}-check-{}", profile.name, std::process::id());
    let connection = Client::of(mqtt, id, trust, &Clock::wall()).connect(None).await?;
    connection.close().await;
    Ok(())
}

/// Where in the state directory of a machine that is kept which waits for a broker.
pub fn kept_in(state: &Path, machine: &str) -> PathBuf {
    state.join(format!("{machine}-mqtt"))
}

/// What stands in a state as people read it.
fn moment(text: &str) -> Option<Moment> {
    let stamp: jiff::Timestamp = text.parse().ok()?;
    u64::try_from(stamp.as_nanosecond()).ok().map(Moment::from_nanos)
}
