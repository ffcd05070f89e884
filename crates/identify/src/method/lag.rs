//! `lag`: `E = Σ K·L·ΔT·(1 − e^(−t/C))`, Janeczko 1989. K is the expansion coefficient of a part, L its
//! length, ΔT its temperature change, and C its time constant. A few sensors are used, each with one gain K·L
//! and one time constant.
//!
//! A forward search over the candidate terms, with one term per sensor, gives the sensors and the initial time
//! constants. Then a golden-section search minimizes the residual over each time constant in turn. At every step of
//! that search, the gains are calculated by least squares.

use std::time::Duration;

use nalgebra::{DMatrix, DVector};

use super::forward::forward_once_each;
use crate::bank::{Bank, Candidate, LAGS_MIN, Rows, trace};
use crate::campaign::Campaign;
use crate::folds::Inner;
use crate::gram::Gram;
use crate::learn::{Learned, Learner};
use crate::solve::ridge;
use crate::statistics::count;

pub(super) struct Lagging<'a> {
    campaign: &'a Campaign<'a>,
    bank: Bank,
    grams: Vec<Gram>,
    terms: usize,
}

/// Default maximum number of sensors. Janeczko uses one to three sensors per axis.
const MOST_TERMS: usize = 4;
const PENALTY: f64 = 1e-3;
/// Number of passes over all time constants. Each pass optimizes every time constant once.
const ROUNDS: usize = 4;
/// Factor by which the initial search range extends below and above a time constant. The factor is about the
/// ratio of neighbouring time constants of the candidate terms.
const AROUND: f64 = 2.2;
/// Time constant below which a lag has no effect on log rows that are means of a minute, s. A term with a smaller time
/// constant is written without a lag.
const FASTEST: f64 = 20.0;
const SLOWEST: f64 = 5.0 * 86_400.0;

impl<'a> Lagging<'a> {
    pub(super) fn new(campaign: &'a Campaign<'a>, bank: Bank, terms: Option<usize>) -> Lagging<'a> {
        let grams = bank.grams();
        Lagging { campaign, bank, grams, terms: terms.unwrap_or(MOST_TERMS) }
    }

    fn begin(&self, runs: &[usize], without: &[usize]) -> Vec<Candidate> {
        let folds = Inner::of(&self.grams, runs).or_itself().scaled();
        let inputs = self.bank.candidates.iter().map(|candidate| candidate.input);
        let groups: Vec<Option<usize>> =
            inputs.map(|input| Some(input).filter(|input| !without.contains(input))).collect();
        let (chosen, _) = forward_once_each(&folds.iter().collect::<Vec<_>>(), PENALTY, self.terms, &groups);
        chosen.into_iter().map(|column| self.bank.candidates[column]).collect()
    }

    /// Returns for each run the rises of the candidates in its rows.
    fn columns(&self, runs: &[usize], candidates: &[Candidate]) -> Vec<DMatrix<f64>> {
        runs.iter().map(|run| trace(self.campaign, *run, candidates, Rows::WithError).rises).collect()
    }

    /// Fits these columns to the targets of the runs by least squares. Returns the sum of squared residuals, and the
    /// gains.
    fn fit(&self, runs: &[usize], columns: &[DMatrix<f64>]) -> (f64, DVector<f64>) {
        let gram = |(rises, run): (&DMatrix<f64>, &usize)| Gram::of(rises, &self.bank.runs[*run].target);
        let sum = Gram::total(&columns.iter().zip(runs).map(gram).collect::<Vec<Gram>>());
        let gains = ridge(&sum, &(0..sum.cross.len()).collect::<Vec<usize>>(), 0.0);
        (sum.left(&gains), gains)
    }
}

fn lag(seconds: f64) -> Option<Duration> {
    // The fit uses whole seconds, because the profile contains whole seconds.
    (seconds > FASTEST).then(|| Duration::from_secs_f64(seconds.min(SLOWEST).round()))
}

impl Learner for Lagging<'_> {
    fn bank(&self) -> &Bank {
        &self.bank
    }

    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String> {
        let mut candidates = self.begin(runs, without);
        if candidates.is_empty() {
            return Ok(Learned::Sum(Vec::new()));
        }
        let mut columns = self.columns(runs, &candidates);
        for round in 0..ROUNDS {
            let around = AROUND.powf(1.0 / count(round + 1));
            for (place, candidate) in candidates.iter_mut().enumerate() {
                let now = candidate.lag.map_or(60.0, |lag| lag.as_secs_f64());
                let mut cost = |log: f64| {
                    let tried = Candidate { lag: lag(log.exp()), ..*candidate };
                    for (columns, new) in columns.iter_mut().zip(self.columns(runs, &[tried])) {
                        columns.set_column(place, &new.column(0));
                    }
                    self.fit(runs, &columns).0
                };
                // The cost may have several minima. The search begins at the best lag of the bank.
                let starts = LAGS_MIN.iter().skip(1).map(|minutes| f64::from(*minutes) * 60.0).chain([now]);
                let logs = starts.map(|start| (cost(start.ln()), start.ln()));
                let start =
                    logs.min_by(|one, other| one.0.total_cmp(&other.0)).map_or(now.ln(), |best| best.1);
                let log = golden(start - around.ln(), start + around.ln(), &mut cost);
                cost(log);
                candidate.lag = lag(log.exp());
            }
        }
        let gains = self.fit(runs, &columns).1;
        Ok(Learned::Sum(candidates.into_iter().zip(gains.iter().copied()).collect()))
    }
}

/// Returns the position of the minimum of a function with a single minimum, within 0.001, by golden-section search.
/// Here, a position is the logarithm of a time constant in s.
fn golden(mut low: f64, mut high: f64, cost: &mut dyn FnMut(f64) -> f64) -> f64 {
    const SHARE: f64 = 0.618_033_988_75;
    let (mut left, mut right) = (high - SHARE * (high - low), low + SHARE * (high - low));
    let (mut at_left, mut at_right) = (cost(left), cost(right));
    while high - low > 1e-3 {
        if at_left <= at_right {
            (high, right, at_right) = (right, left, at_left);
            left = high - SHARE * (high - low);
            at_left = cost(left);
        } else {
            (low, left, at_left) = (left, right, at_right);
            right = low + SHARE * (high - low);
            at_right = cost(right);
        }
    }
    0.5 * (low + high)
}
