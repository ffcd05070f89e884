//! Elastic net for a series of decreasing L1 penalties. The series of its solutions is called its path.

use nalgebra::DVector;

use crate::gram::Gram;

/// Elastic net `½|y − Xw|² + l1·|w|₁ + ½·l2·|w|²` on scaled columns, for a series of values of `l1`. The feature-sign
/// search of Lee, Battle, Raina and Ng (2006) gives the exact solution. Coordinate descent needs many thousand rounds
/// if columns are similar.
///
/// A column is active if its gain is not zero. The sign of a column is the sign of its gain. With fixed
/// signs, the gains are the solution of one linear system. The Cholesky factor of that system is updated for
/// each added or removed column. A column whose sign would change is removed. The inactive column with the
/// largest gradient is added.
pub(crate) struct Net<'a> {
    scaled: &'a Gram,
    l2: f64,
    gains: DVector<f64>,
    columns: Vec<usize>,
    signs: Vec<f64>,
    /// Rows of the lower triangular Cholesky factor of X'X + l2, for the active columns (terms whose gains are not
    /// zero).
    factor: Vec<Vec<f64>>,
}

impl Net<'_> {
    /// Creates the elastic net with the L2 penalty `l2`. At first, all gains are zero.
    pub(crate) fn new(scaled: &Gram, l2: f64) -> Net<'_> {
        let gains = DVector::zeros(scaled.cross.len());
        Net { scaled, l2, gains, columns: Vec::new(), signs: Vec::new(), factor: Vec::new() }
    }

    /// Returns the smallest L1 penalty at which all gains are zero.
    pub(crate) fn first_penalty(&self) -> f64 {
        self.scaled.cross.amax()
    }

    /// Returns the gains at this L1 penalty. The search starts from the gains of the previous call.
    pub(crate) fn at(&mut self, l1: f64) -> &DVector<f64> {
        let size = self.gains.len();
        // Each round reduces the cost. The bound is a safeguard.
        for _ in 0..4 * size {
            self.settle(l1);
            let mut pulls = self.scaled.cross.clone();
            for column in &self.columns {
                pulls.axpy(-self.gains[*column], &self.scaled.square.column(*column), 1.0);
            }
            self.columns.iter().for_each(|column| pulls[*column] = 0.0);
            let hardest = pulls.icamax();
            if pulls.is_empty() || pulls[hardest].abs() <= l1 + 1e-6 * l1.max(1e-9) {
                break;
            }
            self.add(hardest, pulls[hardest].signum());
        }
        &self.gains
    }

    fn add(&mut self, column: usize, sign: f64) {
        let mut row: Vec<f64> = Vec::with_capacity(self.columns.len() + 1);
        for (before, other) in self.factor.iter().zip(&self.columns) {
            let shared = self.scaled.square[(*other, column)] - dot(before, &row);
            row.push(shared / before[row.len()]);
        }
        let own = self.scaled.square[(column, column)] + self.l2 - dot(&row, &row);
        row.push(own.max(f64::MIN_POSITIVE).sqrt());
        self.factor.push(row);
        self.columns.push(column);
        self.signs.push(sign);
    }

    fn remove(&mut self, place: usize) {
        self.columns.remove(place);
        self.signs.remove(place);
        self.factor.remove(place);
        // Each row below has one element too many. Givens rotations remove it, two columns at a time.
        for at in place..self.factor.len() {
            let (own, beyond) = (self.factor[at][at], self.factor[at][at + 1]);
            let length = own.hypot(beyond);
            let (cos, sin) = (own / length, beyond / length);
            for row in &mut self.factor[at..] {
                (row[at], row[at + 1]) =
                    (cos * row[at] + sin * row[at + 1], cos * row[at + 1] - sin * row[at]);
            }
            self.factor[at].truncate(at + 1);
        }
    }

    /// Returns the solution of the linear system: gains of the active columns (gains not zero), for the present signs.
    fn answer(&self, l1: f64) -> Vec<f64> {
        let mut answer: Vec<f64> = Vec::with_capacity(self.columns.len());
        for (row, (column, sign)) in self.factor.iter().zip(self.columns.iter().zip(&self.signs)) {
            let wanted = self.scaled.cross[*column] - l1 * sign;
            answer.push((wanted - dot(row, &answer)) / row[answer.len()]);
        }
        for place in (0..answer.len()).rev() {
            let row = &self.factor[place];
            answer[place] /= row[place];
            let own = answer[place];
            answer[..place].iter_mut().zip(row).for_each(|(other, shared)| *other -= own * shared);
        }
        answer
    }

    /// Moves the gains towards the solution for the present signs. If a gain reaches zero on the way, its column is
    /// removed, and the remaining gains are moved again.
    fn settle(&mut self, l1: f64) {
        while !self.columns.is_empty() {
            let answer = self.answer(l1);
            let mut way = (1.0, None);
            for (place, column) in self.columns.iter().enumerate() {
                if answer[place] * self.signs[place] <= 0.0 {
                    let reach = self.gains[*column] / (self.gains[*column] - answer[place]);
                    let reach = if reach.is_finite() { reach.clamp(0.0, 1.0) } else { 0.0 };
                    if way.1.is_none() || reach < way.0 {
                        way = (reach, Some(place));
                    }
                }
            }
            for (place, column) in self.columns.iter().enumerate() {
                self.gains[*column] += way.0 * (answer[place] - self.gains[*column]);
            }
            let Some(place) = way.1 else { return };
            self.gains[self.columns[place]] = 0.0;
            self.remove(place);
        }
    }
}

/// Returns the dot product of two vectors. If their lengths differ, the shorter length is used.
fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}
