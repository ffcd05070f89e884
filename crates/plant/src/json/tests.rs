//! Times of publication, and events that may not have been delivered.

use super::*;
use crate::interface::{Command, Importance, Outcome};
use isotherm_core::compensation::MeasuredReport;

fn settings() -> JsonSettings {
    JsonSettings {
        group: "plant".into(),
        machine: "press".into(),
        version: "0.1.0".into(),
        refresh: Duration::from_secs(60),
        takes_measured: false,
        home_assistant: false,
    }
}

fn at(seconds: u64) -> Moment {
    Moment::from_nanos(seconds * 1_000_000_000)
}

fn metric(subject: Subject, name: &'static str, value: Option<Value>, resolution: f64) -> Metric {
    let kind = value.clone().unwrap_or(Value::Real(0.0));
    let unit = if name == "value" { "degC" } else { "" };
    Metric { subject, name, value, kind, unit, resolution, at: at(1) }
}

fn snapshot(bed: Option<f64>, state: &str) -> Snapshot {
    let axis = Subject::Axis("z".into());
    let bed = bed.map(Value::Real);
    Snapshot {
        metrics: vec![
            metric(axis.clone(), "state", Some(Value::Text(state.into())), 0.0),
            metric(axis, "cz_um", Some(Value::Real(-12.4)), 0.05),
            metric(Subject::Signal("bed".into()), "value", bed, 0.05),
        ],
        ..Snapshot::default()
    }
}

fn happening(text: &str) -> PlantEvent {
    PlantEvent {
        at: at(7),
        kind: "zeroed".into(),
        importance: Importance::Info,
        text: text.into(),
        data: "{\"axis\":\"z\"}".into(),
    }
}

fn topics(messages: &[Message]) -> Vec<&str> {
    messages.iter().map(|message| message.topic.as_str()).collect()
}

fn text(message: &Message) -> &str {
    std::str::from_utf8(&message.payload).unwrap()
}

#[test]
fn everything_is_told_at_first_then_what_has_changed_and_after_a_minute_everything_again() {
    let mut json = Json::new(settings());
    let all = ["plant/press/axis/z", "plant/press/signal/bed"];
    let first = json.connected(at(10), &snapshot(Some(27.5), "active"));
    assert_eq!(topics(&first), [all[0], all[1], "plant/press/state"]);
    assert_eq!(text(&first[0]), r#"{"at":"1970-01-01T00:00:01Z","cz_um":-12.4,"state":"active"}"#);
    assert_eq!(text(&first[1]), r#"{"at":"1970-01-01T00:00:01Z","unit":"degC","value":27.5}"#);
    assert_eq!(text(&first[2]), "online");
    assert!(first.iter().all(|message| message.retained));
    assert_eq!(json.publish(at(11), &snapshot(Some(27.54), "active")), [], "less than its resolution");
    assert_eq!(topics(&json.publish(at(12), &snapshot(Some(27.6), "active"))), [all[1]]);
    assert_eq!(topics(&json.publish(at(13), &snapshot(Some(27.6), "holding"))), [all[0]]);
    let unknown = json.publish(at(14), &snapshot(None, "holding"));
    assert_eq!(text(&unknown[0]), r#"{"at":"1970-01-01T00:00:01Z","unit":"degC","value":null}"#);
    let state = "plant/press/state";
    assert_eq!(topics(&json.publish(at(73), &snapshot(None, "holding"))), [all[0], state]);
    assert_eq!(topics(&json.publish(at(74), &snapshot(None, "holding"))), [all[1]]);
    let anew = json.connected(at(75), &snapshot(None, "holding"));
    assert_eq!(topics(&anew), [all[0], all[1], "plant/press/state"], "whoever comes anew knows nothing");
}

#[test]
fn an_event_is_told_once_and_again_where_it_may_not_have_arrived() {
    let mut json = Json::new(settings());
    json.connected(at(10), &snapshot(None, "active"));
    let with = |text: &str| Snapshot { events: vec![happening(text)], ..snapshot(None, "active") };
    let published = json.publish(at(11), &with("one"));
    assert_eq!(topics(&published), ["plant/press/event"]);
    assert_eq!(
        text(&published[0]),
        r#"{"at":"1970-01-01T00:00:07Z","data":{"axis":"z"},"kind":"zeroed","level":"info","text":"one"}"#
    );
    assert!(published[0].qos == Qos::AtLeastOnce && !published[0].retained);
    json.publish(at(12), &with("two"));
    let mut kept = json.disconnected(at(12));
    kept.extend(json.absent(at(13), &with("three")));
    let again = json.forward(at(20), &kept);
    let words: Vec<&str> = again.iter().filter_map(|message| text(message).rsplit('"').nth(1)).collect();
    assert_eq!(words, ["two", "three"]);
    assert_eq!(json.disconnected(at(19)), kept, "the connection has broken again at once");
    assert_eq!(json.disconnected(at(19)), []);
}

/// Another client, for example a second gateway of this name, may replace the retained `online` by its `offline`.
#[test]
fn a_foreign_offline_is_replaced_after_the_time_of_refresh() {
    let mut json = Json::new(settings());
    let now = |second: u64| Snapshot {
        metrics: vec![metric(Subject::Gateway, "ready", Some(Value::Flag(true)), 0.0)],
        events: vec![happening(&second.to_string())],
        ..Snapshot::default()
    };
    json.connected(at(1000), &now(1000));
    let mut told = Vec::new();
    for second in 1001..1200 {
        let messages = json.publish(at(second), &now(second));
        for message in messages.iter().filter(|message| message.topic == "plant/press/state") {
            assert_eq!((text(message), message.retained, message.qos), ("online", true, Qos::AtLeastOnce));
            told.push(second);
        }
    }
    assert_eq!(told, [1060, 1120, 1180]);
    // A new connection begins with the state, and counts from there.
    assert!(topics(&json.connected(at(1200), &now(1200))).contains(&"plant/press/state"));
    assert!(!topics(&json.publish(at(1240), &now(1240))).contains(&"plant/press/state"));
}

#[test]
fn the_will_and_the_farewell_say_offline_and_are_kept() {
    let mut json = Json::new(settings());
    for message in [json.will(), json.farewell(at(1)).remove(0)] {
        assert_eq!(
            (message.topic.as_str(), text(&message), message.retained),
            ("plant/press/state", "offline", true)
        );
    }
}

#[test]
fn nothing_is_asked_for_unless_the_profile_says_so_and_nothing_moves() {
    let json = Json::new(settings());
    assert_eq!(json.subscriptions(), []);
    let mut taking = Json::new(JsonSettings { takes_measured: true, ..settings() });
    assert_eq!(taking.subscriptions()[0].filter, "plant/press/command/+");
    let mut outcome = |topic: &str, payload: &str| {
        let reaction = taking.received(at(1), &Snapshot::default(), topic, payload.as_bytes());
        reaction.outcome.unwrap()
    };
    let measured = outcome("plant/press/command/measured", r#"{"axis":"z","error_um":-3.5}"#);
    assert_eq!(measured, Outcome::Asked(Command::Measured { axis: "z".into(), report: (-3.5).into() }));
    let named = outcome(
        "plant/press/command/measured",
        r#"{"axis":"z","error_um":1,"time":"2026-01-31T12:00:00Z","id":"a"}"#,
    );
    let report = MeasuredReport::new(1.0, Some("2026-01-31T12:00:00Z"), Some("a")).unwrap();
    assert_eq!(named, Outcome::Asked(Command::Measured { axis: "z".into(), report }));
    let long = format!(r#"{{"axis":"{}","error_um":1}}"#, "z".repeat(2000));
    for (topic, payload, why) in [
        ("plant/press/command/arm", "{}", "accepts only measured errors"),
        ("plant/press/command/disarm", "z", "accepts only measured errors"),
        ("elsewhere", "", "accepts only measured errors"),
        ("plant/press/command/measured", "3.5", "send {"),
        ("plant/press/command/measured", r#"{"axis":"z","error_um":"3"}"#, "send {"),
        ("plant/press/command/measured", r#"{"axis":"z","error_um":3,"arm":true}"#, "send {"),
        ("plant/press/command/measured", r#"{"axis":"z","error_um":3,"id":""}"#, "write `id` as"),
        ("plant/press/command/measured", r#"{"axis":"z","error_um":3,"time":"noon"}"#, "write `time` as"),
        ("plant/press/command/measured", &long, "are too many for a measured error"),
    ] {
        let Outcome::Refused { why: said, .. } = outcome(topic, payload) else { panic!("{topic} is taken") };
        assert!(said.contains(why), "{said}");
    }
}

#[test]
fn home_assistant_is_told_where_each_figure_stands() {
    let mut json = Json::new(JsonSettings { home_assistant: true, ..settings() });
    let messages = json.connected(at(1), &snapshot(Some(27.5), "active"));
    let config = messages.iter().find(|message| message.topic.ends_with("/signal_bed_value/config")).unwrap();
    assert_eq!(config.topic, "homeassistant/sensor/isotherm-press/signal_bed_value/config");
    let config: Document = serde_json::from_slice(&config.payload).unwrap();
    assert_eq!(config["state_topic"], "plant/press/signal/bed");
    assert_eq!(config["value_template"], "{{ value_json.value }}");
    assert_eq!(
        (&config["unit_of_measurement"], &config["device_class"]),
        (&json!("°C"), &json!("temperature"))
    );
    assert_eq!(config["availability_topic"], "plant/press/state");
    assert_eq!(messages.iter().filter(|message| message.topic.starts_with("homeassistant/")).count(), 3);
}
