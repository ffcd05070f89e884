#![allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "counts of at most 33 bits")]

use proptest::prelude::*;

use super::*;
use crate::codec::{Part, Scale, Whole, WordOrder};

const POLL: Duration = Duration::from_millis(20);

fn encoding(data_type: DataType) -> Encoding {
    Encoding {
        data_type,
        word_order: WordOrder::LswFirst,
        byte_swap: false,
        scale: Scale::of(0.0005),
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    }
}

/// Spindle head: rapid traverse 300 mm/s, half a micrometre per count.
fn counter() -> Counter {
    Counter { max_speed: 300.0, slack: POLL }
}

/// Positions, in counts, for counts read every 20 ms. `Err(None)` is a doubtful value; `Err(Some(…))` is a new
/// reference.
fn tracked(data_type: DataType, counts: &[i64]) -> Vec<Result<i64, Option<(i64, i64)>>> {
    let encoding = encoding(data_type);
    let mut tracked = Tracked::default();
    let back = |position: f64| (position / encoding.scale.get()).round() as i64;
    let mut at = Moment::from_nanos(0);
    let each = counts.iter().map(|count| {
        at = at.after(POLL);
        match tracked.take(&counter(), &encoding, *count as f64 * encoding.scale.get(), at) {
            Motion::To(position) => Ok(back(position)),
            Motion::Doubtful => Err(None),
            Motion::Rereferenced { from, to } => Err(Some((back(from), back(to)))),
        }
    });
    each.collect()
}

#[test]
fn a_counter_that_rolls_over_goes_on() {
    let part = DataType::Part(Part::new(8, 31, Whole::U32).unwrap());
    let cases: [(DataType, &[i64], &[i64]); 9] = [
        (DataType::Bcd(4), &[4, 9_996, 9_990, 3], &[4, -4, -10, 3]),
        (DataType::unsigned(24), &[10, 2, 16_777_210], &[10, 2, -6]),
        (DataType::signed(24), &[8_388_600, -8_388_600], &[8_388_600, 8_388_616]),
        (part, &[16_777_210, 4], &[-6, 4]),
        (DataType::U32, &[10, 2, 4_294_967_290], &[10, 2, -6]),
        (DataType::U32, &[4_294_967_290, 4], &[-6, 4]),
        (DataType::I32, &[2_147_483_640, -2_147_483_640], &[2_147_483_640, 2_147_483_656]),
        (DataType::U16, &[20_000, 32_000, 44_000, 56_000, 2_464], &[20_000, 32_000, 44_000, 56_000, 68_000]),
        (DataType::I16, &[-32_760, 32_760, 32_761], &[-32_760, -32_776, -32_775]),
    ];
    for (data_type, counts, positions) in cases {
        let positions: Vec<_> = positions.iter().map(|position| Ok(*position)).collect();
        assert_eq!(tracked(data_type, counts), positions, "{data_type:?}");
    }
}

#[test]
fn one_garbled_value_is_no_motion_and_no_new_reference() {
    assert_eq!(
        tracked(DataType::I32, &[1000, 1010, 900_000_000, 1020, 1030]),
        [Ok(1000), Ok(1010), Err(None), Ok(1020), Ok(1030)]
    );
    // Two corrupted values that contradict each other are rejected as well.
    assert_eq!(
        tracked(DataType::I32, &[1000, 900_000_000, -900_000_000, 1020]),
        [Ok(1000), Err(None), Err(None), Ok(1020)]
    );
}

#[test]
fn a_step_that_the_axis_cannot_make_is_a_new_reference_once_it_is_confirmed() {
    assert_eq!(
        tracked(DataType::I32, &[400_000, 0, 3, 6]),
        [Ok(400_000), Err(None), Err(Some((400_000, 3))), Ok(6)]
    );
    // At 300 mm/s, poll period plus slack allow 12 mm, 24,000 counts.
    assert_eq!(tracked(DataType::I32, &[0, 24_000, 48_000]), [Ok(0), Ok(24_000), Ok(48_000)]);
    assert_eq!(tracked(DataType::I32, &[0, 24_002]), [Ok(0), Err(None)]);
}

#[test]
fn out_of_sight_for_longer_than_it_takes_to_go_round_only_what_it_shows_is_known() {
    let encoding = encoding(DataType::U16);
    assert_eq!(counter().half_way(&encoding), Some(Duration::from_nanos(54_613_333)));
    let mut tracked = Tracked::default();
    let mut at = Moment::from_nanos(0);
    for count in [0.0, 15_000.0, 30_000.0, 45_000.0] {
        at = at.after(POLL);
        tracked.take(&counter(), &encoding, count * encoding.scale.get(), at);
    }
    at = at.after(Duration::from_secs(60));
    let motion = tracked.take(&counter(), &encoding, 100.0 * encoding.scale.get(), at);
    assert_eq!(motion, Motion::Rereferenced { from: 22.5, to: 0.05 });
    // A counter that never rolled over shows its position.
    at = at.after(Duration::from_secs(60));
    let motion = tracked.take(&counter(), &encoding, 200.0 * encoding.scale.get(), at);
    assert_eq!(motion, Motion::To(0.1));
}

#[test]
fn what_never_rolled_over_is_the_very_number_that_decoding_gives() {
    let encoding = encoding(DataType::I32);
    for count in [0_i32, 1, -229, 123_457] {
        let low = u16::try_from(count & 0xFFFF).unwrap();
        let value = encoding.decode(&[low, u16::try_from((count >> 16) & 0xFFFF).unwrap()]).unwrap();
        let motion = Tracked::default().take(&counter(), &encoding, value, Moment::from_nanos(0));
        assert_eq!(motion, Motion::To(value));
    }
}

proptest! {
    #[test]
    fn any_path_that_the_axis_can_travel_is_followed_through_every_rollover(
        start in -30_000_i64..30_000,
        steps in proptest::collection::vec(-16_000_i64..16_000, 1..200),
        which in 0_usize..4,
    ) {
        let data_type = [DataType::U16, DataType::I16, DataType::U32, DataType::I32][which];
        let modulus = Counter::modulus(data_type).unwrap();
        let mut path = vec![start];
        path.extend(steps.iter().scan(start, |at, step| { *at += step; Some(*at) }));
        let signed = matches!(data_type, DataType::I16 | DataType::I32);
        let shown = |position: &i64| match position.rem_euclid(modulus) {
            count if signed && count >= modulus / 2 => count - modulus,
            count => count,
        };
        let counts: Vec<i64> = path.iter().map(shown).collect();
        let positions: Vec<_> = path.iter().map(|position| Ok(*position)).collect();
        prop_assert_eq!(tracked(data_type, &counts), positions);
    }
}

#[test]
fn a_counter_shows_a_value_beyond_its_last_count_from_its_first_count_on() {
    for (data_type, value, registers) in [
        (DataType::unsigned(24), -0.0005, [0xffff, 0x00ff]),
        (DataType::unsigned(24), 8388.608, [0, 0]),
        (DataType::signed(24), -0.0005, [0xffff, 0x00ff]),
        (DataType::I32, -0.0005, [0xffff, 0xffff]),
    ] {
        let encoding = encoding(data_type);
        assert_eq!(Counter::registers(&encoding, value).registers(), registers, "{data_type:?} {value}");
    }
    let float = encoding(DataType::F32);
    assert_eq!(Counter::registers(&float, 1.0), float.encode(1.0));
}

/// Encoders with 24 bits either leave the highest byte of the second register zero, or extend the sign.
#[test]
fn the_byte_above_24_bits_is_ignored() {
    let (signed, unsigned) = (encoding(DataType::signed(24)), encoding(DataType::unsigned(24)));
    for high in [0x00ff, 0xffff, 0x12ff] {
        assert_eq!(signed.decode(&[0xffff, high]), Ok(-0.0005));
        assert_eq!(unsigned.decode(&[0xffff, high]), Ok(8388.6075));
    }
}
