//! Births, deaths, and the number that they have in common.

use super::*;

fn death_number(payload: &Payload) -> Option<Raw> {
    let metric = find(payload, "bdSeq");
    assert_eq!((metric.datatype, metric.alias), (Some(DataType::Int64.number()), None));
    metric.value.clone()
}

#[test]
fn a_birth_has_every_metric_with_name_alias_type_time_and_value() {
    let (_, birth) = connected(at(500), &snapshot(Some(21.5), true, at(100)));
    assert_eq!((birth.timestamp, birth.seq), (ms(500), Some(0)));
    let table = [
        ("signal/bed/value", Some(1), DataType::Double, ms(100), Some(Raw::Double(21.5))),
        ("axis/z/is_armed", Some(2), DataType::Boolean, ms(100), Some(Raw::Boolean(true))),
        ("gateway/event", Some(3), DataType::String, ms(500), None),
        ("axis/z/measured_error_um", Some(4), DataType::Double, ms(500), None),
        ("Node Control/Rebirth", None, DataType::Boolean, ms(500), Some(Raw::Boolean(false))),
        ("bdSeq", None, DataType::Int64, ms(500), Some(Raw::Long(42))),
    ];
    for (name, alias, kind, time, value) in &table {
        let metric = find(&birth, name);
        let found = (metric.alias, metric.datatype, metric.timestamp);
        assert_eq!(found, (*alias, Some(kind.number()), *time), "{name}");
        assert_eq!(metric.is_null, value.is_none().then_some(true), "{name}");
        assert_eq!(&metric.value, value, "{name}");
    }
    assert_eq!(birth.metrics.len(), table.len());
    assert!(birth.metrics.is_sorted_by_key(|metric| metric.timestamp), "the order of time");
}

#[test]
fn a_birth_says_units_and_only_what_is_not_known_is_of_bad_quality() {
    let (_, birth) = connected(at(500), &snapshot(None, true, Moment::default()));
    let bed = find(&birth, "signal/bed/value");
    assert_eq!((bed.is_null, bed.value.clone(), bed.timestamp), (Some(true), None, ms(500)));
    let properties = bed.properties.clone().unwrap();
    assert_eq!(properties.keys, ["Quality", "engUnit"]);
    let [quality, unit] = properties.values.as_slice() else { panic!("{properties:?}") };
    assert_eq!((quality.datatype, quality.value.clone()), (Some(3), Some(PropertyRaw::Int(0))));
    assert_eq!((unit.datatype, unit.value.clone()), (Some(12), Some(PropertyRaw::String("°C".to_owned()))));
    assert_eq!(find(&birth, "axis/z/is_armed").properties, None);
    assert_eq!(find(&birth, "gateway/event").properties, None);
}

#[test]
fn a_will_is_a_death_of_the_next_number_and_so_is_the_farewell() {
    let mut node = node();
    let will = node.will();
    let (verb, payload) = read(&will);
    assert_eq!((verb, will.qos), ("NDEATH", Qos::AtLeastOnce));
    assert_eq!((payload.seq, payload.metrics.len()), (None, 1));
    assert_eq!(death_number(&payload), Some(Raw::Long(42)));
    // Nothing was published before, so that no death is necessary.
    assert_eq!(node.farewell(at(0)), []);
    let birth = node.connected(at(1), &snapshot(Some(1.0), true, at(0)));
    assert_eq!(death_number(&read(&birth[0]).1), Some(Raw::Long(42)));
    assert_eq!(node.farewell(at(2)), [will]);
    assert_eq!(node.farewell(at(3)), []);
    assert_eq!(node.publish(at(4), &snapshot(Some(2.0), true, at(4))), []);
}

#[test]
fn each_connection_has_the_next_number_from_255_on_0_again() {
    let state = snapshot(Some(1.0), true, at(0));
    let mut node = Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), Some(253), false);
    let mut numbers = Vec::new();
    for round in 0..4 {
        // Attempts that fail before a CONNECT packet is sent.
        node.will();
        node.will();
        let will = node.will();
        node.connect_sent();
        let birth = node.connected(at(round * 10), &state);
        assert_eq!(death_number(&read(&will).1), death_number(&read(&birth[0]).1));
        numbers.push((node.bd_seq(), death_number(&read(&will).1)));
        node.disconnected(at(round * 10 + 5));
    }
    let number = |number: u8| (number, Some(Raw::Long(number.into())));
    assert_eq!(numbers, [254, 255, 0, 1].map(number));
    // The broker refuses this CONNECT packet, which has used its number nevertheless.
    node.will();
    node.connect_sent();
    node.will();
    assert_eq!((node.number_sent(), node.bd_seq()), (Some(2), 3));
}

#[test]
fn the_first_connection_of_all_has_the_number_0() {
    let mut node = Sparkplug::new(Address::new("shop", "grinder-3").unwrap(), None, false);
    for _ in 0..3 {
        assert_eq!(death_number(&read(&node.will()).1), Some(Raw::Long(0)));
        assert_eq!((node.number_to_keep(), node.number_sent()), (Some(0), None));
    }
    node.connect_sent();
    assert_eq!((node.number_to_keep(), node.number_sent()), (Some(0), Some(0)));
    assert_eq!(death_number(&read(&node.will()).1), Some(Raw::Long(1)));
}

#[test]
fn it_hears_its_own_commands_only() {
    let subscriptions = node().subscriptions();
    let [subscription] = subscriptions.as_slice() else { panic!("{subscriptions:?}") };
    assert_eq!(
        (subscription.filter.as_str(), subscription.qos),
        ("spBv1.0/shop/NCMD/grinder-3", Qos::AtLeastOnce)
    );
}

#[test]
fn a_snapshot_of_other_figures_is_a_new_birth() {
    let (mut node, _) = connected(at(0), &snapshot(Some(1.0), true, at(0)));
    let mut other = snapshot(Some(1.0), true, at(10));
    other.metrics.swap(0, 1);
    let messages = node.publish(at(10), &other);
    let (verb, birth) = read(&messages[0]);
    assert_eq!((verb, birth.seq, messages.len()), ("NBIRTH", Some(0), 1));
    assert_eq!(alias(&birth, "axis/z/is_armed"), 1);
    assert_eq!(node.publish(at(11), &other), []);
}

#[test]
fn what_happens_while_it_connects_stands_behind_the_birth() {
    let mut node = node();
    node.will();
    let mut state = snapshot(Some(1.0), true, at(0));
    state.events = vec![happening("z is off", at(5))];
    let messages = node.connected(at(10), &state);
    let birth = read(&messages[0]).1;
    let expected = (1, alias(&birth, "gateway/event"), 5, Some(Raw::String("z is off".to_owned())));
    assert_eq!(rows(&messages[1..]), [expected]);
}
