//! Inner validation: training runs that are left out in turn, so that what a method chooses is chosen on runs that it did not
//! learn from.

use crate::gram::Gram;

/// The products of the runs that are learnt from, and of those that are held out.
#[derive(Clone, Debug)]
pub(super) struct Fold {
    pub(super) training: Gram,
    pub(super) held: Gram,
}

/// Which runs are held out together: one by one where they are few, else in seven folds by place.
pub(super) fn folds(runs: &[usize]) -> Vec<Vec<usize>> {
    const FEW: usize = 8;
    const FOLDS: usize = 7;
    if runs.len() <= FEW {
        return runs.iter().map(|run| vec![*run]).collect();
    }
    (0..FOLDS).map(|number| runs.iter().copied().skip(number).step_by(FOLDS).collect()).collect()
}

/// The runs that are learnt from, all of them, and their inner folds. One run alone has none.
pub(super) struct Inner {
    pub(super) all: Gram,
    pub(super) folds: Vec<Fold>,
}

impl Inner {
    /// Every run is added once, whatever the number of folds.
    pub(super) fn of(grams: &[Gram], runs: &[usize]) -> Inner {
        if runs.len() < 2 {
            return Inner { all: Gram::sum(grams, runs), folds: Vec::new() };
        }
        let parts: Vec<Gram> = folds(runs).iter().map(|held| Gram::sum(grams, held)).collect();
        let mut all = Gram::nothing(parts.first().map_or(0, |part| part.cross.len()));
        // What is learnt from is what comes before the fold and what comes after it. Taken out of the whole it would not do: of a
        // column that moves in that fold alone rounding would be left.
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

    /// The part of these columns.
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

    /// One run alone is judged by itself.
    pub(super) fn or_itself(mut self) -> Inner {
        if self.folds.is_empty() {
            self.folds.push(Fold { training: self.all.clone(), held: self.all.clone() });
        }
        self
    }

    /// The folds in columns of root mean square 1.
    pub(super) fn scaled(&self) -> Vec<Scaled> {
        self.folds.iter().map(Scaled::of).collect()
    }
}

/// A fold in columns whose root mean square is 1 in what is learnt from: that per row, what is held out as it is.
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
