//! Method `whitened`: mean of a ridge regression and an elastic net, both on whitened rows (rows from which their slow
//! random drift is removed).
//!
//! - The ridge regression keeps every column (candidate term). A column that changes less has a greater penalty. The
//!   size of the penalty is chosen by the residual on plain rows (not whitened) of held-out runs.
//! - The elastic net removes most columns. Its L1 penalty is chosen by the residual on whitened rows of held-out runs.
//!
//! The two models have different errors, in particular outside the range of the training data. If their difference is
//! large there, their mean is not reliable.
//!
//! With one or two runs, no penalty can be chosen. The model is then a ridge regression with a fixed penalty; with one
//! run its gains are multiplied by 0.7. A prior is an existing model towards which the gains shrink. With a prior, the
//! penalty is smaller, and the gains are not multiplied.

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
use crate::statistics::{count, least_sum, median, rms};
use isotherm_core::candidate::LAG_MINUTES;

/// Ridge penalty if there are too few runs to choose a penalty by validation.
const UNCHOSEN: f64 = 0.3;
/// Ridge penalty with a prior (existing model) if there are too few runs to choose a penalty by validation.
const TOWARDS: f64 = 0.1;
/// Factor by which the gains of a ridge regression are reduced if there is only one run.
const OF_ONE_RUN: f64 = 0.7;
/// L2 penalties of the elastic net that are tried. The smaller penalty is used only if its residual is less than
/// [`CLEARLY`] times that of the larger penalty.
const SHARED: [f64; 2] = [0.1, 0.003];
const CLEARLY: f64 = 0.4;
/// Relative difference below which two errors count as equal, because of rounding.
const ROUNDING: f64 = 1e-9;
/// Number of L1 penalties of the elastic net that are tried. Each is a quarter decade below the previous penalty.
const STEPS: usize = 13;
/// Minimum of the scale by which all candidate terms are divided, so that terms of zeros cause no division by zero.
const STANDS_STILL: f64 = 1e-9;

/// Returns the default time constants of the lags: none (no lag), 6, 25 and 100 minutes. Eight time constants would not
/// give better results.
pub(crate) fn usual_lags() -> Vec<Option<Duration>> {
    LAG_MINUTES.map(|minutes| (minutes > 0).then(|| Duration::from_mins(minutes))).to_vec()
}

pub(super) struct Whitening {
    bank: Bank,
    products: Products,
    /// Maximum number of sensors, and the forward search that selects them; `None` if the number is not limited.
    few: Option<(usize, Forward)>,
    /// Terms of an existing model, which is the prior.
    prior: Option<Vec<(Candidate, f64)>>,
}

/// Gains of each candidate term. `gains` contains the gains of the model. If the model is a mean, `halves`
/// contains the gains of the ridge regression and of the elastic net.
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

/// Checks that the error with an existing model (prior) is smaller than without compensation, over all runs together.
///
/// # Errors
/// Returns a message with both errors. A model whose gains shrink towards a worse prior would become worse, too.
pub(crate) fn check_prior(campaign: &Campaign<'_>, bank: &Bank, prior: &[PriorTerm]) -> Result<(), String> {
    let prior = Learned::Sum(known(campaign, prior)?);
    let (mut left, mut none) = (Vec::new(), Vec::new());
    for (place, run) in bank.runs.iter().enumerate() {
        let error = run.error();
        left.extend(error.iter().zip(prior.predict(campaign, bank, place)).map(|(error, cz)| error + cz));
        none.extend(error);
    }
    let (left, none) = (rms(&left), rms(&none));
    if left <= none * (1.0 + ROUNDING) {
        return Ok(());
    }
    Err(format!(
        "with the model of --prior, the residual error on these logs is {left:.2} µm RMS; without \
         compensation, it is {none:.2} µm. This prior would make the new model worse: leave --prior out"
    ))
}

/// Returns the terms of an existing model as candidates of this campaign.
pub(crate) fn known(campaign: &Campaign<'_>, prior: &[PriorTerm]) -> Result<Vec<(Candidate, f64)>, String> {
    let input = |term: &PriorTerm| campaign.inputs.iter().position(|input| input.name == term.signal);
    let mut foreign: Vec<&str> =
        prior.iter().filter(|term| input(term).is_none()).map(|term| term.signal.as_str()).collect();
    foreign.dedup();
    if !foreign.is_empty() {
        return Err(format!(
            "the model of --prior has terms of {}, but there is no input with this name. In the file of \
             that model, use the signal names of the profile, or remove these terms",
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

/// Identifies a model from the runs `runs`, with only the candidate terms `columns`.
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

/// Fits a ridge regression whose gains shrink towards the gains of an existing model (prior) instead of
/// towards zero.
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
        1 | 2 => Ridge::of(&all).at(TOWARDS),
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

/// Returns the divisor of each candidate term (column). The values of speeds and of squared speeds are much
/// larger than the values of temperatures. Therefore speeds and squared speeds are scaled to the size of a
/// typical temperature.
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

/// Identifies a model by ridge regression. The penalty is chosen on plain rows of held-out runs, because on whitened
/// rows the best penalty would be too small.
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

/// Returns the gains of the elastic net for each of the `steps` largest L1 penalties, the largest penalty first. All
/// candidate terms are divided by the same scale.
fn path(gram: &Gram, shared: f64, steps: usize) -> Vec<DVector<f64>> {
    let rows = gram.rows.max(1.0);
    let moves = gram.square.diagonal().iter().map(|square| (square / rows).max(0.0).sqrt()).collect();
    let scale = median(moves).max(STANDS_STILL);
    let scaled = gram.divided(&DVector::from_element(gram.cross.len(), scale), rows);
    let mut net = Net::new(&scaled, shared);
    let first = net.first_penalty();
    (0..steps).map(|step| net.at(first * 10f64.powf(-0.25 * count(step))) / scale).collect()
}
