//! Topics that later runs do not publish any more.

use super::*;
use isotherm_plant::{Json, JsonSettings, Metric, Snapshot, Subject, Value};

/// Publisher of readable messages, with its memory.
struct Readable(Json, Memory);

impl Readable {
    fn of(home_assistant: bool, directory: &Path) -> Readable {
        let json = Json::new(JsonSettings {
            group: "g".into(),
            machine: "press".into(),
            version: "1".into(),
            refresh: Duration::from_secs(60),
            takes_measured: false,
            home_assistant,
        });
        Readable(json, Memory::of_topics(directory))
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        let mut messages = self.0.connected(now, snapshot);
        self.1.connects(now, &mut messages);
        messages
    }
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
    let of = |home_assistant| Readable::of(home_assistant, home.path());
    assert_eq!(clears(&of(true).connected(at(1), &snapshot("bed"))), [""; 0]);
    let gone = ["g/press/signal/bed", "homeassistant/sensor/isotherm-press/signal_bed_value/config"];
    // If the program is killed before delivery, the next run clears them again.
    for begun in [10, 20] {
        let mut second = of(false);
        assert_eq!(clears(&second.connected(at(begun), &snapshot("table"))), gone);
        assert_eq!(clears(&second.connected(at(begun + 1), &snapshot("table"))), gone);
        second.1.publishes(at(begun + 30));
    }
    let mut third = of(false);
    assert_eq!(clears(&third.connected(at(100), &snapshot("table"))), gone);
    third.1.publishes(at(161));
    assert_eq!(clears(&of(false).connected(at(200), &snapshot("table"))), [""; 0]);
    assert_eq!(clears(&of(false).connected(at(201), &snapshot("bed"))), ["g/press/signal/table"]);
}

#[test]
fn a_death_number_outlives_the_program() {
    use isotherm_plant::sparkplug::{Address, Sparkplug};
    let home = tempfile::tempdir().unwrap();
    for begun in [None, Some(0), Some(1)] {
        let (mut memory, last) = Memory::of_deaths(home.path());
        assert_eq!(last, begun);
        let mut node = Sparkplug::new(Address::new("g", "press").unwrap(), last, false);
        node.will();
        memory.wills(&node);
        // The program is killed.
    }
}

/// An orderly stop while the broker is away uses no number up.
#[test]
fn a_death_number_that_was_never_sent_is_used_by_the_next_run() {
    use isotherm_plant::sparkplug::{Address, Sparkplug};
    let home = tempfile::tempdir().unwrap();
    for (is_sent, begun) in [(false, None), (false, None), (true, None), (false, Some(0)), (true, Some(0))] {
        let (mut memory, last) = Memory::of_deaths(home.path());
        assert_eq!(last, begun);
        let mut node = Sparkplug::new(Address::new("g", "press").unwrap(), last, false);
        for _ in 0..3 {
            node.will();
            memory.wills(&node);
        }
        if is_sent {
            node.connect_sent();
        }
        memory.ends(&node);
    }
    assert_eq!(Memory::of_deaths(home.path()).1, Some(1));
}
