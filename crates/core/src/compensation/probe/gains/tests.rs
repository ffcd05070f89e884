use proptest::prelude::*;

use super::*;

const FORGETTING: f64 = 0.98;
const LIMIT: f64 = 0.2;
const OFFSET: f64 = 10.0;

/// Returns the contribution of each term in one hour. The terms change independently of each other.
fn parts(hour: u32) -> [f64; 2] {
    let phase = f64::from(hour) / 3.0;
    [20.0 * phase.sin(), 12.0 * (0.37 * phase).cos()]
}

fn taught(hours: u32, wanted: impl Fn(u32, [f64; 2]) -> f64) -> Gains {
    let mut gains = Gains::new(2, LIMIT, OFFSET);
    for hour in 0..hours {
        gains.learn(wanted(hour, parts(hour)), parts(hour).into_iter(), FORGETTING);
        assert_sound(&gains);
    }
    gains
}

#[track_caller]
fn assert_sound(gains: &Gains) {
    let size = gains.bounds.len();
    for row in 0..size {
        for column in 0..size {
            let value = gains.covariance[row * size + column];
            assert_eq!(value.to_bits(), gains.covariance[column * size + row].to_bits(), "symmetric");
            assert!(value.is_finite());
            let bound = 0.25 * gains.bounds[row] * gains.bounds[column] * (1.0 + 1e-9);
            assert!(value.abs() <= bound, "{value} beyond {bound}");
        }
        assert!(gains.covariance[row * size + row] > 0.0);
    }
    assert!(gains.factors().iter().all(|factor| factor.abs() <= LIMIT));
}

#[test]
fn gains_that_are_wrong_are_found() {
    let gains = taught(100, |_, [one, other]| 0.1 * one - 0.05 * other);
    for (found, wanted) in gains.factors().iter().zip([0.1, -0.05]) {
        assert!((found - wanted).abs() < 0.005, "{found}, not {wanted}");
    }
}

#[test]
fn an_offset_is_not_blamed_on_them() {
    let gains = taught(100, |_, _| 6.0);
    assert!(gains.factors().iter().all(|factor| factor.abs() < 0.01), "{:?}", gains.factors());
}

#[test]
fn noise_moves_them_little() {
    let noise = |hour: u32| f64::from(hour.wrapping_mul(2_654_435_761) >> 16) / 65_536.0 * 4.0 - 2.0;
    let gains = taught(1000, |hour, _| noise(hour));
    assert!(gains.factors().iter().all(|factor| factor.abs() < 0.05), "{:?}", gains.factors());
}

#[test]
fn a_machine_that_stands_cold_for_long_forgets_no_more_than_it_ever_knew() {
    let mut gains = taught(50, |_, [one, _]| 0.1 * one);
    for _ in 0..5000 {
        gains.learn(0.3, [0.0, 0.0].into_iter(), FORGETTING);
        assert_sound(&gains);
    }
    assert!((gains.factors()[0] - 0.1).abs() < 0.01, "{:?}", gains.factors());
}

#[test]
fn what_was_kept_of_another_shape_is_not_taken_up() {
    let gains = taught(10, |_, [one, _]| 0.1 * one);
    let fresh = |terms| Gains::new(terms, LIMIT, OFFSET);
    assert_eq!(gains.clone().restored(fresh(2)), gains);
    assert_eq!(gains.clone().restored(fresh(3)), fresh(3));
    let narrower = gains.clone().restored(Gains::new(2, 0.05, OFFSET));
    assert!((narrower.factors()[0] - 0.05).abs() < 1e-12, "{:?}", narrower.factors());
    let mut broken = gains;
    broken.covariance[0] = f64::NAN;
    assert_eq!(broken.restored(fresh(2)), fresh(2));
}

proptest! {
    #[test]
    fn nothing_that_is_learned_breaks_them(
        looks in prop::collection::vec((any::<f64>(), any::<f64>(), any::<f64>()), 1..60),
        later in prop::collection::vec((-1e4..1e4f64, -100.0..100.0f64, -100.0..100.0f64), 1..60),
    ) {
        let mut gains = Gains::new(2, LIMIT, OFFSET);
        for (wanted, one, other) in looks.into_iter().chain(later) {
            gains.learn(wanted, [one, other].into_iter(), FORGETTING);
            assert_sound(&gains);
        }
    }
}
