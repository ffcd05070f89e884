//! Main loop of the publisher: it connects, publishes, and stores records while the broker is unreachable.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::sync::watch;
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::broker::{Broker, BrokerReport, Connection, Fault, ReceivedMessage};
use super::commands::{self, Commands};
use super::event_queue::EventQueue;
use super::memory::Memory;
use super::moment;
use super::record_queue::RecordQueue;
use super::snapshot::metrics;
use crate::clock::Clock;
use crate::observe::events::{Broker as BrokerEvent, Event};
use crate::observe::status::{BrokerFigures, GatewayApi};
use isotherm_core::explained::Cause;
use isotherm_core::quantity::{Moment, Shift};
use isotherm_plant::{Message, Publisher, Snapshot};
use isotherm_profile::stop;

/// Number of consecutive failed attempts with a new reason after which the new reason is reported.
const CHANGED_AFTER: u32 = 2;
/// First pause after a failed or broken connection. Each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
/// Maximum pause between two attempts to connect.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Maximum wait for unpublished messages at the end of a run. Disconnecting may take the same time again.
const LAST_PATIENCE: Duration = Duration::from_secs(stop::BROKER.as_secs() / 2);

/// Publisher for one broker, with its queues.
pub(super) struct Runner {
    pub(super) publisher: Box<dyn Publisher>,
    pub(super) memory: Memory,
    pub(super) source: Arc<dyn GatewayApi>,
    pub(super) figures: Arc<BrokerFigures>,
    pub(super) clock: Clock,
    /// Address of the broker.
    pub(super) address: String,
    pub(super) every: Duration,
    pub(super) resolutions: Vec<f64>,
    pub(super) happenings: EventQueue,
    /// Last sample of the state, and its time.
    pub(super) seen: (Moment, Snapshot),
    pub(super) kept: RecordQueue,
    pub(super) commands: Commands,
    /// Messages that wait until the connection has room, each with the time at which it was made.
    pub(super) outbox: VecDeque<(Moment, Message)>,
}

/// Reason why a connection has ended.
enum End {
    Broken(Fault),
    /// The gateway has ended.
    Stopped,
}

impl Runner {
    /// Connects to the broker and publishes, again after each lost connection, until `stopped` is set.
    pub(super) async fn run(mut self, broker: impl Broker, mut stopped: watch::Receiver<bool>) {
        let mut ticks = interval(self.every);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        // The first connection usually succeeds soon. Its messages then make earlier records unnecessary.
        ticks.reset();
        let (mut failures, mut pause, mut cause) = (0_u64, FIRST_PAUSE, None);
        let mut chance = Pcg64Mcg::seed_from_u64(self.clock.time_of_day().as_nanos());
        loop {
            let will = self.publisher.will();
            self.memory.wills(self.publisher.as_ref());
            let mut connecting = std::pin::pin!(broker.connect(Some(will)));
            let connected = loop {
                tokio::select! {
                    connected = &mut connecting => break Some(connected),
                    _ = ticks.tick() => self.keep(),
                    () = ends(&mut stopped) => break None,
                }
            };
            let fault = match connected {
                None => return self.keep(),
                Some(Err(fault)) => fault,
                Some(Ok(connection)) => {
                    self.is_connected(std::mem::take(&mut failures));
                    cause = None;
                    let since = self.clock.now();
                    let end = self.published(connection, &mut ticks, &mut stopped).await;
                    if self.clock.now().since(since) > LONGEST_PAUSE {
                        pause = FIRST_PAUSE;
                    }
                    match end {
                        End::Stopped => return,
                        End::Broken(fault) => fault,
                    }
                }
            };
            failures += 1;
            self.is_away(&fault, &mut cause);
            // The pause is random, so that several gateways do not connect to a broker at the same time.
            let spread = pause.mul_f64(chance.random_range(0.5..1.0));
            pause = (pause * 2).min(LONGEST_PAUSE);
            let mut waiting = std::pin::pin!(tokio::time::sleep(spread));
            loop {
                tokio::select! {
                    () = &mut waiting => break,
                    _ = ticks.tick() => self.keep(),
                    // The last events stay on disk for the next run.
                    () = ends(&mut stopped) => return self.keep(),
                }
            }
        }
    }

    fn is_connected(&mut self, failures: u64) {
        self.figures.note(|figures| {
            figures.connected = true;
            figures.fault.clear();
            figures.connections += 1;
        });
        let broker = self.address.clone();
        if failures > 0 {
            self.source.report(&Event::Broker(BrokerEvent::Up { broker, attempts: failures }));
        } else {
            tracing::info!("connected to {broker}");
        }
    }

    fn is_away(&mut self, fault: &Fault, cause: &mut Option<Cause<String>>) {
        let why = fault.to_string();
        self.figures.note(|figures| {
            figures.connected = false;
            figures.fault.clone_from(&why);
        });
        if Cause::is_news(cause, why.clone(), CHANGED_AFTER) {
            let broker = self.address.clone();
            self.source.report(&Event::Broker(BrokerEvent::Down { broker, why }));
        }
    }

    /// Uses one connection until it breaks or the gateway ends.
    async fn published(
        &mut self,
        mut connection: impl Connection,
        ticks: &mut Interval,
        stopped: &mut watch::Receiver<bool>,
    ) -> End {
        for subscription in self.publisher.subscriptions() {
            if let Err(fault) = connection.subscribe(&subscription) {
                return End::Broken(fault);
            }
        }
        let now = self.clock.time_of_day();
        let snapshot = self.snapshot_in_order(now);
        let mut messages = self.publisher.connected(now, &snapshot);
        self.memory.connects(now, &mut messages);
        self.outbox.extend(messages.into_iter().map(|message| (now, message)));
        ticks.reset();
        loop {
            self.send(&mut connection);
            let fault = tokio::select! {
                heard = connection.next() => match heard {
                    BrokerReport::Room => continue,
                    BrokerReport::Arrived(arrived) => {
                        self.arrived(arrived);
                        continue;
                    }
                    BrokerReport::Lost(fault) => fault,
                },
                _ = ticks.tick() => {
                    self.tell(connection.last_received());
                    continue;
                }
                () = ends(stopped) => {
                    self.end(connection).await;
                    return End::Stopped;
                }
            };
            self.is_lost(connection.last_received());
            return End::Broken(fault);
        }
    }

    /// Makes messages from the changes of the state, and from stored records. If earlier messages still wait, only
    /// events are queued.
    fn tell(&mut self, last_received: Moment) {
        if !self.outbox.is_empty() {
            // The broker is slow. It gets the newest state later, and only events are queued.
            self.sample();
            self.count();
            return;
        }
        let now = self.clock.time_of_day();
        let snapshot = self.snapshot_in_order(now);
        self.memory.publishes(now);
        let mut messages = self.publisher.publish(now, &snapshot);
        if self.publisher.may_forward() {
            let records = self.kept.next(now, last_received);
            messages.extend(self.publisher.forward(now, &records));
        }
        self.outbox.extend(messages.into_iter().map(|message| (now, message)));
        self.report_dropped();
    }

    /// Samples the state, and queues its new events.
    fn sample(&mut self) {
        let status = self.source.status();
        self.happenings.sample(&status);
        let (metrics, now) = (metrics(&status, &self.resolutions), self.clock.time_of_day());
        // The gateway's time of day follows changes of the computer's clock. This clock does not, so that messages keep
        // their order.
        let shift = moment(&status.now).map_or_else(Shift::default, |day| Shift::between(now, day));
        self.seen = (now, Snapshot { metrics, events: Vec::new(), shift });
    }

    fn snapshot(&mut self) -> Snapshot {
        self.sample();
        Snapshot { events: self.happenings.take(), ..self.seen.1.clone() }
    }

    /// Returns a snapshot to publish now. If the format requires the order of events and older ones are stored, the new
    /// events are stored after them.
    fn snapshot_in_order(&mut self, now: Moment) -> Snapshot {
        let mut snapshot = self.snapshot();
        if self.publisher.publishes_in_order() && self.kept.len() > 0 {
            self.kept.push(self.publisher.absent(now, &snapshot));
            snapshot.events.clear();
        }
        snapshot
    }

    /// Samples the state and stores its records, while there is no connection.
    fn keep(&mut self) {
        let now = self.clock.time_of_day();
        let snapshot = self.snapshot();
        self.kept.push(self.publisher.absent(now, &snapshot));
        if let Some(why) = self.kept.fails() {
            let broker = self.address.clone();
            self.source.report(&Event::Broker(BrokerEvent::NotKept { broker, why }));
        }
        self.count();
    }

    fn is_lost(&mut self, last_received: Moment) {
        // Messages in the outbox have not been sent at all.
        let waiting = self.outbox.front().map_or(last_received, |(told, _)| *told);
        self.outbox.clear();
        self.kept.is_broken();
        self.kept.take_back(self.publisher.disconnected(last_received.min(waiting)));
        self.count();
    }

    fn arrived(&mut self, arrived: ReceivedMessage) {
        let now = self.clock.time_of_day();
        if arrived.retained {
            self.commands.refuse_retained(now, &arrived.topic, self.source.as_ref());
            return;
        }
        // Frequent messages must not cause frequent samples of the state.
        if now.since(self.seen.0) >= commands::PAUSE {
            self.sample();
        }
        let ReceivedMessage { topic, payload, redelivered, .. } = arrived;
        let reaction = self.publisher.received(now, &self.seen.1, &topic, &payload);
        self.outbox.extend(reaction.messages.into_iter().map(|message| (now, message)));
        if let Some(outcome) = reaction.outcome {
            self.commands.take(now, outcome, redelivered, self.source.as_ref());
        }
    }

    fn send(&mut self, connection: &mut impl Connection) {
        let mut sent = 0;
        while let Some((told, message)) = self.outbox.pop_front() {
            match connection.send(message, told) {
                Ok(()) => sent += 1,
                Err(message) => {
                    self.outbox.push_front((told, message));
                    break;
                }
            }
        }
        self.figures.note(|figures| figures.published += sent);
        self.count();
    }

    fn count(&mut self) {
        let queued = u64::try_from(self.outbox.len() + self.happenings.len()).unwrap_or(u64::MAX);
        let queued = queued.saturating_add(self.kept.len());
        self.figures.note(|figures| figures.queued = queued);
    }

    /// Reports the number of lost messages, when the broker accepts messages again.
    fn report_dropped(&mut self) {
        let count = self.happenings.dropped() + self.kept.dropped() + self.publisher.left_out();
        if count > 0 {
            self.figures.note(|figures| figures.dropped += count);
            let broker = self.address.clone();
            self.source.report(&Event::Broker(BrokerEvent::Dropped { broker, count }));
        }
    }

    /// Publishes the last state and the end of the gateway, within [`LAST_PATIENCE`].
    async fn end(&mut self, mut connection: impl Connection) {
        let now = self.clock.time_of_day();
        let snapshot = self.snapshot_in_order(now);
        self.memory.publishes(now);
        let mut messages = self.publisher.publish(now, &snapshot);
        if self.publisher.may_forward() {
            messages.extend(self.publisher.forward(now, &self.kept.ends()));
        }
        messages.extend(self.publisher.farewell(now));
        self.outbox.extend(messages.into_iter().map(|message| (now, message)));
        let last = async {
            loop {
                self.send(&mut connection);
                if self.outbox.is_empty() && connection.is_done() {
                    break true;
                }
                if let BrokerReport::Lost(_) = connection.next().await {
                    break false;
                }
            }
        };
        if tokio::time::timeout(LAST_PATIENCE, last).await == Ok(true) {
            // Only records that no birth message has released are returned.
            self.is_lost(Moment::END);
            connection.close().await;
        } else {
            self.is_lost(connection.last_received());
        }
        self.figures.note(|figures| figures.connected = false);
    }
}

/// Completes when the gateway has ended.
async fn ends(stopped: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

#[cfg(test)]
mod tests;
