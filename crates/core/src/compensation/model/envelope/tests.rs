use crate::quantity::of;
use proptest::prelude::*;

use super::*;
use crate::compensation::model::Reference;

fn known(mean: f64, min: f64, max: f64) -> Identified {
    let input = Input::of(SignalId(0), Reference::Fixed(of(0.0)), None);
    Identified { input, mean, range: (min, max) }
}

fn two(covariance: [[f64; 2]; 2], outside: Outside) -> Result<Envelope, BadEnvelope> {
    let mut inputs = vec![known(24.0, 20.0, 30.0), known(22.0, 20.0, 25.0)];
    inputs[1].input.signal = SignalId(1);
    Envelope::new(inputs, &covariance.map(|row| row.to_vec()), Some(3.0), outside)
}

/// Covariance of two inputs: standard deviations 2 and 1, correlation 0.6.
const COVARIANCE: [[f64; 2]; 2] = [[4.0, 1.2], [1.2, 1.0]];

fn assess(envelope: &Envelope, values: &[f64]) -> Option<Extrapolation> {
    let mut rises = [0.0; MOST];
    rises[..values.len()].copy_from_slice(values);
    envelope.assess(&rises).extrapolating
}

#[test]
fn the_distance_is_that_of_mahalanobis_by_hand() {
    let envelope = two(COVARIANCE, Outside::Warn).unwrap();
    // x − m = (8, 1); S⁻¹ = [1, −1.2; −1.2, 4] / 2.56; d² = (64 − 19.2 + 4) / 2.56.
    let found = assess(&envelope, &[32.0, 23.0]).unwrap();
    let (distance, reach) = found.distance.unwrap();
    assert!((distance - (48.8_f64 / 2.56).sqrt()).abs() < 1e-12);
    assert_eq!(reach.to_bits(), 3.0_f64.to_bits());
    let farthest = found.farthest.unwrap();
    assert_eq!(farthest.signal, SignalId(0));
    assert!((farthest.by - 2.0).abs() < 1e-12);
}

#[test]
fn a_combination_that_never_was_is_outside_although_each_input_is_inside() {
    let envelope = two(COVARIANCE, Outside::Warn).unwrap();
    let found = assess(&envelope, &[29.0, 20.5]).unwrap();
    assert_eq!(found.farthest, None);
    assert!(found.distance.unwrap().0 > 3.0);
    assert_eq!(assess(&envelope, &[26.0, 23.0]), None);
    assert_eq!(assess(&envelope, &[24.0, 22.0]), None);
}

#[test]
fn shrinking_is_a_half_where_the_excess_is_one() {
    let far = Envelope::new(vec![known(0.0, -1.0, 1.0)], &[vec![1e9]], None, Outside::Shrink).unwrap();
    let gain = |x| assess(&far, &[x]).map_or(1.0, |found| found.gain);
    assert!((gain(3.0) - 0.5).abs() < 1e-3, "2 beyond a range of 2: {}", gain(3.0));
    assert!((gain(1.0) - 1.0).abs() < 1e-12);
    assert!(gain(1.0 + 1e-6) > 1.0 - 1e-9, "no jump at the edge");
    assert!(gain(f64::MAX).abs() < 1e-9);
}

#[test]
fn inside_the_excess_says_how_far_the_nearest_edge_is() {
    let excess = |values: [f64; 2]| {
        let mut rises = [0.0; MOST];
        rises[..2].copy_from_slice(&values);
        two(COVARIANCE, Outside::Warn).unwrap().assess(&rises).excess
    };
    assert!(
        (excess([24.0, 22.0]) - -0.4).abs() < 1e-12,
        "two fifths of both ranges: {}",
        excess([24.0, 22.0])
    );
    assert!(
        (excess([28.0, 24.9]) - -0.02).abs() < 1e-9,
        "0.1 of 5 from the largest: {}",
        excess([28.0, 24.9])
    );
    assert!(excess([31.0, 24.0]) >= 0.1, "1 of 10 beyond the largest: {}", excess([31.0, 24.0]));
}

#[test]
fn the_usual_reach_holds_99_percent() {
    // √ of chi-squared at 0.99 for 1, 2, 5, 10 degrees of freedom.
    for (count, expected) in [(1, 2.5758), (2, 3.0349), (5, 3.8841), (10, 4.8176)] {
        assert!((usual_reach(count) - expected).abs() < 0.03, "{count}: {}", usual_reach(count));
    }
}

#[test]
fn what_is_no_region_is_refused() {
    let one = |known, covariance: &[Vec<f64>], reach| {
        Envelope::new(vec![known], covariance, reach, Outside::Warn).unwrap_err()
    };
    let good = known(0.0, -1.0, 1.0);
    assert_eq!(two([[4.0, 2.0], [2.0, 1.0]], Outside::Warn), Err(BadEnvelope::NotPositiveDefinite(1)));
    assert_eq!(two([[4.0, 2.1], [2.1, 1.0]], Outside::Warn), Err(BadEnvelope::NotPositiveDefinite(1)));
    assert_eq!(two([[0.0, 0.0], [0.0, 1.0]], Outside::Warn), Err(BadEnvelope::NotPositiveDefinite(0)));
    assert_eq!(two([[f64::NAN, 0.0], [0.0, 1.0]], Outside::Warn), Err(BadEnvelope::NotPositiveDefinite(0)));
    assert_eq!(two([[4.0, 1.2], [0.2, 1.0]], Outside::Warn), Err(BadEnvelope::NotSymmetric(0, 1)));
    assert_eq!(one(good, &[vec![1.0, 0.0]], None), BadEnvelope::Size);
    assert_eq!(one(good, &[], None), BadEnvelope::Size);
    assert_eq!(one(known(2.0, -1.0, 1.0), &[vec![1.0]], None), BadEnvelope::Range(0));
    assert_eq!(one(known(1.0, 1.0, 1.0), &[vec![1.0]], None), BadEnvelope::Range(0));
    assert_eq!(one(good, &[vec![1.0]], Some(0.0)), BadEnvelope::Reach);
    assert_eq!(Envelope::new(vec![], &[], None, Outside::Warn), Err(BadEnvelope::Count));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_is_ever_not_a_number(a in any::<f64>(), b in any::<f64>()) {
        prop_assume!(a.is_finite() && b.is_finite());
        let found = assess(&two(COVARIANCE, Outside::Shrink).unwrap(), &[a, b]);
        if let Some(found) = found {
            prop_assert!((0.0..=1.0).contains(&found.gain));
            prop_assert!(found.distance.is_some_and(|(distance, _)| distance.is_finite()));
        }
    }

    #[test]
    fn the_farther_out_the_smaller_the_gain(
        a in -10.0..10.0_f64,
        b in -10.0..10.0_f64,
        near in 0.0..5.0_f64,
        more in 0.0..5.0_f64,
    ) {
        let envelope = two(COVARIANCE, Outside::Shrink).unwrap();
        let gain = |far: f64| assess(&envelope, &[24.0 + far * a, 22.0 + far * b]).map_or(1.0, |found| found.gain);
        prop_assert!(gain(near + more) <= gain(near) + 1e-12);
    }
}
