//! Result of an identification: a model of Cz (the compensation value of an axis), with its validation on held-out
//! runs. A held-out run is not used to identify the model that is tested on it. A rise is the value of an input minus
//! its reference.

use serde::Serialize;

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::checks::one_run_only;
use crate::collinear::collinearity;
use crate::coverage;
use crate::dataset::{Column, Kind};
use crate::expected::{Expected, expected, inside};
use crate::faults::{Notes, Repaired, resolution};
use crate::learn::Learned;
use crate::method::whitened::check_prior;
use crate::method::{Method, Settings};
use crate::pruning::prune;
use crate::region::Region;
use crate::select::{Counted, point_counts};
use crate::setup::Ready;
use crate::stand_in::{self, StandIn};
use crate::statistics::least_and_most;
use crate::touches;
use crate::uncertainty::standard_errors;
use crate::validate::{HeldOut, Means, OVER_TOUCHES, Progress, RunScore, leave_one_run_out};
use crate::wander::wander;
use isotherm_profile::counted;
use lost_sensor::{fallbacks, irreplaceable, keep_the_better};

mod harm;
mod lost_sensor;
mod single_sensor;

pub use lost_sensor::Fallback;
pub use single_sensor::Alone;

/// Maximum number of sensors for which [`Identified::by_sensors`] contains a held-out result.
const MOST_COUNTED: usize = 8;

/// Identified model with its cross-validation. In JSON, this structure is the output of `isotherm identify`.
#[derive(Clone, Debug, Serialize)]
pub struct Identified {
    /// Name of the method.
    pub method: &'static str,
    /// Name of the axis in the profile.
    pub axis: String,
    /// Name of the log column with the measured error.
    pub error: String,
    /// Terms of Cz = Σ gain·rise; empty for a network.
    pub terms: Vec<TermFound>,
    /// Condition number of the matrix of term values. Each term is scaled to a root mean square of 1. `None` if two
    /// terms have the same values, or if there are no terms.
    pub condition: Option<f64>,
    /// Description of the network; `None` if the model is not a network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<String>,
    /// Result of each run with a model that was identified from the other runs.
    pub runs: Vec<RunScore>,
    /// Means of the held-out results over all runs.
    #[serde(flatten)]
    pub means: Means,
    /// Means of the error without compensation, over all held-out runs.
    pub uncompensated: Means,
    /// Interval of the simulated probe, s; `None` if no probe is simulated.
    pub probe_s: Option<f64>,
    /// Remarks about the sensors and the logs.
    #[serde(flatten)]
    pub notes: Notes,
    /// Sensors that were faulty in a run, with the repair of their readings.
    pub repaired: Vec<Repaired>,
    /// Columns of the logs, and how the identification uses each of them.
    pub columns: Vec<ColumnShown>,
    /// Expected error of the model: a standard deviation that grows with the hours since the datum (zero point). `None`
    /// if it is not known.
    pub expected: Option<Expected>,
    /// Reason why the expected error is not known; `None` if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_missing: Option<&'static str>,
    /// Random drift of the residual error, µm²/h. It is the setting `q` for a probe of the axis in the profile. `None`
    /// if it is not known.
    pub probe_q: Option<f64>,
    /// Names of the runs whose error was larger with the model than without compensation. Each run was tested with a
    /// model from the other runs.
    pub worse_runs: Vec<String>,
    /// Held-out result for each number of sensors, beginning with zero sensors. Empty if it was not requested.
    pub by_sensors: Vec<Counted>,
    /// Names of the sensors without a good replacement: if such a sensor is lost, the mean range of the error grows by
    /// more than a quarter.
    pub irreplaceable: Vec<String>,
    /// Stand-in of each sensor: a prediction of its reading from the other sensors, used if the sensor fails.
    pub stand_ins: Vec<StandIn>,
    /// Fallback models, each for the loss of one sensor. The best model is the first.
    pub fallbacks: Vec<Fallback>,
    /// Measured error and predicted Cz in every row of the held-out runs.
    #[serde(skip)]
    pub held_out: Vec<HeldOut>,
    /// Model that was identified from all runs together.
    #[serde(skip)]
    pub learned: Learned,
    /// Range of the model's inputs in the logs. `None` if there are too many inputs, or if one input is constant.
    #[serde(rename = "envelope")]
    pub region: Option<Region>,
    /// Position signal of the slope, and the position at which the slope adds nothing to Cz, mm. `None` if the model
    /// has no slope.
    pub position: Option<(String, f64)>,
    /// Averaging time of the references, s. A reference is a value that is subtracted from a signal.
    pub settle_s: f64,
}

/// Term of a model that is a sum of terms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TermFound {
    /// Name of the signal that is the input of the term.
    pub signal: String,
    /// Time constant of the lag, s; 0 means no lag.
    pub lag_s: f64,
    /// Gain: contribution of the term to Cz per unit of the input, in `unit`. Cz is the negative error.
    pub gain: f64,
    /// Unit of the gain: µm per unit of the signal, for example µm/°C. The unit for a term of the slope is for example
    /// µm/mm/°C.
    pub unit: String,
    /// Standard error of the gain; `None` if there are too few runs to calculate it.
    pub se: Option<f64>,
    /// Largest absolute contribution of the term to Cz in any log row, µm.
    pub largest_um: f64,
    /// Factor by which similar terms of the model increase the variance of the gain; `None` if two terms have the same
    /// values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inflation: Option<f64>,
    /// Whether the term belongs to the slope of Cz over the position of the axis. Such a term is multiplied
    /// by the distance from a reference position.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub slope: bool,
    /// Whether the input is the square of the signal.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub squared: bool,
    /// Whether the input is a speed. The reference of a speed is standstill, not its value at machine start.
    #[serde(skip)]
    pub is_speed: bool,
}

/// Column of the logs, and how the identification uses it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ColumnShown {
    /// Name of the log column.
    pub name: String,
    /// Kind of quantity, detected from unit, name and values.
    pub kind: Kind,
    /// Use of the log column in the identification, in one word: for example `error` or `input`.
    pub used: &'static str,
    /// Smallest difference between two values; 0 if the values never change. `None` if the log column was not read.
    pub resolution: Option<f64>,
    /// Smallest value in the logs; `None` if the column was not read.
    pub min: Option<f64>,
    /// Largest value in the logs; `None` if the column was not read.
    pub max: Option<f64>,
}

/// Identifies the model and validates it. If `is_whole`, also identifies stand-ins and fallback models for lost
/// sensors, and calculates the result for each number of sensors.
///
/// # Errors
/// No model can be identified from these runs. The message says what to do.
pub fn identify(
    ready: &Ready<'_>,
    settings: &Settings,
    probe: Option<f64>,
    is_whole: bool,
    progress: Progress<'_>,
) -> Result<Identified, String> {
    settings.check()?;
    let campaign = &ready.campaign;
    let learner = settings.method.prepare(campaign, settings)?;
    let (learner, bank) = (learner.as_ref(), learner.bank());
    bank.check_rows("every sensor", "the sensor")?;
    if let Some(prior) = &settings.prior {
        check_prior(campaign, bank, prior)?;
    }
    let one_run_only = one_run_only(&campaign.dataset).filter(|_| settings.method != Method::Whitened);
    one_run_only.map_or(Ok(()), Err)?;
    check_count(bank, settings.method)?;
    let mut notes = ready.notes.clone();
    let held_out = match bank.runs.len() {
        1 => Vec::new(),
        _ => leave_one_run_out(campaign, learner, settings, &[Vec::new()], probe, progress).remove(0)?,
    };
    let mut learned = learner.learn(&(0..bank.runs.len()).collect::<Vec<usize>>(), &[])?;
    if settings.method == Method::Whitened {
        notes.remarks.extend(worth(bank.runs.len(), settings.prior.is_some()));
        let half_a_count = ready.half_a_count();
        learned = prune(learned, bank, half_a_count);
        if learned.inputs().is_empty() {
            notes.remarks.push(format!(
                "in every row, Cz is smaller than half a count of the register ({half_a_count} µm): there is \
                 nothing to compensate, and no model is written"
            ));
        }
    }
    let inputs = learned.inputs();
    // If the machine keeps only a few sensors, no other sensor may be needed.
    let among = match settings.sensors {
        Some(_) => inputs.clone(),
        None => (0..campaign.inputs.len()).collect(),
    };
    let is_assessed = is_whole && settings.method == Method::Whitened && !held_out.is_empty();
    let mut stand_ins = match is_assessed {
        true => stand_in::stand_ins(campaign, &among, &inputs, &held_out),
        false => Vec::new(),
    };
    let mut fallbacks = match is_whole && campaign.inputs.len() > 1 {
        true => fallbacks(campaign, learner, settings, (&among, &inputs), &learned, &held_out)?,
        false => Vec::new(),
    };
    keep_the_better(&mut stand_ins, &mut fallbacks);
    let by_sensors = match is_assessed {
        true => point_counts(campaign, bank, &campaign.sensors(), MOST_COUNTED, &|_, _| {}).table,
        false => Vec::new(),
    };
    let (mut terms, mut condition) = (Vec::new(), None);
    if let Some(gains) = learned.sum() {
        let left_out: Vec<&Learned> = held_out.iter().map(|held| &held.learned).collect();
        let errors = standard_errors(bank, gains, &left_out, settings.method.is_penalized());
        let collinear = collinearity(campaign, bank, gains);
        condition = collinear.as_ref().map(|collinear| collinear.condition);
        let inflation = |place: usize| collinear.as_ref().map(|collinear| collinear.inflation[place]);
        terms = terms_of(campaign, bank, gains);
        for (place, (term, se)) in terms.iter_mut().zip(errors).enumerate() {
            (term.se, term.inflation) = (se, inflation(place));
        }
    }
    let error = campaign.dataset.columns[campaign.error].name.clone();
    let mut runs: Vec<RunScore> = held_out.iter().map(|held| held.score.clone()).collect();
    let expected = expected(&held_out);
    notes.remarks.extend(over_touches(campaign));
    for (place, run) in runs.iter_mut().enumerate() {
        run.expected_um = inside(&held_out, place);
    }
    let irreplaceable = match is_assessed {
        true => {
            let sensors = inputs.iter().map(|input| &campaign.inputs[*input]);
            let sensors = sensors.filter(|input| !input.is_speed()).map(|input| input.name.as_str());
            irreplaceable(sensors, &stand_ins, &fallbacks, &Means::unprobed(&held_out))
        }
        false => Vec::new(),
    };
    notes.remarks.extend(coverage::alike(campaign, bank));
    let mut found = Identified {
        method: settings.method.name(),
        axis: ready.axis.clone(),
        terms,
        condition,
        network: match &learned {
            Learned::Net { net, .. } => Some(net.what()),
            Learned::Sum(_) | Learned::Mean { .. } => None,
        },
        means: Means::of(&runs),
        uncompensated: Means::uncompensated(&runs),
        expected_missing: expected.err(),
        expected: expected.ok(),
        probe_q: wander(&held_out),
        worse_runs: runs.iter().filter(|run| run.is_worse()).map(|run| run.name.clone()).collect(),
        runs,
        probe_s: probe,
        notes,
        repaired: ready.repaired.clone(),
        columns: columns(ready, &error),
        by_sensors,
        irreplaceable,
        stand_ins,
        fallbacks,
        region: Region::of(campaign, bank, &inputs),
        position: campaign
            .position
            .as_ref()
            .map(|position| (position.input.name.clone(), position.reference)),
        settle_s: campaign.machine.settle.as_secs_f64(),
        error,
        held_out,
        learned,
    };
    let warnings = found.warnings();
    found.notes.remarks.extend(warnings);
    Ok(found)
}

impl Identified {
    /// Returns the terms, sorted by their largest contribution to Cz, the largest first. The gains themselves cannot be
    /// compared, because they have different units.
    pub fn by_size(&self) -> Vec<&TermFound> {
        let mut terms: Vec<&TermFound> = self.terms.iter().collect();
        terms.sort_by(|one, other| other.largest_um.total_cmp(&one.largest_um));
        terms
    }
}

/// Identifies a model from the runs `runs`, and tests it on the other runs. Returns one result for each of these other
/// runs.
///
/// # Errors
/// No model can be identified from these runs. The message says what to do.
pub fn assessed_on_others(
    ready: &Ready<'_>,
    settings: &Settings,
    runs: &[usize],
) -> Result<Vec<RunScore>, String> {
    let campaign = &ready.campaign;
    let learner = settings.method.prepare(campaign, settings)?;
    let (bank, learned) = (learner.bank(), learner.learn(runs, &[])?);
    let others = (0..bank.runs.len()).filter(|run| !runs.contains(run));
    let assessed = |run: usize| {
        let error = bank.runs[run].error();
        let cz = learned.predict(campaign, bank, run);
        let left: Vec<f64> = error.iter().zip(cz).map(|(error, cz)| error + cz).collect();
        RunScore::new(&bank.runs[run].name, &error, &left).over(campaign.touches(run, error.len()))
    };
    Ok(others.map(assessed).collect())
}

/// Returns a remark that the ranges of runs with touches are too small; `None` if there are no such runs.
fn over_touches(campaign: &Campaign<'_>) -> Option<String> {
    let runs = &campaign.dataset.runs;
    let touched = runs.iter().filter(|run| run.is_touched()).count();
    (touched > 0).then(|| {
        format!(
            "{touched} of {} were measured by touches of a probe. Their ranges are marked: a measurement in \
             every row would give a range that is about {OVER_TOUCHES} times as large",
            counted(runs.len(), "run")
        )
    })
}

/// Returns a remark about the low reliability of a model from one or two runs; `None` if there are more runs.
fn worth(runs: usize, has_prior: bool) -> Option<String> {
    let share = match (runs, has_prior) {
        (1, false) => {
            ". One in four such models made a later run worse than without compensation. Therefore each gain \
             was reduced to 70 %. Also,"
        }
        (1, true) => ", and",
        (2, false) => " alone, with each gain reduced to 70 %",
        (2, true) => " alone",
        _ => return None,
    };
    Some(match runs {
        1 => format!(
            "one run: no run could be held out, so the error of this model is not known{share} there is no \
             replacement for a failed sensor. Record another day before you rely on the model"
        ),
        _ => format!(
            "two runs: each run was tested with a model that was identified from the other run{share}. The \
             written model was identified from both runs, so it was not tested. Record a third day"
        ),
    })
}

/// Checks for the method `ols` (least squares) that there are more rows than columns, even while the longest run is
/// held out.
fn check_count(bank: &Bank, method: Method) -> Result<(), String> {
    let terms = bank.candidates.len();
    let rows = bank.runs.iter().map(|run| run.target.len());
    let left = rows.clone().sum::<usize>() - rows.max().unwrap_or(0);
    if method != Method::Ols || left > terms {
        return Ok(());
    }
    Err(format!(
        "{terms} terms cannot be identified from the {left} rows that remain while the longest run is held \
         out. Name fewer inputs with --inputs, record longer runs, use a shorter --resample, or use --method \
         sparse-lag, which selects terms"
    ))
}

fn terms_of(campaign: &Campaign<'_>, bank: &Bank, gains: &[(Candidate, f64)]) -> Vec<TermFound> {
    let unit = |candidate: &Candidate| {
        let (of, per) = (if candidate.along { "µm/mm" } else { "µm" }, campaign.inputs[candidate.input].unit);
        let square = if candidate.squared { "²" } else { "" };
        if per.0 == "1" { of.to_owned() } else { format!("{of}/{per}{square}") }
    };
    let largest = |(candidate, gain): &(Candidate, f64)| {
        // A fitted time constant is in no bank. A lagged input moves no more than the input.
        let column = bank.column(candidate).or_else(|| bank.plain(candidate.input));
        column.map_or(0.0, |column| bank.largest(column) * gain.abs())
    };
    let term = |own @ (candidate, gain): &(Candidate, f64)| TermFound {
        unit: unit(candidate),
        signal: campaign.inputs[candidate.input].name.clone(),
        lag_s: candidate.lag.map_or(0.0, |lag| lag.as_secs_f64()),
        gain: *gain,
        se: None,
        largest_um: largest(own),
        inflation: None,
        slope: candidate.along,
        squared: candidate.squared,
        is_speed: campaign.inputs[candidate.input].is_speed(),
    };
    gains.iter().map(term).collect()
}

/// Returns the columns of the logs with their use. Resolution, minimum and maximum are calculated from the recorded
/// readings, because rebuilt readings have no resolution.
fn columns(ready: &Ready<'_>, error: &str) -> Vec<ColumnShown> {
    let (touches, runs) = (touches::columns(&ready.axis), &ready.logs.runs);
    let are_touches = runs.iter().any(|run| run.is_touched());
    let used = |name: &str| {
        if name == error {
            "error"
        } else if ready.campaign.inputs.iter().any(|input| input.name == name) {
            "input"
        } else if ready.notes.excluded.iter().any(|faulty| faulty.signal == name) {
            "left out: faulty"
        } else if are_touches && touches.iter().any(|touches| touches == name) {
            "touches"
        } else {
            "not used"
        }
    };
    let dataset = ready.logs;
    let shown = |(place, column): (usize, &Column)| {
        let span = least_and_most(dataset.runs.iter().flat_map(|run| &run.values[place]));
        ColumnShown {
            name: column.name.clone(),
            kind: column.kind,
            used: used(&column.name),
            resolution: Some(resolution(dataset, place)),
            min: span.map(|(low, _)| low),
            max: span.map(|(_, high)| high),
        }
    };
    let unread = |Column { name, kind }: &Column| ColumnShown {
        name: name.clone(),
        kind: *kind,
        used: used(name),
        resolution: None,
        min: None,
        max: None,
    };
    dataset.columns.iter().enumerate().map(shown).chain(dataset.unread.iter().map(unread)).collect()
}
