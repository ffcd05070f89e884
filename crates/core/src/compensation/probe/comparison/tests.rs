use proptest::prelude::*;

use super::*;

const SCATTER: f64 = 0.5;
const HOUR: Duration = Duration::from_hours(1);

/// Returns a touch this many hours after the start, with its errors without and with the model.
fn touch(hours: u32, (without, with): (f64, f64)) -> Touch {
    Touch { at: Moment::from_nanos(1).after(HOUR * hours), without, with }
}

/// Returns whether the model is worse after each of these touches. They are one hour apart and all accepted.
fn verdicts(errors: &[(f64, f64)]) -> Vec<bool> {
    let mut comparison = Comparison::new();
    let one = |(hours, errors): (u32, &(f64, f64))| {
        comparison.take(touch(hours, *errors), Credit::Accepted, SCATTER);
        comparison.worse().is_some()
    };
    (0..).zip(errors).map(one).collect()
}

/// Returns the number of the touch at which the model is found worse, counted from one.
fn found(errors: &[(f64, f64)]) -> Option<usize> {
    verdicts(errors).iter().position(|worse| *worse).map(|place| place + 1)
}

#[test]
fn a_model_is_worse_where_both_bounds_are_exceeded_and_by_more_than_one_touch() {
    // 8·4σ² = 8 µm², 4σ² = 1 µm².
    for (what, errors, at) in [
        ("1.21 µm² each: 8.47 of seven", vec![(0.0, 1.1); 12], Some(7)),
        ("1 µm² each: 8 of eight", vec![(0.0, 1.0); 40], None),
        ("5 % more", vec![(10.0, 10.25); 40], None),
        ("10.25 % and 10.25 µm² more", vec![(10.0, 10.5); 12], Some(2)),
        ("the sign does not count", vec![(-10.0, 10.5); 12], Some(2)),
        ("better", vec![(10.0, 3.0); 40], None),
        ("a chip", [vec![(5.0, 1.0), (0.0, 50.0)], vec![(5.0, 1.0); 20]].concat(), None),
        ("a chip first", [vec![(0.0, 50.0)], vec![(5.0, 1.0); 20]].concat(), None),
        ("two of them", [vec![(0.0, 50.0)], vec![(5.0, 1.0); 3], vec![(0.0, 50.0)]].concat(), Some(5)),
        ("scatter", [(0.4, -0.6), (-0.5, 0.7), (0.1, 0.9), (0.8, 0.2)].repeat(10), None),
    ] {
        assert_eq!(found(&errors), at, "{what}");
    }
}

#[test]
fn it_is_better_again_below_one_and_not_by_one_touch() {
    let bad = vec![(0.0, 3.0); 2];
    assert_eq!(verdicts(&[&bad[..], &[(3.0, 0.0)], &[(3.0, 0.0)]].concat()), [false, true, true, true]);
    assert_eq!(verdicts(&[&bad[..], &[(3.0, 0.0)], &[(3.1, 0.0)]].concat()), [false, true, true, false]);
    // After eight better touches, none of those that showed it counts.
    assert_eq!(verdicts(&[bad, vec![(3.0, 2.9); 8]].concat()).iter().filter(|worse| !**worse).count(), 2);
    let mut comparison = Comparison::new();
    (0..2).for_each(|hour| comparison.take(touch(hour, (0.0, 3.0)), Credit::Accepted, SCATTER));
    comparison.begin();
    let worse = comparison.worse().unwrap();
    assert_eq!((worse.touches, worse.without, worse.with), (0, Micron::ZERO, Micron::ZERO), "a new datum");
    comparison.take(touch(3, (9.0, 0.0)), Credit::Accepted, SCATTER);
    assert!(comparison.worse().is_some(), "one touch since then");
    comparison.take(touch(4, (9.0, 0.0)), Credit::Accepted, SCATTER);
    assert_eq!(comparison.worse(), None);
}

#[test]
fn the_figures_are_those_of_the_touches_that_count() {
    let mut comparison = Comparison::new();
    for hour in 0..20 {
        let errors = if hour < 12 { (7.0, 9.0) } else { (3.0, -4.0) };
        comparison.take(touch(hour, errors), Credit::Accepted, SCATTER);
    }
    let worse = comparison.worse().unwrap();
    assert_eq!(worse.touches, 8);
    assert!((worse.without.get() - 3.0).abs() < 1e-12 && (worse.with.get() - 4.0).abs() < 1e-12, "{worse:?}");
}

#[test]
fn what_is_older_than_a_week_does_not_count() {
    for (pause, worse) in [(7 * 24 - 1, true), (7 * 24, false)] {
        let mut comparison = Comparison::new();
        comparison.take(touch(0, (0.0, 3.0)), Credit::Accepted, SCATTER);
        comparison.take(touch(pause + 1, (0.0, 3.0)), Credit::Accepted, SCATTER);
        assert_eq!(comparison.worse().is_some(), worse, "{pause}");
    }
}

#[test]
fn a_doubted_touch_counts_if_the_next_one_confirms_it() {
    use Credit::{Accepted, Doubted};
    // 4·√2·σ = 2.83 µm.
    for (what, second, credit, counted) in [
        ("it agrees", 22.0, Accepted, 2),
        ("the model is right", 1.0, Accepted, 1),
        ("it is doubted too, and wrong in the same direction", 90.0, Doubted, 2),
        ("it is doubted too, and wrong in the other direction", -20.0, Doubted, 0),
    ] {
        let mut comparison = Comparison::new();
        comparison.take(touch(0, (0.0, 20.0)), Doubted, SCATTER);
        assert!(comparison.touches.is_empty() && !comparison.is_empty(), "{what}");
        comparison.take(touch(1, (0.0, second)), credit, SCATTER);
        assert_eq!(comparison.touches.len(), counted, "{what}");
        assert_eq!(comparison.waiting.is_some(), counted == 0, "{what}");
        assert_eq!(comparison.worse().is_some(), counted == 2, "{what}");
    }
}

#[test]
fn what_is_taken_back_and_what_was_kept() {
    let mut comparison = Comparison::new();
    assert!(comparison.is_empty());
    (0..3).for_each(|hour| comparison.take(touch(hour, (0.0, 3.0)), Credit::Accepted, SCATTER));
    let text = serde_json::to_string(&comparison).unwrap();
    let mut again = Comparison::new();
    again.recall(&serde_json::from_str(&text).unwrap());
    assert_eq!(again, comparison);
    comparison.clear();
    assert!(comparison.is_empty() && comparison.worse().is_none());
}

/// One input of a comparison: a touch with its errors, a new datum, or the discarding of the correction.
#[derive(Clone, Copy, Debug)]
enum Act {
    Touch(f64, f64, Credit),
    Datum,
    Forget,
}

/// Applies every sequence of `depth` events, and checks the properties that must be true after each event.
fn search(comparison: &Comparison, acts: &[Act], depth: u32, reached: &mut [u64; 2]) {
    for act in acts {
        let mut next = comparison.clone();
        match *act {
            Act::Touch(without, with, credit) => next.take(touch(0, (without, with)), credit, SCATTER),
            Act::Datum => next.begin(),
            Act::Forget => next.clear(),
        }
        let (was, is) = (comparison.worse().is_some(), next.worse().is_some());
        reached[usize::from(is)] += 1;
        assert!(next.touches.len() <= WINDOW);
        let sums = Sums::of(&next.touches);
        match (act, was, is) {
            (Act::Touch(..), false, true) => {
                assert!(next.touches.len() >= 2, "{comparison:?} {act:?}");
                assert!(sums.with > CLEARLY * sums.without && sums.with - sums.without > 8.0);
                for place in 0..next.touches.len() {
                    let mut others = next.touches.clone();
                    others.remove(place);
                    let others = Sums::of(&others);
                    assert!(others.with > others.without, "one touch decides: {comparison:?} {act:?}");
                }
            }
            (Act::Touch(..), true, false) => {
                assert!(next.touches.len() >= 2 && sums.with < sums.without, "{comparison:?} {act:?}");
            }
            (Act::Touch(..), ..) => {}
            (Act::Datum, ..) => assert!(was == is && next.touches.is_empty()),
            (Act::Forget, ..) => assert!(next.is_empty()),
        }
        if depth > 1 {
            search(&next, acts, depth - 1, reached);
        }
    }
}

#[test]
fn no_order_of_touches_datums_and_lessons_taken_back_breaks_a_rule() {
    let errors = [(0.0, 0.5), (4.0, 1.0), (1.0, 4.0), (-3.0, -9.0)];
    let touches = errors.into_iter().flat_map(|(without, with)| {
        [Credit::Accepted, Credit::Doubted].map(|credit| Act::Touch(without, with, credit))
    });
    let acts: Vec<Act> = touches.chain([Act::Datum, Act::Forget]).collect();
    let mut reached = [0, 0];
    search(&Comparison::new(), &acts, 6, &mut reached);
    assert!(reached.iter().all(|count| *count > 1000), "{reached:?}");
}

fn any_error() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -20.0..20.0f64, 1 => Just(1e200), 1 => Just(f64::NAN), 1 => Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn whatever_is_measured_its_figures_are_finite_and_it_goes_on_from_what_was_kept(
        acts in prop::collection::vec((0..400u32, any_error(), any_error(), any::<bool>(), 0..12u8), 1..40),
        scatter in prop_oneof![Just(0.5), 1e-200..3.0f64],
    ) {
        let (mut comparison, mut hours) = (Comparison::new(), 0);
        for (later, without, with, accepted, act) in acts {
            hours += later;
            match act {
                0 => comparison.begin(),
                1 => comparison.clear(),
                2 => {
                    let text = serde_json::to_string(&comparison).unwrap();
                    let mut again = Comparison::new();
                    again.recall(&serde_json::from_str(&text).unwrap());
                    prop_assert_eq!(&again, &comparison);
                    comparison = again;
                }
                _ => {}
            }
            let credit = if accepted { Credit::Accepted } else { Credit::Doubted };
            comparison.take(touch(hours, (without, with)), credit, scatter);
            prop_assert!(comparison.touches.len() <= WINDOW);
            for touch in &comparison.touches {
                prop_assert!(touch.without.is_finite() && touch.with.is_finite());
            }
            let newest = comparison.touches.last().map(|touch| touch.at);
            let oldest = comparison.touches.first().map(|touch| touch.at);
            prop_assert!(newest.zip(oldest).is_none_or(|(newest, oldest)| newest.since(oldest) <= OLDEST));
        }
    }
}
