//! Sparkplug B, version 3.0 of the specification: isotherm is an edge node. A birth message contains all metrics of the
//! node, and a death message reports that the node is offline.
//!
//! ```text
//! message   will ──► NBIRTH ──► NDATA …        ──► NDEATH
//! number    bdSeq    bdSeq                         bdSeq     (one more for each CONNECT packet)
//! seq                0          1 … 255, 0 …
//! ```
//!
//! **One node, no devices.** Axes, signals and outputs are folders in the names of the node's metrics
//! (`axis/z/cz_um`). They are not Sparkplug devices with their own birth and death messages, because they
//! exist as long as the gateway runs. A failed signal is published as null with bad quality, and its metric
//! remains known to the host.
//!
//! **Report by exception.** Data messages identify each metric by its alias, a number that the birth message
//! assigns to the name. They contain only metrics that have changed by at least their resolution.
//!
//! **Unknown values** are null. For a signal, the property `Quality` is then 0, and 192 in the first valid value after
//! that. Other values have no such property. A rejected value is not published as stale, so that no historian stores
//! it.
//!
//! **Events** are the metric `gateway/event`: the text, with the properties `kind` and `importance`.
//!
//! **Store and forward.** Values that could not be published, or may be undelivered, become stored records.
//! [`forward`](Publisher::forward) publishes them as historical data, with the times of the values. Records contain
//! metric names, so that they remain valid after a change of the profile. Metrics that the birth no longer contains are
//! left out and counted as lost.
//!
//! **Commands.** `Node Control/Rebirth`, at most once per second, and the measured error of an axis if the profile
//! allows it. All other commands are refused.
//!
//! **Primary host.** If the profile names a primary host, the node publishes its birth only while this host
//! is online. When the host goes offline, the node publishes its death, and the gateway closes the
//! connection. Values and events become stored records until the host is online again. The values of the last
//! minutes before the host went offline also become stored records, because the broker reports a dead host
//! only after a while. Without a primary host in the profile, the node ignores the state of every host.
//! Otherwise each client that may publish below `spBv1.0/STATE` could disconnect the node from all other
//! hosts.
//!
//! **Quality of service 0** for births and data, as the specification requires: the broker does not acknowledge these
//! messages. If the broker acknowledges a later packet on the same connection, they are delivered.

use isotherm_core::quantity::{Moment, Shift, Shifted};
use prost::Message as _;

mod address;
mod birth;
mod command;
mod datum;
mod death_number;
mod host;
mod payload;
mod published;
mod unconfirmed;

#[cfg(test)]
mod tests;

pub use address::{Address, Verb};
pub use datum::{DataType, Datum};
pub use payload::{Metric, Payload, Property, PropertyRaw, PropertySet, Raw, Unreadable};

use self::birth::{BD_SEQ, BirthMetrics, milliseconds};
use self::command::CommandResult;
use self::death_number::DeathNumber;
use self::host::HostWatch;
use self::published::PublishedMetrics;
use self::unconfirmed::Unconfirmed;
use crate::interface::{
    Command, Message, Outcome, PlantEvent, PrimaryHost, Publisher, Qos, Reaction, Record, Snapshot,
    Subscription,
};

/// Minimum time between two birth messages. A host may request birth messages more often.
const BETWEEN_BIRTHS: std::time::Duration = std::time::Duration::from_secs(1);

/// Approximate maximum size of a message or record, in bytes. More metrics are divided into several messages.
const BYTES_IN_ONE: usize = 32 * 1024;

/// Maximum number of events that wait for a delayed birth message. If more events wait, the oldest events are lost.
const MOST_WAITING_EVENTS: usize = 256;

/// Sparkplug edge node: the publisher of this message format.
#[derive(Debug)]
pub struct Sparkplug {
    address: Address,
    takes_measured: bool,
    /// State of the primary host; `None` if the profile names no host for which the node must wait.
    host: Option<HostWatch>,
    death_number: DeathNumber,
    seq: u8,
    /// Metrics in the birth of this connection; `None` before the birth, and without a connection.
    born: Option<BirthMetrics>,
    born_at: Moment,
    /// Shift from monotonic time to wall-clock time, from the last snapshot.
    shift: Shift,
    published: PublishedMetrics,
    unconfirmed: Unconfirmed,
    /// Stored records that were published recently, used only with a primary host. If the host goes offline
    /// before it has received these records, they are stored again.
    forwarded: Unconfirmed,
    /// Whether a host has requested a birth message that must wait for the minimum time between births. The node
    /// publishes no data before this birth.
    owes_birth: bool,
    /// Events that occurred after a host requested the birth message. They are published after this birth message.
    waiting: Vec<PlantEvent>,
    /// Time stamp and content of the last measured error without an identification. A second message with the same time
    /// stamp and content is a duplicate delivery.
    last_asked: Option<(u64, Command)>,
    left_out: LostValues,
    /// Total number of lost values at the last call of [`Publisher::left_out`], to calculate the increase since then.
    queried: u64,
}

/// Numbers of values, records and events that were lost since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LostValues {
    /// Stored records that cannot be read.
    pub unreadable_records: u64,
    /// Values in stored records whose metric no longer exists, or has another type.
    pub unknown_values: u64,
    /// Published records that may be undelivered, but could not be stored, because the limit of memory was reached.
    pub unconfirmed_records: u64,
    /// Events that were discarded because too many events waited for a delayed birth.
    pub events: u64,
}

impl Sparkplug {
    /// Creates an edge node with this address. `bd_seq` is the last death number that an earlier run sent;
    /// `None` if no number is known. `takes_measured` states whether the profile lets hosts send measured
    /// errors.
    pub fn new(address: Address, bd_seq: Option<u8>, takes_measured: bool) -> Sparkplug {
        Sparkplug {
            address,
            takes_measured,
            host: None,
            death_number: DeathNumber::after(bd_seq),
            seq: 0,
            born: None,
            born_at: Moment::default(),
            shift: Shift::default(),
            published: PublishedMetrics::default(),
            unconfirmed: Unconfirmed::default(),
            forwarded: Unconfirmed::default(),
            owes_birth: false,
            waiting: Vec::new(),
            last_asked: None,
            left_out: LostValues::default(),
            queried: 0,
        }
    }

    /// Makes the node wait for a primary host, which publishes its state to this topic. [`Address::state_topic`] makes
    /// the topic from the name of the host.
    #[must_use]
    pub fn waiting_for(self, state_topic: String) -> Sparkplug {
        Sparkplug { host: Some(HostWatch::at(state_topic)), ..self }
    }

    /// Returns the death number (bdSeq) of the last will message and of the birth messages of its connection.
    pub fn bd_seq(&self) -> u8 {
        self.death_number.current()
    }

    /// Returns the numbers of values, records and events that were lost since the start.
    pub fn left_out(&self) -> LostValues {
        LostValues { unconfirmed_records: self.unconfirmed.dropped(), ..self.left_out }
    }

    /// Makes the birth message, followed by data messages. The data messages contain the events that waited for the
    /// birth, and `events`.
    fn birth(&mut self, now: Moment, snapshot: &Snapshot, events: &[PlantEvent]) -> Vec<Message> {
        let stamp = self.stamp(now, snapshot);
        self.owes_birth = false;
        self.born_at = now;
        self.seq = 0;
        let mut happened = std::mem::take(&mut self.waiting);
        happened.extend_from_slice(events);
        let changes = self.published.changes(snapshot, &happened, stamp);
        self.unconfirmed.keep(now, records(stamp, &changes));

        let (born, mut metrics) = BirthMetrics::of(snapshot, stamp, self.takes_measured);
        metrics.push(self.death_metric(Some(stamp)));
        metrics.sort_by_key(|metric| metric.timestamp);
        let payload = Payload { timestamp: Some(milliseconds(stamp)), metrics, seq: Some(0) };
        let mut messages = vec![self.message(Verb::Birth, Qos::AtMostOnce, &payload)];
        self.born = Some(born);
        let is_event = |metric: &Metric| metric.name.as_deref() == Some(birth::EVENT);
        messages.extend(self.data(stamp, changes.into_iter().filter(is_event), false));
        messages
    }

    /// Converts `now` to wall-clock time with the shift of the snapshot, and stores this shift.
    fn stamp(&mut self, now: Moment, snapshot: &Snapshot) -> Moment {
        self.shift = snapshot.shift;
        now.shifted(self.shift)
    }

    /// Makes data messages from metrics that have names. `is_historical` marks values of the past, from stored records.
    fn data(
        &mut self,
        stamp: Moment,
        metrics: impl IntoIterator<Item = Metric>,
        is_historical: bool,
    ) -> Vec<Message> {
        let Some(born) = &self.born else { return Vec::new() };
        let mut published = Vec::new();
        for metric in metrics {
            match born.as_data(metric) {
                Some(metric) => {
                    published.push(Metric { is_historical: is_historical.then_some(true), ..metric })
                }
                None => self.left_out.unknown_values += 1,
            }
        }
        let parts = in_parts(published);
        let messages = parts.into_iter().map(|metrics| {
            self.seq = self.seq.wrapping_add(1);
            let timestamp = Some(milliseconds(stamp));
            let payload = Payload { timestamp, metrics, seq: Some(self.seq.into()) };
            self.message(Verb::Data, Qos::AtMostOnce, &payload)
        });
        messages.collect()
    }

    fn death(&self) -> Message {
        let payload = Payload { timestamp: None, metrics: vec![self.death_metric(None)], seq: None };
        self.message(Verb::Death, Qos::AtLeastOnce, &payload)
    }

    fn death_metric(&self, stamp: Option<Moment>) -> Metric {
        let kind = DataType::Int64;
        Metric {
            name: Some(BD_SEQ.to_owned()),
            datatype: Some(kind.number()),
            timestamp: stamp.map(milliseconds),
            value: kind.write(&Datum::Signed(self.bd_seq().into())),
            ..Metric::default()
        }
    }

    fn message(&self, verb: Verb, qos: Qos, payload: &Payload) -> Message {
        Message { topic: self.address.topic(verb), payload: payload.bytes(), qos, retained: false }
    }

    /// Returns whether the node may publish another birth: the last birth is long enough ago, or the clock was set
    /// back.
    fn may_be_born(&self, now: Moment) -> bool {
        now < self.born_at || now.since(self.born_at) >= BETWEEN_BIRTHS
    }
}

/// Divides metrics into groups. Each group fits into one message of about the maximum size.
fn in_parts(metrics: Vec<Metric>) -> Vec<Vec<Metric>> {
    let mut parts: Vec<Vec<Metric>> = Vec::new();
    let mut bytes = 0;
    for metric in metrics {
        let length = metric.encoded_len();
        // The encoded field also contains its key and its length.
        let length = 1 + prost::length_delimiter_len(length) + length;
        match parts.last_mut() {
            Some(part) if bytes + length <= BYTES_IN_ONE => part.push(metric),
            _ => {
                bytes = 0;
                parts.push(vec![metric]);
            }
        }
        bytes += length;
    }
    parts
}

fn records(stamp: Moment, metrics: &[Metric]) -> Vec<Record> {
    let parts = in_parts(metrics.to_vec());
    let payloads = parts.into_iter().map(|metrics| {
        let payload = Payload { timestamp: Some(milliseconds(stamp)), metrics, seq: None };
        Record(payload.bytes())
    });
    payloads.collect()
}

impl Publisher for Sparkplug {
    fn will(&mut self) -> Message {
        self.death_number = self.death_number.next();
        self.host.iter_mut().for_each(HostWatch::connects);
        self.death()
    }

    fn connect_sent(&mut self) {
        self.death_number.is_sent();
    }

    /// Returns the subscription to commands, and then the subscription to the state of the primary host. The state is
    /// last, because the received state can cause a birth message, which must follow both subscriptions.
    fn subscriptions(&self) -> Vec<Subscription> {
        let topics =
            [Some(self.address.topic(Verb::Command)), self.host.as_ref().map(|host| host.topic().to_owned())];
        topics.into_iter().flatten().map(|filter| Subscription { filter, qos: Qos::AtLeastOnce }).collect()
    }

    fn host(&self) -> PrimaryHost {
        self.host.as_ref().map_or(PrimaryHost::NotNeeded, HostWatch::state)
    }

    /// Returns whether the node accepts retained messages on this topic: only on the topic of the primary
    /// host's state.
    fn takes_retained(&self, topic: &str) -> bool {
        self.host.as_ref().is_some_and(|host| host.topic() == topic)
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        self.birth(now, snapshot, &snapshot.events)
    }

    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        if self.born.is_none() {
            return Vec::new();
        }
        if !self.published.is_of(snapshot) || (self.owes_birth && self.may_be_born(now)) {
            return self.birth(now, snapshot, &snapshot.events);
        }
        if self.owes_birth {
            self.waiting.extend_from_slice(&snapshot.events);
            let too_many = self.waiting.len().saturating_sub(MOST_WAITING_EVENTS);
            self.waiting.drain(..too_many);
            self.left_out.events += u64::try_from(too_many).unwrap_or(u64::MAX);
            return Vec::new();
        }
        let stamp = self.stamp(now, snapshot);
        let changes = self.published.changes(snapshot, &snapshot.events, stamp);
        self.unconfirmed.keep(now, records(stamp, &changes));
        self.data(stamp, changes, false)
    }

    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction {
        if let Some(host) = self.host.as_mut().filter(|host| host.topic() == topic) {
            let refused = |why| Outcome::Refused { command: "STATE".to_owned(), why };
            return Reaction { messages: Vec::new(), outcome: host.receive(payload).err().map(refused) };
        }
        let Some(born) = self.born.as_ref().filter(|_| topic == self.address.topic(Verb::Command)) else {
            return Reaction::default();
        };
        let CommandResult { asks_for_birth, sent, outcome } =
            command::receive(payload, now.shifted(snapshot.shift), snapshot, born, self.takes_measured);
        let outcome = match (sent, outcome) {
            (Some(sent), Some(Outcome::Asked(command))) if !command.is_identified() => {
                let asked = Some((sent, command.clone()));
                let is_again = self.last_asked == asked;
                self.last_asked = asked;
                Some(if is_again { command::repeated_outcome(&command) } else { Outcome::Asked(command) })
            }
            (_, outcome) => outcome,
        };
        self.owes_birth |= asks_for_birth;
        let is_due = self.owes_birth && self.may_be_born(now);
        // This snapshot contains no events; they are in the next snapshot.
        let messages = if is_due { self.birth(now, snapshot, &[]) } else { Vec::new() };
        Reaction { messages, outcome }
    }

    fn disconnected(&mut self, last_received: Moment) -> Vec<Record> {
        self.born = None;
        self.owes_birth = false;
        let mut kept = self.forwarded.take(last_received);
        if self.host() != PrimaryHost::Offline {
            // The connection to the broker is lost, but the forwarded records are still on disk. The gateway publishes
            // them again.
            kept.clear();
        }
        kept.extend(self.unconfirmed.take(last_received));
        let waiting = std::mem::take(&mut self.waiting);
        if let Some(last) = waiting.last().map(|event| event.at) {
            kept.extend(records(last, &self.published.happened(&waiting)));
        }
        kept
    }

    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record> {
        let stamp = self.stamp(now, snapshot);
        records(stamp, &self.published.changes(snapshot, &snapshot.events, stamp))
    }

    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message> {
        if !self.may_forward() {
            return Vec::new();
        }
        if self.host.is_some() {
            self.forwarded.keep(now, records.to_vec());
        }
        let mut metrics = Vec::new();
        for record in records {
            match Payload::decode(record.0.as_slice()) {
                Ok(payload) => metrics.extend(payload.metrics),
                Err(_) => self.left_out.unreadable_records += 1,
            }
        }
        self.data(now.shifted(self.shift), metrics, true)
    }

    /// Returns `false` while the node has no birth, or while a requested birth is not published: no data may precede a
    /// birth.
    fn may_forward(&self) -> bool {
        self.born.is_some() && !self.owes_birth
    }

    fn number_to_keep(&self) -> Option<u8> {
        Some(self.bd_seq())
    }

    fn number_sent(&self) -> Option<u8> {
        self.death_number.sent()
    }

    fn left_out(&mut self) -> u64 {
        let all = Sparkplug::left_out(self);
        let all = all.unreadable_records + all.unknown_values + all.unconfirmed_records + all.events;
        all.saturating_sub(std::mem::replace(&mut self.queried, all))
    }

    fn farewell(&mut self, _now: Moment) -> Vec<Message> {
        self.born.take().map(|_| self.death()).into_iter().collect()
    }
}
