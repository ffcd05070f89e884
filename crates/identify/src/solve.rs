//! Least squares by normal equations, with or without a penalty for large gains.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::reborrow::{Reborrow, ReborrowMut};
use faer::{MatMut, Par};
use nalgebra::{DMatrix, DVector};

use crate::gram::Gram;
use crate::statistics::median;

mod net;

pub(super) use net::Net;

/// Minimum penalty. With this penalty, the equations have a solution even if two terms are equal. In other cases, its
/// effect is negligible.
const ROUNDING: f64 = 1e-12;
/// Minimum root mean square that is assumed for a term. Without it, a term of zeros would have the scale zero.
const STANDS_STILL: f64 = 1e-9;

/// Returns the gains w of these columns that minimize the mean squared residual plus `penalty`·|w|². The penalty
/// applies to gains of columns that are scaled to a root mean square of 1.
pub(super) fn ridge(gram: &Gram, columns: &[usize], penalty: f64) -> DVector<f64> {
    let (scaled, scales) = gram.of_columns(columns).scaled();
    least_squares(&scaled, penalty).component_div(&scales)
}

/// Returns the least-squares gains of all columns of products that are already scaled. The gains apply to the scaled
/// columns.
pub(super) fn least_squares(scaled: &Gram, penalty: f64) -> DVector<f64> {
    penalized(&scaled.square, &scaled.cross, penalty.max(ROUNDING))
}

/// Ridge regression on products of whitened rows (rows from which their slow random drift is removed). The solution can
/// be calculated for any penalty. Each column is divided by the square root of the product of its scale and the median
/// scale. A column that changes less has a greater penalty. Without this division, its penalty would be much greater.
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
        penalized(&self.scaled.square, &self.scaled.cross, penalty).component_div(&self.scales)
    }
}

/// Returns a series of penalties from 10^`first` to 10^`last`, with `each` penalties per decade.
pub(super) fn decades(first: i32, last: i32, each: i32) -> Vec<f64> {
    (first * each..=last * each).map(|step| 10f64.powf(f64::from(step) / f64::from(each))).collect()
}

/// Returns the solution w of (X'X + penalty)·w = X'y. If columns are linearly dependent, the penalty is increased until
/// there is a solution.
pub(super) fn penalized(square: &DMatrix<f64>, cross: &DVector<f64>, penalty: f64) -> DVector<f64> {
    let (mut each, mut all) = (penalty, penalty);
    loop {
        if let Some(answer) = positive(square, cross, all) {
            return answer;
        }
        each *= 10.0;
        all += each;
    }
}

/// Solves (X'X + penalty)·w = X'y by Cholesky factorization; `None` if the matrix is not positive definite.
fn positive(square: &DMatrix<f64>, cross: &DVector<f64>, penalty: f64) -> Option<DVector<f64>> {
    let size = square.nrows();
    let mut factors = square.clone();
    (0..size).for_each(|place| factors[(place, place)] += penalty);
    let mut factors = MatMut::from_column_major_slice_mut(factors.as_mut_slice(), size, size);
    let mut memory =
        MemBuffer::new(factor::cholesky_in_place_scratch::<f64>(size, Par::Seq, Default::default()));
    let stack = MemStack::new(&mut memory);
    factor::cholesky_in_place(factors.rb_mut(), Default::default(), Par::Seq, stack, Default::default())
        .ok()?;
    let mut answer = cross.clone();
    let sides = MatMut::from_column_major_slice_mut(answer.as_mut_slice(), size, 1);
    solve::solve_in_place(factors.rb(), sides, Par::Seq, stack);
    Some(answer)
}

#[cfg(test)]
mod tests;
