//! Forward search judged on runs that were left out.
//!
//! Each fold keeps, column by column, what one more gain would do: how hard the column pulls, how much of it the chosen ones do
//! not say already, and what is left on the held runs. To try a column is then a few products, and to take one goes over
//! all columns once for each of the chosen.

use nalgebra::DVector;

use crate::folds::Scaled;

/// One fold. A column's *rest* is the column less what the chosen ones say of it in what is learnt from.
struct Search<'a> {
    fold: &'a Scaled,
    penalty: f64,
    /// By column, in what is learnt from: its rest squared, with the penalty, and times what is left of the target.
    own: DVector<f64>,
    pull: DVector<f64>,
    /// The same on the held runs.
    held_own: DVector<f64>,
    held_pull: DVector<f64>,
    taken: Vec<Taken>,
    /// |y − Xw|² on the held runs.
    left: f64,
}

/// What a chosen column did to the others.
struct Taken {
    /// Its rest squared when it came in, in what is learnt from and on the held runs.
    own: f64,
    held_own: f64,
    /// By column: how many times its rest went out of theirs.
    shares: DVector<f64>,
    /// By column: its rest times theirs on the held runs, just before.
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

    /// The gain of one more column.
    fn gain(&self, column: usize) -> f64 {
        self.pull[column] / self.own[column].max(1e-9)
    }

    /// What would be left on the held runs with one more column.
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
        self.taken.push(Taken { own, held_own, shares, held });
    }
}

/// The columns, in the order in which they came in, and what they leave on held-out runs.
pub(super) fn forward(folds: &[&Scaled], penalty: f64, most: usize) -> (Vec<usize>, f64) {
    let width = folds.first().map_or(0, |fold| fold.held.cross.len());
    let each_its_own: Vec<Option<usize>> = (0..width).map(Some).collect();
    forward_once_each(folds, penalty, most, &each_its_own)
}

/// The same with at most one column of each group; a column without a group stays out.
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
