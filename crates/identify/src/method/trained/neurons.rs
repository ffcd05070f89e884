//! `network`: one layer of tanh neurons, trained by back-propagation with Adam (Kingma and Ba 2015) on all rows at
//! once.
//!
//! The initial weights are small. Therefore a short training gives a nearly linear network that follows only the
//! largest changes of the sensors. A longer training also follows finer details. The number of rounds is chosen on
//! held-out runs (early stopping by run). Then several networks with different initial weights are trained on all runs
//! for that number of rounds. The model is the mean of these networks, which is one wider network.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::{DMatrix, DVector};
use pulp::Arch;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{Fold, Samples, least, rows};
use crate::statistics::count;

/// Number of networks whose mean is the model.
pub(super) const MEMBERS: usize = 5;
/// Number of networks whose mean is tested while the training lengths are compared.
const COMPARED: u64 = 2;
/// Numbers of training rounds that are compared. A round is one pass over all rows.
pub(super) const LENGTHS: [usize; 11] = [30, 60, 100, 150, 200, 300, 400, 600, 800, 1000, 1500];
/// Number of training rounds if there is only one run, because no validation is possible then.
const UNVALIDATED: usize = 100;
/// Weight decay: share of a weight that is added to its gradient.
const DECAY: f64 = 1e-3;
const RATE: f64 = 0.01;
/// Standard deviations of the random initial weights: input weights of a neuron, bias of a neuron, and output weight.
const BEGIN: (f64, f64, f64) = (0.2, 0.2, 0.5);

/// Network y = Σ w·(tanh(W·x + b) − tanh b) with the rises x. It gives zero if all rises are zero.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Neurons {
    first: DMatrix<f64>,
    bias: DVector<f64>,
    second: DVector<f64>,
}

impl Neurons {
    fn begin(inputs: usize, neurons: usize, chance: &mut Pcg64Mcg) -> Neurons {
        // The sum of four uniform random numbers is nearly normal.
        let mut drawn = |spread: f64| {
            let sum: f64 = (0..4).map(|_| chance.random_range(-1.0..1.0)).sum();
            spread * sum * (3.0_f64 / 4.0).sqrt()
        };
        let (sum, bias, adds) = BEGIN;
        let (sum, adds) = (sum / count(inputs).sqrt(), adds / count(neurons).sqrt());
        Neurons {
            first: DMatrix::from_fn(neurons, inputs, |_, _| drawn(sum)),
            bias: DVector::from_fn(neurons, |_, _| drawn(bias)),
            second: DVector::from_fn(neurons, |_, _| drawn(adds)),
        }
    }

    /// Returns the output of each neuron for each row, as a matrix of rows × neurons.
    fn layer(&self, rises: &DMatrix<f64>) -> DMatrix<f64> {
        let mut layer = product(view(rises), view(&self.first).transpose());
        for (mut column, bias) in layer.column_iter_mut().zip(self.bias.iter()) {
            let sums = column.as_mut_slice();
            Arch::new().dispatch(|| sums.iter_mut().for_each(|sum| *sum = tanh(*sum + bias)));
        }
        layer
    }

    fn at_rest(&self) -> DVector<f64> {
        self.bias.map(tanh)
    }

    pub(super) fn output(&self, rises: &DMatrix<f64>) -> DVector<f64> {
        (self.layer(rises) * &self.second).add_scalar(-self.at_rest().dot(&self.second))
    }

    /// Returns the gradients with respect to W, b and w of half the mean squared error, with weight decay. `self`
    /// contains several networks of `neurons` neurons each. The error of each network is calculated separately.
    fn slopes(&self, samples: &Samples, neurons: usize) -> (DMatrix<f64>, DVector<f64>, DVector<f64>) {
        let mut layer = self.layer(&samples.rises);
        let rest = self.at_rest();
        let (mut bias, mut second) = (DVector::zeros(rest.len()), DVector::zeros(rest.len()));
        let each = 1.0 / count(samples.target.len()).max(1.0);
        let ones = DVector::from_element(samples.target.len(), 1.0);
        for begin in (0..rest.len()).step_by(neurons) {
            let own = layer.columns(begin, neurons);
            let (rest, weights) = (rest.rows(begin, neurons), self.second.rows(begin, neurons));
            let left = (own * weights).add_scalar(-rest.dot(&weights)) - &samples.target;
            let sum = left.sum();
            second.rows_mut(begin, neurons).copy_from(&((own.tr_mul(&left) - rest * sum) * each));
            for place in begin..begin + neurons {
                let weight = self.second[place];
                let mut said = layer.column_mut(place);
                let both = said.as_mut_slice().iter_mut().zip(left.as_slice());
                Arch::new().dispatch(|| {
                    both.for_each(|(said, left)| *said = left * weight * (1.0 - *said * *said));
                });
                let at_rest = sum * weight * (1.0 - rest[place - begin] * rest[place - begin]);
                bias[place] = (said.dot(&ones) - at_rest) * each;
            }
        }
        second += &self.second * DECAY;
        let first = product(view(&layer).transpose(), view(&samples.rises));
        (first * each + &self.first * DECAY, bias, second)
    }

    /// Combines several networks into one network that contains all their neurons.
    fn stacked(parts: &[Neurons]) -> Neurons {
        let of = |of: fn(&Neurons) -> &DVector<f64>| {
            DVector::from_vec(parts.iter().flat_map(|part| of(part).iter().copied()).collect())
        };
        let rows: Vec<_> = parts.iter().flat_map(|part| part.first.row_iter()).collect();
        Neurons {
            first: DMatrix::from_rows(&rows),
            bias: of(|part| &part.bias),
            second: of(|part| &part.second),
        }
    }

    /// Returns a network of `neurons` consecutive neurons. `begin` is the index of the first of them.
    fn part(&self, begin: usize, neurons: usize) -> Neurons {
        Neurons {
            first: self.first.rows(begin, neurons).into_owned(),
            bias: self.bias.rows(begin, neurons).into_owned(),
            second: self.second.rows(begin, neurons).into_owned(),
        }
    }
}

/// Product of two matrices. For these sizes, faer takes 70 % of the time of nalgebra, which copies both matrices first.
fn product(one: MatRef<'_, f64>, other: MatRef<'_, f64>) -> DMatrix<f64> {
    let (rows, columns) = (one.nrows(), other.ncols());
    let mut product = DMatrix::zeros(rows, columns);
    let to = MatMut::from_column_major_slice_mut(product.as_mut_slice(), rows, columns);
    matmul(to, Accum::Replace, one, other, 1.0, Par::Seq);
    product
}

fn view(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}

/// Calculates tanh with an error of a few 1e-16, without a branch or a call. Therefore the compiler can vectorize loops
/// over this function, which take most of the training time.
///
/// With e = exp(−2·|x|), the result is (1 − e) / (1 + e). The exponential is 2^k·exp(r). |r| is at most ln 2 / 2, so a
/// short series gives exp(r).
#[inline]
pub(super) fn tanh(x: f64) -> f64 {
    /// Argument of tanh above which the result is 1.
    const FLAT: f64 = 20.0;
    /// Constant for rounding: the sum of this constant and a small number contains the small number in its last bits,
    /// rounded to an integer.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    const LN_2: (f64, f64) = (6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10);
    /// Reciprocals of the factorials of 0 to 13.
    const SERIES: [f64; 14] = {
        let mut shares = [1.0; 14];
        let mut place = 1;
        while place < 14 {
            shares[place] = shares[place - 1] / place as f64;
            place += 1;
        }
        shares
    };
    let size = x.abs();
    let power = -2.0 * if size < FLAT { size } else { FLAT };
    let shifted = power * std::f64::consts::LOG2_E + WHOLE;
    let whole = shifted - WHOLE;
    let rest = power - whole * LN_2.0 - whole * LN_2.1;
    // In a plain evaluation, each operation waits for the one before. Groups of two, four and eight terms are
    // independent.
    let (square, fourth) = (rest * rest, (rest * rest) * (rest * rest));
    let two = |place: usize| SERIES[place] + SERIES[place + 1] * rest;
    let four = |place: usize| two(place) + two(place + 2) * square;
    let series = four(0) + (four(4) + (four(8) + two(12) * fourth) * fourth) * fourth;
    let exp = series * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    ((1.0 - exp) / (1.0 + exp)).copysign(x)
}

/// State of the optimizer Adam for some weights: running mean of the gradient, and running mean of the square of the
/// gradient.
struct Adam {
    mean: Vec<f64>,
    square: Vec<f64>,
}

impl Adam {
    fn of(weights: usize) -> Adam {
        Adam { mean: vec![0.0; weights], square: vec![0.0; weights] }
    }

    /// Updates the weights by one step of the optimizer. `begun` corrects the initial bias of the two running means.
    fn step(&mut self, weights: &mut [f64], slopes: &[f64], begun: (f64, f64)) {
        let means = self.mean.iter_mut().zip(&mut self.square);
        let all = weights.iter_mut().zip(slopes).zip(means);
        Arch::new().dispatch(|| {
            all.for_each(|((weight, slope), (mean, square))| {
                *mean = KEPT.0 * *mean + (1.0 - KEPT.0) * slope;
                *square = KEPT.1 * *square + (1.0 - KEPT.1) * slope * slope;
                *weight -= RATE * (*mean / begun.0) / ((*square / begun.1).sqrt() + 1e-8);
            });
        });
    }
}

const KEPT: (f64, f64) = (0.9, 0.999);

/// Trains one network for each seed. `lengths` contains numbers of rounds in ascending order. Returns all networks for
/// each of these numbers. In each round, all networks are trained in one pass over the rows.
pub(super) fn train(
    samples: &Samples,
    neurons: usize,
    seeds: &[u64],
    lengths: &[usize],
) -> Vec<Vec<Neurons>> {
    let begin =
        |seed: &u64| Neurons::begin(samples.rises.ncols(), neurons, &mut Pcg64Mcg::seed_from_u64(*seed));
    let mut all = Neurons::stacked(&seeds.iter().map(begin).collect::<Vec<_>>());
    let (mut first, mut bias, mut second) =
        (Adam::of(all.first.len()), Adam::of(all.bias.len()), Adam::of(all.second.len()));
    let mut kept = vec![Vec::new(); seeds.len()];
    let mut share = (1.0, 1.0);
    for round in 1..=lengths.last().copied().unwrap_or(0) {
        share = (share.0 * KEPT.0, share.1 * KEPT.1);
        let begun = (1.0 - share.0, 1.0 - share.1);
        let slopes = all.slopes(samples, neurons);
        first.step(all.first.as_mut_slice(), slopes.0.as_slice(), begun);
        bias.step(all.bias.as_mut_slice(), slopes.1.as_slice(), begun);
        second.step(all.second.as_mut_slice(), slopes.2.as_slice(), begun);
        if lengths.contains(&round) {
            kept.iter_mut().enumerate().for_each(|(own, kept)| kept.push(all.part(own * neurons, neurons)));
        }
    }
    kept
}

/// Returns the number of training rounds with the smallest residual on the held-out runs of the folds.
pub(super) fn length(folds: &[Fold<'_>], neurons: usize, seed: u64) -> usize {
    let costs = |fold: &Fold<'_>| {
        let seed = |member| seed.wrapping_mul(1000).wrapping_add(100 * member + fold.number);
        let seeds: Vec<u64> = (0..COMPARED).map(seed).collect();
        let members = train(&fold.training, neurons, &seeds, &LENGTHS);
        let cost = |place: usize| {
            let at = members.iter().filter_map(|member| member.get(place)).collect::<Vec<_>>();
            fold.left(|rises| mean(&at, rises))
        };
        (0..LENGTHS.len()).map(cost).collect()
    };
    least(folds, costs).map_or(UNVALIDATED, |place| LENGTHS[place])
}

fn mean(members: &[&Neurons], rises: &DMatrix<f64>) -> DVector<f64> {
    let zero = DVector::zeros(rises.nrows());
    members.iter().fold(zero, |sum, member| sum + member.output(rises)) / count(members.len())
}

/// Trains the networks whose mean is the model.
pub(super) fn fit(all: &Samples, folds: &[Fold<'_>], neurons: usize, seed: u64) -> Vec<Neurons> {
    let length = length(folds, neurons, seed);
    let members: Vec<u64> = (500..).take(MEMBERS).collect();
    let seed = |member| seed.wrapping_mul(1000).wrapping_add(member);
    let each = members.into_par_iter().flat_map(|member| train(all, neurons, &[seed(member)], &[length]));
    each.flatten().collect()
}

/// Returns the mean of the networks as the content of a model file (one network in JSON).
pub(super) fn file(members: &[Neurons]) -> Value {
    let share = 1.0 / count(members.len());
    let weights: Vec<Vec<f64>> = members.iter().flat_map(|member| rows(&member.first)).collect();
    let bias: Vec<f64> = members.iter().flat_map(|member| member.bias.iter().copied()).collect();
    let second: Vec<f64> =
        members.iter().flat_map(|member| member.second.iter().map(|weight| weight * share)).collect();
    let rest: f64 = bias.iter().zip(&second).map(|(bias, weight)| bias.tanh() * weight).sum();
    json!({
        "type": "bp",
        "layers": [
            { "weights": weights, "bias": bias, "activation": "tanh" },
            { "weights": [second], "bias": [-rest], "activation": "linear" },
        ],
    })
}
