//! Values that could not be published are published later.

use proptest::prelude::*;

use super::*;

/// Times and values of the temperature in records, in their order.
fn beds(records: &[Record]) -> Vec<(u64, Option<Raw>)> {
    let mut found = Vec::new();
    for record in records {
        for metric in Payload::decode(record.0.as_slice()).unwrap().metrics {
            if metric.name.as_deref() == Some("signal/bed/value") {
                found.push((metric.timestamp.unwrap() - ms(0).unwrap(), metric.value));
            }
        }
    }
    found
}

#[test]
fn a_gap_comes_as_historical_after_the_birth_with_the_times_of_its_values() {
    let (mut node, _) = connected(at(0), &snapshot(Some(0.0), true, at(0)));
    node.publish(at(10_000), &snapshot(Some(1.0), true, at(10_000)));
    // Published, but the broker did not answer after it.
    node.publish(at(20_000), &snapshot(Some(2.0), true, at(20_000)));
    let mut records = node.disconnected(at(15_000));
    for second in [30u32, 40] {
        let mut state = snapshot(Some(f64::from(second) / 10.0), true, at(u64::from(second) * 1000));
        state.events = vec![happening("meanwhile", at(u64::from(second) * 1000))];
        records.extend(node.absent(at(u64::from(second) * 1000), &state));
    }
    // Nothing has changed.
    records.extend(node.absent(at(45_000), &snapshot(Some(4.0), true, at(45_000))));
    node.will();
    let birth = node.connected(at(50_000), &snapshot(Some(5.0), true, at(50_000)));
    let birth = read(&birth[0]).1;
    let messages = node.forward(at(51_000), &records);
    for message in &messages {
        let payload = read(message).1;
        assert_eq!(payload.timestamp, ms(51_000));
        assert!(payload.metrics.iter().all(|metric| metric.is_historical == Some(true)));
    }
    let (bed, event) = (alias(&birth, "signal/bed/value"), alias(&birth, "gateway/event"));
    let text = Some(Raw::String("meanwhile".to_owned()));
    let expected = [
        (1, bed, 20_000, Some(Raw::Double(2.0))),
        (1, bed, 30_000, Some(Raw::Double(3.0))),
        (1, event, 30_000, text.clone()),
        (1, bed, 40_000, Some(Raw::Double(4.0))),
        (1, event, 40_000, text),
    ];
    assert_eq!(rows(&messages), expected);
    // The next messages contain current values again, in the same sequence.
    let next = node.publish(at(52_000), &snapshot(Some(6.0), true, at(52_000)));
    assert_eq!(rows(&next), [(2, bed, 52_000, Some(Raw::Double(6.0)))]);
    assert_eq!(read(&next[0]).1.metrics[0].is_historical, None);
}

#[test]
fn a_birth_that_may_not_have_arrived_leaves_its_values_behind() {
    let mut node = node();
    node.will();
    node.connected(at(10_000), &snapshot(Some(1.0), true, at(9_000)));
    assert_eq!(beds(&node.disconnected(at(9_500))), [(9_000, Some(Raw::Double(1.0)))]);
    node.will();
    node.connected(at(20_000), &snapshot(Some(1.0), true, at(19_000)));
    assert_eq!(beds(&node.disconnected(at(19_500))), [], "it had not changed");
}

#[test]
fn before_the_first_connection_everything_is_kept() {
    let mut node = node();
    node.will();
    let records = node.absent(at(10), &snapshot(Some(1.0), true, at(5)));
    assert_eq!(beds(&records), [(5, Some(Raw::Double(1.0)))]);
    assert_eq!((node.may_forward(), node.forward(at(20), &records)), (false, vec![]), "nobody is there");
}

#[test]
fn what_the_birth_does_not_promise_any_more_is_left_out_and_counted() {
    let mut before = node();
    let mut state = snapshot(Some(1.0), true, at(5));
    state.metrics[1].kind = Value::Text(String::new());
    state.metrics[1].value = Some(Value::Text("armed".to_owned()));
    state
        .metrics
        .push(interface::Metric { subject: Subject::Bus("gone".to_owned()), ..state.metrics[0].clone() });
    let records = before.absent(at(10), &state);
    let (mut node, _) = connected(at(20), &snapshot(Some(2.0), true, at(15)));
    let spoiled = Record(vec![0xff; 9]);
    let messages = node.forward(at(30), &[spoiled, records[0].clone()]);
    assert_eq!(rows(&messages), [(1, 1, 5, Some(Raw::Double(1.0)))]);
    let expected = LostValues { unreadable_records: 1, unknown_values: 2, ..LostValues::default() };
    assert_eq!(node.left_out(), expected);
}

#[test]
fn what_happened_while_a_birth_was_owed_is_kept_when_the_connection_breaks() {
    let state = snapshot(Some(1.0), true, at(0));
    let (mut node, _) = connected(at(0), &state);
    let reaction = node.received(at(10), &state, "spBv1.0/shop/NCMD/grinder-3", &commands::rebirth());
    assert_eq!(reaction, Reaction::default(), "it waits");
    assert!(!node.may_forward());
    let events = vec![happening("almost lost", at(15))];
    assert_eq!(node.publish(at(20), &Snapshot { events, ..state }), []);
    let records = node.disconnected(at(20));
    let last = Payload::decode(records.last().unwrap().0.as_slice()).unwrap();
    assert_eq!(find(&last, "gateway/event").value, Some(Raw::String("almost lost".to_owned())));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Connections break at any time, and everything is lost that was sent after the last answer of the broker. In the
    /// end, the host has every change with its time.
    #[test]
    fn a_historian_has_every_change_in_the_end(
        steps in proptest::collection::vec((0u8..10, 0u64..8), 1..80),
    ) {
        let mut node = node();
        let (mut is_connected, mut sent, mut history) = (false, Vec::new(), Vec::new());
        // Records on disk, and records that were published but may be undelivered.
        let (mut kept, mut published): (Vec<Record>, Vec<(u64, Vec<Record>)>) = (Vec::new(), Vec::new());
        let mut changes = Vec::new();
        for (second, (what, back)) in (1u64..).zip(steps.into_iter().chain([(0, 0), (9, 0)])) {
            let now = at(second * 1000);
            let state = snapshot(Some(f64::from(u32::try_from(second).unwrap())), true, now);
            changes.push(second * 1000);
            match (is_connected, what) {
                (true, 0..3) => {
                    let heard = second.saturating_sub(back);
                    let lost = published.drain(..).filter(|(at, _)| *at > heard).flat_map(|(_, records)| records);
                    kept = lost.chain(kept).collect();
                    kept.extend(node.disconnected(at(heard * 1000)));
                    kept.extend(node.absent(now, &state));
                    history.extend(sent.drain(..).filter(|(at, _)| *at <= heard).flat_map(|(_, times)| times));
                    is_connected = false;
                }
                (true, _) => {
                    let mut messages = node.publish(now, &state);
                    messages.extend(node.forward(now, &kept));
                    published.push((second, std::mem::take(&mut kept)));
                    sent.push((second, times(&messages)));
                }
                (false, 0..6) => kept.extend(node.absent(now, &state)),
                (false, _) => {
                    node.will();
                    sent.push((second, times(&node.connected(now, &state))));
                    is_connected = true;
                }
            }
        }
        history.extend(sent.into_iter().flat_map(|(_, times)| times));
        history.extend(beds(&kept).into_iter().map(|(time, _)| time));
        history.sort_unstable();
        history.dedup();
        prop_assert_eq!(history, changes);
    }
}

/// Times of the temperatures that a host receives.
fn times(messages: &[Message]) -> Vec<u64> {
    let payloads = messages.iter().map(|message| read(message).1);
    let metrics = payloads.flat_map(|payload| payload.metrics).filter(|metric| metric.alias == Some(1));
    metrics.map(|metric| metric.timestamp.unwrap() - ms(0).unwrap()).collect()
}
