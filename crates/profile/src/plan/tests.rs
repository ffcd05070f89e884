use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::kinds::modbus::requests::MAX_BITS;
use crate::{BusId, DefaultLimits, DeviceId, Functions, Quirks, ReadBy, Unit};
use isotherm_core::codec::{
    self, Address, BitField, BitKind, ByteOrder, CanId, CanMatch, DataType, Encoding, Object, Register,
    Scale, ScaleFrom, ScaleMeaning, WordOrder,
};

fn device(quirks: Quirks) -> Device {
    Device {
        label: String::new(),
        name: "module".to_owned(),
        bus: BusId(0),
        unit: 1,
        every: Duration::from_secs(1),
        functions: Functions::ALL,
        verify: Vec::new(),
        template: None,
        can: None,
        source_time: None,
        read: ReadBy::Poll,
        is_pc: false,
        quirks,
    }
}

fn signal(register: &str, data_type: DataType, merge: bool) -> Signal {
    let encoding = Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::ONE,
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    };
    Signal {
        label: String::new(),
        name: register.to_owned(),
        device: DeviceId(0),
        address: Address::Modbus(register.parse().unwrap()),
        encoding,
        scale_from: None,
        unit: Unit("1"),
        range: None,
        max_rate: None,
        defaults: DefaultLimits::default(),
        is_difference: false,
        max_age: Duration::from_secs(5),
        fault_when: None,
        merge,
        counter: None,
        capture: None,
    }
}

/// Signal whose scale is in another register.
fn scaled(register: &str, scale: &str) -> Signal {
    let value = signal(register, DataType::I16, true);
    let from = ScaleFrom {
        address: scale.parse().unwrap(),
        encoding: value.encoding.clone(),
        meaning: ScaleMeaning::PowerOfTen,
    };
    Signal { scale_from: Some(Box::new(from)), ..value }
}

fn planned(quirks: Quirks, signals: &[Signal]) -> Vec<ReadRequest> {
    plan(&device(quirks), signals.iter().enumerate().map(|(index, signal)| (SignalId(index), signal)))
}

/// Formats each request as `input:0+8 [0 1 2 1s]`: first register, count, signals, signals whose scale is read.
fn shape(requests: &[ReadRequest]) -> Vec<String> {
    let one = |request: &ReadRequest| {
        let name = |field: &Field| match field.content {
            FieldContent::Value => field.signal.0.to_string(),
            FieldContent::Scale => format!("{}s", field.signal.0),
        };
        let fields: Vec<String> = request.fields.iter().map(name).collect();
        let span = match &request.asks {
            ReadTarget::Registers { from, count } => format!("{from}+{count}"),
            _ => request.to_string(),
        };
        format!("{span} [{}]", fields.join(" "))
    };
    requests.iter().map(one).collect()
}

#[test]
fn signals_become_the_fewest_requests() {
    use DataType::{Bool, F32, I16, I32, U16};
    let usual = Quirks::default();
    let tight = Quirks { max_gap: 0, ..usual };
    let small = Quirks { max_registers_per_request: 4, ..usual };
    let single = Quirks { one_request_per_field: true, ..usual };
    type Case<'a> = (&'a str, Quirks, &'a [(&'a str, DataType)], &'a [&'a str]);
    let cases: [Case<'_>; 14] = [
        ("nothing is asked for", usual, &[], &[]),
        ("one register", usual, &[("input:3", I16)], &["input:3+1 [0]"]),
        ("neighbours", usual, &[("input:0", I16), ("input:1", I16)], &["input:0+2 [0 1]"]),
        (
            "the order of the file does not matter",
            usual,
            &[("input:1", I16), ("input:0", I16)],
            &["input:0+2 [1 0]"],
        ),
        ("a small gap is bridged", usual, &[("input:0", I16), ("input:9", I16)], &["input:0+10 [0 1]"]),
        (
            "a large gap is not",
            usual,
            &[("input:0", I16), ("input:10", I16)],
            &["input:0+1 [0]", "input:10+1 [1]"],
        ),
        (
            "no gap is allowed",
            tight,
            &[("input:0", I16), ("input:2", I16)],
            &["input:0+1 [0]", "input:2+1 [1]"],
        ),
        (
            "tables are never mixed",
            usual,
            &[("input:0", I16), ("holding:0", I16)],
            &["input:0+1 [0]", "holding:0+1 [1]"],
        ),
        (
            "the limit splits",
            small,
            &[("input:0", I32), ("input:2", I32), ("input:4", I32)],
            &["input:0+4 [0 1]", "input:4+2 [2]"],
        ),
        (
            "a gap counts towards the limit",
            small,
            &[("input:0", U16), ("input:4", U16)],
            &["input:0+1 [0]", "input:4+1 [1]"],
        ),
        ("two names for one value", usual, &[("holding:7", F32), ("holding:7", F32)], &["holding:7+2 [0 1]"]),
        (
            "a device that wants one at a time",
            single,
            &[("input:0", I16), ("input:1", I16)],
            &["input:0+1 [0]", "input:1+1 [1]"],
        ),
        ("bits have a limit of their own", small, &[("coil:0", Bool), ("coil:8", Bool)], &["coil:0+9 [0 1]"]),
        (
            "the last register",
            usual,
            &[("holding:65534", I16), ("holding:65535", I16)],
            &["holding:65534+2 [0 1]"],
        ),
    ];
    for (name, quirks, signals, expected) in cases {
        let signals: Vec<Signal> =
            signals.iter().map(|(register, kind)| signal(register, *kind, true)).collect();
        assert_eq!(shape(&planned(quirks, &signals)), expected, "{name}");
    }
}

#[test]
fn a_signal_that_must_not_be_merged_is_read_alone() {
    let signals = [
        signal("input:0", DataType::I16, true),
        signal("input:1", DataType::I16, false),
        signal("input:2", DataType::I16, true),
    ];
    assert_eq!(shape(&planned(Quirks::default(), &signals)), ["input:0+3 [0 2]", "input:1+1 [1]"]);
}

#[test]
fn a_value_and_its_scale_are_read_with_one_request_if_the_device_allows_it() {
    let usual = Quirks::default();
    let other = |register| signal(register, DataType::I16, true);
    type Case<'a> = (&'a str, Quirks, Vec<Signal>, &'a [&'a str]);
    let cases: [Case<'_>; 10] = [
        (
            "a scale beside another value, after its own",
            usual,
            vec![scaled("holding:200", "holding:1"), other("holding:0")],
            &["holding:200+1 [0]", "holding:0+2 [1 0s]"],
        ),
        ("neighbours", usual, vec![scaled("holding:10", "holding:11")], &["holding:10+2 [0 0s]"]),
        ("the scale comes first", usual, vec![scaled("holding:10", "holding:2")], &["holding:2+9 [0s 0]"]),
        ("farther than a gap", usual, vec![scaled("holding:10", "holding:60")], &["holding:10+51 [0 0s]"]),
        (
            "what is between is read along",
            usual,
            vec![scaled("holding:10", "holding:60"), other("holding:30"), other("holding:90")],
            &["holding:10+51 [0 1 0s]", "holding:90+1 [2]"],
        ),
        (
            "one scale of two values",
            usual,
            vec![scaled("holding:10", "holding:40"), scaled("holding:70", "holding:40")],
            &["holding:10+61 [0 0s 1s 1]"],
        ),
        (
            "too far for one request",
            usual,
            vec![scaled("holding:10", "holding:135")],
            &["holding:10+1 [0]", "holding:135+1 [0s]"],
        ),
        (
            "in another table, after the values",
            usual,
            vec![scaled("holding:10", "input:0"), other("holding:90")],
            &["holding:10+1 [0]", "holding:90+1 [1]", "input:0+1 [0s]"],
        ),
        (
            "unused registers are not allowed",
            Quirks { max_gap: 0, ..usual },
            vec![scaled("holding:10", "holding:12")],
            &["holding:10+1 [0]", "holding:12+1 [0s]"],
        ),
        (
            "each value alone",
            Quirks { one_request_per_field: true, ..usual },
            vec![scaled("holding:10", "holding:11")],
            &["holding:10+1 [0]", "holding:11+1 [0s]"],
        ),
    ];
    for (name, quirks, signals, expected) in cases {
        assert_eq!(shape(&planned(quirks, &signals)), expected, "{name}");
    }
}

#[test]
fn a_plan_tells_what_it_reads_in_both_notations() {
    let signals: Vec<Signal> =
        ["input:0", "input:7", "coil:3"].map(|at| signal(at, DataType::I16, true)).into_iter().collect();
    let requests = planned(Quirks::default(), &signals);
    assert_eq!(requests[0].to_string(), "read coil:3 (00004), 1 bit");
    assert_eq!(requests[1].to_string(), "read input:0..7 (30001..30008), 8 registers");
    assert_eq!(summary(&requests), "2 requests touching 8 registers and 1 bit for 3 signals");
}

fn any_signal() -> impl Strategy<Value = Signal> {
    let tables = prop_oneof![Just("coil"), Just("discrete"), Just("input"), Just("holding")];
    let types = prop_oneof![Just(DataType::I16), Just(DataType::F32), Just(DataType::U64)];
    let scales = prop::option::weighted(0.2, (prop_oneof![Just("input"), Just("holding")], 0u16..300));
    let all = (tables, 0u16..300, types, prop::bool::weighted(0.9), scales);
    all.prop_map(|(table, offset, data_type, merge, scale)| {
        let bits = matches!(table, "coil" | "discrete");
        let data_type = if bits { DataType::Bool } else { data_type };
        let scale =
            scale.filter(|_| !bits).map(|(table, offset)| scaled("input:0", &format!("{table}:{offset}")));
        let scale_from = scale.and_then(|signal| signal.scale_from);
        Signal { scale_from, ..signal(&format!("{table}:{offset}"), data_type, merge) }
    })
}

proptest! {
    #[test]
    fn every_signal_is_read_once_and_no_request_is_too_long(
        signals in prop::collection::vec(any_signal(), 0..60),
        max_registers_per_request in 4u16..=125,
        max_gap in 0u16..20,
        one_request_per_field: bool,
    ) {
        let quirks = Quirks { max_registers_per_request, max_gap, one_request_per_field, ..Quirks::default() };
        let requests = planned(quirks, &signals);
        let mut seen = vec![0; signals.len()];
        let mut scales = vec![0; signals.len()];
        for request in &requests {
            let (Register { table, offset }, count) = request.span().unwrap();
            let limit = if table.is_bits() { MAX_BITS } else { max_registers_per_request };
            prop_assert!(count <= limit);
            prop_assert!(u32::from(offset) + u32::from(count) <= 65_536);
            for field in &request.fields {
                let signal = &signals[field.signal.0];
                let own = Register { table, offset: offset + field.at };
                if field.content == FieldContent::Scale {
                    scales[field.signal.0] += 1;
                    prop_assert_eq!(Some(own), signal.scale_from.as_ref().map(|from| from.address));
                    prop_assert_eq!(field.len, 1);
                } else {
                    seen[field.signal.0] += 1;
                    prop_assert_eq!(Some(own), signal.address.register());
                    prop_assert_eq!(field.len, signal.encoding.data_type.registers());
                }
                prop_assert!(field.at + field.len <= count);
                prop_assert!(signal.merge || request.fields.len() == 1);
            }
        }
        prop_assert!(seen.iter().all(|times| *times == 1));
        let scaled = signals.iter().map(|signal| usize::from(signal.scale_from.is_some()));
        prop_assert!(scales.into_iter().eq(scaled));
        let mut backwards: Vec<_> = signals.iter().enumerate().map(|(index, signal)| (SignalId(index), signal)).collect();
        backwards.reverse();
        prop_assert_eq!(plan(&device(quirks), backwards), requests);
    }
}

#[test]
fn an_object_is_a_request_of_its_own_and_what_comes_in_frames_is_not_asked_for() {
    let at = |address| Signal { address, ..signal("input:0", DataType::I32, true) };
    let object = |sub| at(Address::Object(Object::new(0x2000, sub, DataType::I32)));
    let bits = BitField::new(0, 32, ByteOrder::Intel, BitKind::Signed).unwrap();
    let frames = CanMatch::exactly(CanId::standard(0x185).unwrap());
    let frame = at(Address::Frame(codec::Field { frames, is_fd: false, bits, multiplex: Vec::new() }));
    let signals = [object(2), frame.clone(), object(1), frame];
    assert_eq!(shape(&planned(Quirks::default(), &signals)), ["read 2000:02 [0]", "read 2000:01 [2]"]);
}
