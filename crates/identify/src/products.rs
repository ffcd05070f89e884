//! Gram products (X'X, X'y, y'y) of each run, of plain and of whitened rows. Plain rows are the log rows as recorded.
//! Whitened rows are rows from which their slow random drift is removed. With these products, a model can be fitted
//! without the rows. The products of several runs can be added, even if the runs are from several machines of the same
//! type.

use nalgebra::DVector;

use crate::bank::Bank;
use crate::folds::folds;
use crate::gram::Gram;
use crate::whiten;

/// Gram products X'X, X'y and y'y of each run, of plain and of whitened rows.
#[derive(Clone, Debug)]
pub(crate) struct Products {
    /// Gram products of the plain log rows. Models are validated with these products.
    plain: Vec<Gram>,
    /// Gram products of the whitened log rows. Models are identified from these products.
    white: Vec<Gram>,
}

/// Fold: Gram products of some columns. `training` contains whitened rows of the training runs. `plain` and `white`
/// contain plain and whitened rows of the held-out runs.
#[derive(Clone, Debug)]
pub(crate) struct Fold {
    pub(crate) training: Gram,
    pub(crate) plain: Gram,
    pub(crate) white: Gram,
}

impl Products {
    /// Calculates the Gram products of each run. The whitened products of a run are divided by the size of its drift.
    /// Therefore a run with a large drift has less influence than its squared errors alone would give it.
    pub(crate) fn of(bank: &Bank) -> Products {
        Products {
            plain: bank.grams(),
            white: bank.runs_in_parallel(|run| halfway(whiten::gram(&run.seconds, &run.rises, &run.target))),
        }
    }

    /// Creates products from Gram products that were stored in a file. Both vectors have one item per run.
    pub(crate) fn kept(plain: Vec<Gram>, white: Vec<Gram>) -> Products {
        Products { plain, white }
    }

    /// Returns for each run the Gram products of its plain rows and of its whitened rows.
    pub(crate) fn each(&self) -> impl Iterator<Item = (&Gram, &Gram)> {
        self.plain.iter().zip(&self.white)
    }

    /// Adds up the products of the whitened rows of these runs, for the columns `columns`. `units` contains
    /// the number by which each column is divided.
    pub(crate) fn training(&self, runs: &[usize], columns: &[usize], units: &DVector<f64>) -> Gram {
        of(&self.white, runs, columns, units)
    }

    /// Adds up the products of the plain rows of these runs.
    pub(crate) fn plain(&self, runs: &[usize]) -> Gram {
        Gram::sum(&self.plain, runs)
    }

    /// Divides these runs into folds. In each fold, some of the runs are held out.
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

/// Divides the products of a run by the root mean square of its target. Otherwise a run with a large drift would
/// determine most of the model.
fn halfway(gram: Gram) -> Gram {
    let drift = (gram.power / gram.rows.max(1.0)).sqrt();
    if drift > 0.0 { gram.times(1.0 / drift) } else { gram }
}
