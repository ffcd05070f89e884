//! Inner cross-validation: the training runs are divided into folds, which are held out in turn. Therefore a
//! method can choose its settings on runs that were not used to fit the gains.

use crate::gram::Gram;

/// Fold: Gram products (X'X, X'y, y'y) of the training runs, and of the held-out runs.
#[derive(Clone, Debug)]
pub(super) struct Fold {
    pub(super) training: Gram,
    pub(super) held: Gram,
}

/// Divides the runs into groups; the runs of one group are held out together. With up to eight runs, each run is a
/// group. More runs are divided into seven groups by index.
pub(super) fn folds(runs: &[usize]) -> Vec<Vec<usize>> {
    const FEW: usize = 8;
    const FOLDS: usize = 7;
    if runs.len() <= FEW {
        return runs.iter().map(|run| vec![*run]).collect();
    }
    (0..FOLDS).map(|number| runs.iter().copied().skip(number).step_by(FOLDS).collect()).collect()
}

/// Gram products of all training runs, and the folds of the inner cross-validation. If there is only one run, there are
/// no folds.
pub(super) struct Inner {
    pub(super) all: Gram,
    pub(super) folds: Vec<Fold>,
}

impl Inner {
    /// Adds up the Gram products of the runs `runs`, and creates the folds. The field `all` is the sum over these runs.
    pub(super) fn of(grams: &[Gram], runs: &[usize]) -> Inner {
        if runs.len() < 2 {
            return Inner { all: Gram::sum(grams, runs), folds: Vec::new() };
        }
        let parts: Vec<Gram> = folds(runs).iter().map(|held| Gram::sum(grams, held)).collect();
        let mut all = Gram::nothing(parts.first().map_or(0, |part| part.cross.len()));
        // The training part of a fold is the sum of the runs before and after it. Subtracting the fold from the total
        // is not exact: a column that changes only in that fold would keep a rounding error.
        let mut folds: Vec<Fold> = Vec::with_capacity(parts.len());
        for held in parts {
            let training = all.clone();
            all += &held;
            folds.push(Fold { training, held });
        }
        let mut after = Gram::nothing(all.cross.len());
        for fold in folds.iter_mut().rev() {
            fold.training += &after;
            after += &fold.held;
        }
        Inner { all, folds }
    }

    /// Returns the products of only these columns (candidate terms).
    pub(super) fn of_columns(self, columns: &[usize]) -> Inner {
        if columns.iter().copied().eq(0..self.all.cross.len()) {
            return self;
        }
        let fold = |fold: &Fold| Fold {
            training: fold.training.of_columns(columns),
            held: fold.held.of_columns(columns),
        };
        Inner { all: self.all.of_columns(columns), folds: self.folds.iter().map(fold).collect() }
    }

    /// Adds a fold if there are no folds. In this fold, the single run is both the training run and the held-out run.
    pub(super) fn or_itself(mut self) -> Inner {
        if self.folds.is_empty() {
            self.folds.push(Fold { training: self.all.clone(), held: self.all.clone() });
        }
        self
    }

    /// Returns the folds. Each column (candidate term) is scaled to a root mean square of 1 in the training runs.
    pub(super) fn scaled(&self) -> Vec<Scaled> {
        self.folds.iter().map(Scaled::of).collect()
    }
}

/// Fold with each column scaled to a root mean square of 1 in the training runs. The products of the training runs are
/// also divided by their number of rows. The products of the held-out runs are not divided.
#[derive(Clone, Debug)]
pub(super) struct Scaled {
    pub(super) training: Gram,
    pub(super) held: Gram,
}

impl Scaled {
    fn of(fold: &Fold) -> Scaled {
        let (training, scales) = fold.training.scaled();
        Scaled { training, held: fold.held.divided(&scales, 1.0) }
    }
}
