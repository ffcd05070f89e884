use proptest::prelude::*;

use super::*;
use crate::quantity::Shifted;

const HOUR: Duration = Duration::from_hours(1);

fn occasion(seconds: u64) -> Occasion {
    Occasion { now: Moment::from_nanos(1).after(Duration::from_secs(seconds)), since_datum: HOUR }
}

#[test]
fn how_much_is_believed_grows_with_the_time_since_it_was_certain() {
    let filter = Filter::Weighed { repeat: 0.5, walk: 4.0 };
    for (hours, most) in [(0, 2.0), (1, 4.0 * 4.25_f64.sqrt()), (24, 4.0 * 96.25_f64.sqrt())] {
        let occasion = Occasion { now: Moment::from_nanos(1), since_datum: hours * HOUR };
        let certainty = Certainty::default();
        assert_eq!(certainty.assess(0.999 * most, filter, occasion), Ok(()), "{hours}");
        let refused = certainty.assess(-1.001 * most, filter, occasion).unwrap_err();
        assert!((refused.get() - most).abs() < 1e-9, "{hours}");
    }
}

#[test]
fn a_fixed_share_believes_everything_and_is_always_the_same() {
    let mut certainty = Certainty::default();
    for seconds in [0, 1, 100_000] {
        assert_eq!(certainty.assess(1e9, Filter::Share(0.3), occasion(seconds)), Ok(()));
        let share = certainty.learn(1e9, Filter::Share(0.3), occasion(seconds));
        assert!((share - 0.3).abs() < 1e-12);
        assert_eq!(certainty.touched, Some(occasion(seconds).now));
    }
}

fn any_positive() -> impl Strategy<Value = f64> {
    prop_oneof![6 => 1e-3..100.0f64, 1 => Just(f64::MIN_POSITIVE), 1 => Just(1e-200), 1 => Just(1e308)]
}

proptest! {
    #[test]
    fn a_share_is_one_and_a_variance_never_negative(
        repeat in any_positive(),
        walk in any_positive(),
        older: bool,
        touches in prop::collection::vec((prop_oneof![-50.0..50.0f64, Just(1e300)], 0u64..1_000_000, any::<bool>()), 1..60),
    ) {
        let filter = Filter::Weighed { repeat, walk };
        let mut certainty = Certainty::default();
        if older {
            certainty.variance = Some(f64::INFINITY);
        }
        for (residual, seconds, lost) in touches {
            let occasion = occasion(seconds);
            if certainty.assess(residual, filter, occasion).is_err() {
                certainty.doubt(residual);
                prop_assert_eq!(certainty.assess(residual, filter, occasion), Ok(()), "the same again agrees");
                if lost {
                    continue;
                }
            }
            let share = certainty.learn(residual, filter, occasion);
            prop_assert!((0.0..=1.0).contains(&share), "{share}");
            let variance = certainty.variance.unwrap();
            prop_assert!((0.0..=LARGEST).contains(&variance), "{variance}");
            let kept: Certainty = serde_json::from_str(&serde_json::to_string(&certainty).unwrap()).unwrap();
            prop_assert_eq!(kept, certainty);
            prop_assert_eq!(certainty.shifted(crate::quantity::Shift::from_nanos(5)).variance, certainty.variance);
        }
    }
}
