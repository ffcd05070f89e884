use crate::quantity::of;
use proptest::prelude::*;

use super::*;

fn um(value: f64) -> Micron {
    Micron::new(value).unwrap()
}

fn settings() -> GuardSettings {
    GuardSettings { limit: um(40.0), step: um(1.0), rate: of(0.5), deadband: um(0.1), count: Some(um(0.1)) }
}

fn at(place: f64, settings: &GuardSettings) -> Guard {
    let mut guard = Guard::default();
    guard.take_over(um(place), settings);
    guard
}

fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

#[test]
fn each_stage_acts_alone_and_says_so() {
    for (name, from, target, dt, pace, expected, acted) in [
        ("nothing to do", 8.4, 8.4, 10.0, Pace::Follow, 8.4, ""),
        ("a change inside every bound", 8.0, 8.4, 10.0, Pace::Follow, 8.4, ""),
        ("exactly one step", 8.0, 9.0, 10.0, Pace::Follow, 9.0, ""),
        ("smaller than the deadband", 8.0, 8.05, 10.0, Pace::Follow, 8.0, "deadband"),
        ("more than a step", 0.0, 8.4, 10.0, Pace::Follow, 1.0, "step"),
        ("more than a step down", 0.0, -8.4, 10.0, Pace::Follow, -1.0, "step"),
        ("faster than the rate", 0.0, 8.4, 1.0, Pace::Follow, 0.5, "rate"),
        ("between two counts", 8.0, 8.44, 10.0, Pace::Follow, 8.4, "round"),
        ("beyond the limit, standing there", 40.0, 55.0, 10.0, Pace::Follow, 40.0, "limit"),
        ("a ramp knows no deadband", 0.04, 0.0, 10.0, Pace::Ramp, 0.0, ""),
        ("a ramp goes at the rate", 5.0, 0.0, 0.4, Pace::Ramp, 4.8, "rate"),
        ("steps know no rate", 5.0, 0.0, 0.4, Pace::Steps, 4.0, "step"),
        ("no time has passed", 5.0, 8.0, 0.0, Pace::Follow, 5.0, "rate"),
    ] {
        let mut guard = at(from, &settings());
        let (cz, stages) = guard.advance(um(target), seconds(dt), pace, &settings());
        assert!((cz.get() - expected).abs() < 1e-9, "{name}: {cz:?}");
        assert_eq!(stages.to_string(), acted, "{name}");
    }
}

#[test]
fn stages_act_together() {
    for (name, from, target, dt, count, expected, acted) in [
        ("limit and step", 0.0, 1e6, 10.0, 0.1, 1.0, "limit+step"),
        ("limit and rate", 0.0, -1e300, 1.0, 0.1, -0.5, "limit+rate"),
        ("rate and round", 0.0, 5.0, 0.48, 0.1, 0.2, "rate+round"),
        ("step and round", 0.0, 5.0, 10.0, 0.3, 0.9, "step+round"),
        ("limit, step and round", 0.0, 500.0, 10.0, 0.3, 0.9, "limit+step+round"),
        ("limit and round", 39.9, 500.0, 10.0, 0.7, 39.9, "limit+round"),
    ] {
        let settings = GuardSettings { count: Some(um(count)), ..settings() };
        let (cz, stages) = at(from, &settings).advance(um(target), seconds(dt), Pace::Follow, &settings);
        assert!((cz.get() - expected).abs() < 1e-9, "{name}: {cz:?}");
        assert_eq!(stages.to_string(), acted, "{name}");
    }
}

#[test]
fn a_change_of_exactly_the_deadband_is_made() {
    let settings = GuardSettings { deadband: um(0.5), ..settings() };
    let (cz, stages) = at(8.0, &settings).advance(um(8.5), seconds(10.0), Pace::Follow, &settings);
    assert_eq!((cz, stages), (um(8.5), Stages::default()));
}

#[test]
fn changes_smaller_than_the_deadband_are_made_once_they_add_up() {
    let settings = settings();
    let mut guard = at(0.0, &settings);
    let values = [0.04, 0.08, 0.12].map(|to| guard.advance(um(to), seconds(10.0), Pace::Follow, &settings).0);
    assert_eq!(values, [Micron::ZERO, Micron::ZERO, um(0.1)]);
}

#[test]
fn a_rate_of_less_than_one_count_per_update_still_moves() {
    let settings = GuardSettings { rate: of(0.001), deadband: Micron::ZERO, ..settings() };
    let mut guard = at(0.0, &settings);
    for _ in 0..1000 {
        guard.advance(um(8.0), seconds(10.0), Pace::Follow, &settings);
    }
    assert!((guard.value().get() - 8.0).abs() < 1e-9, "{guard:?}");
}

#[test]
fn a_step_that_is_no_multiple_of_the_count_still_arrives() {
    let settings = GuardSettings { step: um(0.15), rate: of(100.0), ..settings() };
    let mut guard = at(0.0, &settings);
    for _ in 0..100 {
        let last = guard.value();
        let (cz, _) = guard.advance(um(5.0), seconds(10.0), Pace::Follow, &settings);
        assert!((cz - last).abs().get() <= 0.15 + 1e-12);
    }
    assert!((guard.value().get() - 5.0).abs() < 1e-9, "{guard:?}");
    let (cz, _) = guard.advance(um(-5.0), seconds(10.0), Pace::Follow, &settings);
    assert!((cz.get() - 4.9).abs() < 1e-9, "it turns at once: {cz:?}");
}

#[test]
fn a_limit_that_is_no_multiple_of_the_count_is_never_exceeded_by_rounding() {
    for (limit, count, expected) in [(40.0, 1.5, 39.0), (0.3, 0.1, 0.3), (1.0, 0.7, 0.7), (0.05, 0.1, 0.0)] {
        let settings =
            GuardSettings { limit: um(limit), step: um(2.0), count: Some(um(count)), ..settings() };
        for sign in [1.0, -1.0] {
            let mut guard = at(0.0, &settings);
            for _ in 0..100 {
                let (cz, _) = guard.advance(um(sign * 100.0), seconds(10.0), Pace::Follow, &settings);
                assert!(cz.abs() <= settings.limit, "{limit} {count}: {cz:?}");
            }
            assert!((guard.value().get() - sign * expected).abs() < 1e-9, "{limit} {count}: {guard:?}");
        }
    }
}

#[test]
fn rounding_is_named_only_where_it_changed_the_value() {
    let settings = GuardSettings { step: um(50.0), rate: of(50.0), ..settings() };
    for tenths in -400..=400 {
        let target = um(f64::from(tenths) / 10.0);
        let (_, stages) = at(0.0, &settings).advance(target, seconds(10.0), Pace::Ramp, &settings);
        assert_eq!(stages, Stages::default(), "{target:?}");
    }
}

#[test]
fn what_stands_in_the_register_is_taken_over_as_whole_counts_inside_the_limit() {
    for (found, count, expected) in
        [(0.7, 0.1, 0.7), (12.34, 0.1, 12.3), (80.0, 0.1, 40.0), (-80.0, 1.5, -39.0), (0.04, 0.1, 0.0)]
    {
        let settings = GuardSettings { count: Some(um(count)), ..settings() };
        let value = at(found, &settings).value();
        assert!((value.get() - expected).abs() < 1e-9, "{found}: {value:?}");
    }
    let settings = GuardSettings { count: None, ..settings() };
    assert_eq!(at(12.34, &settings).value(), um(12.34));
}

#[test]
fn zero_has_no_sign() {
    let (cz, _) = at(-0.1, &settings()).advance(um(-0.0), seconds(10.0), Pace::Ramp, &settings());
    assert_eq!(cz.get().to_bits(), 0.0f64.to_bits());
}

fn any_settings() -> impl Strategy<Value = GuardSettings> {
    let count = prop_oneof![Just(None), (0.01..3.0).prop_map(Some), Just(Some(0.1))];
    (0.1..100.0, 0.001..20.0, 1e-4..50.0, 0.0..1.0, count).prop_map(|(limit, step, rate, deadband, count)| {
        GuardSettings {
            limit: um(limit),
            step: um(step),
            rate: of(rate),
            deadband: um(deadband),
            count: count.map(um),
        }
    })
}

proptest! {
    #[test]
    fn no_bound_is_ever_broken(
        settings in any_settings(),
        moves in prop::collection::vec((-200.0..200.0, 0.0..30.0, 0usize..3, prop::option::weighted(0.1, -200.0..200.0)), 1..60),
    ) {
        let mut guard = Guard::default();
        for (target, dt, pace, found) in moves {
            if let Some(found) = found {
                guard.take_over(um(found), &settings);
            }
            let last = guard.value();
            let pace = [Pace::Follow, Pace::Ramp, Pace::Steps][pace];
            let (cz, stages) = guard.advance(um(target), seconds(dt), pace, &settings);
            prop_assert_eq!(cz, guard.value());
            prop_assert!(cz.abs() <= settings.limit, "{:?}", cz);
            prop_assert!((cz - last).abs().get() <= settings.step.get() + 1e-9, "{:?} to {:?}", last, cz);
            prop_assert_eq!(stages.contains(Stages::LIMIT), target.abs() > settings.limit.get());
            if let Some(count) = settings.count {
                let counts = cz.get() / count.get();
                prop_assert!((counts - counts.round()).abs() < 1e-6, "{:?}", cz);
                prop_assert!((guard.place - cz).abs().get() <= count.get() + 1e-9, "{:?}", guard);
            }
            if stages == Stages::default() {
                prop_assert!((cz.get() - target).abs() < 1e-9, "nothing acted, yet {:?} is not {}", cz, target);
            }
        }
    }

    #[test]
    fn the_target_is_reached_to_within_deadband_and_count(
        settings in any_settings().prop_filter("a step holds a count", |s| s.count.is_none_or(|c| c <= s.step)),
        target in -90.0..90.0,
    ) {
        let settings = GuardSettings { rate: of(50.0), ..settings };
        let mut guard = Guard::default();
        let target = um(target).clamp_to(settings.limit);
        for _ in 0..200_000 {
            let last = guard.place;
            guard.advance(target, seconds(10.0), Pace::Follow, &settings);
            if last == guard.place { break; }
        }
        let near = settings.deadband.get() + settings.count.map_or(0.0, Micron::get);
        prop_assert!((guard.value() - target).abs().get() <= near + 1e-9, "{:?} {:?}", guard, target);
    }
}
