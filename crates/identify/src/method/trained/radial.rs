//! `rbf`: a sum of Gaussian functions around centres. All functions have the same width. k-means finds the centres
//! among the rows. Penalized least squares gives their weights. Width and penalty are chosen on held-out runs. Wide
//! functions with large positive and negative weights give a smooth surface. Narrow functions follow each region of the
//! inputs separately.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

use super::{Fold, Samples, least, rows};
use crate::solve::penalized;
use crate::statistics::{count, smallest};

/// Widths that are tried, as multiples of the root mean square of all inputs together.
const WIDTHS: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];
/// Number of penalties that are tried, from 1e-10 to 0.1 times the mean square of a basis function.
const PENALTIES: i32 = 10;
/// Width and penalty if there is only one run, because no validation is possible then.
const UNVALIDATED: (f64, f64) = (4.0, 1e-4);
const ROUNDS: usize = 50;
/// Limit of the movement of a centre in one step of k-means, in units of the scaled inputs. k-means ends if no centre
/// moves farther.
const STILL: f64 = 1e-6;

/// Number of radial-basis models whose mean is the model. Each has its own centres, because the result of k-means
/// depends on its random start.
const MEMBERS: u8 = 5;

/// Model that is the mean of several radial-basis models.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bumps(Vec<Member>);

/// Radial-basis model y = Σ w·(φ(x) − φ(0)) with the rises x. It gives zero if all rises are zero.
#[derive(Clone, Debug, PartialEq)]
struct Member {
    centres: DMatrix<f64>,
    width: f64,
    weights: DVector<f64>,
}

#[cfg(test)]
impl Bumps {
    pub(super) fn output(&self, rises: &DMatrix<f64>) -> DVector<f64> {
        let sum = DVector::zeros(rises.nrows());
        self.0.iter().map(|member| member.output(rises)).fold(sum, |sum, said| sum + said)
            / count(self.0.len())
    }
}

impl Member {
    /// Fits the weights. `width` is a multiple of the root mean square of all inputs together. Each input is already
    /// scaled to a root mean square of 1.
    fn new(samples: &Samples, centres: DMatrix<f64>, width: f64, penalty: f64) -> Member {
        let width = count(centres.ncols()).sqrt() * width;
        let said = said(&samples.rises, &centres, width);
        let square = said.tr_mul(&said);
        let usual = (square.trace() / count(centres.nrows())).max(f64::MIN_POSITIVE);
        let weights = penalized(&square, &said.tr_mul(&samples.target), penalty * usual);
        Member { centres, width, weights }
    }

    fn output(&self, rises: &DMatrix<f64>) -> DVector<f64> {
        said(rises, &self.centres, self.width) * &self.weights
    }
}

/// Returns the width and the penalty with the smallest residual on the held-out runs of the folds.
fn chosen(folds: &[Fold<'_>], centres: usize, seed: u64) -> (f64, f64) {
    let penalties = || (0..PENALTIES).map(|place| 10f64.powi(place - PENALTIES));
    let tried: Vec<(f64, f64)> =
        WIDTHS.iter().flat_map(|width| penalties().map(|penalty| (*width, penalty))).collect();
    let costs = |fold: &Fold<'_>| {
        let centres =
            k_means(&fold.training.rises, centres, seed.wrapping_mul(100).wrapping_add(fold.number));
        let cost = |(width, penalty): &(f64, f64)| {
            let member = Member::new(&fold.training, centres.clone(), *width, *penalty);
            fold.left(|rises| member.output(rises))
        };
        tried.iter().map(cost).collect()
    };
    least(folds, costs).map_or(UNVALIDATED, |place| tried[place])
}

pub(super) fn fit(all: &Samples, folds: &[Fold<'_>], centres: usize, seed: u64) -> Bumps {
    let own = |member: u8| seed.wrapping_mul(u64::from(MEMBERS)).wrapping_add(u64::from(member));
    Bumps((0..MEMBERS).map(|member| member_of(all, folds, centres, own(member))).collect())
}

fn member_of(all: &Samples, folds: &[Fold<'_>], centres: usize, seed: u64) -> Member {
    let (width, penalty) = chosen(folds, centres, seed);
    let centres = k_means(&all.rises, centres, seed.wrapping_mul(100).wrapping_add(99));
    Member::new(all, centres, width, penalty)
}

/// Returns the model as the content of a model file (a network in JSON).
pub(super) fn file(bumps: &Bumps) -> Value {
    let share = 1.0 / count(bumps.0.len());
    let mut bias = 0.0;
    let (mut centres, mut widths, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for member in &bumps.0 {
        bias -= at_rest(&member.centres, member.width).dot(&member.weights) * share;
        centres.extend(rows(&member.centres));
        widths.extend(member.weights.iter().map(|_| member.width));
        weights.extend(member.weights.iter().map(|weight| weight * share));
    }
    json!({ "type": "rbf", "centres": centres, "widths": widths, "weights": weights, "bias": bias })
}

fn bump(squared: f64, width: f64) -> f64 {
    (-0.5 * squared / (width * width)).exp()
}

fn at_rest(centres: &DMatrix<f64>, width: f64) -> DVector<f64> {
    DVector::from_iterator(
        centres.nrows(),
        centres.row_iter().map(|centre| bump(centre.norm_squared(), width)),
    )
}

/// Returns for each row the value of each basis function, minus the value of that function at zero rises.
fn said(rises: &DMatrix<f64>, centres: &DMatrix<f64>, width: f64) -> DMatrix<f64> {
    let rest = at_rest(centres, width);
    let apart = |row: usize, place: usize| apart(rises, row, centres, place);
    DMatrix::from_fn(rises.nrows(), centres.nrows(), |row, place| {
        bump(apart(row, place), width) - rest[place]
    })
}

/// Returns the squared distance between the rises in the row `row` and the centre `place`.
fn apart(rises: &DMatrix<f64>, row: usize, centres: &DMatrix<f64>, place: usize) -> f64 {
    (0..rises.ncols()).map(|column| (rises[(row, column)] - centres[(place, column)]).powi(2)).sum()
}

/// Returns the centres of groups of similar rows; there are at most as many centres as rows. k-means begins with rows
/// that are far apart (k-means++, Arthur and Vassilvitskii 2007).
fn k_means(rises: &DMatrix<f64>, centres: usize, seed: u64) -> DMatrix<f64> {
    let mut chance = Pcg64Mcg::seed_from_u64(seed);
    let count = rises.nrows();
    let mut drawn = vec![chance.random_range(0..count.max(1))];
    let mut far = vec![f64::MAX; count];
    while drawn.len() < centres.min(count) {
        for (row, far) in far.iter_mut().enumerate() {
            *far = far.min(apart(rises, row, rises, drawn[drawn.len() - 1]));
        }
        let mut left = chance.random_range(0.0..1.0) * far.iter().sum::<f64>();
        let next = far.iter().position(|far| {
            left -= far;
            left < 0.0
        });
        drawn.push(next.unwrap_or(count - 1));
    }
    let mut centres = rises.select_rows(&drawn);
    for _ in 0..ROUNDS {
        let mut groups = vec![Vec::new(); centres.nrows()];
        for row in 0..count {
            let costs: Vec<f64> =
                (0..centres.nrows()).map(|place| apart(rises, row, &centres, place)).collect();
            groups[smallest(&costs)].push(row);
        }
        let mut moved: f64 = 0.0;
        for (place, group) in groups.iter().enumerate().filter(|(_, group)| !group.is_empty()) {
            let mean = rises.select_rows(group).row_mean();
            moved = moved.max((&mean - centres.row(place)).norm());
            centres.set_row(place, &mean);
        }
        if moved < STILL {
            break;
        }
    }
    centres
}
