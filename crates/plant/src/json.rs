//! MQTT messages in JSON. Each axis, signal, output, device and bus has its own topic with one JSON document.
//!
//! ```text
//! GROUP/MACHINE/state           online or offline; the will message also says offline
//! GROUP/MACHINE/gateway         { "at": "2026-07-02T12:00:00Z", "ready": true, … }
//! GROUP/MACHINE/axis/z          { "at": …, "state": "active", "cz_um": -12.4, … }
//! GROUP/MACHINE/signal/bed      { "at": …, "value": 27.5, "unit": "degC", "quality": "good" }
//! GROUP/MACHINE/event           { "at": …, "kind": "axis-state", "level": "warning", "text": …, "data": { … } }
//! ```
//!
//! The broker retains all messages except events. Documents have QoS 0, because the next document replaces a
//! lost document. State, events and the discovery messages for Home Assistant have QoS 1. After the time
//! `refresh`, unchanged documents are published again. The state `online` is published again as well,
//! because another client may have replaced the retained message.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use isotherm_core::quantity::Moment;
use serde_json::{Map, Value as Document, json};

use crate::interface::{
    Message, Metric, PlantEvent, Publisher, Qos, Reaction, Record, Snapshot, Subject, Subscription, Value,
};

mod command;
mod discovery;

/// Maximum number of events whose delivery is not confirmed. If more events wait, the oldest events count as delivered.
const MOST_RECENT: usize = 1000;

/// Settings of the JSON messages.
#[derive(Clone, Debug, PartialEq)]
pub struct JsonSettings {
    /// First level of every topic, except those of the discovery messages.
    pub group: String,
    /// Name of the machine, the second level of every topic except those of the discovery messages.
    pub machine: String,
    /// Version of isotherm, shown by Home Assistant.
    pub version: String,
    /// Time after which unchanged values are published again.
    pub refresh: Duration,
    /// Whether the gateway accepts measured errors, and therefore subscribes to commands.
    pub takes_measured: bool,
    /// Whether the gateway publishes discovery messages for Home Assistant.
    pub home_assistant: bool,
}

/// Publisher of JSON messages. It stores the last published values, to find those that have changed.
#[derive(Debug)]
pub struct Json {
    settings: JsonSettings,
    /// Topic prefix `GROUP/MACHINE`.
    root: String,
    published: BTreeMap<Subject, PublishedValues>,
    /// Time at which `online` was published last on this connection.
    online_at: Moment,
    /// Events that were published last, with the times of publication. They are published again if the connection is
    /// lost before the broker has confirmed them.
    recent: VecDeque<(Moment, Record)>,
}

#[derive(Debug)]
struct PublishedValues {
    values: Vec<Option<Value>>,
    at: Moment,
}

impl Json {
    /// Creates a publisher that has published nothing yet.
    pub fn new(settings: JsonSettings) -> Json {
        let root = format!("{}/{}", settings.group, settings.machine);
        Json {
            settings,
            root,
            published: BTreeMap::new(),
            online_at: Moment::default(),
            recent: VecDeque::new(),
        }
    }

    fn state(&self, word: &str) -> Message {
        Message {
            topic: format!("{}/state", self.root),
            payload: word.into(),
            qos: Qos::AtLeastOnce,
            retained: true,
        }
    }

    fn event(&mut self, now: Moment, record: Record) -> Message {
        if self.recent.len() == MOST_RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back((now, record.clone()));
        let topic = format!("{}/event", self.root);
        Message { topic, payload: record.0, qos: Qos::AtLeastOnce, retained: false }
    }
}

impl Publisher for Json {
    fn will(&mut self) -> Message {
        self.state("offline")
    }

    fn subscriptions(&self) -> Vec<Subscription> {
        let command = Subscription { filter: format!("{}/command/+", self.root), qos: Qos::AtMostOnce };
        self.settings.takes_measured.then_some(command).into_iter().collect()
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        self.published.clear();
        self.online_at = now;
        let mut messages = match self.settings.home_assistant {
            true => discovery::messages(&self.settings, snapshot),
            false => Vec::new(),
        };
        messages.extend(self.publish(now, snapshot));
        messages.push(self.state("online"));
        messages
    }

    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        let mut messages = Vec::new();
        for metrics in snapshot.metrics.chunk_by(|one, next| one.subject == next.subject) {
            let [first, ..] = metrics else { continue };
            let published = self.published.get(&first.subject);
            if published.is_some_and(|published| {
                now.since(published.at) < self.settings.refresh && published.is_still(metrics)
            }) {
                continue;
            }
            let values = metrics.iter().map(|metric| metric.value.clone()).collect();
            self.published.insert(first.subject.clone(), PublishedValues { values, at: now });
            messages.push(Message {
                topic: format!("{}/{}", self.root, first.subject),
                payload: document(metrics).to_string().into_bytes(),
                qos: Qos::AtMostOnce,
                retained: true,
            });
        }
        messages.extend(snapshot.events.iter().map(|event| self.event(now, record(event))));
        // Another client may have published `offline` to this topic.
        if now.since(self.online_at) >= self.settings.refresh {
            self.online_at = now;
            messages.push(self.state("online"));
        }
        messages
    }

    fn received(&mut self, _now: Moment, _snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction {
        let command = topic.strip_prefix(&self.root).and_then(|rest| rest.strip_prefix("/command/"));
        let outcome = Some(command::read(command.unwrap_or(topic), payload));
        Reaction { messages: Vec::new(), outcome }
    }

    fn disconnected(&mut self, last_received: Moment) -> Vec<Record> {
        let recent = std::mem::take(&mut self.recent);
        recent.into_iter().filter(|(at, _)| *at >= last_received).map(|(_, record)| record).collect()
    }

    fn absent(&mut self, _now: Moment, snapshot: &Snapshot) -> Vec<Record> {
        snapshot.events.iter().map(record).collect()
    }

    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message> {
        records.iter().map(|record| self.event(now, record.clone())).collect()
    }

    fn publishes_in_order(&self) -> bool {
        true
    }

    fn farewell(&mut self, _now: Moment) -> Vec<Message> {
        vec![self.state("offline")]
    }
}

impl PublishedValues {
    fn is_still(&self, metrics: &[Metric]) -> bool {
        let is_near = |(published, metric): (&Option<Value>, &Metric)| match (published, &metric.value) {
            (Some(published), Some(value)) => published.is_near(value, metric.resolution),
            (published, value) => published.is_none() && value.is_none(),
        };
        self.values.len() == metrics.len() && self.values.iter().zip(metrics).all(is_near)
    }
}

/// Makes the JSON document with the metrics of one subject.
fn document(metrics: &[Metric]) -> Document {
    let mut document = Map::new();
    let newest = metrics.iter().map(|metric| metric.at).max().unwrap_or_default();
    document.insert("at".to_owned(), json!(newest.to_string()));
    for metric in metrics {
        if metric.name == "value" && !metric.unit.is_empty() {
            document.insert("unit".to_owned(), json!(metric.unit));
        }
        let value = match &metric.value {
            None => Document::Null,
            Some(Value::Real(number)) => json!(number),
            Some(Value::Count(count)) => json!(count),
            Some(Value::Flag(flag)) => json!(flag),
            Some(Value::Text(text)) => json!(text),
        };
        document.insert(metric.name.to_owned(), value);
    }
    Document::Object(document)
}

fn record(event: &PlantEvent) -> Record {
    let mut document = json!({
        "at": event.at.to_string(),
        "kind": event.kind,
        "level": event.importance.name(),
        "text": event.text,
    });
    if let Ok(data) = serde_json::from_str::<Document>(&event.data) {
        document["data"] = data;
    }
    Record(document.to_string().into_bytes())
}

#[cfg(test)]
mod tests;
