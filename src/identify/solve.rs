//! Least squares on normal equations, with or without a penalty.

use nalgebra::DVector;

use super::gram::Gram;

/// What keeps two columns that are the same from having no answer; far below any effect on one that has.
const ROUNDING: f64 = 1e-12;

/// Gains of these columns: least squares with `penalty`·|w|² on columns of root mean square 1, per row.
pub(super) fn ridge(gram: &Gram, columns: &[usize], penalty: f64) -> DVector<f64> {
    let (scaled, scales) = gram.of_columns(columns).scaled();
    let mut square = scaled.square;
    // Twin sensors: a larger penalty until there is an answer.
    let mut penalty = penalty.max(ROUNDING);
    loop {
        for place in 0..columns.len() {
            square[(place, place)] += penalty;
        }
        if let Some(factors) = square.clone().cholesky() {
            let gains = factors.solve(&scaled.cross);
            return DVector::from_fn(columns.len(), |place, _| gains[place] / scales[place]);
        }
        penalty *= 10.0;
    }
}

/// The largest elastic net worth trying: below this L1 penalty the first gain leaves zero.
pub(super) fn first_penalty(scaled: &Gram) -> f64 {
    scaled.cross.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()))
}

/// Coordinate descent on scaled columns for `½|y − Xw|² + l1·|w|₁ + ½·l2·|w|²`, from `gains` on (Friedman, Hastie,
/// Tibshirani 2010).
pub(super) fn elastic_net(scaled: &Gram, l1: f64, l2: f64, gains: &mut DVector<f64>) {
    const MOST_ROUNDS: usize = 100;
    // Of the largest gain that one column alone would have.
    let enough = 1e-4 * first_penalty(scaled);
    let size = scaled.cross.len();
    let mut pull = &scaled.cross - &scaled.square * &*gains - &*gains * l2;
    let mut round = |columns: &mut dyn Iterator<Item = usize>, gains: &mut DVector<f64>| {
        let mut largest: f64 = 0.0;
        for column in columns {
            let stiffness = scaled.square[(column, column)] + l2;
            let wanted = pull[column] + stiffness * gains[column];
            let next = wanted.signum() * (wanted.abs() - l1).max(0.0) / stiffness;
            let moved = next - gains[column];
            if moved.abs() > 0.0 {
                let pushed = scaled.square.column(column);
                pull.iter_mut().zip(pushed.iter()).for_each(|(pull, square)| *pull -= moved * square);
                pull[column] -= l2 * moved;
                gains[column] = next;
                largest = largest.max(moved.abs());
            }
        }
        largest
    };
    // Those that are in settle first; a full round then says whether another comes in.
    for _ in 0..MOST_ROUNDS {
        if round(&mut (0..size), gains) <= enough {
            return;
        }
        for _ in 0..MOST_ROUNDS {
            let active: Vec<usize> = (0..size).filter(|column| gains[*column].abs() > 0.0).collect();
            if round(&mut active.into_iter(), gains) <= enough {
                break;
            }
        }
    }
}
