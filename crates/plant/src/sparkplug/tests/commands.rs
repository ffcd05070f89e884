//! Commands of hosts, and their results.

use super::*;
use isotherm_core::compensation::MeasuredReport;

const NCMD: &str = "spBv1.0/shop/NCMD/grinder-3";

pub(super) fn rebirth() -> Vec<u8> {
    command(&[named("Node Control/Rebirth", Raw::Boolean(true))], ms(0))
}

fn command(metrics: &[Metric], sent: Option<u64>) -> Vec<u8> {
    Payload { timestamp: sent, metrics: metrics.to_vec(), seq: None }.bytes()
}

fn named(name: &str, value: Raw) -> Metric {
    Metric { name: Some(name.to_owned()), value: Some(value), ..Metric::default() }
}

/// Number of messages and outcome of a command, directly after the birth of a node.
fn outcome_of(payload: &[u8], takes_measured: bool) -> (usize, Option<Outcome>) {
    let mut node = Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), None, takes_measured);
    node.will();
    let state = snapshot(Some(21.5), true, at(0));
    node.connected(at(0), &state);
    let reaction = node.received(at(5_000), &state, NCMD, payload);
    (reaction.messages.len(), reaction.outcome)
}

fn measured(error_um: f64) -> Option<Outcome> {
    Some(Outcome::Asked(Command::Measured { axis: "z".to_owned(), report: error_um.into() }))
}

#[test]
fn a_birth_is_told_to_whoever_asks_for_it_with_the_same_number_and_from_0_on() {
    let (mut node, first) = connected(at(0), &snapshot(Some(21.5), true, at(0)));
    node.publish(at(1_000), &snapshot(Some(22.0), true, at(1_000)));
    let now = snapshot(Some(23.0), true, at(2_000));
    let reaction = node.received(at(2_000), &now, NCMD, &rebirth());
    assert_eq!((reaction.outcome, reaction.messages.len()), (None, 1));
    let (verb, birth) = read(&reaction.messages[0]);
    assert_eq!((verb, birth.seq), ("NBIRTH", Some(0)));
    assert_eq!(find(&birth, "bdSeq").value, find(&first, "bdSeq").value);
    assert_eq!(find(&birth, "signal/bed/value").value, Some(Raw::Double(23.0)));
    // The birth contains this value, so that it is no change.
    assert_eq!(node.publish(at(3_000), &now), []);
    assert_eq!(rows(&node.publish(at(4_000), &snapshot(Some(24.0), true, at(4_000))))[0].0, 1);
}

#[test]
fn births_that_are_asked_for_too_often_are_told_once_a_second_and_no_data_before_them() {
    let (mut node, _) = connected(at(0), &snapshot(Some(0.0), true, at(0)));
    let (mut births, mut values) = (0, Vec::new());
    for time in (10..=3_000).step_by(10) {
        let mut state = snapshot(Some(f64::from(u32::try_from(time).unwrap())), true, at(time));
        let reaction = node.received(at(time), &state, NCMD, &rebirth());
        assert_eq!(reaction.outcome, None);
        state.events = vec![happening("once", at(time))];
        for message in reaction.messages.into_iter().chain(node.publish(at(time), &state)) {
            let (verb, payload) = read(&message);
            births += usize::from(verb == "NBIRTH");
            values.extend(payload.metrics.into_iter().filter(|metric| metric.name.is_none()));
        }
    }
    assert_eq!(births, 3);
    let texts = values.iter().filter(|metric| matches!(metric.value, Some(Raw::String(_)))).count();
    assert_eq!(texts, values.len(), "between births stand events only");
    assert_eq!(texts, 300, "no event is lost");
    assert_eq!(node.left_out(), LostValues::default());
}

#[test]
fn a_clock_that_is_set_back_does_not_keep_a_birth() {
    let (mut node, _) = connected(at(9_000_000), &snapshot(Some(0.0), true, at(0)));
    let state = snapshot(Some(0.0), true, at(0));
    assert_eq!(node.received(at(10), &state, NCMD, &rebirth()).messages.len(), 1);
}

#[test]
fn the_measured_error_of_an_axis_is_taken_where_the_profile_takes_it() {
    let by_name = named("axis/z/measured_error_um", Raw::Double(3.2));
    // With the alias that the birth has assigned.
    let by_alias = Metric { alias: Some(4), value: Some(Raw::Double(-1.5)), ..Metric::default() };
    let single = Metric { datatype: Some(9), ..named("axis/z/measured_error_um", Raw::Float(0.5)) };
    let table = [(by_name, 3.2), (by_alias, -1.5), (single, 0.5)];
    for (metric, error_um) in table {
        assert_eq!(outcome_of(&command(&[metric], ms(4_000)), true), (0, measured(error_um)));
    }
    let both = [
        named("Node Control/Rebirth", Raw::Boolean(true)),
        named("axis/z/measured_error_um", Raw::Double(2.0)),
    ];
    assert_eq!(outcome_of(&command(&both, ms(0)), true), (1, measured(2.0)));
}

#[test]
fn a_measured_error_is_of_now_by_a_clock_that_was_set() {
    let hour = 3_600_000;
    let shift = Shift::from_nanos(i64::try_from(hour * 1_000_000).unwrap());
    let state = Snapshot { shift, ..snapshot(Some(21.5), true, at(0)) };
    let (mut node, birth) = connected(at(0), &state);
    assert_eq!((birth.timestamp, find(&birth, "bdSeq").timestamp), (ms(hour), ms(hour)));
    let mut receive = |sent| {
        let payload = command(&[named("axis/z/measured_error_um", Raw::Double(3.2))], ms(sent));
        node.received(at(5_000), &state, NCMD, &payload).outcome
    };
    assert_eq!(receive(hour + 4_000), measured(3.2));
    let Some(Outcome::Refused { why, .. }) = receive(4_000) else { panic!("it was sent an hour ago") };
    assert!(why.contains("the message was sent 3601 s ago"), "{why}");
}

#[test]
fn a_measured_error_that_a_broker_brings_twice_is_taken_once() {
    let state = snapshot(Some(21.5), true, at(0));
    let (mut node, _) = connected(at(0), &state);
    let mut receive = |error_um, sent| {
        let payload = command(&[named("axis/z/measured_error_um", Raw::Double(error_um))], ms(sent));
        node.received(at(5_000), &state, NCMD, &payload).outcome
    };
    assert_eq!(receive(3.2, 10), measured(3.2));
    let why = "the message is a duplicate: the gateway accepted the first copy".to_owned();
    let refused = Outcome::Refused { command: "axis/z/measured_error_um".to_owned(), why };
    assert_eq!(receive(3.2, 10), Some(refused));
    assert_eq!(receive(3.2, 20), measured(3.2));
    assert_eq!(receive(3.3, 20), measured(3.3));
}

fn with(metric: Metric, properties: &[(&str, PropertyRaw)]) -> Metric {
    let one = |(key, value): &(&str, PropertyRaw)| {
        ((*key).to_owned(), Property { value: Some(value.clone()), ..Property::default() })
    };
    let (keys, values) = properties.iter().map(one).unzip();
    Metric { properties: Some(PropertySet { keys, values }), ..metric }
}

#[test]
fn the_properties_time_and_id_say_which_measurement_it_is() {
    let error = || named("axis/z/measured_error_um", Raw::Double(1.5));
    let text = |text: &str| PropertyRaw::String(text.to_owned());
    let (zoned, utc) = ("1970-01-01T01:00:04+01:00", "1970-01-01T00:00:04Z");
    let table = [
        (vec![("time", text(zoned)), ("id", text("a"))], Ok((Some(utc), Some("a")))),
        (vec![("time", PropertyRaw::Long(4_000))], Ok((Some(utc), None))),
        (vec![("id", text("a")), ("unit", text("mm"))], Ok((None, Some("a")))),
        (vec![("id", text(""))], Err("write `id` as")),
        (vec![("id", PropertyRaw::Int(17))], Err("write `id` as")),
        (vec![("time", text("noon"))], Err("write `time` as")),
        (vec![("time", PropertyRaw::Double(4.0))], Err("write `time` as")),
    ];
    for (properties, expected) in table {
        let payload = command(&[with(error(), &properties)], ms(4_000));
        match (outcome_of(&payload, true).1, expected) {
            (Some(Outcome::Asked(Command::Measured { report, .. })), Ok((time, id))) => {
                assert_eq!(report, MeasuredReport::new(1.5, time, id).unwrap(), "{properties:?}");
            }
            (Some(Outcome::Refused { why, .. }), Err(begins)) => assert!(why.starts_with(begins), "{why}"),
            (outcome, _) => panic!("{properties:?}: {outcome:?}"),
        }
    }
    let null = Metric {
        properties: Some(PropertySet {
            keys: vec!["id".to_owned(), "time".to_owned()],
            values: vec![Property { is_null: Some(true), ..Property::default() }],
        }),
        ..error()
    };
    assert_eq!(outcome_of(&command(&[null], ms(4_000)), true).1, measured(1.5));
}

#[test]
fn a_measured_error_with_an_id_that_comes_twice_is_left_to_the_gateway() {
    let state = snapshot(Some(21.5), true, at(0));
    let (mut node, _) = connected(at(0), &state);
    let id = [("id", PropertyRaw::String("a".to_owned()))];
    let payload = command(&[with(named("axis/z/measured_error_um", Raw::Double(1.5)), &id)], ms(10));
    // The gateway may not have accepted it the first time.
    for _ in 0..2 {
        let outcome = node.received(at(5_000), &state, NCMD, &payload).outcome;
        assert!(matches!(outcome, Some(Outcome::Asked(_))), "{outcome:?}");
    }
}

#[test]
fn everything_else_is_refused_with_its_reason() {
    let error = |raw| named("axis/z/measured_error_um", raw);
    let null = Metric { is_null: Some(true), ..error(Raw::Double(1.0)) };
    let int = Metric { datatype: Some(3), ..error(Raw::Int(3)) };
    let nothing_else = "the gateway accepts only a measured error or a request for a birth message over \
                        MQTT; no message can arm, disarm or move an axis";
    let no_number = "the value of the metric is not a number (Double or Float, in µm)";
    let waited = "the message was delayed, or a clock is wrong";
    let now = ms(5_000);
    let table: [(Metric, Option<u64>, &str, String); 15] = [
        (named("axis/z/is_armed", Raw::Boolean(true)), now, "axis/z/is_armed", nothing_else.into()),
        (named("Node Control/Reboot", Raw::Boolean(true)), now, "Node Control/Reboot", nothing_else.into()),
        (named("arm", Raw::Boolean(true)), now, "arm", nothing_else.into()),
        (
            Metric { alias: Some(2), value: Some(Raw::Boolean(true)), ..Metric::default() },
            now,
            "axis/z/is_armed",
            nothing_else.into(),
        ),
        (
            Metric { alias: Some(u64::MAX), ..Metric::default() },
            now,
            "alias 18446744073709551615",
            nothing_else.into(),
        ),
        (Metric { alias: Some(0), ..Metric::default() }, now, "alias 0", nothing_else.into()),
        (Metric::default(), now, "a value without a name", nothing_else.into()),
        (named("a\u{1b}[2J\n", Raw::Int(1)), now, "a\\u{1b}[2J\\n", nothing_else.into()),
        (
            named("axis/y/measured_error_um", Raw::Double(1.0)),
            now,
            "axis/y/measured_error_um",
            "the profile has no axis with this name".into(),
        ),
        (error(Raw::Double(f64::NAN)), now, "axis/z/measured_error_um", no_number.into()),
        (null, now, "axis/z/measured_error_um", no_number.into()),
        (int, now, "axis/z/measured_error_um", no_number.into()),
        (error(Raw::Double(1.0)), None, "axis/z/measured_error_um", "the message has no timestamp".into()),
        (
            error(Raw::Double(1.0)),
            Some(ms(0).unwrap() - 3_595_000),
            "axis/z/measured_error_um",
            format!("by the sender's clock, the message was sent 3600 s ago; the limit is 60 s: {waited}"),
        ),
        (
            error(Raw::Double(1.0)),
            ms(66_000),
            "axis/z/measured_error_um",
            format!("by the sender's clock, the message was sent 61 s from now; the limit is 60 s: {waited}"),
        ),
    ];
    for (metric, sent, name, why) in table {
        let refused = Outcome::Refused { command: name.to_owned(), why };
        assert_eq!(outcome_of(&command(&[metric], sent), true), (0, Some(refused)));
    }
}

#[test]
fn a_measured_error_that_the_profile_does_not_take_is_refused_with_the_key_that_would() {
    let (published, outcome) =
        outcome_of(&command(&[named("axis/z/measured_error_um", Raw::Double(1.0))], ms(0)), false);
    let Some(Outcome::Refused { command, why }) = outcome else { panic!("{outcome:?}") };
    assert_eq!((published, command.as_str()), (0, "axis/z/measured_error_um"));
    assert_eq!(why, "the profile does not accept measured errors: write `[mqtt] commands = [\"measured\"]`");
}

#[test]
fn of_several_things_in_one_message_only_the_birth_is_done() {
    let many = [
        named("Node Control/Rebirth", Raw::Boolean(true)),
        named("axis/z/measured_error_um", Raw::Double(1.0)),
        named("axis/z/measured_error_um", Raw::Double(2.0)),
    ];
    let (births, outcome) = outcome_of(&command(&many, ms(0)), true);
    let why = "2 values in one message; send one value in each message".to_owned();
    assert_eq!(
        (births, outcome),
        (1, Some(Outcome::Refused { command: "axis/z/measured_error_um".to_owned(), why }))
    );
    let (births, outcome) =
        outcome_of(&command(&[named("Node Control/Rebirth", Raw::Boolean(false))], ms(0)), true);
    let why = "send `true` to request a birth message".to_owned();
    assert_eq!(
        (births, outcome),
        (0, Some(Outcome::Refused { command: "Node Control/Rebirth".to_owned(), why }))
    );
    assert_eq!(outcome_of(&command(&[], ms(0)), true), (0, None));
}

#[test]
fn what_is_no_command_is_refused_and_another_topic_is_not_ours() {
    let too_long = vec![0; Payload::MOST_BYTES + 1];
    let too_many = command(&vec![Metric::default(); 65], ms(0));
    let table = [
        (b"\xff\xff".to_vec(), "not a message of Sparkplug B"),
        (too_long, "the message has 16385 bytes; at most 16384 are accepted"),
        (too_many, "the message has 65 metrics; at most 64 are accepted"),
    ];
    for (bytes, words) in table {
        let (births, outcome) = outcome_of(&bytes, true);
        let Some(Outcome::Refused { command, why }) = outcome else { panic!("{outcome:?}") };
        assert!(births == 0 && command == "NCMD" && why.starts_with(words), "{why}");
    }
    let state = snapshot(Some(21.5), true, at(0));
    let (mut node, _) = connected(at(0), &state);
    for topic in ["spBv1.0/shop/NCMD/grinder-4", "spBv1.0/shop/DCMD/grinder-3/z", "spBv1.0/STATE/scada", ""] {
        assert_eq!(node.received(at(5_000), &state, topic, &rebirth()), Reaction::default(), "{topic}");
    }
    node.disconnected(at(5_000));
    assert_eq!(node.received(at(6_000), &state, NCMD, &rebirth()), Reaction::default());
}
