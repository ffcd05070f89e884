//! Rows of one run with the Cz (compensation value) of a model: the residual errors, and the accepted
//! touches. A touch is a measurement with a probe.

use super::doubt::accepted;
use super::in_use::{InUse, settings};
use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::dataset::{BadLog, Dataset};
use crate::faults::is_constant;
use crate::fleet::FleetModel;
use crate::learn::Learned;
use crate::method::PriorTerm;
use crate::method::whitened::known;
use crate::setup::{Choice, Ready, ready};
use isotherm_core::compensation::settings::Filter;
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

/// Rows of one run: time, measured error without compensation, and the Cz that a model calculates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelRows {
    /// Time of each row, h since the datum.
    pub hours: Vec<f64>,
    /// Measured error without compensation in each row, µm.
    pub error: Vec<f64>,
    /// Cz that the model calculates for each row, µm.
    pub cz: Vec<f64>,
}

impl ModelRows {
    /// Returns the residual error in each row: measured error plus Cz, µm.
    pub fn left(&self) -> Vec<f64> {
        self.error.iter().zip(&self.cz).map(|(error, cz)| error + cz).collect()
    }
}

/// Returns the rows of the first run of a dataset, with the Cz of the model. The errors of that run must not contain
/// Cz.
///
/// # Errors
/// The run cannot be used, or the model requires another input. The message states the reason.
pub fn rows(
    profile: &Profile,
    single: &Dataset,
    choice: &Choice,
    model: &InUse,
) -> Result<ModelRows, String> {
    let ready = prepared(profile, single, choice)?;
    let (bank, left) = residuals(&ready.campaign, &model.terms)?;
    let run = bank.runs.first().ok_or("the run has no row")?;
    let error = run.error();
    let cz = left.iter().zip(&error).map(|(left, error)| left - error).collect();
    let first = run.seconds.first().copied().unwrap_or_default();
    let hours = run.seconds.iter().map(|second| (second - first) / 3600.0).collect();
    Ok(ModelRows { hours, error, cz })
}

/// Touches of one run, divided into accepted and rejected touches.
pub(super) struct JudgedTouches {
    /// Numbers of the averaging windows that contain the rejected touches.
    pub(super) rejected: Vec<u128>,
    /// Number of all touches of the run, accepted or rejected.
    all: usize,
    /// Mean square of the residual error at the touches with the model in use, µm²; `None` if no model is in use.
    pub(super) left: Option<f64>,
    error: usize,
}

impl JudgedTouches {
    pub(super) fn accepted(&self) -> usize {
        self.all - self.rejected.len()
    }

    /// Removes the errors of the rejected touches from the run.
    pub(super) fn reject(&self, single: &mut Dataset, choice: &Choice) {
        for run in &mut single.runs {
            let first = run.times.first().copied().unwrap_or_default();
            let window = |at: &Moment| at.since(first).as_nanos() / choice.resample.as_nanos().max(1);
            let is_rejected = |at: &Moment| self.rejected.contains(&window(at));
            run.values[self.error].change(|errors| {
                let errors = errors.iter_mut().zip(&run.times);
                errors.filter(|(_, at)| is_rejected(at)).for_each(|(error, _)| *error = f64::NAN);
            });
        }
    }
}

/// Decides for each touch of a single run whether it is accepted, by its residual error with the model in use. If no
/// model is in use, the candidate is used instead.
pub(super) fn touches(
    profile: &Profile,
    single: &Dataset,
    choice: &Choice,
    in_use: Option<&InUse>,
    candidate: Option<&FleetModel>,
) -> Result<JudgedTouches, String> {
    let is_signal = |term: &PriorTerm| profile.signals.iter().any(|signal| signal.name == term.signal);
    let judge = in_use.filter(|in_use| !in_use.terms.is_empty());
    let terms = match judge {
        Some(in_use) => in_use.terms.clone(),
        // A candidate with an input that the profile no longer has cannot judge.
        None => {
            candidate.map(FleetModel::prior).filter(|terms| terms.iter().all(is_signal)).unwrap_or_default()
        }
    };
    // The model in use may have inputs that the candidate must not have.
    let mut inputs = choice.inputs.clone();
    for term in terms.iter().filter(|term| is_signal(term)) {
        if !inputs.contains(&term.signal) {
            inputs.push(term.signal.clone());
        }
    }
    let ready = prepared(profile, single, &Choice { inputs, ..choice.clone() })?;
    let campaign = &ready.campaign;
    let is_input = |name: &str| campaign.inputs.iter().any(|input| input.name == name);
    if let Some(term) = terms.iter().find(|term| !is_input(&term.signal)) {
        return Err(format!("the model in use needs {}, which the logs do not have", term.signal));
    }
    let (bank, residuals) = residuals(campaign, &terms)?;
    let own = in_use.map(|in_use| residuals_of(campaign, &bank, &in_use.terms)).transpose()?;
    let run = bank.runs.first().ok_or("the run has no row")?;
    let hours: Vec<f64> = run.seconds.iter().map(|second| second / 3600.0).collect();
    // The gateway accepts no larger residual of its model. The first candidates may leave more.
    let axis = choice.axis.as_deref().unwrap_or_default();
    let probe = settings(profile, axis).and_then(|own| own.probe).filter(|_| judge.is_some());
    let most = probe.map_or(f64::INFINITY, |probe| probe.max_error.get());
    // Without any model, the residual is the whole drift, and nothing can be doubted.
    let accepted = match terms.is_empty() {
        true => vec![true; residuals.len()],
        false => accepted(&hours, &residuals, scatter(profile, choice), most),
    };
    let rejected = accepted.iter().zip(&run.windows).filter(|(accepted, _)| !**accepted);
    let rejected: Vec<u128> = rejected.map(|(_, window)| *window).collect();
    // The first row is the datum.
    let all = residuals.len().saturating_sub(1);
    let touches = u32::try_from(all.saturating_sub(rejected.len())).unwrap_or(u32::MAX);
    let left = own.filter(|_| touches > 0).map(|own| {
        let squares = own.iter().zip(&accepted).filter(|(_, accepted)| **accepted);
        squares.map(|(left, _)| left * left).sum::<f64>() / f64::from(touches)
    });
    Ok(JudgedTouches { rejected, all, left, error: campaign.error })
}

/// Returns the rows of the only run of a campaign, and the residual error of the model with these terms in each row.
fn residuals(campaign: &Campaign<'_>, terms: &[PriorTerm]) -> Result<(Bank, Vec<f64>), String> {
    let candidates = known(campaign, terms)?.iter().map(|(candidate, _)| *candidate).collect();
    let bank = Bank::new(campaign, candidates);
    let left = residuals_of(campaign, &bank, terms)?;
    Ok((bank, left))
}

/// Returns the residual error of the model with these terms in each row of the only run of a campaign.
fn residuals_of(campaign: &Campaign<'_>, bank: &Bank, terms: &[PriorTerm]) -> Result<Vec<f64>, String> {
    let model = Learned::Sum(known(campaign, terms)?);
    let run = bank.runs.first().ok_or("the run has no row")?;
    Ok(run.error().iter().zip(model.predict(campaign, bank, 0)).map(|(error, cz)| error + cz).collect())
}

/// Checks the sensors in a single run. A constant sensor is used, because it has no effect. A run with any other faulty
/// sensor is rejected, because no other data show the true reading.
pub(super) fn prepared<'a>(
    profile: &Profile,
    single: &'a Dataset,
    choice: &Choice,
) -> Result<Ready<'a>, String> {
    let in_words = |wrong: BadLog| wrong.0.join("; ");
    let constant = |name: &&String| single.column(name).is_some_and(|column| is_constant(single, column));
    let keep = choice.keep.iter().chain(choice.inputs.iter().filter(constant)).cloned().collect();
    let ready = ready(profile, single, &Choice { keep, ..choice.clone() }).map_err(in_words)?;
    match ready.notes.excluded.first() {
        None => Ok(ready),
        Some(faulty) => Err(format!("{}: {}", faulty.signal, faulty.reason)),
    }
}

/// Returns two settings for the touches: the standard deviation of a touch, µm, and the growth of the variance of a
/// correction, µm²/h.
fn scatter(profile: &Profile, choice: &Choice) -> (f64, f64) {
    let axis = choice.axis.as_deref().unwrap_or_default();
    match settings(profile, axis).and_then(|own| own.probe).map(|probe| probe.filter) {
        Some(Filter::Weighed { repeat, walk }) => (repeat, walk),
        Some(Filter::Share(_)) | None => (Filter::REPEAT, Filter::WALK),
    }
}
