use isotherm_core::quantity::Moment;
use prost::Message as _;

use super::*;
use crate::interface::{self, Command, Importance, Outcome, Subject, Value};

mod births;
mod commands;
mod data;
mod host;
mod lost;
mod wire;

pub(super) fn at(milliseconds: u64) -> Moment {
    Moment::from_nanos(1_800_000_000_000_000_000 + milliseconds * 1_000_000)
}

/// Time in a message, ms since 1970.
pub(super) fn ms(milliseconds: u64) -> Option<u64> {
    Some(1_800_000_000_000 + milliseconds)
}

pub(super) fn node() -> Sparkplug {
    Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), Some(41), true)
}

/// Snapshot with a temperature, which may be unknown, and with a flag whether the axis is armed.
pub(super) fn snapshot(bed: Option<f64>, is_armed: bool, taken: Moment) -> Snapshot {
    let metric = |subject, name, value, kind, unit, resolution| interface::Metric {
        subject,
        name,
        value,
        kind,
        unit,
        resolution,
        at: taken,
    };
    let bed = bed.map(Value::Real);
    let armed = Some(Value::Flag(is_armed));
    Snapshot {
        metrics: vec![
            metric(Subject::Signal("bed".to_owned()), "value", bed, Value::Real(0.0), "°C", 0.01),
            metric(Subject::Axis("z".to_owned()), "is_armed", armed, Value::Flag(false), "", 0.0),
        ],
        ..Snapshot::default()
    }
}

pub(super) fn happening(text: &str, at: Moment) -> PlantEvent {
    PlantEvent {
        at,
        kind: "axis-state".to_owned(),
        importance: Importance::Warning,
        text: text.to_owned(),
        data: String::new(),
    }
}

/// Kind and content of a message.
pub(super) fn read(message: &Message) -> (&str, Payload) {
    let mut levels = message.topic.split('/');
    assert_eq!((levels.next(), levels.next()), (Some("spBv1.0"), Some("shop")));
    let verb = levels.next().unwrap();
    assert_eq!((levels.next(), levels.next()), (Some("grinder-3"), None));
    assert!(!message.retained);
    (verb, Payload::decode(message.payload.as_slice()).unwrap())
}

pub(super) fn find<'a>(payload: &'a Payload, name: &str) -> &'a Metric {
    let mut found = payload.metrics.iter().filter(|metric| metric.name.as_deref() == Some(name));
    let metric = found.next().unwrap_or_else(|| panic!("no {name} in {payload:?}"));
    assert_eq!(found.next(), None, "{name} twice");
    metric
}

pub(super) fn alias(birth: &Payload, name: &str) -> u64 {
    find(birth, name).alias.unwrap()
}

/// Connects a node. Returns it with the content of its birth message.
pub(super) fn connected(now: Moment, snapshot: &Snapshot) -> (Sparkplug, Payload) {
    let mut node = node();
    node.will();
    let messages = node.connected(now, snapshot);
    let [birth] = messages.as_slice() else { panic!("{messages:?}") };
    let (verb, payload) = read(birth);
    assert_eq!((verb, birth.qos), ("NBIRTH", Qos::AtMostOnce));
    (node, payload)
}

/// Row of a test: sequence number of the message; alias, time and value of a metric.
type Row = (u64, u64, u64, Option<Raw>);

pub(super) fn rows(messages: &[Message]) -> Vec<Row> {
    let mut rows = Vec::new();
    for message in messages {
        let (verb, payload) = read(message);
        assert_eq!((verb, message.qos), ("NDATA", Qos::AtMostOnce));
        for metric in payload.metrics {
            assert_eq!((metric.name, metric.datatype), (None, None), "data have aliases only");
            let time = metric.timestamp.unwrap() - ms(0).unwrap();
            rows.push((payload.seq.unwrap(), metric.alias.unwrap(), time, metric.value));
        }
    }
    rows
}
