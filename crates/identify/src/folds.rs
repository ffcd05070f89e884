//! Inner validation: training runs that are left out in turn, so that what a method chooses is chosen on runs that it did not
//! learn from.

use crate::gram::Gram;

/// Inner folds of training runs: one out where they are few, else seven by place.
pub(super) fn folds(runs: &[usize]) -> Vec<Vec<usize>> {
    const FEW: usize = 8;
    const FOLDS: usize = 7;
    if runs.len() <= FEW {
        return runs.iter().map(|run| vec![*run]).collect();
    }
    let fold = |fold| runs.iter().copied().enumerate().filter(move |(place, _)| place % FOLDS == fold);
    (0..FOLDS).map(|number| fold(number).map(|(_, run)| run).collect()).collect()
}

/// The runs that are left for training beside each inner fold, with the fold. One run alone has no inner validation.
pub(super) fn inner(grams: &[Gram], runs: &[usize]) -> Vec<(Gram, Vec<usize>)> {
    if runs.len() < 2 {
        return Vec::new();
    }
    let fold = |fold: Vec<usize>| {
        let others: Vec<usize> = runs.iter().copied().filter(|run| !fold.contains(run)).collect();
        (Gram::sum(grams, &others), fold)
    };
    folds(runs).into_iter().map(fold).collect()
}
