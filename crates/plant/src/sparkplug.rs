//! Sparkplug B, as its specification in version 3.0 has it: isotherm is an edge node.
//!
//! ```text
//! will ──► NBIRTH ──► NDATA … ──► NDEATH      bdSeq is the same in the will, in each birth and in the death of a connection
//!  bdSeq+1  seq 0       1 … 255, 0 …
//! ```
//!
//! **One node, no devices.** Axes, signals and outputs are folders in the names of the node's metrics (`axis/z/cz_um`), not
//! devices with births and deaths of their own: they come and go with the gateway only, and a signal that fails is null with the
//! quality bad, which says more than a death.
//!
//! **By change.** Data have the alias of a metric that the birth has named, and only what has changed by its resolution.
//!
//! **Not known** is null; a signal is of bad quality then, by its property `Quality` 0. Nothing is told as stale: what isotherm
//! does not believe, no historian should. Its first value after that has `Quality` 192; otherwise good quality is not mentioned.
//!
//! **What happens** is the metric `gateway/event`: the sentence, with the properties `kind` and `importance`.
//!
//! **Store and forward.** What could not be told, or may not have arrived, becomes records; they come back through
//! [`forward`](Publisher::forward) as data that are historical, with the times of their values. Records name their metrics, so
//! that they outlive a change of the profile: what the birth no longer promises is left out and counted.
//!
//! **Commands.** `Node Control/Rebirth`, at most once a second, and the measured error of an axis where the profile takes it.
//! Everything else is refused.
//!
//! **No primary host.** The specification lets a node wait for one host, at whose word that it is off the node leaves the broker.
//! That word would take the node from every other host, and whoever may publish below `spBv1.0/STATE` could say it. A host that
//! was off while the broker was there has the gateway's logs to fill its gap from.
//!
//! **Quality of service 0** for births and data, as the specification demands: no acknowledgement of a message by itself. The
//! broker has taken what stood before something on the same connection that it does acknowledge.

use isotherm_core::quantity::{Moment, Shift, Shifted};
use prost::Message as _;

mod address;
mod born;
mod command;
mod datum;
mod payload;
mod told;
mod unconfirmed;

#[cfg(test)]
mod tests;

pub use address::{Address, Verb};
pub use datum::{DataType, Datum};
pub use payload::{Metric, Payload, Property, PropertyRaw, PropertySet, Raw, Unreadable};

use self::born::{BD_SEQ, Born, milliseconds};
use self::command::Heard;
use self::told::Told;
use self::unconfirmed::Unconfirmed;
use crate::seam::{
    Command, Happening, Message, Outcome, Publisher, Qos, Reaction, Record, Snapshot, Subscription,
};

/// Two births that hosts ask for are so far apart at least.
const BETWEEN_BIRTHS: std::time::Duration = std::time::Duration::from_secs(1);

/// Messages and records of more than a few metrics have about so many bytes.
const BYTES_IN_ONE: usize = 32 * 1024;

/// So many events wait for a birth that has to wait.
const MOST_WAITING_EVENTS: usize = 256;

/// An edge node.
#[derive(Debug)]
pub struct Sparkplug {
    address: Address,
    takes_measured: bool,
    bd_seq: u8,
    seq: u8,
    /// What the broker was promised on this connection.
    born: Option<Born>,
    born_at: Moment,
    /// As the last snapshot had it.
    shift: Shift,
    told: Told,
    unconfirmed: Unconfirmed,
    /// A host has asked for a birth that is not yet due. No data are told before it.
    owes_birth: bool,
    /// They have happened meanwhile.
    waiting: Vec<Happening>,
    /// When the last measured error was sent that does not say which measurement it is of, and what it says: a broker may bring
    /// it twice.
    last_asked: Option<(u64, Command)>,
    left_out: LeftOut,
}

/// What was not told, counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Kept records that cannot be read.
    pub unreadable_records: u64,
    /// Values in kept records whose metric is no longer there, or has another type.
    pub unknown_values: u64,
    /// What may not have arrived, and had no room in memory.
    pub unconfirmed_records: u64,
    /// Events that happened while a birth was owed, and were too many.
    pub events: u64,
}

impl Sparkplug {
    /// An edge node at this address. Each connection takes the number after `bd_seq`, which was the last one; `takes_measured`:
    /// the profile lets hosts tell an axis's measured error.
    pub fn new(address: Address, bd_seq: u8, takes_measured: bool) -> Sparkplug {
        Sparkplug {
            address,
            takes_measured,
            bd_seq,
            seq: 0,
            born: None,
            born_at: Moment::default(),
            shift: Shift::default(),
            told: Told::default(),
            unconfirmed: Unconfirmed::default(),
            owes_birth: false,
            waiting: Vec::new(),
            last_asked: None,
            left_out: LeftOut::default(),
        }
    }

    /// The number that the last will has in common with its births: to be kept over restarts.
    pub fn bd_seq(&self) -> u8 {
        self.bd_seq
    }

    /// What was not told so far.
    pub fn left_out(&self) -> LeftOut {
        LeftOut { unconfirmed_records: self.unconfirmed.dropped(), ..self.left_out }
    }

    /// The birth, and what has happened meanwhile, behind it.
    fn birth(&mut self, now: Moment, snapshot: &Snapshot, events: &[Happening]) -> Vec<Message> {
        let stamp = self.stamp(now, snapshot);
        self.owes_birth = false;
        self.born_at = now;
        self.seq = 0;
        let mut happened = std::mem::take(&mut self.waiting);
        happened.extend_from_slice(events);
        let changes = self.told.changes(snapshot, &happened, stamp);
        self.unconfirmed.keep(now, records(stamp, &changes));

        let (born, mut metrics) = Born::of(snapshot, stamp, self.takes_measured);
        metrics.push(self.death_number(Some(stamp)));
        metrics.sort_by_key(|metric| metric.timestamp);
        let payload = Payload { timestamp: Some(milliseconds(stamp)), metrics, seq: Some(0) };
        let mut messages = vec![self.message(Verb::Birth, Qos::AtMostOnce, &payload)];
        self.born = Some(born);
        let is_event = |metric: &Metric| metric.name.as_deref() == Some(born::EVENT);
        messages.extend(self.data(stamp, changes.into_iter().filter(is_event), false));
        messages
    }

    /// The time of day.
    fn stamp(&mut self, now: Moment, snapshot: &Snapshot) -> Moment {
        self.shift = snapshot.shift;
        now.shifted(self.shift)
    }

    /// Metrics that have their names, as data; `is_historical`: not of now.
    fn data(
        &mut self,
        stamp: Moment,
        metrics: impl IntoIterator<Item = Metric>,
        is_historical: bool,
    ) -> Vec<Message> {
        let Some(born) = &self.born else { return Vec::new() };
        let mut told = Vec::new();
        for metric in metrics {
            match born.as_data(metric) {
                Some(metric) => told.push(Metric { is_historical: is_historical.then_some(true), ..metric }),
                None => self.left_out.unknown_values += 1,
            }
        }
        let parts = in_parts(told);
        let messages = parts.into_iter().map(|metrics| {
            self.seq = self.seq.wrapping_add(1);
            let timestamp = Some(milliseconds(stamp));
            let payload = Payload { timestamp, metrics, seq: Some(self.seq.into()) };
            self.message(Verb::Data, Qos::AtMostOnce, &payload)
        });
        messages.collect()
    }

    fn death(&self) -> Message {
        let payload = Payload { timestamp: None, metrics: vec![self.death_number(None)], seq: None };
        self.message(Verb::Death, Qos::AtLeastOnce, &payload)
    }

    fn death_number(&self, stamp: Option<Moment>) -> Metric {
        let kind = DataType::Int64;
        Metric {
            name: Some(BD_SEQ.to_owned()),
            datatype: Some(kind.number()),
            timestamp: stamp.map(milliseconds),
            value: kind.write(&Datum::Signed(self.bd_seq.into())),
            ..Metric::default()
        }
    }

    fn message(&self, verb: Verb, qos: Qos, payload: &Payload) -> Message {
        Message { topic: self.address.topic(verb), payload: payload.bytes(), qos, retained: false }
    }

    /// A birth that was asked for may be told: not too soon after the last one, unless the clock was set back.
    fn may_be_born(&self, now: Moment) -> bool {
        now < self.born_at || now.since(self.born_at) >= BETWEEN_BIRTHS
    }
}

/// Metrics in parts of about as many bytes as one message should have.
fn in_parts(metrics: Vec<Metric>) -> Vec<Vec<Metric>> {
    let mut parts: Vec<Vec<Metric>> = Vec::new();
    let mut bytes = 0;
    for metric in metrics {
        let length = metric.encoded_len();
        // With its key and its length.
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
        self.bd_seq = self.bd_seq.wrapping_add(1);
        self.death()
    }

    fn subscriptions(&self) -> Vec<Subscription> {
        vec![Subscription { filter: self.address.topic(Verb::Command), qos: Qos::AtLeastOnce }]
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        self.birth(now, snapshot, &snapshot.events)
    }

    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        if self.born.is_none() {
            return Vec::new();
        }
        if !self.told.is_of(snapshot) || (self.owes_birth && self.may_be_born(now)) {
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
        let changes = self.told.changes(snapshot, &snapshot.events, stamp);
        self.unconfirmed.keep(now, records(stamp, &changes));
        self.data(stamp, changes, false)
    }

    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction {
        let Some(born) = self.born.as_ref().filter(|_| topic == self.address.topic(Verb::Command)) else {
            return Reaction::default();
        };
        let Heard { asks_for_birth, sent, outcome } =
            command::hear(payload, now.shifted(snapshot.shift), snapshot, born, self.takes_measured);
        let outcome = match (sent, outcome) {
            (Some(sent), Some(Outcome::Asked(command))) if !command.is_identified() => {
                let asked = Some((sent, command.clone()));
                let is_again = self.last_asked == asked;
                self.last_asked = asked;
                Some(if is_again { command::came_twice(&command) } else { Outcome::Asked(command) })
            }
            (_, outcome) => outcome,
        };
        self.owes_birth |= asks_for_birth;
        let is_due = self.owes_birth && self.may_be_born(now);
        // Events of this snapshot are told by whoever gets it next.
        let messages = if is_due { self.birth(now, snapshot, &[]) } else { Vec::new() };
        Reaction { messages, outcome }
    }

    fn disconnected(&mut self, last_heard: Moment) -> Vec<Record> {
        self.born = None;
        self.owes_birth = false;
        let mut kept = self.unconfirmed.take(last_heard);
        let waiting = std::mem::take(&mut self.waiting);
        if let Some(last) = waiting.last().map(|event| event.at) {
            kept.extend(records(last, &self.told.happened(&waiting)));
        }
        kept
    }

    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record> {
        let stamp = self.stamp(now, snapshot);
        records(stamp, &self.told.changes(snapshot, &snapshot.events, stamp))
    }

    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message> {
        if !self.may_forward() {
            return Vec::new();
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

    /// No data before a birth that somebody waits for.
    fn may_forward(&self) -> bool {
        self.born.is_some() && !self.owes_birth
    }

    fn farewell(&mut self, _now: Moment) -> Vec<Message> {
        self.born.take().map(|_| self.death()).into_iter().collect()
    }
}
