//! Whitening of log rows: removes the slow random drift from the rows of a run. The residual of a model in a run is a
//! slow random walk, so its values in neighbouring minutes are nearly equal.
//!
//! Least squares on plain minute rows would fit the level of this random walk in each run. Therefore a scalar Kalman
//! filter (local level model) replaces the values z of each column and of the target by their innovations z'. Least
//! squares on the innovations is the correct fit for such a walk (generalised least squares):
//!
//! ```text
//! P += q·Δt      F = P + r      z' = (z − m) / √F      K = P / F      m += K·(z − m)      P *= 1 − K
//! ```
//!
//! At the first row, m = P = 0. Per hour, the variance of the walk grows by q = 1, and the variance of a minute row is
//! r = 1. P, F and K depend only on the times of the rows. After a gap, P is larger.

use nalgebra::{DMatrix, DVector};

use crate::gram::Gram;

/// Growth per hour of the variance of the random walk of the residual, as a ratio to the variance of a minute row.
const WALK_PER_HOUR: f64 = 1.0;

/// Returns for each log row two numbers of the Kalman filter: the gain K, and the standard deviation √F by which the
/// innovation of the row is divided.
fn steps(seconds: &[f64]) -> Vec<(f64, f64)> {
    let mut variance = 0.0;
    let mut last = seconds.first().copied().unwrap_or_default();
    let mut step = |second: &f64| {
        let passed = (second - last).max(0.0);
        last = *second;
        variance += WALK_PER_HOUR * passed / 3600.0;
        // Rows at a shorter interval than a minute have proportionally more noise. Rows at a longer interval have that
        // of a minute.
        let noise = if passed > 0.0 { (60.0 / passed).max(1.0) } else { 1.0 };
        let innovation = variance + noise;
        let gain = variance / innovation;
        variance *= 1.0 - gain;
        (gain, innovation.sqrt())
    };
    seconds.iter().map(&mut step).collect()
}

fn whiten(values: &mut [f64], steps: &[(f64, f64)]) {
    let mut level = 0.0;
    for (value, (gain, scale)) in values.iter_mut().zip(steps) {
        let surprise = *value - level;
        level += gain * surprise;
        *value = surprise / scale;
    }
}

/// Whitens the rows of a run, and returns their products X'X, X'y and y'y. `seconds` contains the times of the rows,
/// `rises` the columns X, and `target` is y.
pub(crate) fn gram(seconds: &[f64], rises: &DMatrix<f64>, target: &DVector<f64>) -> Gram {
    let steps = steps(seconds);
    let mut rises = rises.clone();
    rises.column_iter_mut().for_each(|mut column| whiten(column.as_mut_slice(), &steps));
    let mut target = target.clone();
    whiten(target.as_mut_slice(), &steps);
    Gram::of(&rises, &target)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_becomes_white_and_white_noise_nearly_stays() {
        let minutes: Vec<f64> = (0..4).map(|minute| f64::from(minute) * 60.0).collect();
        // Calculated by hand: P = 0, 1/60, …
        let steps = steps(&minutes);
        assert_eq!(steps[0], (0.0, 1.0));
        let first = 1.0 / 60.0;
        assert!((steps[1].0 - first / (first + 1.0)).abs() < 1e-15);
        assert!((steps[1].1 - (first + 1.0).sqrt()).abs() < 1e-15);
        let second = first * (1.0 - steps[1].0) + first;
        assert!((steps[2].0 - second / (second + 1.0)).abs() < 1e-15);
        let mut values = vec![0.0, 1.0, 1.0, 1.0];
        whiten(&mut values, &steps);
        assert!(values[0] == 0.0 && values[1] > values[2] && values[2] > values[3], "{values:?}");
    }

    #[test]
    fn after_a_gap_a_row_tells_the_new_level() {
        let steps = steps(&[0.0, 60.0, 36_000.0]);
        assert!(steps[2].0 > 0.9, "{steps:?}");
    }
}
