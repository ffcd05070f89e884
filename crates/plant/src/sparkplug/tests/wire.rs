//! Tests of the bytes of encoded messages.

use proptest::prelude::*;

use super::*;

#[test]
fn each_type_has_its_number_and_its_range() {
    let table: [(DataType, u32, Datum, Raw); 18] = [
        (DataType::Int8, 1, Datum::Signed(-128), Raw::Int(0x80)),
        (DataType::Int16, 2, Datum::Signed(-2), Raw::Int(0xfffe)),
        (DataType::Int32, 3, Datum::Signed(-2), Raw::Int(0xffff_fffe)),
        (DataType::Int32, 3, Datum::Signed(500), Raw::Int(500)),
        (DataType::Int64, 4, Datum::Signed(-2), Raw::Long(u64::MAX - 1)),
        (DataType::UInt8, 5, Datum::Unsigned(255), Raw::Int(255)),
        (DataType::UInt16, 6, Datum::Unsigned(65_535), Raw::Int(65_535)),
        (DataType::UInt32, 7, Datum::Unsigned(u32::MAX.into()), Raw::Int(u32::MAX)),
        (DataType::UInt64, 8, Datum::Unsigned(u64::MAX), Raw::Long(u64::MAX)),
        (DataType::Float, 9, Datum::Real(0.5), Raw::Float(0.5)),
        (DataType::Double, 10, Datum::Real(0.1), Raw::Double(0.1)),
        (DataType::Boolean, 11, Datum::Flag(true), Raw::Boolean(true)),
        (DataType::String, 12, Datum::Text("µm".to_owned()), Raw::String("µm".to_owned())),
        (DataType::DateTime, 13, Datum::Date(1_800_000_000_000), Raw::Long(1_800_000_000_000)),
        (DataType::Int8, 1, Datum::Signed(127), Raw::Int(127)),
        (DataType::Int16, 2, Datum::Signed(32_767), Raw::Int(32_767)),
        (DataType::Int8, 1, Datum::Signed(0), Raw::Int(0)),
        (DataType::Float, 9, Datum::Real(f64::INFINITY), Raw::Float(f32::INFINITY)),
    ];
    for (kind, number, datum, raw) in table {
        assert_eq!((kind.number(), DataType::from_number(number)), (number, Some(kind)));
        assert_eq!(kind.write(&datum), Some(raw.clone()), "{kind:?}");
        assert_eq!(kind.read(&raw), Some(datum), "{kind:?}");
    }
    assert_eq!([0, 14, 16, 19, 34, u32::MAX].map(DataType::from_number), [None; 6]);
}

#[test]
fn what_is_no_value_of_a_type_is_not_written_and_not_read() {
    let written = [
        (DataType::Int8, Datum::Signed(128)),
        (DataType::Int16, Datum::Signed(-32_769)),
        (DataType::Int32, Datum::Signed(1 << 31)),
        (DataType::UInt8, Datum::Unsigned(256)),
        (DataType::UInt16, Datum::Unsigned(65_536)),
        (DataType::UInt32, Datum::Unsigned(1 << 32)),
        (DataType::Float, Datum::Real(1e39)),
        (DataType::Double, Datum::Signed(1)),
        (DataType::Boolean, Datum::Unsigned(1)),
        (DataType::UInt64, Datum::Signed(1)),
    ];
    for (kind, datum) in written {
        assert_eq!(kind.write(&datum), None, "{kind:?} {datum:?}");
    }
    let read = [
        (DataType::Int8, Raw::Int(0x100)),
        (DataType::Int8, Raw::Int(0xffff_ff7f)),
        (DataType::Int16, Raw::Int(0x0001_8000)),
        (DataType::UInt8, Raw::Int(256)),
        (DataType::Int32, Raw::Long(1)),
        (DataType::Double, Raw::Float(1.0)),
        (DataType::Boolean, Raw::Int(1)),
        (DataType::String, Raw::Bytes(vec![65])),
    ];
    for (kind, raw) in read {
        assert_eq!(kind.read(&raw), None, "{kind:?} {raw:?}");
    }
    // Other implementations extend a negative number to 32 bits.
    assert_eq!(DataType::Int8.read(&Raw::Int(0xffff_ff80)), Some(Datum::Signed(-128)));
    assert_eq!(DataType::Int16.read(&Raw::Int(0xffff_fffe)), Some(Datum::Signed(-2)));
}

/// The expected bytes were derived by hand from the table of fields in the specification.
#[test]
fn a_message_has_the_bytes_of_the_specification() {
    let metric = Metric {
        name: Some("a".to_owned()),
        alias: Some(1),
        timestamp: Some(300),
        datatype: Some(10),
        is_historical: Some(true),
        is_null: None,
        properties: Some(PropertySet {
            keys: vec!["Quality".to_owned()],
            values: vec![Property { datatype: Some(3), is_null: None, value: Some(PropertyRaw::Int(500)) }],
        }),
        value: Some(Raw::Double(1.0)),
    };
    let payload = Payload { timestamp: Some(1), metrics: vec![metric], seq: Some(2) };
    let properties = b"\x0a\x07Quality\x12\x05\x08\x03\x18\xf4\x03";
    let metric = [
        &b"\x0a\x01a\x10\x01\x18\xac\x02\x20\x0a\x28\x01\x4a\x10"[..],
        properties,
        b"\x69\0\0\0\0\0\0\xf0\x3f",
    ]
    .concat();
    let expected =
        [&b"\x08\x01\x12"[..], &[u8::try_from(metric.len()).unwrap()], &metric, b"\x18\x02"].concat();
    assert_eq!(payload.bytes(), expected);
}

#[test]
fn fields_that_are_not_read_here_are_skipped() {
    // A transient metric with metadata, a body, and an unknown field.
    let bytes = b"\x08\x01\x12\x0b\x0a\x01a\x30\x01\x42\x02\x08\x01\x70\x01\x2a\x02xy\xa2\x06\x01z";
    let payload = Payload::arrived(bytes).unwrap();
    assert_eq!((payload.timestamp, payload.metrics.len()), (Some(1), 1));
    assert_eq!(find(&payload, "a").value, Some(Raw::Boolean(true)));
}

fn raw() -> impl Strategy<Value = Raw> {
    prop_oneof![
        any::<u32>().prop_map(Raw::Int),
        any::<u64>().prop_map(Raw::Long),
        (-1e30f32..1e30).prop_map(Raw::Float),
        (-1e300f64..1e300).prop_map(Raw::Double),
        any::<bool>().prop_map(Raw::Boolean),
        ".{0,20}".prop_map(Raw::String),
        proptest::collection::vec(any::<u8>(), 0..20).prop_map(Raw::Bytes),
    ]
}

prop_compose! {
    fn metric()(
        name in proptest::option::of(".{0,20}"),
        alias in any::<Option<u64>>(),
        timestamp in any::<Option<u64>>(),
        datatype in any::<Option<u32>>(),
        flags in any::<(Option<bool>, Option<bool>)>(),
        keys in proptest::option::of(proptest::collection::vec("[a-z]{0,5}", 0..3)),
        property in any::<(Option<u32>, Option<bool>)>(),
        value in proptest::option::of(raw()),
    ) -> Metric {
        let property = Property { datatype: property.0, is_null: property.1, value: value.clone().and_then(Raw::into_property) };
        let properties = keys.map(|keys| PropertySet { values: vec![property; keys.len()], keys });
        Metric { name, alias, timestamp, datatype, is_historical: flags.0, is_null: flags.1, properties, value }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_is_written_is_read_again(
        timestamp in any::<Option<u64>>(),
        seq in any::<Option<u64>>(),
        metrics in proptest::collection::vec(metric(), 0..8),
    ) {
        let payload = Payload { timestamp, metrics, seq };
        prop_assert_eq!(Payload::arrived(&payload.bytes()), Ok(payload));
    }

    #[test]
    fn a_value_of_a_type_is_itself_again(number in 1u32..14, signed in any::<i64>(), real in any::<f64>(), text in ".{0,9}") {
        let kind = DataType::from_number(number).unwrap();
        let data = [
            Datum::Signed(signed), Datum::Signed(signed >> 56), Datum::Unsigned(signed.cast_unsigned()),
            Datum::Unsigned(signed.cast_unsigned() >> 56), Datum::Flag(signed > 0), Datum::Text(text),
            Datum::Date(signed.cast_unsigned()),
        ];
        for datum in data {
            if let Some(raw) = kind.write(&datum) {
                prop_assert_eq!(kind.read(&raw), Some(datum));
            }
        }
        if let Some(raw) = DataType::Double.write(&Datum::Real(real)) {
            let Some(Datum::Real(again)) = DataType::Double.read(&raw) else { panic!("{raw:?}") };
            prop_assert_eq!(again.to_bits(), real.to_bits());
        }
    }

    /// Any bytes give a result, and the memory for it is limited.
    #[test]
    fn bytes_of_nobody_are_heard_and_arm_nothing(
        start in proptest::collection::vec(metric(), 0..3),
        spoil in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        tail in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let mut bytes = Payload { timestamp: ms(0), metrics: start, seq: None }.bytes();
        bytes.extend(tail);
        for (at, byte) in spoil {
            if !bytes.is_empty() {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
        }
        let state = snapshot(Some(1.0), true, at(0));
        let (mut node, _) = connected(at(0), &state);
        let reaction = node.received(at(2_000), &state, "spBv1.0/shop/NCMD/grinder-3", &bytes);
        prop_assert!(reaction.messages.len() <= 1);
        if let Some(Outcome::Refused { command, why }) = reaction.outcome {
            prop_assert!(command.len() <= 64 * 10 && why.len() < 400, "{command} {why}");
        }
        node.forward(at(3_000), &[Record(bytes)]);
    }
}
