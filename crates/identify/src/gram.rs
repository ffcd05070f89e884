//! Gram products X'X, X'y and y'y of a run. X has one column for each candidate term, and y is the target. With these
//! products, any subset of the columns can be fitted without the rows of the run.

use std::ops::AddAssign;

use nalgebra::{DMatrix, DVector};

use crate::statistics::count;

/// Indices of columns in the matrix of candidate terms, each with the gain of its term.
pub(crate) type Gains = Vec<(usize, f64)>;

/// Gram products of a run: X'X, X'y and y'y of its columns X and its target y. Products of several runs can be added.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gram {
    /// X'X: products of the columns (candidate terms) with each other.
    pub(crate) square: DMatrix<f64>,
    /// X'y: product of each column (candidate term) with the target.
    pub(crate) cross: DVector<f64>,
    /// y'y: sum of the squares of the target y.
    pub(crate) power: f64,
    /// Number of log rows over which the products were summed.
    pub(crate) rows: f64,
}

impl Gram {
    /// Calculates the Gram products of the columns X and the target y.
    pub(crate) fn of(columns: &DMatrix<f64>, target: &DVector<f64>) -> Gram {
        Gram {
            // The plain matrix product has optimized kernels, the transposed one has none.
            square: columns.transpose() * columns,
            cross: columns.tr_mul(target),
            power: target.norm_squared(),
            rows: count(target.len()),
        }
    }

    /// Returns the sum of the products of the runs in `runs`.
    pub(crate) fn sum(grams: &[Gram], runs: &[usize]) -> Gram {
        let mut sum = Gram::nothing(grams.first().map_or(0, |gram| gram.cross.len()));
        runs.iter().filter_map(|run| grams.get(*run)).for_each(|gram| sum += gram);
        sum
    }

    /// Returns the Gram products of zero rows with this number of columns.
    pub(crate) fn nothing(width: usize) -> Gram {
        Gram { square: DMatrix::zeros(width, width), cross: DVector::zeros(width), power: 0.0, rows: 0.0 }
    }

    /// Returns the sum of the products of all runs in `grams`.
    pub(crate) fn total(grams: &[Gram]) -> Gram {
        Gram::sum(grams, &(0..grams.len()).collect::<Vec<usize>>())
    }

    /// Returns these products minus the products `part` of some of their runs.
    pub(crate) fn less(&self, part: &Gram) -> Gram {
        Gram {
            square: &self.square - &part.square,
            cross: &self.cross - &part.cross,
            power: self.power - part.power,
            rows: self.rows - part.rows,
        }
    }

    /// Returns the Gram products for the residual y − X·gains as the target instead of y.
    pub(crate) fn after(mut self, gains: &DVector<f64>) -> Gram {
        self.power = self.left(gains);
        self.cross -= &self.square * gains;
        self
    }

    /// Multiplies all products by `weight`. The number of rows stays the same.
    pub(crate) fn times(mut self, weight: f64) -> Gram {
        self.square *= weight;
        self.cross *= weight;
        self.power *= weight;
        self
    }

    /// Multiplies all products and the number of rows by `weight`, so that the rows have less weight in a sum.
    pub(crate) fn faded(mut self, weight: f64) -> Gram {
        self.rows *= weight;
        self.times(weight)
    }

    /// Returns the products of only these columns (candidate terms).
    pub(crate) fn of_columns(&self, columns: &[usize]) -> Gram {
        Gram {
            square: DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
                self.square[(columns[i], columns[j])]
            }),
            cross: DVector::from_fn(columns.len(), |i, _| self.cross[columns[i]]),
            power: self.power,
            rows: self.rows,
        }
    }

    /// Returns the sum of squared residuals with these gains w: |y − X·w|², never below zero.
    pub(crate) fn left(&self, gains: &DVector<f64>) -> f64 {
        (self.power - 2.0 * gains.dot(&self.cross) + gains.dot(&(&self.square * gains))).max(0.0)
    }

    /// Returns the root mean square of each column. For a column of zeros, the result is 1, so that a division by it is
    /// possible.
    pub(crate) fn scales(&self) -> DVector<f64> {
        let rows = self.rows.max(1.0);
        self.square.diagonal().map(|square| {
            let scale = f64::sqrt(square / rows);
            if scale > 1e-9 { scale } else { 1.0 }
        })
    }

    /// Returns the Gram products per row, with each column divided by its root mean square. Penalties require columns
    /// of equal size. Also returns the divisor of each column.
    pub(crate) fn scaled(&self) -> (Gram, DVector<f64>) {
        let scales = self.scales();
        (self.divided(&scales, self.rows.max(1.0)), scales)
    }

    /// Returns the products with changed X'X and X'y: each column is divided by its scale in `scales`, and each product
    /// by `rows`.
    pub(crate) fn divided(&self, scales: &DVector<f64>, rows: f64) -> Gram {
        let shares = scales.map(|scale| 1.0 / scale);
        let mut divided = self.clone();
        divided.cross.component_mul_assign(&(&shares / rows));
        for (mut column, share) in divided.square.column_iter_mut().zip(shares.iter()) {
            let share = share / rows;
            column.zip_apply(&shares, |value, other| *value *= share * other);
        }
        divided
    }
}

impl AddAssign<&Gram> for Gram {
    fn add_assign(&mut self, other: &Gram) {
        self.square += &other.square;
        self.cross += &other.cross;
        self.power += other.power;
        self.rows += other.rows;
    }
}
