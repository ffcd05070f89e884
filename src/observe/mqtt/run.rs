//! Main loop of the publisher: it connects, publishes, and stores records while the broker is unreachable.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::sync::watch;
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::broker::{
    Broker, BrokerReport, ConnectPacket, Connection, Fault, ReceivedMessage, SubscriptionAnswer,
};
use super::commands::{self, Commands};
use super::denials::Denials;
use super::event_queue::EventQueue;
use super::host_report::{HostNews, HostReport};
use super::memory::Memory;
use super::moment;
use super::record_queue::RecordQueue;
use super::snapshot::metrics;
use crate::clock::Clock;
use crate::observe::events::{Broker as BrokerEvent, Event};
use crate::observe::status::{BrokerFigures, GatewayApi};
use isotherm_core::explained::Cause;
use isotherm_core::quantity::{Moment, Shift};
use isotherm_plant::{Message, Publisher, Qos, Snapshot};
use isotherm_profile::stop;

/// Number of consecutive failed attempts with a new reason after which the new reason is reported.
const CHANGED_AFTER: u32 = 2;
/// First pause after a failed or broken connection. Each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
/// Maximum pause between two attempts to connect.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// Maximum wait for unpublished messages at the end of a run. Disconnecting may take the same time again.
const LAST_PATIENCE: Duration = Duration::from_secs(stop::BROKER.as_secs() / 2);

/// Publisher for one broker, with its queues and its connection state.
pub(super) struct Runner {
    pub(super) publisher: Box<dyn Publisher>,
    pub(super) memory: Memory,
    pub(super) source: Arc<dyn GatewayApi>,
    pub(super) figures: Arc<BrokerFigures>,
    pub(super) clock: Clock,
    /// Scheme, host and port of the broker.
    pub(super) address: String,
    pub(super) every: Duration,
    pub(super) resolutions: Vec<f64>,
    pub(super) happenings: EventQueue,
    /// Last sample of the state, and the time of this sample.
    pub(super) seen: (Moment, Snapshot),
    pub(super) kept: RecordQueue,
    pub(super) commands: Commands,
    /// Messages that wait until the connection has room, each with the time at which it was made.
    pub(super) outbox: VecDeque<(Moment, Message)>,
    /// Topics to which the broker does not let the gateway publish.
    pub(super) denials: Denials,
    pub(super) outage: Outage,
    /// Name of the primary host; empty if the profile names none.
    pub(super) host: String,
    pub(super) host_report: HostReport,
}

/// Period without a usable connection to the broker.
#[derive(Default)]
pub(super) struct Outage {
    /// Number of failed attempts, and of connections that the broker closed after a denied message.
    failures: u64,
    /// Reported cause; `None` if the connection is usable.
    cause: Option<Cause<String>>,
}

/// Reason why a connection has ended.
enum End {
    Broken(Fault),
    /// The primary host has gone offline.
    HostOffline,
    /// The gateway has ended, so that the publisher must end too.
    Stopped,
}

impl Runner {
    /// Connects to the broker and publishes until `stopped` is set. Connects again after each lost
    /// connection.
    pub(super) async fn run(mut self, broker: impl Broker, stopped: watch::Receiver<bool>) {
        self.publish_until(broker, stopped).await;
        self.memory.ends(self.publisher.as_ref());
        self.figures.note(|figures| figures.connected = false);
    }

    async fn publish_until(&mut self, broker: impl Broker, mut stopped: watch::Receiver<bool>) {
        let mut ticks = interval(self.every);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        // The first connection usually succeeds soon. Its messages then make earlier records unnecessary.
        ticks.reset();
        let mut pause = FIRST_PAUSE;
        let mut chance = Pcg64Mcg::seed_from_u64(self.clock.time_of_day().as_nanos());
        loop {
            let will = self.publisher.will();
            self.check_host(Duration::ZERO);
            self.memory.wills(self.publisher.as_ref());
            let mut connecting = std::pin::pin!(broker.connect(Some(will)));
            let connected = loop {
                tokio::select! {
                    connected = &mut connecting => break Some(connected),
                    _ = ticks.tick() => self.keep(),
                    () = ends(&mut stopped) => break None,
                }
            };
            if broker.packet() == ConnectPacket::Sent {
                self.publisher.connect_sent();
            }
            let fault = match connected {
                None => return self.keep(),
                Some(Err(fault)) => Some(fault),
                Some(Ok(connection)) => {
                    self.is_connected();
                    let since = self.clock.now();
                    let end = self.published(connection, &mut ticks, &mut stopped).await;
                    if self.clock.now().since(since) > LONGEST_PAUSE {
                        pause = FIRST_PAUSE;
                    }
                    match end {
                        End::Stopped => return,
                        End::HostOffline => None,
                        End::Broken(fault) => Some(fault),
                    }
                }
            };
            if let Some(fault) = fault {
                self.is_away(&fault);
            }
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

    fn is_connected(&mut self) {
        self.figures.note(|figures| {
            figures.connected = true;
            figures.fault.clear();
            figures.connections += 1;
        });
        if self.outage.failures == 0 {
            tracing::info!("connected to {}", self.address);
        }
    }

    /// Reports the end of an outage when the broker has answered the subscriptions. No report is made while a topic is
    /// suspected, because the broker may then close the connection again.
    fn report_up(&mut self) {
        if self.denials.has_suspects() {
            return;
        }
        let Outage { failures: attempts, .. } = std::mem::take(&mut self.outage);
        if attempts > 0 {
            let broker = self.address.clone();
            self.source.report(&Event::Broker(BrokerEvent::Up { broker, attempts }));
        }
    }

    fn is_away(&mut self, fault: &Fault) {
        self.outage.failures += 1;
        let said = fault.to_string();
        self.figures.note(|figures| {
            figures.connected = false;
            figures.fault.clone_from(&said);
        });
        if Cause::is_news(&mut self.outage.cause, said, CHANGED_AFTER) {
            let (broker, why) = (self.address.clone(), fault.explained());
            self.source.report(&Event::Broker(BrokerEvent::Down { broker, why }));
        }
    }

    /// Publishes over one connection until the connection breaks, the primary host goes offline, or the gateway ends.
    /// Returns the reason for the end.
    async fn published(
        &mut self,
        mut connection: impl Connection,
        ticks: &mut Interval,
        stopped: &mut watch::Receiver<bool>,
    ) -> End {
        let begun = match self.subscribed(&mut connection, ticks, stopped).await {
            Ok(()) => {
                self.report_up();
                self.awaited_host(&mut connection, ticks, stopped).await
            }
            Err(end) => Err(end),
        };
        match begun {
            Ok(()) => {}
            Err(End::Stopped) => {
                self.keep();
                self.leaves(connection).await;
                return End::Stopped;
            }
            Err(end) => return end,
        }
        let now = self.clock.time_of_day();
        self.denials.begins(now);
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
                        if self.publisher.host().is_present() {
                            continue;
                        }
                        self.check_host(Duration::ZERO);
                        self.leaves(connection).await;
                        return End::HostOffline;
                    }
                    BrokerReport::Lost(fault) => fault,
                },
                _ = ticks.tick() => {
                    self.tell(&connection);
                    continue;
                }
                () = ends(stopped) => {
                    self.end(connection).await;
                    return End::Stopped;
                }
            };
            let (fault, denied) = self.denials.ends(fault, connection.is_done());
            if let Some(topic) = denied {
                self.is_refused(&topic);
                let broker = self.address.clone();
                self.source.report(&Event::Broker(BrokerEvent::PublishDenied { broker, topic }));
            }
            self.is_lost(connection.last_received());
            return End::Broken(fault);
        }
    }

    /// Subscribes to the topics of commands and of the primary host. The first message is published only
    /// after the broker has answered. Otherwise, a command in reply to that message could be lost. The error
    /// is the reason why the connection has ended.
    async fn subscribed(
        &mut self,
        connection: &mut impl Connection,
        ticks: &mut Interval,
        stopped: &mut watch::Receiver<bool>,
    ) -> Result<(), End> {
        for subscription in self.publisher.subscriptions() {
            let answer = {
                let mut answering = std::pin::pin!(connection.subscribe(&subscription));
                loop {
                    tokio::select! {
                        answer = &mut answering => break answer,
                        _ = ticks.tick() => self.keep(),
                        () = ends(stopped) => return Err(End::Stopped),
                    }
                }
            };
            self.is_answered(subscription.filter, answer.map_err(End::Broken)?);
        }
        Ok(())
    }

    /// Records the answer of the broker to a subscription, and reports a change.
    fn is_answered(&mut self, topic: String, answer: SubscriptionAnswer) {
        let broker = self.address.clone();
        let is_known = self.figures.read().refused.contains(&topic);
        match answer {
            SubscriptionAnswer::Refused if !is_known => {
                self.is_refused(&topic);
                self.source.report(&Event::Broker(BrokerEvent::SubscriptionRefused { broker, topic }));
            }
            SubscriptionAnswer::Accepted if is_known => {
                self.figures.note(|figures| figures.refused.retain(|refused| *refused != topic));
                self.source.report(&Event::Broker(BrokerEvent::Subscribed { broker, topic }));
            }
            SubscriptionAnswer::Refused | SubscriptionAnswer::Accepted => {}
        }
    }

    fn is_refused(&self, topic: &str) {
        self.figures.note(|figures| figures.refused.push(topic.to_owned()));
    }

    /// Waits until the primary host is online, and stores records of the state meanwhile. The error is the
    /// reason why the connection has ended.
    async fn awaited_host(
        &mut self,
        connection: &mut impl Connection,
        ticks: &mut Interval,
        stopped: &mut watch::Receiver<bool>,
    ) -> Result<(), End> {
        let since = self.clock.now();
        loop {
            self.check_host(self.clock.now().since(since));
            if self.publisher.host().is_present() {
                return Ok(());
            }
            tokio::select! {
                report = connection.next() => match report {
                    BrokerReport::Room => {}
                    BrokerReport::Arrived(arrived) => self.arrived(arrived),
                    BrokerReport::Lost(fault) => return Err(End::Broken(fault)),
                },
                _ = ticks.tick() => self.keep(),
                () = ends(stopped) => return Err(End::Stopped),
            }
        }
    }

    /// Updates the state of the primary host in the status, and reports a change. `waited` is the time since the
    /// subscription to this state.
    fn check_host(&mut self, waited: Duration) {
        let host = self.publisher.host();
        self.figures.note(|figures| host.name().clone_into(&mut figures.primary_host));
        let Some(news) = self.host_report.check(host, waited) else { return };
        let (broker, host) = (self.address.clone(), self.host.clone());
        self.source.report(&Event::Broker(match news {
            HostNews::Offline(why) => BrokerEvent::HostOffline { broker, host, why },
            HostNews::Online => BrokerEvent::HostOnline { broker, host },
        }));
    }

    /// Makes messages from the changes of the state, and from stored records. While earlier messages still
    /// wait, the function only queues the new events.
    fn tell(&mut self, connection: &impl Connection) {
        self.report_up();
        let now = self.clock.time_of_day();
        self.denials.waits(now);
        if !self.outbox.is_empty() {
            // The broker is slow. It gets the newest state later, and only events are queued.
            self.sample();
            self.count();
            return;
        }
        if self.kept.len() == 0 {
            self.denials.rests(now);
        }
        let snapshot = self.snapshot_in_order(now);
        self.memory.publishes(now);
        let mut messages = self.publisher.publish(now, &snapshot);
        if self.publisher.may_forward() {
            let records = self.kept.next(now, connection.last_received());
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

    /// Returns a snapshot to publish now. If the format requires events in order, and older events are stored, the new
    /// events are stored after them.
    fn snapshot_in_order(&mut self, now: Moment) -> Snapshot {
        let mut snapshot = self.snapshot();
        if self.publisher.publishes_in_order() && self.kept.len() > 0 {
            self.kept.push(self.publisher.absent(now, &snapshot));
            snapshot.events.clear();
        }
        snapshot
    }

    /// Samples the state and stores its records, because nothing can be published now.
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
        self.kept.take_back(self.publisher.disconnected(last_received.min(waiting)));
        self.kept.is_broken();
        self.count();
    }

    fn arrived(&mut self, arrived: ReceivedMessage) {
        let now = self.clock.time_of_day();
        if arrived.retained && !self.publisher.takes_retained(&arrived.topic) {
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
        while self.denials.may_send(connection.is_done()) {
            let Some((told, message)) = self.denials.next(&mut self.outbox) else { break };
            let (awaited, qos) = (self.denials.awaits(&message), message.qos);
            if let Err(message) = connection.send(message, told) {
                self.outbox.push_front((told, message));
                break;
            }
            sent += 1;
            if let Some(topic) = awaited {
                self.denials.is_sent(&topic);
                if qos == Qos::AtMostOnce {
                    connection.request_answer(&topic);
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

    /// Publishes the last state, and a message that the gateway has ended. Waits at most [`LAST_PATIENCE`].
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
        if self.delivers(&mut connection).await {
            // Only records that no birth message has released are returned.
            self.is_lost(Moment::END);
            connection.close().await;
        } else {
            self.is_lost(connection.last_received());
        }
    }

    /// Sends all messages of the outbox. Returns whether the broker has received them within [`LAST_PATIENCE`].
    async fn delivers(&mut self, connection: &mut impl Connection) -> bool {
        let last = async {
            loop {
                self.send(connection);
                if self.outbox.is_empty() && connection.is_done() {
                    break true;
                }
                if let BrokerReport::Lost(_) = connection.next().await {
                    break false;
                }
            }
        };
        tokio::time::timeout(LAST_PATIENCE, last).await == Ok(true)
    }

    /// Publishes that the machine or node is offline, and closes the connection, because the primary host is offline or
    /// the gateway stops. The values of the last minutes are stored again, because the host may not have received them.
    /// The broker reports a dead host only after a while.
    async fn leaves(&mut self, mut connection: impl Connection) {
        self.outbox.clear();
        let now = self.clock.time_of_day();
        self.outbox.extend(self.publisher.farewell(now).into_iter().map(|message| (now, message)));
        let is_delivered = self.delivers(&mut connection).await;
        self.is_lost(Moment::default());
        if is_delivered {
            connection.close().await;
        }
        self.figures.note(|figures| figures.connected = false);
    }
}

/// Completes when `stopped` is set, because the gateway has ended.
async fn ends(stopped: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

#[cfg(test)]
mod tests;
