//! The methods: each learns a [`Learned`](super::learn::Learned) from some runs of a campaign.

use std::fmt;
use std::time::Duration;

use super::bank::{Bank, Candidate, usual_lags};
use super::campaign::Campaign;
use super::gram::Gram;
use super::learn::{Learned, Learner};

mod forward;
mod least_squares;
mod ridge;
mod sparse;
mod stepwise;

/// How a model is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Method {
    /// Some of (sensor, lag), chosen on runs that were left out; with --terms N at most so many
    #[default]
    SparseLag,
    /// Ridge regression on every sensor through every lag
    RidgeLag,
    /// Stepwise over (sensor, lag) by partial F tests, in and out
    Stepwise,
    /// Least squares on the rises of all sensors, without lags
    Ols,
    /// No model: the bare machine, or a probe alone
    None,
}

/// What a method may be told.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// How.
    pub method: Method,
    /// Time constants that are tried.
    pub lags: Vec<Option<Duration>>,
    /// Most terms of a chosen model; `None`: the method's own limit.
    pub terms: Option<usize>,
    /// Rows closer than this are no independent samples: partial F tests count one sample per so long.
    pub independent: Duration,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            method: Method::default(),
            lags: usual_lags(),
            terms: None,
            independent: Duration::from_secs(1800),
        }
    }
}

impl Method {
    /// The word for it on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Method::SparseLag => "sparse-lag",
            Method::RidgeLag => "ridge-lag",
            Method::Stepwise => "stepwise",
            Method::Ols => "ols",
            Method::None => "none",
        }
    }

    /// Its gains are held small or chosen: how far they may be off shows in their spread, not in a normal equation.
    pub(super) fn is_penalized(self) -> bool {
        matches!(self, Method::SparseLag | Method::RidgeLag)
    }

    /// The method with its data.
    pub fn prepare(self, campaign: &Campaign<'_>, settings: &Settings) -> Box<dyn Learner> {
        let lags: &[Option<Duration>] = match self {
            Method::Ols | Method::None => &[None],
            _ => &settings.lags,
        };
        let bank = Bank::of(campaign, lags);
        let grams = Gram::each(&bank);
        let rule: Box<dyn Rule> = match self {
            Method::SparseLag => Box::new(sparse::Sparse { terms: settings.terms }),
            Method::RidgeLag => Box::new(ridge::Ridge),
            Method::Stepwise => {
                let rows_per_sample = settings.independent.as_secs_f64() / campaign.row_seconds();
                Box::new(stepwise::Stepwise {
                    rows_per_sample: rows_per_sample.max(1.0),
                    terms: settings.terms.unwrap_or(usize::MAX),
                })
            }
            Method::Ols => Box::new(least_squares::LeastSquares),
            Method::None => Box::new(Nothing),
        };
        Box::new(OnBank { bank, grams, rule })
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A linear method that needs no more than the products of each run.
trait Rule: Sync {
    /// Columns of the bank with their gains; `columns` are those that may be used.
    fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Vec<(usize, f64)>, String>;
}

struct OnBank {
    bank: Bank,
    grams: Vec<Gram>,
    rule: Box<dyn Rule>,
}

impl Learner for OnBank {
    fn bank(&self) -> &Bank {
        &self.bank
    }

    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String> {
        let may = |(_, candidate): &(usize, &Candidate)| !without.contains(&candidate.input);
        let columns: Vec<usize> =
            self.bank.candidates.iter().enumerate().filter(may).map(|(place, _)| place).collect();
        let gains = self.rule.fit(&self.grams, runs, &columns)?;
        let gains = gains.into_iter().map(|(column, gain)| (self.bank.candidates[column], gain));
        Ok(Learned::Sum(gains.collect()))
    }
}

struct Nothing;

impl Rule for Nothing {
    fn fit(&self, _: &[Gram], _: &[usize], _: &[usize]) -> Result<Vec<(usize, f64)>, String> {
        Ok(Vec::new())
    }
}

/// The runs that are left for training beside each inner fold, with the fold. One run alone has no inner validation.
fn inner(grams: &[Gram], runs: &[usize]) -> Vec<(Gram, Vec<usize>)> {
    if runs.len() < 2 {
        return Vec::new();
    }
    let fold = |fold: Vec<usize>| {
        let others: Vec<usize> = runs.iter().copied().filter(|run| !fold.contains(run)).collect();
        (Gram::sum(grams, &others), fold)
    };
    super::validate::folds(runs).into_iter().map(fold).collect()
}

/// The place of the smallest cost; the first of equals.
fn smallest(costs: &[f64]) -> usize {
    let place = |best: usize, place: usize| if costs[place] < costs[best] { place } else { best };
    (1..costs.len()).fold(0, place)
}
