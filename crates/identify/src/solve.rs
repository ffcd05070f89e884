//! Least squares on normal equations, with or without a penalty.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::gram::Gram;
use crate::statistics::median;

/// What keeps two columns that are the same from having no answer; far below any effect on one that has.
const ROUNDING: f64 = 1e-12;
/// A column that moves less counts as if it moved so.
const STANDS_STILL: f64 = 1e-9;

/// Gains of these columns: least squares with `penalty`·|w|² on columns of root mean square 1, per row.
pub(super) fn ridge(gram: &Gram, columns: &[usize], penalty: f64) -> DVector<f64> {
    let (scaled, scales) = gram.of_columns(columns).scaled();
    penalized(scaled.square, &scaled.cross, penalty.max(ROUNDING)).component_div(&scales)
}

/// A ridge on whitened products, for any penalty: a column that moves little is held more, but by the root alone.
pub(super) struct Ridge {
    scaled: Gram,
    scales: DVector<f64>,
}

impl Ridge {
    pub(super) fn of(gram: &Gram) -> Ridge {
        let rows = gram.rows.max(1.0);
        let moves = gram.square.diagonal().map(|square| (square / rows).max(0.0).sqrt().max(STANDS_STILL));
        let usual = median(moves.iter().copied().collect());
        let scales = moves.map(|own| (own * usual).sqrt());
        Ridge { scaled: gram.divided(&scales, rows), scales }
    }

    pub(super) fn at(&self, penalty: f64) -> DVector<f64> {
        penalized(self.scaled.square.clone(), &self.scaled.cross, penalty).component_div(&self.scales)
    }
}

/// Penalties from 10^`first` to 10^`last`, so many in each decade.
pub(super) fn decades(first: i32, last: i32, each: i32) -> Vec<f64> {
    (first * each..=last * each).map(|step| 10f64.powf(f64::from(step) / f64::from(each))).collect()
}

/// w of (X'X + penalty)·w = X'y. Where columns say the same, the penalty grows until there is an answer.
pub(super) fn penalized(mut square: DMatrix<f64>, cross: &DVector<f64>, mut penalty: f64) -> DVector<f64> {
    loop {
        for place in 0..square.nrows() {
            square[(place, place)] += penalty;
        }
        if let Some(factors) = square.clone().cholesky() {
            return factors.solve(cross);
        }
        penalty *= 10.0;
    }
}

/// The largest elastic net worth trying: below this L1 penalty the first gain leaves zero.
pub(super) fn first_penalty(scaled: &Gram) -> f64 {
    scaled.cross.amax()
}

/// The elastic net `½|y − Xw|² + l1·|w|₁ + ½·l2·|w|²` on scaled columns, from `gains` on: exact, by the search over signs of
/// Lee, Battle, Raina and Ng (2006). Coordinate descent needs many thousand rounds where columns are nearly alike.
///
/// The columns that are in have signs; with these fixed the answer is one linear system, whose factor grows and shrinks
/// by a column at a time. Who would change its sign goes out; who pulls hardest comes in.
pub(super) fn elastic_net(scaled: &Gram, l1: f64, l2: f64, gains: &mut DVector<f64>) {
    let size = scaled.cross.len();
    let mut active = Active::new(scaled, l2, gains);
    // Each round lessens what is left; a bound all the same.
    for _ in 0..4 * size {
        active.settle(scaled, l1, gains);
        let mut hardest = (l1 + 1e-6 * l1.max(1e-9), None);
        for column in (0..size).filter(|column| !active.columns.contains(column)) {
            let taken: f64 =
                active.columns.iter().map(|other| gains[*other] * scaled.square[(column, *other)]).sum();
            let pull = scaled.cross[column] - taken;
            if pull.abs() > hardest.0 {
                hardest = (pull.abs(), Some((column, pull.signum())));
            }
        }
        let Some((column, sign)) = hardest.1 else { return };
        active.add(scaled, l2, column, sign);
    }
}

/// The columns that are in, with their signs and the factor of their part of X'X + l2.
struct Active {
    columns: Vec<usize>,
    signs: Vec<f64>,
    factor: Option<Cholesky<f64, Dyn>>,
}

impl Active {
    fn new(scaled: &Gram, l2: f64, gains: &DVector<f64>) -> Active {
        let mut active = Active { columns: Vec::new(), signs: Vec::new(), factor: None };
        for (column, gain) in gains.iter().enumerate().filter(|(_, gain)| gain.abs() > 0.0) {
            active.add(scaled, l2, column, gain.signum());
        }
        active
    }

    fn add(&mut self, scaled: &Gram, l2: f64, column: usize, sign: f64) {
        self.columns.push(column);
        self.signs.push(sign);
        let last = self.columns.len() - 1;
        let mut row = DVector::from_fn(last + 1, |place, _| scaled.square[(self.columns[place], column)]);
        row[last] += l2;
        self.factor = match self.factor.take() {
            Some(factor) => Some(factor.insert_column(last, row)),
            None => Cholesky::new(DMatrix::from_element(1, 1, row[0])),
        };
    }

    fn remove(&mut self, place: usize) {
        self.columns.remove(place);
        self.signs.remove(place);
        let left = !self.columns.is_empty();
        self.factor = self.factor.take().filter(|_| left).map(|factor| factor.remove_column(place));
    }

    /// The answer for these signs, or as far towards it as they hold; those that reach zero go out.
    fn settle(&mut self, scaled: &Gram, l1: f64, gains: &mut DVector<f64>) {
        while let Some(factor) = &self.factor {
            let answer = factor.solve(&DVector::from_fn(self.columns.len(), |place, _| {
                scaled.cross[self.columns[place]] - l1 * self.signs[place]
            }));
            let mut way = (1.0, None);
            for (place, column) in self.columns.iter().enumerate() {
                if answer[place] * self.signs[place] <= 0.0 {
                    let reach = gains[*column] / (gains[*column] - answer[place]);
                    let reach = if reach.is_finite() { reach.clamp(0.0, 1.0) } else { 0.0 };
                    if way.1.is_none() || reach < way.0 {
                        way = (reach, Some(place));
                    }
                }
            }
            for (place, column) in self.columns.iter().enumerate() {
                gains[*column] += way.0 * (answer[place] - gains[*column]);
            }
            let Some(place) = way.1 else { return };
            gains[self.columns[place]] = 0.0;
            self.remove(place);
        }
    }
}

#[cfg(test)]
mod tests;
