use proptest::prelude::*;

use super::*;

#[test]
fn inside_its_bounds_it_is_plain_least_squares_and_outside_it_stays_at_the_edge() {
    let square = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0]);
    let cross = DVector::from_row_slice(&[3.0, 3.0]);
    let free = least_squares(&square, &cross, &[(-9.0, 9.0), (-9.0, 9.0)]);
    assert!((free[0] - 1.0).abs() < 1e-9 && (free[1] - 1.0).abs() < 1e-9, "{free:?}");
    let at_the_edge = least_squares(&square, &cross, &[(-9.0, 0.5), (-9.0, 9.0)]);
    assert!((at_the_edge[0] - 0.5).abs() < 1e-12 && (at_the_edge[1] - 1.25).abs() < 1e-9);
}

#[test]
fn a_block_that_offers_one_temperature_only_has_that_one() {
    let square = DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, 2.0]);
    let found = least_squares(&square, &DVector::from_row_slice(&[2.0, 2.0]), &[(0.3, 0.3), (0.0, 5.0)]);
    assert!((found[0] - 0.3).abs() < 1e-12 && (found[1] - 1.0).abs() < 1e-9, "{found:?}");
}

proptest! {
    /// At the minimum, the gradient of a free variable is zero, and that of a fixed one points outwards.
    #[test]
    fn nothing_within_the_bounds_is_better(
        entries in prop::collection::vec(-1.0..1.0_f64, 40),
        wanted in prop::collection::vec(-5.0..5.0_f64, 8),
        edges in prop::collection::vec((-2.0..2.0_f64, 0.0..2.0_f64), 5),
    ) {
        let matrix = DMatrix::from_row_slice(8, 5, &entries);
        let (square, cross) = (matrix.tr_mul(&matrix), matrix.tr_mul(&DVector::from_vec(wanted)));
        let bounds: Vec<(f64, f64)> = edges.iter().map(|(low, width)| (*low, low + width)).collect();
        let theta = DVector::from_vec(least_squares(&square, &cross, &bounds));
        let downhill = &cross - &square * &theta;
        for (place, (low, high)) in bounds.iter().enumerate() {
            prop_assert!(theta[place] >= *low && theta[place] <= *high);
            let pull = downhill[place];
            let at_low = theta[place] - low < 1e-9;
            let at_high = high - theta[place] < 1e-9;
            prop_assert!(pull.abs() < 1e-6 || (pull < 0.0 && at_low) || (pull > 0.0 && at_high), "{pull}");
        }
    }
}
