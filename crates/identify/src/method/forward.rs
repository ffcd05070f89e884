//! Forward search judged on runs that were left out.
//!
//! For each fold the Cholesky factor of the chosen columns is kept; one more column then costs a row of the factor and
//! two small products, so that trying every column of the bank is cheap.

use nalgebra::DVector;

use crate::folds::Fold;
use crate::gram::Gram;

/// One fold: what is learnt from, scaled, and what is judged on, in the same scale.
#[derive(Debug)]
struct Search {
    training: Gram,
    held: Gram,
    penalty: f64,
    /// Row by row of the factor: its products with every column of the bank.
    rows: Vec<DVector<f64>>,
    /// The factor's products with X'y.
    solved: Vec<f64>,
    /// Gains of the chosen, in their order.
    gains: Vec<f64>,
}

impl Search {
    fn new(fold: &Fold, penalty: f64) -> Search {
        let (training, scales) = fold.training.scaled();
        let held = fold.held.divided(&scales, 1.0);
        Search { training, held, penalty, rows: Vec::new(), solved: Vec::new(), gains: Vec::new() }
    }

    /// The gains with one more column: those of the chosen, and its own.
    fn with(&self, chosen: &[usize], column: usize) -> (Vec<f64>, f64, f64) {
        let dot: f64 = self.rows.iter().map(|row| row[column] * row[column]).sum();
        let pivot = (self.training.square[(column, column)] + self.penalty - dot).max(1e-9).sqrt();
        let taken: f64 = self.rows.iter().zip(&self.solved).map(|(row, solved)| row[column] * solved).sum();
        let solved = (self.training.cross[column] - taken) / pivot;
        let own = solved / pivot;
        // The chosen give up what the new column says too: L'·t = its part of the factor.
        let mut shared: Vec<f64> = self.rows.iter().map(|row| row[column]).collect();
        for place in (0..shared.len()).rev() {
            let after: f64 =
                (place + 1..shared.len()).map(|next| self.rows[place][chosen[next]] * shared[next]).sum();
            shared[place] = (shared[place] - after) / self.rows[place][chosen[place]];
        }
        let gains = self.gains.iter().zip(&shared).map(|(gain, share)| gain - own * share).collect();
        (gains, own, solved)
    }

    /// |y − Xw|² on the held-out runs.
    fn left(&self, chosen: &[usize], gains: &[f64]) -> f64 {
        let mut left = self.held.power;
        for (place, (column, gain)) in chosen.iter().zip(gains).enumerate() {
            left += gain * (gain * self.held.square[(*column, *column)] - 2.0 * self.held.cross[*column]);
            let before = chosen.iter().zip(gains).take(place);
            left += 2.0
                * gain
                * before.map(|(other, gain)| gain * self.held.square[(*other, *column)]).sum::<f64>();
        }
        left
    }

    fn take(&mut self, chosen: &[usize], column: usize) {
        let (mut gains, own, solved) = self.with(chosen, column);
        let mut row = self.training.square.column(column).into_owned();
        row[column] += self.penalty;
        for other in &self.rows {
            row.axpy(-other[column], other, 1.0);
        }
        let pivot = row[column].max(1e-9).sqrt();
        row /= pivot;
        row[column] = pivot;
        self.rows.push(row);
        self.solved.push(solved);
        gains.push(own);
        self.gains = gains;
    }
}

/// The columns, in the order in which they came in, and what they leave on held-out runs.
pub(super) fn forward(folds: &[Fold], penalty: f64, most: usize) -> (Vec<usize>, f64) {
    let width = folds.first().map_or(0, |fold| fold.held.cross.len());
    let each_its_own: Vec<Option<usize>> = (0..width).map(Some).collect();
    forward_once_each(folds, penalty, most, &each_its_own)
}

/// The same with at most one column of each group; a column without a group stays out.
pub(super) fn forward_once_each(
    folds: &[Fold],
    penalty: f64,
    most: usize,
    groups: &[Option<usize>],
) -> (Vec<usize>, f64) {
    let mut folds: Vec<Search> = folds.iter().map(|fold| Search::new(fold, penalty)).collect();
    let mut chosen: Vec<usize> = Vec::new();
    let mut now: f64 = folds.iter().map(|fold| fold.held.power).sum();
    while chosen.len() < most {
        let is_free = |column: &usize| {
            groups[*column].is_some() && !chosen.iter().any(|other| groups[*other] == groups[*column])
        };
        let tried = (0..groups.len()).filter(is_free).map(|column| {
            let with = [chosen.as_slice(), &[column]].concat();
            let left = |fold: &Search| {
                let (mut gains, own, _) = fold.with(&chosen, column);
                gains.push(own);
                fold.left(&with, &gains)
            };
            (folds.iter().map(left).sum::<f64>(), column)
        });
        let best = tried.reduce(|best, next| if next.0 < best.0 { next } else { best });
        let Some((cost, column)) = best.filter(|(cost, _)| *cost < now) else { break };
        folds.iter_mut().for_each(|fold| fold.take(&chosen, column));
        chosen.push(column);
        now = cost;
    }
    (chosen, now)
}
