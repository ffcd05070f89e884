//! Gram products (X'X, X'y, y'y) of each run, of plain and of whitened rows. Whitened rows are rows without their slow
//! random drift. With these products, a fit needs no second pass over the data. Products of several runs are added,
//! also of runs of another machine of the same type.

use nalgebra::DVector;

use crate::bank::Bank;
use crate::folds::folds;
use crate::gram::Gram;
use crate::whiten;

/// Gram products X'X, X'y and y'y of each run.
#[derive(Clone, Debug)]
pub(crate) struct Products {
    /// Gram products of the log rows as recorded. Models are validated with them.
    plain: Vec<Gram>,
    /// Gram products of the whitened log rows (rows without their slow random drift). Models are identified from them.
    white: Vec<Gram>,
}

/// Gram products of some columns for one fold. `training` contains whitened rows of the training runs; `plain` and
/// `white` contain rows of the held-out runs.
#[derive(Clone, Debug)]
pub(crate) struct Fold {
    pub(crate) training: Gram,
    pub(crate) plain: Gram,
    pub(crate) white: Gram,
}

impl Products {
    /// Calculates the Gram products of each run. The weight of a run is halfway between equal weights and weights by
    /// drift.
    pub(crate) fn of(bank: &Bank) -> Products {
        Products {
            plain: bank.grams(),
            white: bank.runs_in_parallel(|run| halfway(whiten::gram(&run.seconds, &run.rises, &run.target))),
        }
    }

    /// Restores Gram products that were stored in a file: those of plain and of whitened rows, by run.
    pub(crate) fn kept(plain: Vec<Gram>, white: Vec<Gram>) -> Products {
        Products { plain, white }
    }

    /// Returns the Gram products of each run: first of plain rows, then of whitened rows.
    pub(crate) fn each(&self) -> impl Iterator<Item = (&Gram, &Gram)> {
        self.plain.iter().zip(&self.white)
    }

    /// Adds up the whitened products of these runs, for some columns. Each column is divided by its unit.
    pub(crate) fn training(&self, runs: &[usize], columns: &[usize], units: &DVector<f64>) -> Gram {
        of(&self.white, runs, columns, units)
    }

    /// Adds up the Gram products of plain rows of these runs.
    pub(crate) fn plain(&self, runs: &[usize]) -> Gram {
        Gram::sum(&self.plain, runs)
    }

    /// Returns the folds, in which some of these runs are held out in turn.
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

/// Weights a run by the inverse of the root mean square of its target.
fn halfway(gram: Gram) -> Gram {
    let drift = (gram.power / gram.rows.max(1.0)).sqrt();
    if drift > 0.0 { gram.times(1.0 / drift) } else { gram }
}
