//! Tests with sparkplug-payload, the library of Sparkplug hosts in JavaScript, for example of Node-RED.

use super::*;

/// Starts the process of sparkplug-payload.
fn sparkplug_payload() -> Host {
    let modules = tools().join("node/node_modules");
    let library = modules.join("sparkplug-payload");
    let lacks = "sparkplug-payload is not installed: `tests/run interop` does it";
    assert!(library.exists(), "{}: {lacks}", library.display());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/payload.cjs");
    Host::of("sparkplug-payload", Command::new("node").arg(script).arg(modules))
}

fn state(second: u64, bed: Option<f64>) -> Snapshot {
    let mut state = snapshot(second, bed);
    // Numbers of JavaScript have 53 bits.
    state.metrics[3].value = Some(Value::Count(1 << 40));
    state
}

#[test]
fn a_library_of_hosts_reads_will_birth_data_history_and_death() {
    let (mut host, mut node) = (sparkplug_payload(), node());
    let will = host.reads(&node.will());
    node.connect_sent();
    assert_eq!((&will["kind"], &find(&will, "bdSeq")["value"]), (&json!("NDEATH"), &json!(255)));
    assert_eq!((&find(&will, "bdSeq")["type"], &will["seq"]), (&json!("Int64"), &Json::Null));

    let birth = host.reads(&node.connected(at(1), &state(1, Some(21.5)))[0]);
    assert_eq!(
        (&birth["kind"], &birth["seq"], &birth["timestamp"]),
        (&json!("NBIRTH"), &json!(0), &json!(ms(1)))
    );
    for (name, kind, value) in [
        ("bdSeq", "Int64", json!(255)),
        ("Node Control/Rebirth", "Boolean", json!(false)),
        ("signal/bed/value", "Double", json!(21.5)),
        ("axis/z/state", "String", json!("active")),
        ("axis/z/armed", "Boolean", json!(true)),
        ("gateway/events", "UInt64", json!(1_u64 << 40)),
        ("gateway/event", "String", Json::Null),
        ("axis/z/measured_error_um", "Double", Json::Null),
    ] {
        let metric = find(&birth, name);
        assert_eq!((&metric["type"], &metric["value"]), (&json!(kind), &value), "{name}");
        assert_eq!(metric["timestamp"], json!(ms(1)), "{name}");
    }
    assert_eq!(find(&birth, "signal/bed/value")["properties"], json!({ "engUnit": ["String", "°C"] }));

    let bad = host.reads(&node.publish(at(2), &state(2, None))[0]);
    let bed = find(&bad, "signal/bed/value");
    assert_eq!((&bad["kind"], &bad["seq"], &bed["value"]), (&json!("NDATA"), &json!(1), &Json::Null));
    assert_eq!(bed["properties"], json!({ "Quality": ["Int32", 0] }));
    let good = host.reads(&node.publish(at(3), &state(3, Some(22.25)))[0]);
    let bed = find(&good, "signal/bed/value");
    assert_eq!((&bed["value"], &bed["historical"]), (&json!(22.25), &json!(false)));
    assert_eq!(bed["properties"], json!({ "Quality": ["Int32", 192] }));

    let death = host.reads(&node.farewell(at(4))[0]);
    assert_eq!((&death["kind"], &find(&death, "bdSeq")["value"]), (&json!("NDEATH"), &json!(255)));
    let kept = node.disconnected(at(3));
    host.reads(&node.will());
    node.connect_sent();
    let birth = host.reads(&node.connected(at(5), &state(5, Some(23.0)))[0]);
    assert_eq!(find(&birth, "bdSeq")["value"], json!(0), "0 follows 255");
    let late = host.reads(&node.forward(at(6), &kept)[0]);
    let bed = find(&late, "signal/bed/value");
    assert_eq!((&bed["value"], &bed["historical"]), (&json!(22.25), &json!(true)));
    assert_eq!(bed["timestamp"], json!(ms(3)));
}

#[test]
fn what_a_library_of_hosts_asks_for_is_taken() {
    let (mut host, mut node) = (sparkplug_payload(), node());
    node.will();
    let now = state(0, Some(0.0));
    host.reads(&node.connected(at(0), &now)[0]);
    let rebirth =
        json!({ "command": "Node Control/Rebirth", "value": true, "type": "Boolean", "sent": ms(2) });
    let (topic, payload) = host.asks(&rebirth);
    assert_eq!(topic, node.subscriptions()[0].filter);
    let reaction = node.received(at(2), &now, &topic, &payload);
    assert_eq!(reaction.outcome, None);
    let birth = host.reads(&reaction.messages[0]);
    assert_eq!((&birth["kind"], &birth["seq"]), (&json!("NBIRTH"), &json!(0)));
    let name = "axis/z/measured_error_um";
    let (topic, payload) =
        host.asks(&json!({ "command": name, "value": -3.5, "type": "Double", "sent": ms(3) }));
    let reaction = node.received(at(3), &now, &topic, &payload);
    let report = (-3.5).into();
    assert_eq!(reaction.outcome, Some(Outcome::Asked(Asked::Measured { axis: "z".to_owned(), report })));
    let (topic, payload) =
        host.asks(&json!({ "command": "axis/z/armed", "value": false, "type": "Boolean", "sent": ms(4) }));
    let reaction = node.received(at(4), &now, &topic, &payload);
    assert!(matches!(reaction.outcome, Some(Outcome::Refused { .. })), "{:?}", reaction.outcome);
}
