//! Nodes that are browsed, read, subscribed to, written and called.

use std::time::Duration;

use serde_json::{Value, json};

use super::process::until;
use super::rig::{Behaviour, Machine, SIGNALS};

#[test]
fn axes_signals_outputs_alarms_and_events_are_browsed_and_read_with_unit_quality_and_time() {
    let machine = Machine::open();
    let nodes = machine.asks(&["browse"]);
    for (id, name) in [
        ("machine", "press"),
        ("Identification", "Identification"),
        ("gateway", "Gateway"),
        ("gateway.Identification", "Identification"),
        ("axis.z", "z"),
        ("axis.z.cz_um", "cz_um"),
        ("axis.z.probe.correction_um", "correction_um"),
        ("signal.bed7.value", "value"),
        ("output.cnc_z.state", "state"),
        ("device.cnc.state", "state"),
        ("alarms.text", "text"),
        ("events.text", "text"),
    ] {
        assert_eq!(nodes[id], name, "{id}");
    }
    let read = machine.asks(&[
        "read",
        "axis.z.verified_um",
        "axis.z.state",
        "signal.bed0.value",
        "signal.bed0.quality",
        "output.cnc_z.value",
        "axis.z.warn_um",
        "axis.z.armed",
        "gateway.SoftwareRevision",
        "events.text",
    ]);
    for (id, value, status, unit) in [
        ("axis.z.verified_um", json!(10.0), "Good", json!("µm")),
        ("axis.z.state", json!("active"), "Good", Value::Null),
        ("signal.bed0.value", json!(10.0), "Good", json!("°C")),
        ("signal.bed0.quality", json!("good"), "Good", Value::Null),
        ("output.cnc_z.value", json!(10.0), "Good", json!("µm")),
        ("axis.z.warn_um", Value::Null, "GoodNoData", json!("µm")),
        ("axis.z.armed", json!(true), "Good", Value::Null),
        ("gateway.SoftwareRevision", json!(env!("CARGO_PKG_VERSION")), "Good", Value::Null),
    ] {
        let found = &read[id];
        assert_eq!((&found["value"], &found["unit"]), (&value, &unit), "{id}: {found}");
        assert_eq!(found["status"], status, "{id}");
        assert!(found["times"][0].as_str().is_some_and(|time| time.starts_with("20")), "{id}: {found}");
    }
    let events = read["events.text"]["value"].as_array().unwrap();
    assert!(
        events.iter().any(|text| text.as_str().is_some_and(|text| text.contains("axis z"))),
        "{events:?}"
    );
}

#[test]
fn a_signal_without_a_value_is_bad_with_its_reason_and_an_alarm_and_an_event_say_so() {
    let machine = Machine::open();
    let mut listener = machine.watched_by(&["events", "20"]);
    machine.device(Behaviour::Refuses);
    until("the signal is bad", || {
        let read = machine.asks(&["read", "signal.bed3.value", "signal.bed3.quality", "alarms.count"]);
        let status = read["signal.bed3.value"]["status"].as_str().unwrap_or_default().to_owned();
        let alarms = read["alarms.count"]["value"].as_u64().unwrap_or_default();
        let is_bad = status.starts_with("Bad") && read["signal.bed3.value"]["value"].is_null();
        if is_bad && alarms > 0 { Ok(()) } else { Err(read.to_string()) }
    });
    let said = listener.receives("signal bed");
    let events: Vec<(String, u64, String)> = serde_json::from_str(&said).unwrap();
    // All signals become bad at once, and the queue of the client holds the newest events.
    let found = events.iter().find(|(text, ..)| text.contains("signal bed"));
    let (_, severity, source) = found.unwrap_or_else(|| panic!("{said}"));
    assert!(*severity >= 500 && source == "press", "{said}");
}

#[test]
fn a_register_that_can_no_longer_be_read_keeps_its_value_with_an_uncertain_status() {
    let machine = Machine::open();
    let ids = ["output.cnc_z.value", "axis.z.verified_um"];
    let have = |status: &str| {
        until(status, || {
            let read = machine.asks(&[&["read"][..], &ids].concat());
            let has = |id: &&str| read[*id]["status"] == status && read[*id]["value"] == 10.0;
            if ids.iter().all(has) { Ok(()) } else { Err(read.to_string()) }
        });
    };
    have("Good");
    machine.device(Behaviour::IsGone);
    have("UncertainNoCommunicationLastUsableValue");
    machine.device(Behaviour::Answers);
    have("Good");
}

#[test]
fn a_subscription_without_a_filter_gets_a_status_that_changes_although_the_value_does_not() {
    let machine = Machine::open();
    let ids = ["output.cnc_z.value", "axis.z.verified_um"];
    let mut watchers = ids.map(|id| machine.watched_by(&["changes", "60", id]));
    for (behaviour, status) in
        [(Behaviour::IsGone, "\"UncertainNoCommunicationLastUsableValue\""), (Behaviour::Answers, "\"Good\"")]
    {
        machine.device(behaviour);
        for watcher in &mut watchers {
            let said = watcher.receives(status);
            let change: Value = serde_json::from_str(&said).unwrap();
            let value = change[2].as_f64().unwrap_or_default();
            assert!((value - 10.0).abs() < 1e-12, "{said}");
        }
    }
}

#[test]
fn a_subscription_gets_every_change_and_nothing_that_did_not_change() {
    let machine = Machine::open();
    let mut watcher = machine.watched_by(&["watch-all", "10"]);
    let said = watcher.receives("signal.bed7.value");
    let counts: Value = serde_json::from_str(&said).unwrap();
    let counts = counts.as_object().unwrap();
    assert_eq!(counts.len(), SIGNALS, "{said}");
    // All temperatures but one change ten times a second; the computer may be busy.
    assert_eq!(counts["signal.bed0.value"], 1, "{said}");
    let least = counts.iter().filter(|(name, _)| *name != "signal.bed0.value");
    let least = least.filter_map(|(_, count)| count.as_u64()).min().unwrap();
    assert!(least >= 30, "{least} changes in ten seconds");
}

#[test]
fn identifiers_are_the_same_after_a_restart() {
    let machine = Machine::open();
    let before = machine.asks(&["browse"]);
    let mut machine = machine.dies_and_begins();
    assert_eq!(machine.asks(&["browse"]), before);
    machine.running.signal("TERM");
    assert!(machine.running.ends_within(Duration::from_secs(60)).success());
}

#[test]
fn nothing_can_be_written_and_no_method_is_there_without_a_user_who_may_call_it() {
    let machine = Machine::open();
    for id in ["axis.z.cz_um", "signal.bed0.value", "axis.z.limit_um", "output.cnc_z.value"] {
        let refused = machine.asks(&["write", id, "7"]);
        assert!(
            matches!(refused["error"].as_str(), Some("BadNotWritable" | "BadUserAccessDenied")),
            "{refused}"
        );
    }
    assert_eq!(machine.asks(&["methods"]), json!([]));
    let axis = &machine.status()["axes"]["z"];
    assert_eq!((&axis["armed"], &axis["limit_um"]), (&json!(true), &json!(40.0)));
}
