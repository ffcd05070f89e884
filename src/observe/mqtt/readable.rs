//! Readable messages. The broker retains them for later subscribers. Retained messages of topics that are no longer
//! published would look current forever. The topics are therefore kept on disk, and the next run clears those that it
//! no longer publishes.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use isotherm_core::quantity::Moment;
use isotherm_plant::store::TopicsFile;
use isotherm_plant::{Json, Message, Publisher, Qos, Reaction, Record, Snapshot, Subscription};

/// File name, in the directory of the queue.
const TOPICS: &str = "topics";
/// Age of a connection after which its first messages count as delivered.
const ARRIVED_AFTER: Duration = Duration::from_secs(60);

/// Makes the messages, and keeps the list of topics that the broker may have retained.
pub(super) struct Readable {
    json: Json,
    file: TopicsFile,
    /// Topics of earlier runs that this run does not publish.
    gone: BTreeSet<String>,
    /// Start of this connection, and the topics published on it.
    told: (Moment, BTreeSet<String>),
}

impl Readable {
    pub(super) fn new(json: Json, directory: &Path) -> Readable {
        let file = TopicsFile::at(directory.join(TOPICS));
        // If the list cannot be read, old messages stay at the broker.
        let gone = file.read().unwrap_or_default();
        Readable { json, file, gone, told: (Moment::default(), BTreeSet::new()) }
    }
}

/// Message that makes the broker delete the retained message of a topic.
fn cleared(topic: &str) -> Message {
    Message { topic: topic.to_owned(), payload: Vec::new(), qos: Qos::AtLeastOnce, retained: true }
}

impl Publisher for Readable {
    fn will(&mut self) -> Message {
        self.json.will()
    }

    fn subscriptions(&self) -> Vec<Subscription> {
        self.json.subscriptions()
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        let mut messages = self.json.connected(now, snapshot);
        let kept = messages.iter().filter(|message| message.retained);
        let told: BTreeSet<String> = kept.map(|message| message.topic.clone()).collect();
        self.gone.retain(|topic| !told.contains(topic));
        messages.extend(self.gone.iter().map(|topic| cleared(topic)));
        // If the disk fails, the next run uses an older list.
        let _ = self.file.write(told.union(&self.gone));
        self.told = (now, told);
        messages
    }

    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        if !self.gone.is_empty() && now.since(self.told.0) > ARRIVED_AFTER {
            self.gone.clear();
            let _ = self.file.write(&self.told.1);
        }
        self.json.publish(now, snapshot)
    }

    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction {
        self.json.received(now, snapshot, topic, payload)
    }

    fn disconnected(&mut self, last_heard: Moment) -> Vec<Record> {
        self.json.disconnected(last_heard)
    }

    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record> {
        self.json.absent(now, snapshot)
    }

    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message> {
        self.json.forward(now, records)
    }

    fn tells_in_order(&self) -> bool {
        self.json.tells_in_order()
    }

    fn farewell(&mut self, now: Moment) -> Vec<Message> {
        self.json.farewell(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_plant::{JsonSettings, Metric, Subject, Value};

    fn of(home_assistant: bool, directory: &Path) -> Readable {
        let json = Json::new(JsonSettings {
            group: "g".into(),
            machine: "press".into(),
            version: "1".into(),
            refresh: Duration::from_secs(60),
            takes_measured: false,
            home_assistant,
        });
        Readable::new(json, directory)
    }

    fn snapshot(signal: &str) -> Snapshot {
        let value = Metric {
            subject: Subject::Signal(signal.into()),
            name: "value",
            value: Some(Value::Real(1.0)),
            kind: Value::Real(0.0),
            unit: "degC",
            resolution: 0.0,
            at: Moment::default(),
        };
        Snapshot { metrics: vec![value], ..Snapshot::default() }
    }

    fn at(seconds: u64) -> Moment {
        Moment::from_nanos(seconds * 1_000_000_000)
    }

    fn clears(messages: &[Message]) -> Vec<&str> {
        let cleared = messages.iter().filter(|message| message.retained && message.payload.is_empty());
        cleared.map(|message| message.topic.as_str()).collect()
    }

    #[test]
    fn what_the_profile_has_no_more_is_cleared_until_that_has_arrived() {
        let home = tempfile::tempdir().unwrap();
        let mut first = of(true, home.path());
        assert_eq!(clears(&first.connected(at(1), &snapshot("bed"))), [""; 0]);
        let gone = ["g/press/signal/bed", "homeassistant/sensor/isotherm-press/signal_bed_value/config"];
        // If the program is killed before delivery, the next run clears them again.
        for begun in [10, 20] {
            let mut second = of(false, home.path());
            assert_eq!(clears(&second.connected(at(begun), &snapshot("table"))), gone);
            assert_eq!(clears(&second.connected(at(begun + 1), &snapshot("table"))), gone);
            second.publish(at(begun + 30), &snapshot("table"));
        }
        let mut third = of(false, home.path());
        assert_eq!(clears(&third.connected(at(100), &snapshot("table"))), gone);
        third.publish(at(161), &snapshot("table"));
        let mut fourth = of(false, home.path());
        assert_eq!(clears(&fourth.connected(at(200), &snapshot("table"))), [""; 0]);
        assert_eq!(
            clears(&of(false, home.path()).connected(at(201), &snapshot("bed"))),
            ["g/press/signal/table"]
        );
    }
}
