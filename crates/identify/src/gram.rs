//! X'X, X'y and y'y of a run: every subset of the bank is then algebra, with no second pass over the data.

use nalgebra::{DMatrix, DVector};

use crate::statistics::count;

/// The products of a run, or of several added up.
#[derive(Clone, Debug, PartialEq)]
pub struct Gram {
    /// X'X.
    pub square: DMatrix<f64>,
    /// X'y.
    pub cross: DVector<f64>,
    /// y'y.
    pub power: f64,
    /// Rows.
    pub rows: f64,
}

impl Gram {
    /// Of these columns X, row by row with what they should give, y.
    pub fn of(columns: &DMatrix<f64>, wanted: &DVector<f64>) -> Gram {
        Gram {
            square: columns.tr_mul(columns),
            cross: columns.tr_mul(wanted),
            power: wanted.norm_squared(),
            rows: count(wanted.len()),
        }
    }

    /// Of these runs together.
    pub fn sum(grams: &[Gram], runs: &[usize]) -> Gram {
        let width = grams.first().map_or(0, |gram| gram.cross.len());
        let mut sum = Gram {
            square: DMatrix::zeros(width, width),
            cross: DVector::zeros(width),
            power: 0.0,
            rows: 0.0,
        };
        for gram in runs.iter().filter_map(|run| grams.get(*run)) {
            sum.square += &gram.square;
            sum.cross += &gram.cross;
            sum.power += gram.power;
            sum.rows += gram.rows;
        }
        sum
    }

    /// The part of these columns.
    #[must_use]
    pub fn of_columns(&self, columns: &[usize]) -> Gram {
        Gram {
            square: DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
                self.square[(columns[i], columns[j])]
            }),
            cross: DVector::from_fn(columns.len(), |i, _| self.cross[columns[i]]),
            power: self.power,
            rows: self.rows,
        }
    }

    /// What is left: |y − X·w|², never below zero.
    pub fn left(&self, gains: &DVector<f64>) -> f64 {
        (self.power - 2.0 * gains.dot(&self.cross) + gains.dot(&(&self.square * gains))).max(0.0)
    }

    /// The root mean square of each column; 1 for one that is zero throughout, which then gets no gain.
    pub fn scales(&self) -> Vec<f64> {
        let scale = |place| {
            let scale = f64::sqrt(self.square[(place, place)] / self.rows.max(1.0));
            if scale > 1e-9 { scale } else { 1.0 }
        };
        (0..self.cross.len()).map(scale).collect()
    }

    /// The same in columns of root mean square 1, per row: what penalties act upon.
    #[must_use]
    pub fn scaled(&self) -> (Gram, Vec<f64>) {
        let scales = self.scales();
        let rows = self.rows.max(1.0);
        let mut scaled = self.clone();
        for (i, own) in scales.iter().enumerate() {
            scaled.cross[i] /= own * rows;
            for (j, other) in scales.iter().enumerate() {
                scaled.square[(i, j)] /= own * other * rows;
            }
        }
        (scaled, scales)
    }
}
