use proptest::prelude::*;

use super::*;
use crate::reading::Reason;

fn encoding(data_type: DataType, word_order: WordOrder) -> Encoding {
    Encoding {
        data_type,
        word_order,
        byte_swap: false,
        scale: Scale::ONE,
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    }
}

#[test]
fn both_notations_name_the_same_register() {
    for (protocol, modicon) in
        [("input:0", "30001"), ("holding:100", "40101"), ("coil:19", "00020"), ("discrete:128", "10129")]
    {
        let address: Register = protocol.parse().unwrap();
        assert_eq!(modicon.parse(), Ok(address));
        assert_eq!((address.to_string().as_str(), address.modicon().as_str()), (protocol, modicon));
    }
    assert_eq!("465536".parse(), Ok(Register { table: Table::Holding, offset: 65535 }));
    assert_eq!("holding:65535".parse::<Register>().unwrap().modicon(), "465536");
}

#[test]
fn what_is_no_register_is_refused_with_what_is_allowed() {
    for wrong in
        ["", "holding", "holding:-1", "holding:65536", "holdin:1", "40000", "465537", "20001", "4000x"]
    {
        let said = wrong.parse::<Register>().unwrap_err();
        assert!(said.contains("allowed") || said.contains("write a"), "{wrong}: {said}");
    }
}

#[test]
fn registers_become_the_numbers_that_devices_mean() {
    let cases: [(DataType, WordOrder, &[u16], f64); 10] = [
        (DataType::I16, WordOrder::MswFirst, &[0xFF01], -255.0),
        (DataType::U16, WordOrder::MswFirst, &[0xFF01], 65281.0),
        (DataType::I32, WordOrder::MswFirst, &[0xFFFF, 0xFFFF], -1.0),
        (DataType::I32, WordOrder::LswFirst, &[0x0001, 0x0002], 131_073.0),
        (DataType::I32, WordOrder::MswFirst, &[0x0001, 0x0002], 65_538.0),
        (DataType::U32, WordOrder::MswFirst, &[0xFFFF, 0xFFFF], 4_294_967_295.0),
        (DataType::F32, WordOrder::MswFirst, &[0x41C8, 0x0000], 25.0),
        (DataType::F32, WordOrder::LswFirst, &[0x0000, 0x41C8], 25.0),
        (DataType::I64, WordOrder::MswFirst, &[0xFFFF, 0xFFFF, 0xFFFF, 0xFFFE], -2.0),
        (DataType::F64, WordOrder::MswFirst, &[0x4039, 0, 0, 0], 25.0),
    ];
    for (data_type, order, words, value) in cases {
        assert_eq!(encoding(data_type, order).decode(words), Ok(value), "{data_type:?} {words:04x?}");
    }
    let swapped = Encoding { byte_swap: true, ..encoding(DataType::U16, WordOrder::MswFirst) };
    assert_eq!(swapped.decode(&[0x3412]), Ok(f64::from(0x1234)));
}

#[test]
fn a_sentinel_is_compared_before_scaling() {
    let axiomatic = Encoding {
        scale: Scale::of(0.0625),
        bad: vec![(-1).into(), (-512).into()],
        ..encoding(DataType::I16, WordOrder::MswFirst)
    };
    assert_eq!(axiomatic.decode(&[0xFE00]), Err(Reason::Sentinel));
    assert_eq!(axiomatic.decode(&[0xFFFF]), Err(Reason::Sentinel));
    assert_eq!(axiomatic.decode(&[400]), Ok(25.0));
}

#[test]
fn nan_and_infinity_in_a_float_register_are_no_value() {
    let float = encoding(DataType::F32, WordOrder::MswFirst);
    assert_eq!(float.decode(&[0x7FC0, 0]), Err(Reason::NotANumber));
    assert_eq!(float.decode(&[0x7F80, 0]), Err(Reason::NotANumber));
}

#[test]
fn the_wrong_number_of_registers_is_a_bad_reply() {
    let two = encoding(DataType::I32, WordOrder::MswFirst);
    assert_eq!(two.decode(&[1]), Err(Reason::BadReply));
    assert_eq!(two.decode(&[1, 2, 3]), Err(Reason::BadReply));
}

#[test]
fn what_does_not_fit_is_cut_and_reported() {
    let tenth = Encoding { scale: Scale::of(0.1), ..encoding(DataType::I16, WordOrder::MswFirst) };
    assert_eq!(tenth.encode(8.4).registers(), [84]);
    assert!(!tenth.encode(8.4).saturated);
    let cut = tenth.encode(1e9);
    assert_eq!((cut.registers(), cut.saturated), ([0x7FFF].as_slice(), true));
    assert!(tenth.encode(f64::NAN).saturated);
}

#[test]
fn tenths_and_thousandths_come_out_as_they_are_written() {
    for (raw, scale, value) in
        [(229, 0.1, 22.9), (3, 0.1, 0.3), (-84, 0.1, -8.4), (123_457, 0.0001, 12.3457), (7, 0.0005, 0.0035)]
    {
        let encoding = Encoding { scale: Scale::of(scale), ..encoding(DataType::I32, WordOrder::MswFirst) };
        let words = encoding.encode(value);
        assert_eq!(encoding.decode(words.registers()), Ok(value), "{raw} counts of {scale}");
        assert_eq!(Encoding { scale: Scale::ONE, ..encoding }.decode(words.registers()), Ok(f64::from(raw)));
    }
}

#[test]
fn a_bias_keeps_a_negative_offset_above_zero_on_the_wire() {
    let linuxcnc =
        Encoding { scale: Scale::of(0.1), bias: 32768, ..encoding(DataType::U16, WordOrder::MswFirst) };
    assert_eq!(linuxcnc.encode(-0.1).registers(), [32767]);
    assert_eq!(linuxcnc.encode(0.0).registers(), [32768]);
    assert!((linuxcnc.decode(&[32767]).unwrap() + 0.1).abs() < 1e-12);
}

#[test]
fn a_bit_that_its_scale_makes_infinite_is_no_number() {
    let bit =
        Encoding { scale: Scale::of(2.0), offset: 1.0, ..encoding(DataType::Bool, WordOrder::MswFirst) };
    assert_eq!((bit.decode_bit(false), bit.decode_bit(true)), (Ok(1.0), Ok(3.0)));
    let endless = Encoding { scale: Scale::of(1e308), offset: 1e308, ..bit };
    assert_eq!(endless.decode_bit(true), Err(Reason::NotANumber));
}

proptest! {
    #[test]
    fn every_count_survives_the_way_there_and_back(raw: i32, order in prop_oneof![Just(WordOrder::MswFirst), Just(WordOrder::LswFirst)], byte_swap: bool) {
        let encoding = Encoding { byte_swap, ..encoding(DataType::I32, order) };
        let encoded = encoding.encode(f64::from(raw));
        prop_assert!(!encoded.saturated);
        prop_assert_eq!(encoding.decode(encoded.registers()), Ok(f64::from(raw)));
    }

    #[test]
    fn every_number_of_digits_and_of_sign_and_magnitude_survives_the_way_there_and_back(
        raw in -32_767i16..=32_767, order in prop_oneof![Just(WordOrder::MswFirst), Just(WordOrder::LswFirst)],
    ) {
        for data_type in [DataType::SignMagnitude(16), DataType::SignMagnitude(32), DataType::Bcd(4), DataType::Bcd(8)] {
            let encoding = encoding(data_type, order);
            let (low, high) = data_type.integer_range().unwrap();
            let value = f64::from(raw);
            let encoded = encoding.encode(value);
            let fits = (low..=high).contains(&i128::from(raw));
            prop_assert_eq!(encoded.saturated, !fits);
            prop_assert_eq!(encoding.decode(encoded.registers()) == Ok(value), fits);
        }
    }

    #[test]
    fn no_registers_decode_to_anything_but_a_finite_number(words in proptest::collection::vec(any::<u16>(), 0..6), kind in 0usize..9) {
        let types = [DataType::Bool, DataType::U16, DataType::I16, DataType::U32, DataType::I32, DataType::U64, DataType::I64, DataType::F32, DataType::F64];
        if let Ok(value) = encoding(types[kind], WordOrder::LswFirst).decode(&words) {
            prop_assert!(value.is_finite());
        }
    }
}

#[test]
fn a_bit_of_a_register_is_read_alone() {
    let bit = |bit| encoding(DataType::Bit(bit), WordOrder::MswFirst);
    assert_eq!((bit(5).decode(&[0x0021]), bit(4).decode(&[0x0021])), (Ok(1.0), Ok(0.0)));
    assert_eq!((bit(15).decode(&[0x8000]), bit(15).encode(1.0).registers()), (Ok(1.0), [0x8000].as_slice()));
}

/// Source: DM36B06. The high nibble is the sign, the next nibble the number of decimals, then 24 bits of magnitude.
#[test]
fn a_digit_display_is_given_sign_decimals_and_magnitude() {
    let display =
        Encoding { scale: Scale::of(0.01), ..encoding(DataType::Decimal24(2), WordOrder::MswFirst) };
    for (value, words) in [(32.70, [0x0200, 0x0cc6]), (-32.70, [0x1200, 0x0cc6]), (1310.72, [0x0202, 0x0000])]
    {
        assert_eq!(display.encode(value).registers(), words, "{value}");
        assert_eq!(display.decode(&words), Ok(value));
    }
    assert!(display.encode(10_000.0).saturated && !display.encode(-9_999.99).saturated);
}

#[test]
fn decimal_digits_and_sign_and_magnitude_become_the_numbers_that_devices_mean() {
    let cases: [(DataType, &[u16], Result<f64, Reason>); 11] = [
        (DataType::Bcd(4), &[0x1234], Ok(1234.0)),
        (DataType::Bcd(4), &[0x9999], Ok(9999.0)),
        (DataType::Bcd(8), &[0x0012, 0x3456], Ok(123_456.0)),
        // The digits A to F are not decimal digits.
        (DataType::Bcd(4), &[0x123a], Err(Reason::NotANumber)),
        (DataType::Bcd(8), &[0xffff, 0x0000], Err(Reason::NotANumber)),
        (DataType::SignMagnitude(16), &[0x00eb], Ok(235.0)),
        (DataType::SignMagnitude(16), &[0x80eb], Ok(-235.0)),
        (DataType::SignMagnitude(16), &[0x8000], Ok(0.0)),
        (DataType::SignMagnitude(16), &[0xffff], Ok(-32767.0)),
        (DataType::SignMagnitude(32), &[0x8001, 0x0000], Ok(-65_536.0)),
        (DataType::Bcd(8), &[0x1234], Err(Reason::BadReply)),
    ];
    for (data_type, words, value) in cases {
        let encoding = encoding(data_type, WordOrder::MswFirst);
        assert_eq!(encoding.decode(words), value, "{data_type:?} {words:04x?}");
        assert_eq!(encoding.counts(words).is_some(), value.is_ok(), "{data_type:?} {words:04x?}");
    }
    let bcd = encoding(DataType::Bcd(4), WordOrder::MswFirst);
    assert_eq!((bcd.encode(1234.0).registers(), bcd.encode(-1.0).saturated), ([0x1234].as_slice(), true));
    let signed = encoding(DataType::SignMagnitude(16), WordOrder::MswFirst);
    assert_eq!(signed.encode(-40_000.0).registers(), [0xffff]);
}
