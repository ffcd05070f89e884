//! The products of each run, as they are and whitened: whatever is learnt is then algebra, with no second pass over the data.
//! Runs add up, those of a second machine of the same kind as well.

use nalgebra::DVector;

use crate::bank::Bank;
use crate::folds::folds;
use crate::gram::Gram;
use crate::whiten;

/// By run.
#[derive(Clone, Debug)]
pub(crate) struct Products {
    /// Of the rows as they are: what a model is judged by.
    plain: Vec<Gram>,
    /// Of whitened rows: what a model is learnt from.
    white: Vec<Gram>,
}

/// Some columns of these products, over runs that are learnt from and runs that are left out.
#[derive(Clone, Debug)]
pub(crate) struct Fold {
    pub(crate) training: Gram,
    pub(crate) plain: Gram,
    pub(crate) white: Gram,
}

impl Products {
    /// Runs count halfway between alike and by what they drift.
    pub(crate) fn of(bank: &Bank) -> Products {
        Products {
            plain: bank.grams(),
            white: bank.runs_in_parallel(|run| halfway(whiten::gram(&run.seconds, &run.rises, &run.target))),
        }
    }

    /// Those of each run that were kept: of its rows as they are, and whitened.
    pub(crate) fn kept(plain: Vec<Gram>, white: Vec<Gram>) -> Products {
        Products { plain, white }
    }

    /// By run: of its rows as they are, and whitened.
    pub(crate) fn each(&self) -> impl Iterator<Item = (&Gram, &Gram)> {
        self.plain.iter().zip(&self.white)
    }

    /// What is learnt from these runs, in columns that are divided by these units.
    pub(crate) fn training(&self, runs: &[usize], columns: &[usize], units: &DVector<f64>) -> Gram {
        of(&self.white, runs, columns, units)
    }

    /// Plain rows of these runs.
    pub(crate) fn plain(&self, runs: &[usize]) -> Gram {
        Gram::sum(&self.plain, runs)
    }

    /// The same where some of these runs are left out in turn.
    pub(crate) fn folds(&self, runs: &[usize], columns: &[usize], units: &DVector<f64>) -> Vec<Fold> {
        let all = self.training(runs, columns, units);
        let fold = |held: Vec<usize>| {
            let white = of(&self.white, &held, columns, units);
            Fold { training: all.less(&white), plain: of(&self.plain, &held, columns, units), white }
        };
        folds(runs).into_iter().map(fold).collect()
    }
}

fn of(grams: &[Gram], runs: &[usize], columns: &[usize], units: &DVector<f64>) -> Gram {
    Gram::sum(grams, runs).of_columns(columns).divided(units, 1.0)
}

/// What a run drifts counts by its root.
fn halfway(gram: Gram) -> Gram {
    let drift = (gram.power / gram.rows.max(1.0)).sqrt();
    if drift > 0.0 { gram.times(1.0 / drift) } else { gram }
}
