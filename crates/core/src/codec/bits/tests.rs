use proptest::prelude::*;

use super::*;
use crate::codec::{Encoding, Scale, WordOrder};

const INTEL: ByteOrder = ByteOrder::Intel;
const MOTOROLA: ByteOrder = ByteOrder::Motorola;

fn field(start: u16, length: u16, order: ByteOrder, kind: BitKind) -> BitField {
    BitField::new(start, length, order, kind).unwrap()
}

fn value(field: BitField, scale: f64, offset: f64, frame: &[u8]) -> Result<f64, Reason> {
    let data_type = field.data_type();
    let word_order = WordOrder::MswFirst;
    let encoding = Encoding {
        data_type,
        word_order,
        byte_swap: false,
        scale: Scale::of(scale),
        offset,
        bias: 0,
        bad: Vec::new(),
    };
    encoding.decode(field.registers(frame)?.registers())
}

#[test]
fn an_unsigned_field_is_where_a_dbc_file_says_in_both_byte_orders() {
    const FRAME: [u8; 8] = [0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc, 0xde, 0xf0];
    let cases = [
        (0, 8, INTEL, 0x12),
        (0, 16, INTEL, 0x3412),
        (4, 8, INTEL, 0x41),
        (12, 12, INTEL, 0x563),
        (0, 64, INTEL, 0xf0de_bc9a_7856_3412),
        (63, 1, INTEL, 1),
        // The start of a Motorola field is its most significant bit.
        (7, 8, MOTOROLA, 0x12),
        (7, 16, MOTOROLA, 0x1234),
        (3, 12, MOTOROLA, 0x234),
        (15, 16, MOTOROLA, 0x3456),
        (11, 16, MOTOROLA, 0x4567),
        (2, 4, MOTOROLA, 0b0100),
        (0, 2, MOTOROLA, 0b00),
        (7, 64, MOTOROLA, 0x1234_5678_9abc_def0),
        (56, 1, MOTOROLA, 0),
    ];
    for (start, length, order, expected) in cases {
        let field = field(start, length, order, BitKind::Unsigned);
        assert_eq!(field.bits(&FRAME), Ok(expected), "{field}");
    }
}

#[test]
fn a_signed_field_of_any_length_has_its_sign_and_a_float_its_point() {
    let signed = |start, length, order, frame: &[u8]| {
        value(field(start, length, order, BitKind::Signed), 1.0, 0.0, frame)
    };
    assert_eq!(signed(4, 12, INTEL, &[0x0f, 0xfe]), Ok(-32.0));
    assert_eq!(signed(3, 12, MOTOROLA, &[0x0f, 0xe0]), Ok(-32.0));
    assert_eq!(signed(0, 16, INTEL, &[0x00, 0xfe]), Ok(-512.0));
    assert_eq!(signed(0, 24, INTEL, &[0xff, 0xff, 0x7f]), Ok(8_388_607.0));
    assert_eq!(signed(0, 1, INTEL, &[1]), Ok(-1.0));
    let float = field(8, 32, INTEL, BitKind::Float);
    assert_eq!(value(float, 1.0, 0.0, &[0, 0, 0, 0xc8, 0x41]), Ok(25.0));
    let double = field(7, 64, MOTOROLA, BitKind::Float);
    assert_eq!(value(double, 1.0, 0.0, &25.5f64.to_be_bytes()), Ok(25.5));
}

/// Source: CSS Electronics, documentation of CANmod.temp, frame 0x001.
#[test]
fn the_published_frame_of_a_thermocouple_module_decodes_to_its_published_values() {
    const FRAME: [u8; 8] = [0x99, 0x04, 0x60, 0x0a, 0x28, 0x19, 0x8e, 0xbe];
    let read =
        |start, length, offset| value(field(start, length, INTEL, BitKind::Unsigned), 1.0, offset, &FRAME);
    assert_eq!(read(0, 8, -128.0), Ok(25.0));
    let status = [8, 22, 36, 50].map(|start| read(start, 2, 0.0));
    let temperatures = [10, 24, 38, 52].map(|start| read(start, 12, -2048.0));
    assert_eq!((status, temperatures), ([0.0, 1.0, 2.0, 3.0].map(Ok), [1.0, 10.0, 100.0, 1000.0].map(Ok)));
}

#[test]
fn a_longer_frame_is_fine_and_a_shorter_one_is_bad() {
    let encoder = field(0, 32, INTEL, BitKind::Signed);
    assert_eq!(value(encoder, 1.0, 0.0, &[1, 0, 0, 0, 9, 9, 9]), Ok(1.0));
    assert_eq!(value(encoder, 1.0, 0.0, &[1, 0, 0]), Err(Reason::ShortFrame));
    assert_eq!(encoder.insert(&mut [0; 3], 1), Err(Reason::ShortFrame));
    assert_eq!(field(3, 12, MOTOROLA, BitKind::Unsigned).bits(&[0xff]), Err(Reason::ShortFrame));
}

#[test]
fn a_field_beyond_a_frame_or_of_a_length_that_its_kind_has_not_does_not_exist() {
    let exists = |start, length, order, kind| BitField::new(start, length, order, kind).is_some();
    assert!(exists(448, 64, INTEL, BitKind::Unsigned) && !exists(449, 64, INTEL, BitKind::Unsigned));
    assert!(exists(511, 8, MOTOROLA, BitKind::Unsigned) && !exists(510, 8, MOTOROLA, BitKind::Unsigned));
    assert!(!exists(0, 0, INTEL, BitKind::Unsigned) && !exists(0, 65, INTEL, BitKind::Signed));
    assert!(!exists(0, 16, INTEL, BitKind::Float) && exists(0, 64, INTEL, BitKind::Float));
    assert!(!exists(u16::MAX, 64, MOTOROLA, BitKind::Unsigned));
}

#[test]
fn a_value_that_does_not_fit_its_field_is_cut_and_reported() {
    let data_type = field(0, 12, INTEL, BitKind::Signed).data_type();
    let encoding = Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::of(0.1),
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    };
    let written = encoding.encode(-3.2);
    assert_eq!((written.bits(), written.saturated), (0xfe0, false));
    assert_eq!((encoding.encode(-205.0).bits(), encoding.encode(-205.0).saturated), (0x800, true));
    assert_eq!(encoding.decode(written.registers()), Ok(-3.2));
}

fn any_field() -> impl Strategy<Value = BitField> {
    let order = prop_oneof![Just(INTEL), Just(MOTOROLA)];
    let kind = prop_oneof![Just(BitKind::Unsigned), Just(BitKind::Signed)];
    (0u16..512, 1u16..=64, order, kind)
        .prop_filter_map("outside of a frame", |(start, length, order, kind)| {
            BitField::new(start, length, order, kind)
        })
}

proptest! {
    #[test]
    fn what_is_put_into_a_frame_is_what_is_taken_out_and_nothing_else_changes(
        field in any_field(), bits: u64, mut frame in proptest::collection::vec(any::<u8>(), 64),
    ) {
        let width = u32::from(field.data_type().width());
        let bits = bits & (u64::MAX >> (64 - width));
        let before = frame.clone();
        let old = field.bits(&frame).unwrap();
        field.insert(&mut frame, bits).unwrap();
        prop_assert_eq!(field.bits(&frame), Ok(bits));
        prop_assert_eq!(field.registers(&frame).unwrap().bits(), bits);
        prop_assert_eq!(field.bits(&frame[..field.bytes()]), Ok(bits));
        prop_assert!(field.bits(&frame[..field.bytes() - 1]).is_err());
        field.insert(&mut frame, old).unwrap();
        prop_assert_eq!(frame, before);
    }

    #[test]
    fn every_count_of_a_field_survives_the_way_through_its_encoding(field in any_field(), bits: u64) {
        let data_type = field.data_type();
        let encoding = Encoding {
            data_type, word_order: WordOrder::MswFirst, byte_swap: false, scale: Scale::ONE, offset: 0.0, bias: 0, bad: Vec::new(),
        };
        let bits = bits & (u64::MAX >> (64 - u32::from(data_type.width())));
        let words = data_type.encode(bits);
        if let Some(counts) = encoding.counts(words.registers()) {
            let (low, high) = data_type.integer_range().unwrap();
            prop_assert!((low..=high).contains(&i128::from(counts.0)));
            prop_assert_eq!(encoding.encode_counts(counts), words);
        }
    }

    #[test]
    fn two_fields_overlap_exactly_where_one_changes_the_other(a in any_field(), b in any_field()) {
        let mut frame = [0; 64];
        a.insert(&mut frame, u64::MAX).unwrap();
        prop_assert_eq!(a.overlaps(&b), b.bits(&frame).unwrap() != 0);
    }
}
