//! `whitened`: the mean of a ridge and an elastic net, both on whitened rows.
//!
//! - The ridge keeps every column, the more held the less it moves; how much, is chosen by what is left on plain rows of runs
//!   that were left out.
//! - The elastic net takes most columns out; how far it goes, is chosen by what is left on their whitened rows.
//!
//! The two err differently, most of all outside what they were learnt on: how far they are apart there says how far their
//! mean may be believed.
//!
//! Of one or two runs nothing can be chosen: a ridge with a fixed penalty, and of one run seven tenths of it.

use std::time::Duration;

use nalgebra::DVector;

use super::{PriorTerm, Settings};
use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::gram::Gram;
use crate::learn::{Learned, Learner};
use crate::products::{Fold, Products};
use crate::sensors::Forward;
use crate::solve::{Net, Ridge, decades};
use crate::statistics::{count, least_sum, median};

/// Where there are too few runs to choose.
const UNCHOSEN: f64 = 0.3;
/// What of a ridge is believed that has seen one run.
const OF_ONE_RUN: f64 = 0.7;
/// L2 of the net; the weaker one only where it leaves less than [`CLEARLY`] times as much.
const SHARED: [f64; 2] = [0.1, 0.003];
const CLEARLY: f64 = 0.4;
/// Steps of a quarter decade along the net's path.
const STEPS: usize = 13;
/// A column that moves less counts as if it moved so.
const STANDS_STILL: f64 = 1e-9;

/// Four time constants do as well as eight.
pub(crate) fn usual_lags() -> Vec<Option<Duration>> {
    [0, 6, 25, 100].map(|minutes: u64| (minutes > 0).then(|| Duration::from_mins(minutes))).to_vec()
}

pub(super) struct Whitening {
    bank: Bank,
    products: Products,
    /// Where a few sensors are to be chosen: how many, and how.
    few: Option<(usize, Forward)>,
    /// A model that exists, towards which is learnt.
    prior: Option<Vec<(Candidate, f64)>>,
}

/// What was found, by column: of the mean, and where there are two halves, of the ridge and the net.
pub(crate) struct Fitted {
    pub(crate) gains: Vec<f64>,
    pub(crate) halves: Option<Vec<[f64; 2]>>,
}

impl Whitening {
    pub(super) fn new(
        campaign: &Campaign<'_>,
        lags: &[Option<Duration>],
        settings: &Settings,
    ) -> Result<Whitening, String> {
        let prior = settings.prior.as_ref().map(|prior| known(campaign, prior)).transpose()?;
        let beside = prior.iter().flatten().map(|(candidate, _)| *candidate);
        let bank = Bank::with_speeds(campaign, lags, beside);
        let products = Products::of(&bank);
        let few = settings.sensors.map(|most| (most, Forward::new(campaign)));
        Ok(Whitening { bank, products, few, prior })
    }
}

/// The terms of a model that exists.
fn known(campaign: &Campaign<'_>, prior: &[PriorTerm]) -> Result<Vec<(Candidate, f64)>, String> {
    let input = |term: &PriorTerm| campaign.inputs.iter().position(|input| input.name == term.signal);
    let mut foreign: Vec<&str> =
        prior.iter().filter(|term| input(term).is_none()).map(|term| term.signal.as_str()).collect();
    foreign.dedup();
    if !foreign.is_empty() {
        return Err(format!(
            "the model of --prior has terms of {}, of which there is no input here: give the signals their names in it, or take \
             these terms out of it",
            foreign.join(", ")
        ));
    }
    let candidate = |term: &PriorTerm| {
        let plain = Candidate::new(input(term)?, term.lag);
        Some((Candidate { squared: term.squared, ..plain }, term.gain))
    };
    Ok(prior.iter().filter_map(candidate).collect())
}

impl Learner for Whitening {
    fn bank(&self) -> &Bank {
        &self.bank
    }

    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String> {
        let chosen = self.few.as_ref().map(|(most, forward)| forward.path(runs, without, *most));
        let may = |(_, candidate): &(usize, &Candidate)| {
            !without.contains(&candidate.input)
                && (self.bank.is_speed[candidate.input]
                    || chosen.as_ref().is_none_or(|chosen| chosen.contains(&candidate.input)))
        };
        let columns: Vec<usize> =
            self.bank.candidates.iter().enumerate().filter(may).map(|(place, _)| place).collect();
        let fitted = match &self.prior {
            None => fit(&self.products, runs, &columns, &self.bank),
            Some(prior) => {
                let gain = |column: &usize| {
                    let same = prior.iter().filter(|(known, _)| *known == self.bank.candidates[*column]);
                    same.map(|(_, gain)| gain).sum()
                };
                let prior = DVector::from_iterator(columns.len(), columns.iter().map(gain));
                towards(&self.products, runs, &columns, &self.bank, &prior)
            }
        };
        let gains = columns.iter().zip(fitted.gains);
        let gains = gains.map(|(column, gain)| (self.bank.candidates[*column], gain)).collect();
        Ok(match fitted.halves {
            Some(halves) => Learned::Mean { gains, halves },
            None => Learned::Sum(gains),
        })
    }
}

/// Learns from these runs, in these columns of the bank.
pub(crate) fn fit(products: &Products, runs: &[usize], columns: &[usize], bank: &Bank) -> Fitted {
    if runs.is_empty() || columns.is_empty() {
        return Fitted { gains: vec![0.0; columns.len()], halves: None };
    }
    let units = units(products, runs, columns, bank);
    let all = products.training(runs, columns, &units);
    if runs.len() < 3 {
        let share = if runs.len() == 1 { OF_ONE_RUN } else { 1.0 };
        let gains = Ridge::of(&all).at(UNCHOSEN).component_div(&units) * share;
        return Fitted { gains: gains.data.into(), halves: None };
    }
    let folds = products.folds(runs, columns, &units);
    let (ridge, net) = (ridge(&all, &folds).component_div(&units), net(&all, &folds).component_div(&units));
    Fitted {
        gains: ((&ridge + &net) * 0.5).data.into(),
        halves: Some(ridge.iter().zip(net.iter()).map(|(ridge, net)| [*ridge, *net]).collect()),
    }
}

/// The ridge towards the gains of a model that exists instead of towards none.
fn towards(
    products: &Products,
    runs: &[usize],
    columns: &[usize],
    bank: &Bank,
    prior: &DVector<f64>,
) -> Fitted {
    let units = units(products, runs, columns, bank);
    let prior = &prior.component_mul(&units);
    let all = products.training(runs, columns, &units).after(prior);
    let gains = match runs.len() {
        0 => DVector::zeros(columns.len()),
        1 | 2 => Ridge::of(&all).at(UNCHOSEN),
        _ => {
            let after = |fold: Fold| Fold {
                training: fold.training.after(prior),
                plain: fold.plain.after(prior),
                white: fold.white,
            };
            ridge(&all, &products.folds(runs, columns, &units).into_iter().map(after).collect::<Vec<_>>())
        }
    };
    Fitted { gains: (gains + prior).component_div(&units).data.into(), halves: None }
}

/// By column what it is divided by first. Speeds and their squares move by other numbers than temperatures: each kind is
/// made as large as the usual temperature.
fn units(products: &Products, runs: &[usize], columns: &[usize], bank: &Bank) -> DVector<f64> {
    let kind = |column: usize| {
        let candidate = bank.candidates[column];
        (bank.is_speed[candidate.input], candidate.squared)
    };
    if !columns.iter().any(|column| kind(*column).0) {
        return DVector::from_element(columns.len(), 1.0);
    }
    let sum = products.plain(runs);
    let usual = |is: &dyn Fn(usize) -> bool| {
        let own = columns.iter().copied().filter(|column| is(*column));
        median(own.map(|column| (sum.square[(column, column)] / sum.rows.max(1.0)).sqrt()).collect())
    };
    let temperature = usual(&|column| !kind(column).0);
    let unit = |column: &usize| {
        let own = kind(*column);
        let unit = if own.0 { usual(&|other| kind(other) == own) / temperature } else { 1.0 };
        if unit.is_finite() && unit > 0.0 { unit } else { 1.0 }
    };
    DVector::from_iterator(columns.len(), columns.iter().map(unit))
}

/// Judged on plain rows: whitened ones would choose the weaker penalty.
fn ridge(all: &Gram, folds: &[Fold]) -> DVector<f64> {
    let penalties = decades(-4, 2, 2);
    let costs = folds.iter().map(|fold| {
        let ridge = Ridge::of(&fold.training);
        penalties.iter().map(|penalty| fold.plain.left(&ridge.at(*penalty))).collect()
    });
    let penalty = least_sum(costs).map_or(UNCHOSEN, |(place, _)| penalties[place]);
    Ridge::of(all).at(penalty)
}

fn net(all: &Gram, folds: &[Fold]) -> DVector<f64> {
    let [usual, weaker] = SHARED.map(|shared| {
        let left = |fold: &Fold| {
            path(&fold.training, shared, STEPS).iter().map(|gains| fold.white.left(gains)).collect()
        };
        let (step, cost) = least_sum(folds.iter().map(left)).unwrap_or_default();
        (cost, step, shared)
    });
    let (_, step, shared) = if weaker.0 < CLEARLY * usual.0 { weaker } else { usual };
    path(all, shared, step + 1).pop().unwrap_or_else(|| DVector::zeros(all.cross.len()))
}

/// The gains after each of the first steps of the net's path. All columns have one scale: none is helped to be chosen.
fn path(gram: &Gram, shared: f64, steps: usize) -> Vec<DVector<f64>> {
    let rows = gram.rows.max(1.0);
    let moves = gram.square.diagonal().iter().map(|square| (square / rows).max(0.0).sqrt()).collect();
    let scale = median(moves).max(STANDS_STILL);
    let scaled = gram.divided(&DVector::from_element(gram.cross.len(), scale), rows);
    let mut net = Net::new(&scaled, shared);
    let first = net.first_penalty();
    (0..steps).map(|step| net.at(first * 10f64.powf(-0.25 * count(step))) / scale).collect()
}
