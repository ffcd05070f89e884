//! Forward search: repeatedly adds the best column (candidate term), as long as the residual on held-out runs
//! decreases.
//!
//! A fold is a division into training runs and held-out runs. The rest of a column is the part that the chosen columns
//! do not explain. For each column, a fold stores the squared norm of its rest, and the product of its rest with the
//! residual. Therefore a column can be tried with a few multiplications.

use nalgebra::DVector;

use crate::folds::Scaled;

/// State of the search in one fold. The rest of a column is the column minus its projection on the chosen columns. The
/// projection is calculated in the training runs.
struct Search<'a> {
    fold: &'a Scaled,
    penalty: f64,
    /// For each column: squared norm of its rest in the training runs, plus the penalty.
    own: DVector<f64>,
    /// For each column: product of its rest with the residual of the target, in the training runs.
    pull: DVector<f64>,
    /// For each column: squared norm of its rest in the held-out runs, without the penalty.
    held_own: DVector<f64>,
    /// For each column: product of its rest with the residual of the target, in the held-out runs.
    held_pull: DVector<f64>,
    taken: Vec<ColumnEffect>,
    /// Squared residual |y − Xw|² of the held-out runs with the chosen columns.
    left: f64,
}

/// Effect of a chosen column on the rests (unexplained parts) of the other columns.
struct ColumnEffect {
    /// Squared norm of the rest of the chosen column when it was chosen: `own` in the training runs, `held_own` in the
    /// held-out runs.
    own: f64,
    held_own: f64,
    /// For each other column: multiple of the rest of the chosen column that was subtracted from the rest of the other
    /// column.
    shares: DVector<f64>,
    /// For each other column: product of its rest and the rest of the chosen column in the held-out runs, before the
    /// subtraction.
    held: DVector<f64>,
}

impl Search<'_> {
    fn new(fold: &Scaled, penalty: f64) -> Search<'_> {
        Search {
            fold,
            penalty,
            own: fold.training.square.diagonal().add_scalar(penalty),
            pull: fold.training.cross.clone(),
            held_own: fold.held.square.diagonal(),
            held_pull: fold.held.cross.clone(),
            taken: Vec::new(),
            left: fold.held.power,
        }
    }

    /// Returns the gain that a column (candidate term) would have if it were chosen next.
    fn gain(&self, column: usize) -> f64 {
        self.pull[column] / self.own[column].max(1e-9)
    }

    /// Returns the squared residual of the held-out runs if this column (candidate term) were chosen next.
    fn left(&self, column: usize) -> f64 {
        let gain = self.gain(column);
        self.left + gain * (gain * self.held_own[column] - 2.0 * self.held_pull[column])
    }

    fn take(&mut self, column: usize) {
        let (gain, own) = (self.gain(column), self.own[column].max(1e-9));
        let mut shares = self.fold.training.square.column(column).into_owned();
        let mut held = self.fold.held.square.column(column).into_owned();
        for before in &self.taken {
            let share = before.shares[column];
            shares.axpy(-share * before.own, &before.shares, 1.0);
            held.axpy(-share, &before.held, 1.0);
            held.axpy(share * before.held_own - before.held[column], &before.shares, 1.0);
        }
        shares[column] += self.penalty;
        shares /= own;
        let (held_own, held_pull, pull) = (held[column], self.held_pull[column], self.pull[column]);
        self.left = self.left(column);
        self.own.zip_apply(&shares, |rest, share| *rest -= share * share * own);
        self.pull.axpy(-pull, &shares, 1.0);
        self.held_own.zip_zip_apply(&shares, &held, |rest, share, held| {
            *rest += share * (share * held_own - 2.0 * held);
        });
        self.held_pull.axpy(gain * held_own - held_pull, &shares, 1.0);
        self.held_pull.axpy(-gain, &held, 1.0);
        self.taken.push(ColumnEffect { own, held_own, shares, held });
    }
}

/// Adds columns as long as the residual of the held-out runs decreases, at most `most` columns. Returns the columns in
/// the order in which they were chosen, and the squared residual of the held-out runs.
pub(super) fn forward(folds: &[&Scaled], penalty: f64, most: usize) -> (Vec<usize>, f64) {
    let width = folds.first().map_or(0, |fold| fold.held.cross.len());
    let each_its_own: Vec<Option<usize>> = (0..width).map(Some).collect();
    forward_once_each(folds, penalty, most, &each_its_own)
}

/// Forward search with at most one candidate term (column) of each group. A column without a group is never chosen.
pub(super) fn forward_once_each(
    folds: &[&Scaled],
    penalty: f64,
    most: usize,
    groups: &[Option<usize>],
) -> (Vec<usize>, f64) {
    let mut folds: Vec<Search<'_>> = folds.iter().map(|fold| Search::new(fold, penalty)).collect();
    let mut chosen: Vec<usize> = Vec::new();
    let mut now: f64 = folds.iter().map(|fold| fold.left).sum();
    while chosen.len() < most {
        let is_free = |column: &usize| {
            groups[*column].is_some() && !chosen.iter().any(|other| groups[*other] == groups[*column])
        };
        let tried = (0..groups.len())
            .filter(is_free)
            .map(|column| (folds.iter().map(|fold| fold.left(column)).sum::<f64>(), column));
        let best = tried.reduce(|best, next| if next.0 < best.0 { next } else { best });
        let Some((cost, column)) = best.filter(|(cost, _)| *cost < now) else { break };
        folds.iter_mut().for_each(|fold| fold.take(column));
        chosen.push(column);
        now = cost;
    }
    (chosen, now)
}
