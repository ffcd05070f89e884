//! Products X'X, X'y and y'y of a run. With them, a fit of any subset of the bank needs no second pass over the data.

use std::ops::AddAssign;

use nalgebra::{DMatrix, DVector};

use crate::statistics::count;

/// Products of one run, or the sum of several runs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gram {
    /// X'X.
    pub(crate) square: DMatrix<f64>,
    /// X'y.
    pub(crate) cross: DVector<f64>,
    /// y'y.
    pub(crate) power: f64,
    /// Number of rows.
    pub(crate) rows: f64,
}

impl Gram {
    /// Products of the columns X and the target y.
    pub(crate) fn of(columns: &DMatrix<f64>, target: &DVector<f64>) -> Gram {
        Gram {
            // The plain matrix product has optimized kernels, the transposed one has none.
            square: columns.transpose() * columns,
            cross: columns.tr_mul(target),
            power: target.norm_squared(),
            rows: count(target.len()),
        }
    }

    /// Sum of these runs.
    pub(crate) fn sum(grams: &[Gram], runs: &[usize]) -> Gram {
        let mut sum = Gram::nothing(grams.first().map_or(0, |gram| gram.cross.len()));
        runs.iter().filter_map(|run| grams.get(*run)).for_each(|gram| sum += gram);
        sum
    }

    /// Products of zero rows with this number of columns.
    pub(crate) fn nothing(width: usize) -> Gram {
        Gram { square: DMatrix::zeros(width, width), cross: DVector::zeros(width), power: 0.0, rows: 0.0 }
    }

    /// Sum of all runs.
    pub(crate) fn total(grams: &[Gram]) -> Gram {
        Gram::sum(grams, &(0..grams.len()).collect::<Vec<usize>>())
    }

    /// Subtracts a part.
    pub(crate) fn less(&self, part: &Gram) -> Gram {
        Gram {
            square: &self.square - &part.square,
            cross: &self.cross - &part.cross,
            power: self.power - part.power,
            rows: self.rows - part.rows,
        }
    }

    /// Products of the residual target after the contribution of these gains has been subtracted.
    pub(crate) fn after(mut self, gains: &DVector<f64>) -> Gram {
        self.power = self.left(gains);
        self.cross -= &self.square * gains;
        self
    }

    /// Multiplies the weight of each row, but not the number of rows.
    pub(crate) fn times(mut self, weight: f64) -> Gram {
        self.square *= weight;
        self.cross *= weight;
        self.power *= weight;
        self
    }

    /// Selects these columns.
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

    /// Sum of squared residuals with these gains: |y − X·w|², never below zero.
    pub(crate) fn left(&self, gains: &DVector<f64>) -> f64 {
        (self.power - 2.0 * gains.dot(&self.cross) + gains.dot(&(&self.square * gains))).max(0.0)
    }

    /// Root mean square of each column; 1 for a column of zeros, which then gets no gain.
    pub(crate) fn scales(&self) -> DVector<f64> {
        let rows = self.rows.max(1.0);
        self.square.diagonal().map(|square| {
            let scale = f64::sqrt(square / rows);
            if scale > 1e-9 { scale } else { 1.0 }
        })
    }

    /// Products per row with columns of root mean square 1, as penalties require, and the scales.
    pub(crate) fn scaled(&self) -> (Gram, DVector<f64>) {
        let scales = self.scales();
        (self.divided(&scales, self.rows.max(1.0)), scales)
    }

    /// X'X and X'y with columns divided by these scales, and divided by this number of rows.
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
