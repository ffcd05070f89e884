use proptest::prelude::*;
use proptest::sample::select;

use super::*;
use crate::codec::{DataType, Scale, WordOrder};
use crate::quantity::of;

const ORDERS: [WordOrder; 2] = [WordOrder::MswFirst, WordOrder::LswFirst];
const TYPES: [DataType; 13] = [
    DataType::U16,
    DataType::I16,
    DataType::U32,
    DataType::I32,
    DataType::U64,
    DataType::I64,
    DataType::F32,
    DataType::F64,
    DataType::Unsigned(8),
    DataType::Signed(8),
    DataType::Signed(12),
    DataType::Signed(24),
    DataType::Decimal24(1),
];

fn view(data_type: DataType, scale: f64, bias: i64, per_micron: f64, limit: f64) -> ControlView {
    let encoding = Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::of(scale),
        offset: 0.0,
        bias,
        bad: Vec::new(),
    };
    ControlView { encoding, per_micron, limit: of(limit) }
}

/// Compares all 65,536 register values with arithmetic in whole counts.
#[test]
fn of_all_contents_of_a_register_those_within_the_limit_are_admitted() {
    for (signed, bias, count, factor) in
        [(true, 0, 1, 1), (true, 0, -1, 1), (false, 32768, 1, 2), (true, -100, 5, 2), (false, 0, 1, 1)]
    {
        let data_type = if signed { DataType::I16 } else { DataType::U16 };
        // One count is a tenth of `count` µm. The limit is 40 µm.
        let view = view(data_type, f64::from(count) / 10.0, i64::from(bias), f64::from(factor), 40.0);
        for word in 0..=u16::MAX {
            let raw = if signed { i32::from(word.cast_signed()) } else { i32::from(word) };
            // Value in tenths of µm. It is `factor` times the correction.
            let tenths = (raw - bias) * count;
            // A value up to half a count beyond the limit is admitted.
            let is_within = 2 * tenths.abs() <= 2 * 400 * factor + count.abs();
            let meant = of(f64::from(tenths) / 10.0 / f64::from(factor));
            let admitted = view.admit(&[word], meant, 0.0, Micron::ZERO);
            assert_eq!(admitted.is_ok(), is_within, "{raw} with bias {bias}: {admitted:?}");
            let other = view.admit(&[word], meant + of(1.0), 0.0, Micron::ZERO);
            assert!(other.is_err(), "{raw} is not {meant} and 1 µm");
        }
    }
}

#[test]
fn a_register_beyond_the_limit_is_walked_back_and_never_further_away() {
    let view = view(DataType::I16, 0.1, 0, 1.0, 40.0);
    let sent = |counts: i16, held: f64| {
        view.admit(&[counts.cast_unsigned()], of(f64::from(counts) / 10.0), 0.0, of(held))
    };
    assert_eq!(sent(490, 50.0), Ok(()));
    assert_eq!(sent(500, -50.0), Ok(()));
    assert_eq!(sent(510, 50.0), Err(Inadmissible::Beyond { correction: of(51.0), limit: of(40.0) }));
}

#[test]
fn a_share_is_measured_from_the_operators_part_and_a_correction_from_the_position() {
    let shared = view(DataType::I32, 0.1, 0, 1.0, 40.0);
    let registers = |value: f64| shared.encoding.encode(value);
    let sent =
        |value: f64, meant: f64| shared.admit(registers(value).registers(), of(meant), 1200.0, Micron::ZERO);
    assert_eq!((sent(1239.5, 39.5), sent(1160.0, -40.0)), (Ok(()), Ok(())));
    assert!(matches!(sent(1240.1, 40.1), Err(Inadmissible::Beyond { .. })));
    assert!(matches!(sent(39.5, 39.5), Err(Inadmissible::Beyond { .. })));
    // Position in mm of a diameter: 40 µm are 0.08 mm.
    let position = view(DataType::I32, 0.0001, 0, 2.0 / 1000.0, 40.0);
    let sent = |value: f64, meant: f64| {
        let encoded = position.encoding.encode(value);
        position.admit(encoded.registers(), of(meant), 123.4567, Micron::ZERO)
    };
    assert_eq!(sent(123.4567 + 0.08, 40.0), Ok(()));
    assert!(matches!(sent(123.4567 + 0.0802, 40.1), Err(Inadmissible::Beyond { .. })));
    // A register too narrow for the position holds another value.
    let narrow = view(DataType::I16, 0.0001, 0, 1.0 / 1000.0, 40.0);
    let cut = narrow.encoding.encode(123.4567);
    assert!(cut.saturated);
    assert!(matches!(
        narrow.admit(cut.registers(), of(0.0), 123.4567, Micron::ZERO),
        Err(Inadmissible::Beyond { .. })
    ));
}

#[test]
fn what_is_no_number_is_not_sent() {
    let float = view(DataType::F32, 1.0, 0, 1.0, 40.0);
    assert_eq!(float.admit(&[0x7fc0, 0], of(0.0), 0.0, Micron::ZERO), Err(Inadmissible::NoNumber));
    assert_eq!(float.admit(&[0], of(0.0), 0.0, Micron::ZERO), Err(Inadmissible::NoNumber));
    assert_eq!(float.admit(&[0, 0], of(0.0), f64::NAN, Micron::ZERO), Err(Inadmissible::NoNumber));
}

prop_compose! {
    fn views()(
        data_type in select(TYPES.to_vec()),
        word_order in select(ORDERS.to_vec()),
        byte_swap in any::<bool>(),
        scale in select(vec![1.0, -1.0, 0.1, -0.1, 0.5, 0.003, 2.5e-4, 1e-3]),
        bias in select(vec![0i64, 0, 1, -300, 32768]),
        factor in select(vec![1.0, 2.0, 1.0 / 350.0]),
        limit in 1.0..200.0f64,
    ) -> ControlView {
        let is_whole = data_type.integer_range().is_some();
        let mut view = view(data_type, scale, if is_whole { bias } else { 0 }, factor, limit);
        (view.encoding.word_order, view.encoding.byte_swap) = (word_order, byte_swap);
        view
    }
}

/// Returns half a count plus the rounding error of floats, µm.
fn slack(view: &ControlView, size: f64) -> f64 {
    let is_whole = view.encoding.data_type.integer_range().is_some();
    let count = if is_whole { 0.5 * view.encoding.scale.get().abs() / view.per_micron } else { 0.0 };
    count + size / view.per_micron * 2.5e-7
}

proptest! {
    /// Checks that the view admits every value that the gateway encodes correctly.
    #[test]
    fn what_is_encoded_as_the_control_reads_it_is_admitted(
        view in views(), share in -1.0..=1.0f64, centre in select(vec![0.0, 0.0, 120.0, -7.5]),
    ) {
        let meant = view.limit.get() * share;
        let encoded = view.encoding.encode(centre + meant * view.per_micron);
        prop_assume!(!encoded.saturated);
        let admitted = view.admit(encoded.registers(), of(meant), centre, Micron::ZERO);
        prop_assert_eq!(admitted, Ok(()));
    }

    /// Checks that, with a wrong scale, bias or factor, the view admits a value only under two conditions. The control
    /// reads the intended correction, and this correction is at most the limit.
    #[test]
    fn what_is_encoded_otherwise_is_admitted_only_if_the_control_reads_what_is_meant(
        view in views(), share in -1.0..=1.0f64,
        other in select(vec![1.0, -1.0, 0.01, 100.0, 1.001, 2.0, 0.5]),
        bias in select(vec![0i64, 1, 32768, -5]),
        factor in select(vec![1.0, 2.0]),
        swaps in any::<bool>(), reverses in any::<bool>(),
    ) {
        let meant = view.limit.get() * share;
        let mut wrong = view.encoding.clone();
        wrong.scale = Scale::of(wrong.scale.get() * other);
        if wrong.data_type.integer_range().is_some() {
            wrong.bias += bias;
        }
        wrong.byte_swap ^= swaps;
        if reverses {
            wrong.word_order = ORDERS[usize::from(wrong.word_order == ORDERS[0])];
        }
        let encoded = wrong.encode(meant * view.per_micron * factor);
        if view.admit(encoded.registers(), of(meant), 0.0, Micron::ZERO).is_ok() {
            let value = view.encoding.decode(encoded.registers()).unwrap();
            let read = value / view.per_micron;
            let slack = slack(&view, value.abs());
            prop_assert!(read.abs() <= view.limit.get() + slack, "{read} of {}", view.limit);
            prop_assert!((read - meant).abs() <= slack, "{read} for {meant}");
        }
    }

    /// Checks that the view admits no register values, whatever they are, with a correction above the limit.
    #[test]
    fn no_registers_at_all_carry_more_than_the_limit(
        view in views(), words in proptest::array::uniform4(any::<u16>()), centre in -500.0..500.0f64,
    ) {
        let words = &words[..usize::from(view.encoding.data_type.registers())];
        let Ok(value) = view.encoding.decode(words) else { return Ok(()) };
        let read = (value - centre) / view.per_micron;
        let Some(meant) = Micron::new(read) else { return Ok(()) };
        let slack = slack(&view, value.abs() + centre.abs());
        let admitted = view.admit(words, meant, centre, Micron::ZERO).is_ok();
        prop_assert!(!admitted || read.abs() <= view.limit.get() + slack);
        prop_assert!(admitted || read.abs() > view.limit.get() - slack);
    }
}
