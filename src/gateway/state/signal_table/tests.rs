use std::time::Duration;

use super::*;

const PROFILE: &str = r#"
[machine]
name = "m"
[bus.b]
type = "modbus-tcp"
address = "127.0.0.1:1"
timeout = "100ms"
[device.d]
bus = "b"
unit = 1
[signal.bed]
device = "d"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
range = [-10.0, 80.0]
max_rate = 2.0
max_age = "5s"
fault_when = "open == 1"
[signal.open]
device = "d"
register = "discrete:0"
type = "bool"
unit = "bool"
max_age = "5s"
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
deadband = 0.1
every = "10s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "one"
kind = "linear"
terms = [{ signal = "bed", gain = 1.0, reference = 0.0 }]
"#;

const BED: SignalId = SignalId(0);
const MAX_AGE: Duration = Duration::from_secs(5);
const OPEN: SignalId = SignalId(1);

fn profile() -> Profile {
    let parsed = isotherm_profile::parse(std::path::Path::new("m.toml"), PROFILE, &[], &[]);
    parsed.unwrap_or_else(|errors| panic!("{errors}")).profile
}

fn at(seconds: u64) -> Moment {
    Moment::default().after(Duration::from_secs(1000 + seconds))
}

/// Board on which both signals were good at 0 s.
fn board(profile: &Profile) -> SignalTable {
    let mut board = SignalTable::new(&profile.clone().into());
    board.store(BED, Ok(20.0), at(0), 0);
    board.store(OPEN, Ok(0.0), at(0), 0);
    board
}

fn quality(board: &mut SignalTable, now: Moment) -> Quality {
    board.check(now)[BED.0].quality
}

#[test]
fn a_value_outside_its_range_is_no_value() {
    let profile = profile();
    let mut board = board(&profile);
    board.store(BED, Ok(80.1), at(3600), 0);
    board.store(OPEN, Ok(0.0), at(3600), 0);
    assert_eq!(quality(&mut board, at(3600)), Quality::Bad(Reason::OutOfRange));
    assert_eq!(board.value(BED, at(3600)), None);
}

#[test]
fn a_value_that_changes_too_fast_is_believed_once_time_has_caught_up() {
    let profile = profile();
    let mut board = board(&profile);
    board.store(BED, Ok(23.0), at(1), 0);
    assert_eq!(quality(&mut board, at(1)), Quality::Bad(Reason::TooFast));
    board.store(BED, Ok(23.0), at(2), 0);
    assert_eq!(quality(&mut board, at(2)), Quality::Good);
}

#[test]
fn a_status_bit_condemns_it_and_so_does_one_that_is_not_known() {
    let profile = profile();
    let mut board = board(&profile);
    assert_eq!(quality(&mut board, at(1)), Quality::Good);
    board.store(OPEN, Ok(1.0), at(1), 0);
    assert_eq!(quality(&mut board, at(1)), Quality::Bad(Reason::FaultBit));
    board.store(OPEN, Ok(0.0), at(2), 0);
    board.store(BED, Ok(20.0), at(8), 0);
    assert_eq!(quality(&mut board, at(8)), Quality::Bad(Reason::FaultBit), "the bit is stale");
}

#[test]
fn what_a_status_bit_condemns_is_no_position_to_be_corrected() {
    let profile = profile();
    let mut board = board(&profile);
    board.store(OPEN, Ok(1.0), at(1), 0);
    assert_eq!(board.value(BED, at(1)), None);
}

#[test]
fn one_lost_answer_leaves_the_value_until_it_is_stale_and_then_says_why() {
    let profile = profile();
    let mut board = board(&profile);
    board.fail(BED, Reason::Timeout);
    assert_eq!(quality(&mut board, at(5)), Quality::Good);
    assert_eq!(quality(&mut board, at(6)), Quality::Bad(Reason::Timeout));
    let mut fresh = SignalTable::new(&profile.clone().into());
    fresh.fail(BED, Reason::LinkDown);
    assert_eq!(quality(&mut fresh, at(0)), Quality::Bad(Reason::LinkDown));
}

#[test]
fn a_change_is_reported_once_each_way_with_its_reason() {
    let profile = profile();
    let mut board = board(&profile);
    board.store(BED, Err(Reason::Sentinel), at(1), 0);
    for now in [at(1), at(2)] {
        board.check(now);
        let reported = board.changes(now, |_| false);
        let expected: &[QualityChange] =
            if now == at(1) { &[QualityChange::Lost(BED, Reason::Sentinel)] } else { &[] };
        assert_eq!(reported, expected);
    }
    board.store(BED, Ok(20.5), at(3), 0);
    board.check(at(3));
    assert_eq!(board.changes(at(3), |_| false), [QualityChange::Back(BED, at(1))]);
    board.check(at(4));
    assert_eq!(board.changes(at(4), |_| false), []);
}

/// A new reason is reported if it is found twice in a row, but not if it comes and goes.
#[test]
fn another_reason_is_reported_once_it_lasts_and_the_end_comes_with_the_first_begin() {
    let profile = profile();
    let mut board = board(&profile);
    let mut look = |second: u64, found: Result<f64, Reason>| {
        board.store(BED, found, at(second), 0);
        board.store(OPEN, Ok(0.0), at(second), 0);
        board.check(at(second));
        board.changes(at(second), |_| false)
    };
    assert_eq!(look(1, Err(Reason::OpenCircuit)), [QualityChange::Lost(BED, Reason::OpenCircuit)]);
    assert_eq!(look(2, Err(Reason::LinkDown)), []);
    assert_eq!(look(3, Err(Reason::OpenCircuit)), []);
    assert_eq!(look(4, Err(Reason::LinkDown)), []);
    assert_eq!(look(5, Err(Reason::LinkDown)), [QualityChange::Lost(BED, Reason::LinkDown)]);
    assert_eq!(look(6, Err(Reason::LinkDown)), []);
    assert_eq!(look(7, Ok(20.5)), [QualityChange::Back(BED, at(1))]);
}

/// A Modbus gateway answers for a device that does not. The loss of this device is reported once, not for each signal.
#[test]
fn a_signal_of_a_lost_device_behind_a_gateway_is_reported_only_if_it_outlasts_the_loss() {
    let profile = profile();
    for code in [10, 11] {
        let mut board = board(&profile);
        let mut look = |second: u64, found: Result<f64, Reason>, is_lost: bool| {
            board.store(BED, found, at(second), 0);
            board.store(OPEN, Ok(0.0), at(second), 0);
            board.check(at(second));
            board.changes(at(second), |_| is_lost)
        };
        let missing = || Err(Reason::Exception(code));
        assert_eq!(look(1, missing(), true), []);
        assert_eq!(look(2, missing(), true), []);
        assert_eq!(look(3, Ok(20.0), true), [], "the return of the device is reported instead");
        assert_eq!(look(4, missing(), true), []);
        assert_eq!(look(5, missing(), false), [QualityChange::Lost(BED, Reason::Exception(code))]);
        assert_eq!(look(6, missing(), false), []);
        assert_eq!(look(7, Ok(20.0), false), [QualityChange::Back(BED, at(4))]);
        assert_eq!(
            look(8, missing(), false),
            [QualityChange::Lost(BED, Reason::Exception(code))],
            "other registers of the device are read"
        );
        assert_eq!(look(9, Ok(20.0), false), [QualityChange::Back(BED, at(8))]);
        assert_eq!(
            look(10, Err(Reason::Exception(4)), true),
            [QualityChange::Lost(BED, Reason::Exception(4))]
        );
    }
}

/// The loss of a device or a line is reported separately. A signal that is still bad after its device has returned is
/// reported itself.
#[test]
fn a_reason_after_a_silent_device_is_reported_and_so_is_its_end() {
    let profile = profile();
    let mut board = board(&profile);
    let mut look = |second: u64, found: Result<f64, Reason>| {
        board.store(BED, found, at(second), 0);
        board.store(OPEN, Ok(0.0), at(second), 0);
        board.check(at(second));
        board.changes(at(second), |_| false)
    };
    assert_eq!(look(1, Err(Reason::Timeout)), []);
    assert_eq!(look(2, Ok(20.0)), []);
    assert_eq!(look(3, Err(Reason::Timeout)), []);
    assert_eq!(look(4, Err(Reason::OpenCircuit)), []);
    assert_eq!(look(5, Err(Reason::OpenCircuit)), [QualityChange::Lost(BED, Reason::OpenCircuit)]);
    assert_eq!(look(6, Ok(20.0)), [QualityChange::Back(BED, at(3))]);
}

#[test]
fn an_ambiguous_value_is_used_only_if_the_one_before_it_agrees() {
    let profile = profile();
    let mut board = board(&profile);
    let value = |board: &SignalTable, seconds| board.value(BED, at(seconds));
    board.store(OPEN, Ok(0.0), at(30), 0);
    board.store_ambiguous(BED, Ok(21.0), at(1), 0);
    assert_eq!(value(&board, 1), Some(21.0), "within max_rate of the one before");
    board.store_ambiguous(BED, Ok(41.2), at(2), 0);
    assert_eq!(value(&board, 2), Some(21.0), "the last good one serves meanwhile");
    board.store_ambiguous(BED, Ok(21.1), at(3), 0);
    assert_eq!(value(&board, 3), Some(21.0), "the one before it was another");
    board.store_ambiguous(BED, Ok(21.2), at(4), 0);
    assert_eq!(value(&board, 4), Some(21.2));
    for second in 5..12 {
        board.store_ambiguous(BED, Ok(if second % 2 == 0 { 21.2 } else { 41.2 }), at(second), 0);
    }
    assert_eq!(quality(&mut board, at(12)), Quality::Bad(Reason::BadReply), "none agreed until it was stale");
    // Contested answers are discarded. The next answer then has no predecessor to agree with.
    board.store(BED, Ok(21.0), at(15), 0);
    board.store_contested(BED);
    assert_eq!(value(&board, 15), Some(21.0));
    board.store_ambiguous(BED, Ok(21.1), at(16), 0);
    assert_eq!(value(&board, 16), Some(21.0));
    board.store_ambiguous(BED, Ok(21.1), at(17), 0);
    assert_eq!(value(&board, 17), Some(21.1));
    // Two foreign values in a row change too fast compared with the last used value, as long as that value is young.
    board.store(BED, Ok(21.0), at(20), 0);
    board.store_ambiguous(BED, Ok(41.2), at(21), 0);
    board.store_ambiguous(BED, Ok(41.2), at(22), 0);
    assert_eq!(quality(&mut board, at(22)), Quality::Bad(Reason::TooFast));
}

/// Without a recent good value, nothing shows that the values of another master are wrong.
#[test]
fn without_a_recent_good_value_thirty_ambiguous_values_in_a_row_must_agree() {
    let profile = profile();
    let ambiguous = |board: &mut SignalTable, seconds: std::ops::Range<u64>, value: f64| {
        for second in seconds {
            board.store(OPEN, Ok(0.0), at(second), 0);
            board.store_ambiguous(BED, Ok(value), at(second), 0);
        }
    };
    let mut after_a_start = SignalTable::new(&Arc::new(profile.clone()));
    ambiguous(&mut after_a_start, 1..30, 41.2);
    assert_eq!(after_a_start.value(BED, at(29)), None, "29 agree");
    ambiguous(&mut after_a_start, 30..31, 21.0);
    ambiguous(&mut after_a_start, 31..60, 41.2);
    assert_eq!(after_a_start.value(BED, at(59)), None, "29 agree again");
    ambiguous(&mut after_a_start, 60..61, 41.2);
    assert_eq!(after_a_start.value(BED, at(60)), Some(41.2));

    let mut after_a_gap = board(&profile);
    ambiguous(&mut after_a_gap, 100..129, 22.0);
    assert_eq!(after_a_gap.value(BED, at(128)), None, "the rate would allow the change by now");
    ambiguous(&mut after_a_gap, 129..130, 22.0);
    assert_eq!(after_a_gap.value(BED, at(129)), Some(22.0));

    // A bad value moves nothing, and must be reported soon.
    let mut broken = SignalTable::new(&Arc::new(profile.clone()));
    broken.store(OPEN, Ok(0.0), at(1), 0);
    for second in [1, 2] {
        broken.store_ambiguous(BED, Err(Reason::OpenCircuit), at(second), 0);
    }
    assert_eq!(quality(&mut broken, at(2)), Quality::Bad(Reason::OpenCircuit));
}

#[test]
fn without_max_rate_two_values_agree_if_they_are_the_same() {
    let profile = profile();
    let mut board = board(&profile);
    let value = |board: &SignalTable, seconds| board.value(OPEN, at(seconds));
    for (second, read, used) in [(1, 1.0, 0.0), (2, 1.0, 1.0), (3, 0.0, 1.0), (4, 1.0, 1.0), (5, 1.0, 1.0)] {
        board.store_ambiguous(OPEN, Ok(read), at(second), 0);
        assert_eq!(value(&board, second), Some(used), "second {second}");
    }
    board.store_ambiguous(OPEN, Err(Reason::NotANumber), at(6), 0);
    assert_eq!(value(&board, 6), Some(1.0));
    board.store_ambiguous(OPEN, Err(Reason::NotANumber), at(7), 0);
    assert_eq!(value(&board, 7), None);
}

#[test]
fn a_reading_before_another_master_was_noticed_serves_on_only_if_its_rate_was_checked() {
    let profile = profile();
    let mut board = board(&profile);
    for _ in 1..30 {
        board.store(BED, Ok(20.0), at(0), 0);
    }
    board.doubt(BED);
    assert_eq!(board.latest().taken(BED), at(0));
    assert_eq!(board.value(BED, at(1)), Some(20.0), "it has max_rate");
    board.doubt(OPEN);
    assert_eq!(board.value(OPEN, at(1)), None);
    board.store_ambiguous(OPEN, Ok(0.0), at(2), 0);
    assert_eq!(board.value(OPEN, at(2)), None, "the one before it may have been another's");
    board.store_ambiguous(OPEN, Ok(0.0), at(3), 0);
    assert_eq!(board.value(OPEN, at(3)), Some(0.0));
}

/// Before another master is noticed, its values look like readings. A few of them must not become the value with which
/// the later ones are compared.
#[test]
fn a_few_good_values_before_another_master_was_noticed_confirm_no_later_ones() {
    let profile = profile();
    let mut board = SignalTable::new(&Arc::new(profile));
    let fresh = |board: &mut SignalTable, second| board.store(OPEN, Ok(0.0), at(second), 0);
    for second in 0..29 {
        fresh(&mut board, second);
        board.store(BED, Ok(41.2), at(second), 0);
    }
    assert_eq!(board.value(BED, at(28)), Some(41.2));
    board.doubt(BED);
    assert_eq!(board.value(BED, at(28)), None);
    for second in 29..58 {
        fresh(&mut board, second);
        assert!(!board.store_ambiguous(BED, Ok(41.2), at(second), 0), "{second}");
    }
    assert!(board.store_ambiguous(BED, Ok(41.2), at(58), 0));
    board.doubt(BED);
    assert_eq!(board.value(BED, at(58)), Some(41.2), "thirty have agreed");
}

/// Values that wait for their confirmation end the time without a value: from then on, waiting allows no larger jump.
#[test]
fn waiting_for_agreeing_values_allows_no_larger_jump_after_a_start() {
    let profile = profile();
    let mut board = SignalTable::new(&Arc::new(profile));
    let before = LastGood { value: 20.0, age: Duration::from_secs(2), exponent: None };
    board.recall(&BTreeMap::from([("bed".to_owned(), before)]), at(0));
    for second in 1..=60 {
        board.store(OPEN, Ok(0.0), at(second), 0);
        board.store_ambiguous(BED, Ok(41.2), at(second), 1);
    }
    assert_eq!(quality(&mut board, at(60)), Quality::Bad(Reason::Jumped));
}

/// Profile whose temperature has no limits of its own.
fn unlimited(keys: &str) -> Profile {
    let text = PROFILE.replace("range = [-10.0, 80.0]\nmax_rate = 2.0\n", keys);
    let parsed = isotherm_profile::parse(std::path::Path::new("m.toml"), &text, &[], &[]);
    parsed.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Values for an open circuit in devices whose `bad` is not known. They are the least 16-bit count and the largest
/// 32-bit count in tenths, and a large floating-point number.
#[test]
fn a_temperature_of_a_model_has_a_range_and_a_rate_without_keys() {
    let profile = unlimited("");
    for (value, reason) in [
        (-3276.8, Reason::OutOfRange),
        (214_748_364.7, Reason::OutOfRange),
        (1e30, Reason::OutOfRange),
        (200.1, Reason::OutOfRange),
        (-40.1, Reason::OutOfRange),
        (25.1, Reason::TooFast),
        (14.9, Reason::TooFast),
    ] {
        let mut board = board(&profile);
        board.store(BED, Ok(value), at(1), 0);
        assert_eq!(quality(&mut board, at(1)), Quality::Bad(reason), "{value}");
    }
    for value in [24.9, 15.1] {
        let mut board = board(&profile);
        board.store(BED, Ok(value), at(1), 0);
        assert_eq!(board.value(BED, at(1)), Some(value));
    }
}

#[test]
fn none_switches_each_limit_off_and_a_difference_has_none() {
    let of = |keys: &str, value: f64| {
        let profile = unlimited(keys);
        let mut board = board(&profile);
        board.store(BED, Ok(value), at(1), 0);
        quality(&mut board, at(1))
    };
    let too_fast = Quality::Bad(Reason::TooFast);
    assert_eq!(of("range = \"none\"\n", 1e30), too_fast);
    assert_eq!(of("max_rate = \"none\"\n", 200.0), Quality::Good);
    assert_eq!(of("max_rate = \"none\"\n", 200.1), Quality::Bad(Reason::OutOfRange));
    assert_eq!(of("range = \"none\"\nmax_rate = \"none\"\n", 1e30), Quality::Good);
    assert_eq!(of("difference = true\n", -3276.8), Quality::Good);
    assert_eq!(of("difference = true\nrange = [-10.0, 80.0]\n", 80.1), Quality::Bad(Reason::OutOfRange));
}

/// The default rate is too wide to distinguish the answers of two masters.
#[test]
fn a_default_rate_confirms_no_ambiguous_value() {
    let profile = unlimited("");
    let mut board = board(&profile);
    board.store_ambiguous(BED, Ok(21.0), at(1), 0);
    assert_eq!(board.value(BED, at(1)), Some(20.0), "the value before it was another");
    board.store_ambiguous(BED, Ok(21.0), at(2), 0);
    assert_eq!(board.value(BED, at(2)), Some(21.0));
    board.doubt(BED);
    assert_eq!(board.value(BED, at(2)), None);
}

/// Registers with this count.
fn raw(count: u16) -> Result<Encoded, Reason> {
    Ok(Encoded::of(&[count]))
}

#[test]
fn a_value_of_another_answer_waits_for_the_read_of_its_scale() {
    let profile = profile();
    let mut board = SignalTable::new(&profile.clone().into());
    let value =
        |board: &SignalTable, seconds| board.latest().readings[BED.0].aged(at(seconds), MAX_AGE).usable();
    board.store_scaled(BED, raw(200), at(0), 0, ScalePlace::OtherAnswer);
    assert_eq!(value(&board, 0), None);
    board.store_scale(BED, Ok(0), 0);
    assert_eq!(value(&board, 0), Some(20.0));
    // Between two different scales, a value is not used. The scale is used again when it has been read twice.
    board.store_scaled(BED, raw(2000), at(1), 0, ScalePlace::OtherAnswer);
    board.store_scale(BED, Ok(-1), 0);
    assert_eq!(value(&board, 1), None);
    board.store_scaled(BED, raw(2010), at(2), 0, ScalePlace::OtherAnswer);
    board.store_scale(BED, Ok(-1), 0);
    assert_eq!(value(&board, 2), Some(20.1));
    board.check(at(2));
    assert!(board.changes(at(2), |_| false).contains(&QualityChange::ScaleChanged(BED, 0, -1)));
    // A break of the continuity of the device, or a pause, discards the value that waits.
    board.store_scaled(BED, raw(2020), at(3), 0, ScalePlace::OtherAnswer);
    board.store_scale(BED, Ok(-1), 1);
    assert_eq!(value(&board, 3), Some(20.1));
    board.store_scaled(BED, raw(2020), at(4), 1, ScalePlace::OtherAnswer);
    board.forget();
    board.store_scale(BED, Ok(-1), 1);
    assert_eq!(value(&board, 4), None);
}

#[test]
fn after_a_change_of_its_scale_a_value_is_bad_until_it_is_plausible_or_confirmed() {
    let profile = profile();
    let mut board = SignalTable::new(&profile.clone().into());
    let mut look = |seconds, exponent, count| {
        board.store_scale(BED, Ok(exponent), 0);
        board.store_scaled(BED, raw(count), at(seconds), 0, ScalePlace::SameAnswer);
        board.latest().readings[BED.0].quality
    };
    assert_eq!(look(0, 0, 200), Quality::Good);
    assert_eq!(look(1, -1, 200), Quality::Bad(Reason::ScaleChanged));
    // Two degrees instead of twenty: waiting does not make it plausible.
    for seconds in 2..60 {
        assert_eq!(look(seconds, -1, 200), Quality::Bad(Reason::ScaleChanged), "{seconds}");
    }
    assert_eq!(look(60, -1, 2005), Quality::Good);
    assert_eq!(look(61, 0, 2005), Quality::Bad(Reason::ScaleChanged));
    assert_eq!(look(62, 0, 2005), Quality::Bad(Reason::OutOfRange), "200.5 °C is beyond its range");
    assert_eq!(look(63, 0, 450), Quality::Bad(Reason::ScaleChanged));
    assert_eq!(board.confirm(DeviceId(0)), ["bed"]);
    board.store_scaled(BED, raw(450), at(64), 0, ScalePlace::SameAnswer);
    assert_eq!(board.latest().readings[BED.0].quality, Quality::Good);
}

#[test]
fn a_value_out_of_range_after_a_change_of_the_scale_makes_no_later_value_plausible() {
    let profile = profile();
    let mut board = SignalTable::new(&profile.clone().into());
    let mut look = |seconds, exponent, count| {
        board.store_scale(BED, Ok(exponent), 0);
        board.store_scaled(BED, raw(count), at(seconds), 0, ScalePlace::SameAnswer);
        board.latest().readings[BED.0].quality
    };
    assert_eq!(look(0, 0, 200), Quality::Good);
    assert_eq!(look(1, 1, 450), Quality::Bad(Reason::ScaleChanged));
    for seconds in 2..3600 {
        assert_eq!(look(seconds, 1, 450), Quality::Bad(Reason::OutOfRange), "450 °C, {seconds}");
    }
    assert_eq!(look(3600, 1, 45), Quality::Bad(Reason::ScaleChanged));
    assert_eq!(look(3601, 0, 450), Quality::Bad(Reason::ScaleChanged));
    assert_eq!(look(3602, 0, 450), Quality::Bad(Reason::ScaleChanged), "45 °C again");
    assert_eq!(look(3603, 0, 200), Quality::Good);
}

#[test]
fn a_doubtful_line_discards_a_value_that_waits_for_its_scale() {
    let profile = profile();
    let mut board = SignalTable::new(&profile.clone().into());
    board.store_scale(BED, Ok(0), 0);
    board.store_scaled(BED, raw(200), at(0), 0, ScalePlace::OtherAnswer);
    board.doubt(BED);
    board.store_scale(BED, Ok(0), 0);
    assert_eq!(board.latest().readings[BED.0].quality, Quality::Bad(Reason::NeverRead));
}

#[test]
fn a_scale_that_changed_while_the_gateway_was_stopped_is_reported_and_its_value_compared() {
    // The check of the device does not include the scale.
    let check = "unit = 1\nverify = [{ register = \"holding:7\", equals = 1 }]";
    let parsed = |text: &str| {
        let parsed = isotherm_profile::parse(std::path::Path::new("m.toml"), text, &[], &[]);
        Arc::new(parsed.unwrap_or_else(|errors| panic!("{errors}")).profile)
    };
    let text =
        PROFILE.replacen("scale = 0.1", "decimals_from = \"input:9\"", 1).replacen("unit = 1", check, 1);
    let profile = parsed(&text);
    let run = |board: &mut SignalTable, seconds, exponent, count| {
        board.store_scale(BED, Ok(exponent), 0);
        board.store_scaled(BED, raw(count), at(seconds), 0, ScalePlace::SameAnswer);
        board.latest().readings[BED.0].quality
    };
    let mut before = SignalTable::new(&profile);
    assert_eq!(run(&mut before, 0, -1, 200), Quality::Good);
    let values = before.last_good(at(1));
    assert_eq!(values["bed"].exponent, Some(-1));
    let mut board = SignalTable::new(&profile);
    board.recall(&values, at(2));
    assert_eq!(run(&mut board, 2, -2, 200), Quality::Bad(Reason::ScaleChanged));
    assert_eq!(run(&mut board, 3, -2, 200), Quality::Bad(Reason::ScaleChanged), "2 °C");
    board.check(at(3));
    assert!(board.changes(at(3), |_| false).contains(&QualityChange::ScaleChanged(BED, -1, -2)));
    assert_eq!(run(&mut board, 4, -2, 2000), Quality::Good);
    // With the same scale, the first value is used.
    let mut board = SignalTable::new(&profile);
    board.recall(&values, at(2));
    assert_eq!(run(&mut board, 2, -1, 201), Quality::Good);
}

#[test]
fn a_register_without_a_scale_gives_its_reason_to_the_value() {
    let profile = profile();
    let mut board = SignalTable::new(&profile.clone().into());
    board.store_scale(BED, Err(Reason::NoScale), 0);
    board.store_scaled(BED, raw(200), at(0), 0, ScalePlace::SameAnswer);
    assert_eq!(board.latest().readings[BED.0].quality, Quality::Bad(Reason::NoScale));
    board.store_scale(BED, Ok(0), 0);
    board.store_scaled(BED, Err(Reason::BadReply), at(1), 0, ScalePlace::SameAnswer);
    assert_eq!(board.latest().readings[BED.0].quality, Quality::Bad(Reason::BadReply));
}
