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

/// The inner folds of these runs. One run alone has none.
pub(super) fn inner(grams: &[Gram], runs: &[usize]) -> Vec<Fold> {
    if runs.len() < 2 {
        return Vec::new();
    }
    let fold = |held: Vec<usize>| {
        let others: Vec<usize> = runs.iter().copied().filter(|run| !held.contains(run)).collect();
        Fold { training: Gram::sum(grams, &others), held: Gram::sum(grams, &held) }
    };
    folds(runs).into_iter().map(fold).collect()
}

/// The inner folds; one run alone is judged by itself.
pub(super) fn inner_or_itself(grams: &[Gram], runs: &[usize]) -> Vec<Fold> {
    match inner(grams, runs) {
        folds if folds.is_empty() => {
            let sum = Gram::sum(grams, runs);
            vec![Fold { training: sum.clone(), held: sum }]
        }
        folds => folds,
    }
}
