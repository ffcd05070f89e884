use std::time::Duration;

use super::{Break, CheckFailure, Continuity, DeviceContinuity, Difference, Identity, RateFault, RateFilter};
use crate::quantity::Moment;

const PERIOD: Duration = Duration::from_secs(1);

fn at(seconds: f64) -> Moment {
    Moment::default().after(Duration::from_secs(1000) + Duration::from_secs_f64(seconds))
}

fn checked() -> DeviceContinuity {
    let mut device = DeviceContinuity::new(Identity::Checks, PERIOD, at(0.0));
    device.verified(0, Vec::new());
    device.answers(at(0.0));
    assert!(device.is_confirmed());
    device
}

fn difference() -> Difference {
    Difference {
        what: "holding:90 (40091)".into(),
        was: "5".into(),
        is: CheckFailure::Value("6".into()),
        meaning: "decimal point".into(),
        remedy: String::new(),
    }
}

#[test]
fn a_device_is_unconfirmed_until_its_checks_pass() {
    let mut device = DeviceContinuity::new(Identity::Checks, PERIOD, at(0.0));
    assert_eq!(*device.state(), Continuity::Unconfirmed { since: at(0.0), cause: Break::Start });
    assert!(device.verified(0, Vec::new()).is_some());
    assert!(device.is_confirmed());
    assert!(DeviceContinuity::new(Identity::None, PERIOD, at(0.0)).is_confirmed(), "nothing identifies it");
}

#[test]
fn each_cause_breaks_continuity_and_the_first_one_is_kept() {
    let causes = [
        Break::Refused,
        Break::ConnectionLost,
        Break::NewConnection,
        Break::InterfaceDown,
        Break::Restarted,
        Break::MachineOn,
        Break::Pause,
    ];
    for cause in causes {
        let mut device = checked();
        device.breaks(cause, at(3.0));
        device.breaks(Break::Silence, at(4.0));
        assert_eq!(*device.state(), Continuity::Unconfirmed { since: at(3.0), cause });
        assert_eq!(device.breaks_so_far(), 2);
    }
}

#[test]
fn a_check_that_was_read_before_a_break_confirms_nothing() {
    let mut device = checked();
    device.breaks(Break::Refused, at(1.0));
    let before = device.breaks_so_far();
    device.breaks(Break::ConnectionLost, at(2.0));
    assert_eq!(device.verified(before, Vec::new()), None);
    assert!(!device.is_confirmed());
    assert!(device.verified(device.breaks_so_far(), Vec::new()).is_some());
    assert!(device.is_confirmed());
}

#[test]
fn a_changed_device_stays_changed_over_breaks_until_its_checks_pass() {
    let mut device = checked();
    device.verified(0, vec![difference()]);
    device.breaks(Break::Refused, at(1.0));
    assert_eq!(*device.state(), Continuity::Changed(vec![difference()]));
    device.verified(1, Vec::new());
    assert!(device.is_confirmed());
}

#[test]
fn continuity_has_lasted_as_long_as_nothing_broke_it_since_the_checks_passed() {
    let mut device = DeviceContinuity::new(Identity::Checks, PERIOD, at(0.0));
    assert!(!device.has_lasted());
    device.verified(device.breaks_so_far(), Vec::new());
    device.verified(device.breaks_so_far(), vec![difference()]);
    assert!(device.has_lasted());
    device.breaks(Break::ConnectionLost, at(1.0));
    device.verified(device.breaks_so_far(), vec![difference()]);
    assert!(!device.has_lasted());
    device.verified(device.breaks_so_far(), Vec::new());
    assert!(device.has_lasted());
}

#[test]
fn one_lost_answer_is_no_break_and_silence_is_one() {
    // Times of the unanswered requests after an answer at 0 s, and whether continuity is broken then.
    let table: [(&[f64], bool); 6] = [
        (&[1.0], false),
        (&[5.0], false),
        (&[1.0, 1.5], false),
        (&[1.0, 2.0], true),
        (&[1.0, 1.2, 1.4, 1.9], false),
        (&[1.0, 1.2, 1.4, 2.1], true),
    ];
    for (misses, is_broken) in table {
        let mut device = checked();
        misses.iter().for_each(|moment| device.misses(at(*moment)));
        assert_eq!(!device.is_confirmed(), is_broken, "misses at {misses:?}");
    }
    let mut device = checked();
    for second in 1..200 {
        device.misses(at(f64::from(second)));
        device.answers(at(f64::from(second) + 0.5));
    }
    assert!(device.is_confirmed(), "an answer after each lost one");
}

#[test]
fn a_silence_that_becomes_long_after_its_last_miss_is_one_break() {
    let silent = || {
        let mut device = checked();
        device.misses(at(0.3));
        device.misses(at(0.6));
        assert!(device.is_confirmed());
        device
    };
    let mut asked = silent();
    asked.notice_silence(at(1.9));
    assert!(asked.is_confirmed());
    asked.notice_silence(at(2.1));
    asked.answers(at(2.2));
    assert!(!asked.is_confirmed() && asked.breaks_so_far() == 1);
    let mut answers = silent();
    answers.answers(at(2.1));
    assert!(!answers.is_confirmed() && answers.breaks_so_far() == 1);
    let mut answers = checked();
    answers.misses(at(0.3));
    answers.answers(at(9.0));
    assert!(answers.is_confirmed(), "one lost answer is no silence");
}

#[test]
fn lasting_silence_is_one_break() {
    let mut device = checked();
    (1..100).for_each(|second| device.misses(at(f64::from(second))));
    assert_eq!(device.breaks_so_far(), 1);
    device.answers(at(100.0));
    (101..110).for_each(|second| device.misses(at(f64::from(second))));
    assert_eq!(device.breaks_so_far(), 2);
}

#[test]
fn a_value_after_a_break_does_not_become_plausible_by_waiting() {
    let mut filter = RateFilter::default();
    let rate = Some(0.1);
    assert_eq!(filter.assess(25.1, at(0.0), rate, 0), Ok(()));
    // Whole degrees are read instead of tenths.
    for second in 20..2000 {
        assert_eq!(filter.assess(2.5, at(f64::from(second)), rate, 1), Err(RateFault::Jumped), "{second} s");
    }
    // Another break a second later increases the allowed change by that of one second.
    assert_eq!(filter.assess(2.5, at(2000.0), rate, 2), Err(RateFault::Jumped));
    // Two degrees in twenty-one seconds are plausible.
    assert_eq!(filter.assess(27.1, at(2001.0), rate, 2), Ok(()));
    assert_eq!(filter.assess(27.3, at(2002.0), rate, 2), Err(RateFault::TooFast));
}

#[test]
fn a_device_that_is_off_for_a_night_may_return_with_any_plausible_value() {
    let mut filter = RateFilter::default();
    let rate = Some(0.01);
    assert_eq!(filter.assess(35.0, at(0.0), rate, 0), Ok(()));
    // The first value after a reset is 0, which is invalid.
    assert_eq!(filter.assess(0.0, at(5.0), rate, 1), Err(RateFault::Jumped));
    // The device is off until the morning, and seventeen degrees colder.
    assert_eq!(filter.assess(18.0, at(36_000.0), rate, 2), Ok(()));
}

#[test]
fn a_break_while_a_real_step_is_too_fast_keeps_nothing_out() {
    let mut filter = RateFilter::default();
    let rate = Some(0.5);
    assert_eq!(filter.assess(20.0, at(0.0), rate, 0), Ok(()));
    for second in 1..8 {
        assert_eq!(filter.assess(30.0, at(f64::from(second)), rate, 0), Err(RateFault::TooFast));
    }
    for second in 8..20 {
        assert_eq!(
            filter.assess(30.0, at(f64::from(second)), rate, 1),
            Err(RateFault::TooFast),
            "{second} s"
        );
    }
    assert_eq!(filter.assess(30.0, at(20.0), rate, 1), Ok(()));
}

/// A module sends 0 while its supply fails. Three seconds later it is back.
#[test]
fn a_rejected_value_before_a_break_does_not_keep_the_right_one_out() {
    let mut filter = RateFilter::default();
    let rate = Some(5.0);
    assert_eq!(filter.assess(25.0, at(0.0), rate, 0), Ok(()));
    assert_eq!(filter.assess(0.0, at(1.0), rate, 0), Err(RateFault::TooFast));
    let mut other = filter;
    assert_eq!(filter.assess(25.2, at(4.0), rate, 1), Ok(()));
    // Another device is compared with both values.
    for second in 4..400 {
        let assessed = other.assess(60.0, at(f64::from(second)), rate, 1);
        assert_eq!(assessed, Err(RateFault::Jumped), "{second} s");
    }
}

/// After a break, a device shows a value out of its range for an hour, and then a value within it.
#[test]
fn a_rejected_value_after_a_break_ends_the_time_in_which_the_allowed_change_grows() {
    let (rate, hour) = (0.1, 3600.0);
    let mut filter = RateFilter::default();
    assert_eq!(filter.assess(20.0, at(0.0), Some(rate), 0), Ok(()));
    (1..3600).for_each(|second| filter.reject(200.0, at(f64::from(second)), rate, 1));
    assert!(filter.has_jumped());
    assert_eq!(filter.assess(45.0, at(hour), Some(rate), 1), Err(RateFault::Jumped));
    assert_eq!(filter.assess(45.0, at(hour + 1.0), Some(rate), 2), Err(RateFault::Jumped), "another break");
    assert_eq!(filter.assess(20.1, at(hour + 2.0), Some(rate), 2), Ok(()));
    // A rejected first value is compared with nothing, and does not become the last good value.
    filter.forget();
    filter.reject(200.0, at(hour + 3.0), rate, 3);
    assert_eq!(filter.before_stop(at(hour + 3.0), rate), None);
    assert_eq!(filter.assess(45.0, at(hour + 4.0), Some(rate), 3), Ok(()));
}

#[test]
fn a_device_with_checks_needs_no_comparison_and_keeps_its_setup_over_a_pause() {
    let mut device = checked();
    for (cause, resets) in
        [(Break::Pause, 0), (Break::MachineOn, 0), (Break::Restarted, 1), (Break::Refused, 2)]
    {
        device.breaks(cause, at(1.0));
        assert_eq!(device.resets_so_far(), resets, "{cause}");
    }
    assert_eq!((device.breaks_so_far(), device.breaks_without_checks()), (4, 0));
    let mut plain = DeviceContinuity::new(Identity::None, PERIOD, at(0.0));
    plain.breaks(Break::Refused, at(1.0));
    assert_eq!(plain.breaks_without_checks(), 1);
}

#[test]
fn without_a_break_a_value_that_stays_is_accepted_in_time() {
    let mut filter = RateFilter::default();
    assert_eq!(filter.assess(20.0, at(0.0), Some(1.0), 7), Ok(()));
    assert_eq!(filter.assess(25.0, at(1.0), Some(1.0), 7), Err(RateFault::TooFast));
    assert_eq!(filter.assess(25.0, at(5.0), Some(1.0), 7), Ok(()));
    assert_eq!(filter.assess(99.0, at(6.0), None, 8), Ok(()), "a signal without max_rate");
}

#[test]
fn a_confirmed_signal_takes_its_next_value() {
    let mut filter = RateFilter::default();
    assert_eq!(filter.assess(25.0, at(0.0), Some(0.1), 0), Ok(()));
    assert_eq!(filter.assess(80.0, at(9.0), Some(0.1), 1), Err(RateFault::Jumped));
    filter.forget();
    assert_eq!(filter.assess(80.0, at(10.0), Some(0.1), 1), Ok(()));
}

#[test]
fn a_difference_says_what_was_expected_and_what_was_found() {
    let mut difference = difference();
    assert_eq!(difference.to_string(), "holding:90 (40091) reads 6 instead of 5 (decimal point)");
    difference.remedy = "set it to 5 at the panel".into();
    assert_eq!(
        difference.to_string(),
        "holding:90 (40091) reads 6 instead of 5 (decimal point): set it to 5 at the panel"
    );
    difference.is = CheckFailure::Unreadable("no answer in time".into());
    assert_eq!(
        difference.to_string(),
        "holding:90 (40091) cannot be read: no answer in time (decimal point): set it to 5 at the panel"
    );
}

#[test]
fn the_first_value_after_a_start_must_fit_to_the_last_good_one_of_the_run_before() {
    // Time since the last good value of 20.0, first value, and whether it is plausible at 0.1 per second.
    let table =
        [(0.0, 20.05, true), (0.0, 20.5, false), (10.0, 20.9, true), (10.0, 2.0, false), (3600.0, 2.0, true)];
    for (away, value, is_plausible) in table {
        let mut filter = RateFilter::after_start(20.0, at(5.0), Duration::from_secs_f64(away));
        let assessed = filter.assess(value, at(5.0), Some(0.1), 0);
        assert_eq!(assessed.is_ok(), is_plausible, "{value} after {away} s");
        if !is_plausible {
            assert_eq!(assessed, Err(RateFault::Jumped));
            assert_eq!(filter.assess(value, at(500.0), Some(0.1), 0), Err(RateFault::Jumped), "also later");
            filter.forget();
        }
        assert_eq!(filter.assess(value, at(501.0), Some(0.1), 0), Ok(()));
        assert_eq!(filter.before_stop(at(504.0), 0.1), Some((value, Duration::from_secs(3))));
    }
}

#[test]
fn what_a_jump_is_compared_with_survives_any_number_of_starts() {
    let minute = Duration::from_secs(60);
    let mut filter = RateFilter::after_start(20.0, at(0.0), minute);
    for start in 1..10 {
        // No value arrives in this run.
        let (value, away) = filter.before_stop(at(5.0), 0.1).unwrap();
        assert_eq!((value, away), (20.0, minute + Duration::from_secs(5 * start)));
        filter = RateFilter::after_start(value, at(0.0), away);
    }
    let allowed = 0.1 * (60.0 + 45.0);
    for _ in 0..10 {
        // Every value of this run jumps, for an hour.
        (0..60).for_each(|minute| {
            let assessed = filter.assess(20.0 + allowed + 1.0, at(60.0 * f64::from(minute)), Some(0.1), 0);
            assert_eq!(assessed, Err(RateFault::Jumped));
        });
        let (value, away) = filter.before_stop(at(3600.0), 0.1).unwrap();
        assert!(
            (value - 20.0).abs() < 1e-9 && (away.as_secs_f64() - 105.0).abs() < 1e-6,
            "{value}, {away:?}"
        );
        filter = RateFilter::after_start(value, at(0.0), away);
    }
    assert_eq!(filter.assess(20.0 + allowed - 1.0, at(0.0), Some(0.1), 0), Ok(()));
}

/// A doubted value must neither remain for comparison, nor be stored for the next run.
#[test]
fn a_good_value_that_is_forgotten_is_compared_with_nothing_and_not_saved() {
    let mut filter = RateFilter::default();
    filter.assess(41.0, at(0.0), Some(0.1), 0).unwrap();
    filter.forget_good();
    assert_eq!(filter.before_stop(at(1.0), 0.1), None);
    filter.hold_back(20.0, at(1.0), 0.1, 1);
    assert_eq!(filter.assess(20.0, at(2.0), Some(0.1), 1), Ok(()));
}

/// The value of the former run is none of this one: it remains.
#[test]
fn a_value_of_the_former_run_is_compared_after_the_good_value_was_forgotten() {
    let mut filter = RateFilter::after_start(20.0, at(0.0), Duration::from_secs(2));
    filter.forget_good();
    filter.hold_back(41.0, at(1.0), 0.1, 1);
    assert_eq!(filter.assess(41.0, at(60.0), Some(0.1), 1), Err(RateFault::Jumped));
    assert_eq!(filter.assess(20.2, at(61.0), Some(0.1), 1), Ok(()));
}
