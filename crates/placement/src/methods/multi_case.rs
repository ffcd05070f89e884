//! Selection of one node per block for all load cases together.
//!
//! The error of each case is divided by the larger of two figures:
//!
//! - The unavoidable error: the lower bound with the best block temperatures, together with the effect of the sensor
//!   noise.
//! - The error of the patent's method on this case alone.
//!
//! The search minimizes the sum of the sixth powers of these ratios. Therefore the worst case has the greatest weight,
//! and a case that cannot be improved has almost none.
//!
//! Single nodes are changed under a decreasing threshold (threshold accepting; Dueck and Scheuer, Journal of
//! Computational Physics 90, 1990), from several random starts. At the end, each block in turn gets its best node,
//! until no change helps. The search also starts from the placements for single cases. With a single case, the result
//! is therefore never worse than the patent's method or bounded least squares. The same input gives the same result.

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use super::bounded::bounded;
use super::nearest;
use super::patent::patent;
use crate::mesh::count;
use crate::problem::{Problem, Target};

/// Effort of the search. A greater effort finds better nodes, but takes longer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Number of random starts; the best result is used.
    pub starts: u64,
    /// Number of tried changes of a single node, for each start.
    pub changes: u32,
}

impl Effort {
    /// Effort for the search that places the sensors.
    pub const FULL: Effort = Effort { starts: 4, changes: 1_000_000 };
    /// Effort for comparisons, for example without one case or with another number of blocks.
    pub const SHORT: Effort = Effort { starts: 2, changes: 150_000 };
}

/// Fraction of the sensor noise that remains in an average over one minute. The unavoidable error includes the effect
/// of this remaining noise.
const LEFT_OF_NOISE: f64 = 0.3;

/// Limits below which errors are negligible. A method ends when it reaches its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Noise of the temperature of a single sensor, K.
    pub noise: f64,
    /// Residual at which the patent's iteration ends, µm RMS.
    pub enough: f64,
}

/// Selects a sensor node for each block, so that the error is small in all load cases `cases` (indices). Returns for
/// each block the index of the node in its list of candidates.
#[must_use]
pub fn multi_case(problem: &Problem, cases: &[usize], tolerance: Tolerance, effort: Effort) -> Vec<usize> {
    let alone: Vec<Alone> = cases.par_iter().map(|case| Alone::new(problem, *case, tolerance)).collect();
    let search = Search::new(problem, &alone);
    let starts: Vec<u64> = (0..effort.starts).collect();
    let found: Vec<_> = starts.par_iter().map(|seed| search.from(*seed, effort.changes)).collect();
    let known: Vec<&Vec<usize>> = alone.iter().flat_map(|alone| &alone.placements).collect();
    let settled = known.into_par_iter().map(|places| search.settle(search.stand(places.clone())));
    let found = found.into_iter().chain(settled.collect::<Vec<_>>());
    let best = found.min_by(|(one, _), (other, _)| one.total_cmp(other));
    best.map(|(_, places)| places).unwrap_or_default()
}

/// Returns the effect of the noise of all sensors on the guideway, µm RMS. `noise` is the noise of one sensor, K.
#[must_use]
pub fn noise_um(problem: &Problem, noise: f64) -> f64 {
    noise * (problem.matrix.norm_squared() / problem.rows().max(1.0)).sqrt()
}

/// Load case with its weight, and the placements that were calculated for this case alone.
struct Alone<'a> {
    target: &'a Target,
    /// Placements by the patent's method, and by bounded least squares.
    placements: [Vec<usize>; 2],
    /// Weight of the case, 1/µm²: 1 / (squared reference error × number of rows of the guideway).
    weight: f64,
}

impl<'a> Alone<'a> {
    fn new(problem: &'a Problem, case: usize, Tolerance { noise, enough }: Tolerance) -> Alone<'a> {
        let target = &problem.targets[case];
        let floor = bounded(problem, target);
        let by_patent = nearest(target, &patent(problem, target, enough).theta);
        let unavoidable = problem.rms(target, &floor).hypot(noise_um(problem, LEFT_OF_NOISE * noise));
        // A reference below 0.001 µm is negligible.
        let measure = unavoidable.max(problem.rms_of(target, &by_patent)).max(1e-3);
        let placements = [by_patent, nearest(target, &floor)];
        Alone { target, placements, weight: 1.0 / (measure.powi(2) * problem.rows()) }
    }
}

struct Search<'a> {
    problem: &'a Problem,
    cases: &'a [Alone<'a>],
    /// Weights of all load cases, 1/µm².
    weights: Vec<f64>,
    /// For each block, the temperature rises of its candidate nodes, K: all load cases of the first candidate, then all
    /// load cases of the next candidate.
    offered: Vec<Vec<f64>>,
}

/// State of the search: the selected nodes, the error of each load case, and its derivatives.
struct SearchState {
    places: Vec<usize>,
    /// For each load case, the sum of the squared errors over the rows of the guideway, µm².
    error: Vec<f64>,
    /// For each block and case, half the derivative of the squared error by the block temperature.
    slope: Vec<Vec<f64>>,
    cost: f64,
}

/// First and last threshold of the search. A threshold is the relative increase of the cost up to which a change is
/// accepted.
const THRESHOLD: (f64, f64) = (2.0, 1e-4);
/// Number of tried changes after which the threshold is lowered.
const STRETCH: u32 = 256;

/// Returns the cost of the error of one load case: the sixth power of the ratio of the error to the reference error.
/// `error` is the squared error.
fn weighed(error: f64, weight: f64) -> f64 {
    let ratio = error.max(0.0) * weight;
    ratio * ratio * ratio
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem, cases: &'a [Alone<'a>]) -> Search<'a> {
        let offered = |block: usize| {
            let candidates = 0..problem.blocks[block].candidates.len();
            candidates
                .flat_map(|place| cases.iter().map(move |case| case.target.offered[block][place]))
                .collect()
        };
        let weights = cases.iter().map(|case| case.weight).collect();
        Search { problem, cases, weights, offered: (0..problem.blocks.len()).map(offered).collect() }
    }

    fn blocks(&self) -> usize {
        self.offered.len()
    }

    fn candidates(&self, block: usize) -> usize {
        self.problem.blocks[block].candidates.len()
    }

    fn rises(&self, block: usize, place: usize) -> &[f64] {
        &self.offered[block][place * self.cases.len()..(place + 1) * self.cases.len()]
    }

    fn cost(&self, error: impl Iterator<Item = f64>) -> f64 {
        error.zip(&self.weights).map(|(error, weight)| weighed(error, *weight)).sum()
    }

    fn stand(&self, places: Vec<usize>) -> SearchState {
        let square = &self.problem.square;
        let rise = |block: usize, case: usize| self.rises(block, places[block])[case];
        let cross = |block: usize, case: usize| self.cases[case].target.cross[block];
        let slope = |block: usize, case: usize| {
            let moved: f64 = (0..self.blocks()).map(|other| square[(block, other)] * rise(other, case)).sum();
            moved - cross(block, case)
        };
        let cases = 0..self.cases.len();
        let slope: Vec<Vec<f64>> =
            (0..self.blocks()).map(|block| cases.clone().map(|case| slope(block, case)).collect()).collect();
        let error = |case: usize| {
            let each =
                (0..self.blocks()).map(|block| rise(block, case) * (slope[block][case] - cross(block, case)));
            self.cases[case].target.power + each.sum::<f64>()
        };
        let error: Vec<f64> = cases.map(error).collect();
        let cost = self.cost(error.iter().copied());
        SearchState { places, error, slope, cost }
    }

    /// Returns the total cost if the sensor of this block moves to the candidate with the index `place`.
    fn cost_of(&self, at: &SearchState, block: usize, place: usize) -> f64 {
        let own = self.problem.square[(block, block)];
        let (now, then) = (self.rises(block, at.places[block]), self.rises(block, place));
        let (error, slope) = (&at.error, &at.slope[block]);
        // This function is called millions of times; a plain loop is fast without further inlining.
        let mut cost = 0.0;
        for (case, weight) in self.weights.iter().enumerate() {
            let change = then[case] - now[case];
            cost += weighed(error[case] + change * (2.0 * slope[case] + own * change), *weight);
        }
        cost
    }

    fn change(&self, at: &mut SearchState, block: usize, place: usize, cost: f64) {
        let own = self.problem.square[(block, block)];
        for case in 0..self.cases.len() {
            let change = self.rises(block, place)[case] - self.rises(block, at.places[block])[case];
            at.error[case] += change * (2.0 * at.slope[block][case] + own * change);
            for other in 0..self.blocks() {
                at.slope[other][case] += self.problem.square[(other, block)] * change;
            }
        }
        at.places[block] = place;
        at.cost = cost;
    }

    fn from(&self, seed: u64, changes: u32) -> (f64, Vec<usize>) {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut below = |end: usize| {
            let wide = u128::from(random.next_u64()) * (end as u128);
            usize::try_from(wide >> 64).unwrap_or(0)
        };
        let mut at = self.stand((0..self.blocks()).map(|block| below(self.candidates(block))).collect());
        let mut best = (at.cost, at.places.clone());
        let falls =
            (THRESHOLD.1 / THRESHOLD.0).powf(count(STRETCH as usize) / f64::from(changes.max(STRETCH)));
        let mut threshold = THRESHOLD.0;
        for tried in 0..changes {
            if tried % STRETCH == STRETCH - 1 {
                threshold *= falls;
            }
            let block = below(self.blocks());
            let place = below(self.candidates(block));
            let cost = self.cost_of(&at, block, place);
            // A random part of the threshold makes small increases more likely than large ones.
            let part = count(below(1 << 16)) / 65536.0;
            if cost < at.cost * (1.0 + threshold * part) {
                self.change(&mut at, block, place, cost);
                if cost < best.0 {
                    best = (cost, at.places.clone());
                }
            }
        }
        self.settle(self.stand(best.1))
    }

    /// Moves the sensor of each block in turn to the node with the lowest cost, until no move reduces the
    /// cost. Returns the cost, and the index of the selected candidate of each block.
    fn settle(&self, mut at: SearchState) -> (f64, Vec<usize>) {
        loop {
            let before = at.cost;
            for block in 0..self.blocks() {
                let costs = (0..self.candidates(block)).map(|place| (self.cost_of(&at, block, place), place));
                let best = costs.min_by(|(one, _), (other, _)| one.total_cmp(other));
                if let Some((cost, place)) = best.filter(|(cost, _)| *cost < at.cost * (1.0 - 1e-9)) {
                    self.change(&mut at, block, place, cost);
                }
            }
            if at.cost >= before {
                return (at.cost, at.places);
            }
        }
    }
}
