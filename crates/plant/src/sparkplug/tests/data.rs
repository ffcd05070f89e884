//! Tests of the data messages that follow a birth.

use proptest::prelude::*;

use super::*;

#[test]
fn only_what_has_changed_by_its_resolution_is_told_under_its_alias() {
    let (mut node, birth) = connected(at(0), &snapshot(Some(21.5), true, at(0)));
    let (bed, armed) = (alias(&birth, "signal/bed/value"), alias(&birth, "axis/z/is_armed"));
    let mut published = Vec::new();
    let states = [(21.5, true), (21.505, true), (21.51, true), (21.51, false), (21.53, true)];
    for (time, (value, is_armed)) in (100..).step_by(100).zip(states) {
        published.extend(rows(&node.publish(at(time), &snapshot(Some(value), is_armed, at(time - 1)))));
    }
    let expected = [
        (1, bed, 299, Some(Raw::Double(21.51))),
        (2, armed, 399, Some(Raw::Boolean(false))),
        (3, bed, 499, Some(Raw::Double(21.53))),
        (3, armed, 499, Some(Raw::Boolean(true))),
    ];
    assert_eq!(published, expected);
    assert_eq!(node.left_out(), LostValues::default());
}

#[test]
fn what_is_no_longer_known_is_null_and_bad_and_good_is_said_when_it_is_back() {
    let (mut node, _) = connected(at(0), &snapshot(Some(21.5), true, at(0)));
    let mut found = Vec::new();
    for (time, bed) in [(10, None), (20, None), (30, Some(21.5)), (40, Some(22.0))] {
        for message in node.publish(at(time), &snapshot(bed, true, at(time))) {
            for metric in read(&message).1.metrics {
                let quality = metric.properties.map(|properties| properties.values[0].value.clone());
                found.push((time, metric.is_null, metric.value, quality.flatten()));
            }
        }
    }
    let (bad, good) = (Some(PropertyRaw::Int(0)), Some(PropertyRaw::Int(192)));
    let expected = [
        (10, Some(true), None, bad),
        (30, None, Some(Raw::Double(21.5)), good),
        (40, None, Some(Raw::Double(22.0)), None),
    ];
    assert_eq!(found, expected);
}

#[test]
fn what_an_axis_has_not_is_null_and_says_nothing_of_quality() {
    let with = |correction: Option<f64>, time| {
        let mut state = snapshot(Some(1.0), true, at(time));
        let (subject, value) = (Subject::Axis("z".to_owned()), correction.map(Value::Real));
        state.metrics.push(interface::Metric {
            subject,
            name: "correction_um",
            value,
            ..state.metrics[0].clone()
        });
        state
    };
    let (mut node, birth) = connected(at(0), &with(None, 0));
    let correction = find(&birth, "axis/z/correction_um");
    let unit = correction.properties.clone().unwrap();
    assert_eq!((correction.is_null, unit.keys), (Some(true), vec!["engUnit".to_owned()]));
    let messages = node.publish(at(10), &with(Some(2.0), 10));
    let metric = read(&messages[0]).1.metrics.remove(0);
    assert_eq!((metric.value, metric.properties), (Some(Raw::Double(2.0)), None));
}

#[test]
fn what_is_no_number_is_not_told_as_one() {
    let (mut node, _) = connected(at(0), &snapshot(Some(21.5), true, at(0)));
    for value in [f64::NAN, f64::INFINITY] {
        let messages = node.publish(at(10), &snapshot(Some(value), true, at(10)));
        let metric = read(&messages[0]).1.metrics.remove(0);
        assert_eq!((metric.is_null, metric.value), (Some(true), None));
    }
}

#[test]
fn events_are_told_in_the_order_of_time_among_the_values_with_kind_and_importance() {
    let (mut node, birth) = connected(at(0), &snapshot(Some(21.5), true, at(0)));
    let mut state = snapshot(Some(22.0), true, at(50));
    // Two events in one millisecond, because hosts store one value for each time.
    state.events = vec![happening("one", at(40)), happening("two", at(40)), happening("three", at(60))];
    let messages = node.publish(at(100), &state);
    let (event, bed) = (alias(&birth, "gateway/event"), alias(&birth, "signal/bed/value"));
    let text = |text: &str| Some(Raw::String(text.to_owned()));
    let expected = [
        (1, event, 40, text("one")),
        (1, event, 41, text("two")),
        (1, bed, 50, Some(Raw::Double(22.0))),
        (1, event, 60, text("three")),
    ];
    assert_eq!(rows(&messages), expected);
    let metric = read(&messages[0]).1.metrics.remove(0);
    let properties = metric.properties.unwrap();
    assert_eq!(properties.keys, ["kind", "importance"]);
    let values: Vec<_> = properties.values.into_iter().map(|value| value.value.unwrap()).collect();
    assert_eq!(values, ["axis-state", "warning"].map(|word| PropertyRaw::String(word.to_owned())));
    assert_eq!(node.publish(at(200), &snapshot(Some(22.0), true, at(50))), []);
}

#[test]
fn much_at_once_becomes_several_messages_of_one_sequence() {
    let many = |value: u64| {
        let metric = |number: usize| interface::Metric {
            subject: Subject::Signal(format!("signal-{number}")),
            name: "value",
            value: Some(Value::Count(value)),
            kind: Value::Count(0),
            unit: "",
            resolution: 0.0,
            at: at(value),
        };
        Snapshot { metrics: (0..5000).map(metric).collect(), ..Snapshot::default() }
    };
    let (mut node, birth) = connected(at(0), &many(0));
    assert_eq!(birth.metrics.len(), 5000 + 4 - 1);
    let messages = node.publish(at(1), &many(1_000_000));
    assert!(messages.len() > 1 && messages.iter().all(|message| message.payload.len() < 33_000));
    let rows = rows(&messages);
    assert_eq!(rows.len(), 5000);
    assert_eq!(rows.last().unwrap().0, u64::try_from(messages.len()).unwrap());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    /// A host that receives the birth and each later message finds no gap, and stores the current state.
    #[test]
    fn a_host_that_missed_nothing_knows_the_state(
        states in proptest::collection::vec((proptest::option::of(-50i32..50), any::<bool>(), 0u8..12), 1..600),
    ) {
        let first = snapshot(Some(0.0), false, at(0));
        let (mut node, birth) = connected(at(0), &first);
        let (bed, armed) = (alias(&birth, "signal/bed/value"), alias(&birth, "axis/z/is_armed"));
        let (mut seq, mut known) = (0u8, (Some(Raw::Double(0.0)), Some(Raw::Boolean(false))));
        for (time, (value, is_armed, what)) in (1000u64..).step_by(1000).zip(states) {
            let state = snapshot(value.map(f64::from), is_armed, at(time));
            let messages = match what {
                0 => node.received(at(time), &state, "spBv1.0/shop/NCMD/grinder-3", &commands::rebirth()).messages,
                _ => node.publish(at(time), &state),
            };
            for message in &messages {
                let (verb, payload) = read(message);
                seq = if verb == "NBIRTH" { 0 } else { seq.wrapping_add(1) };
                prop_assert_eq!(payload.seq, Some(seq.into()));
                for metric in payload.metrics {
                    match metric.alias {
                        Some(alias) if alias == bed => known.0 = metric.value,
                        Some(alias) if alias == armed => known.1 = metric.value,
                        _ => {}
                    }
                }
            }
            let now = (value.map(|value| Raw::Double(value.into())), Some(Raw::Boolean(is_armed)));
            prop_assert_eq!(&known, &now);
        }
    }
}
