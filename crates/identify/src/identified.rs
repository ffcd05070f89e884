//! What was found, and how far it may be believed.

use serde::Serialize;

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::collinear::collinearity;
use crate::dataset::{Column, Kind};
use crate::faults::{Notes, Repaired, resolution};
use crate::learn::{Learned, Learner};
use crate::method::{Method, Settings};
use crate::region::Region;
use crate::setup::Ready;
use crate::statistics::least_and_most;
use crate::uncertainty::standard_errors;
use crate::validate::{HeldOut, Means, Progress, RunScore, leave_one_run_out};
use alone::alone;

mod alone;

pub use alone::Alone;

/// A model with its cross-validation. Serialized, it is the JSON of `identify`.
#[derive(Clone, Debug, Serialize)]
pub struct Identified {
    /// The method's word.
    pub method: &'static str,
    /// The axis.
    pub axis: String,
    /// The column with the measured error.
    pub error: String,
    /// The terms of Cz = Σ gain·rise; empty for a network.
    pub terms: Vec<TermFound>,
    /// The condition number of the terms' columns, each of root mean square 1; none where two are the same, or there are none.
    pub condition: Option<f64>,
    /// What the network is, where it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network: Option<String>,
    /// Each run, held out.
    pub runs: Vec<RunScore>,
    /// How they fared.
    #[serde(flatten)]
    pub means: Means,
    /// The same without compensation.
    pub uncompensated: Means,
    /// The interval of the probe, s, where the residual is taken out at one.
    pub probe_s: Option<f64>,
    /// What is odd about the sensors and the logs.
    #[serde(flatten)]
    pub notes: Notes,
    /// Sensors that were faulty in a run, and what was done about it.
    pub repaired: Vec<Repaired>,
    /// What each column of the logs was taken for.
    pub columns: Vec<ColumnShown>,
    /// Models for the loss of each sensor, the best first.
    pub fallbacks: Vec<Fallback>,
    /// Every held-out run, row by row.
    #[serde(skip)]
    pub held_out: Vec<HeldOut>,
    /// The model over all runs.
    #[serde(skip)]
    pub learned: Learned,
    /// Where its inputs were; none where they are too many, or one never moved.
    #[serde(rename = "envelope")]
    pub region: Option<Region>,
    /// The slope's position signal and where the slope adds nothing, mm.
    pub position: Option<(String, f64)>,
    /// What references are the mean over, s.
    pub settle_s: f64,
}

/// One term of the sum.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TermFound {
    /// The signal.
    pub signal: String,
    /// Time constant, s; 0: it acts at once.
    pub lag_s: f64,
    /// For Cz = −e.
    pub gain: f64,
    /// The gain's unit: µm/°C, or as the profile has the signal; a term of the slope: µm/mm/°C.
    pub unit: String,
    /// The gain's standard error.
    pub se: f64,
    /// How many times the variance of the gain is what it were if no other term resembled it; none as for the condition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inflation: Option<f64>,
    /// It belongs to the slope over the position.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub slope: bool,
}

/// A column, and what it was taken for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ColumnShown {
    /// Its name.
    pub name: String,
    /// What it seems to be.
    pub kind: Kind,
    /// What it is used as.
    pub used: &'static str,
    /// The smallest step between two of its values; 0 where it never moved.
    pub resolution: f64,
    /// Its least value.
    pub min: Option<f64>,
    /// Its largest value.
    pub max: Option<f64>,
}

/// The model that stands in where a sensor is lost.
#[derive(Clone, Debug, Serialize)]
pub struct Fallback {
    /// The signal that is not there.
    pub without: String,
    /// The method's word.
    pub method: &'static str,
    /// Its terms; empty for a formula.
    pub terms: Vec<TermFound>,
    /// Where its inputs were; none where they are too many, or one never moved.
    #[serde(rename = "envelope")]
    pub region: Option<Region>,
    /// The sensor that is left, with the time since machine start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alone: Option<Alone>,
    /// Held out.
    #[serde(flatten)]
    pub means: Means,
}

impl Fallback {
    /// The method, or what the sensor that is left goes with.
    pub fn kind(&self) -> String {
        match &self.alone {
            Some(alone) => format!("{} alone, with the time since machine start", alone.signal),
            None => self.method.to_owned(),
        }
    }
}

/// Finds the model, validates it, and looks for its stand-ins.
///
/// # Errors
/// What the method says: a sentence that says what to do.
pub fn identify(
    ready: &Ready<'_>,
    settings: &Settings,
    probe: Option<f64>,
    fallbacks: bool,
    progress: Progress<'_>,
) -> Result<Identified, String> {
    let campaign = &ready.campaign;
    let learner = settings.method.prepare(campaign, settings)?;
    let (learner, bank) = (learner.as_ref(), learner.bank());
    bank.check_rows("every sensor", "the sensor")?;
    check_count(bank, settings.method)?;
    let held_out = leave_one_run_out(campaign, learner, settings, &[], probe, progress)?;
    let learned = learner.learn(&(0..bank.runs.len()).collect::<Vec<usize>>(), &[])?;
    let inputs = learned.inputs();
    let fallbacks = match fallbacks && inputs.len() > 1 {
        true => self::fallbacks(campaign, learner, settings, &inputs, &learned, &held_out)?,
        false => Vec::new(),
    };
    let (mut terms, mut condition) = (Vec::new(), None);
    if let Some(gains) = learned.sum() {
        let left_out: Vec<&Learned> = held_out.iter().map(|held| &held.learned).collect();
        let errors = standard_errors(bank, gains, &left_out, settings.method.is_penalized());
        let collinear = collinearity(campaign, bank, gains);
        condition = collinear.as_ref().map(|collinear| collinear.condition);
        let inflation = |place: usize| collinear.as_ref().map(|collinear| collinear.inflation[place]);
        terms = terms_of(campaign, gains);
        for (place, (term, se)) in terms.iter_mut().zip(errors).enumerate() {
            (term.se, term.inflation) = (se, inflation(place));
        }
    }
    let error = campaign.dataset.columns[campaign.error].name.clone();
    let runs: Vec<RunScore> = held_out.iter().map(|held| held.score.clone()).collect();
    Ok(Identified {
        method: settings.method.name(),
        axis: ready.axis.clone(),
        terms,
        condition,
        network: match &learned {
            Learned::Net { net, .. } => Some(net.what()),
            Learned::Sum(_) => None,
        },
        means: Means::of(&runs),
        uncompensated: Means::uncompensated(&runs),
        runs,
        probe_s: probe,
        notes: ready.notes.clone(),
        repaired: ready.repaired.clone(),
        columns: columns(ready, &error),
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
    })
}

/// Least squares on all columns needs more rows than columns, also where the longest run is held out.
fn check_count(bank: &Bank, method: Method) -> Result<(), String> {
    let terms = bank.candidates.len();
    let rows = bank.runs.iter().map(|run| run.target.len());
    let left = rows.clone().sum::<usize>() - rows.max().unwrap_or(0);
    if method != Method::Ols || left > terms {
        return Ok(());
    }
    Err(format!(
        "{terms} terms cannot be learnt from {left} rows, which is what is left while the longest run is held out: name fewer \
         inputs with --inputs, record longer, average less with --resample, or let --method sparse-lag choose"
    ))
}

fn terms_of(campaign: &Campaign<'_>, gains: &[(Candidate, f64)]) -> Vec<TermFound> {
    let unit = |candidate: &Candidate| {
        let (of, per) = (if candidate.along { "µm/mm" } else { "µm" }, campaign.inputs[candidate.input].unit);
        if per.0 == "1" { of.to_owned() } else { format!("{of}/{per}") }
    };
    let term = |(candidate, gain): &(Candidate, f64)| TermFound {
        unit: unit(candidate),
        signal: campaign.inputs[candidate.input].name.clone(),
        lag_s: candidate.lag.map_or(0.0, |lag| lag.as_secs_f64()),
        gain: *gain,
        se: 0.0,
        inflation: None,
        slope: candidate.along,
    };
    gains.iter().map(term).collect()
}

/// For the loss of each input, the best first.
fn fallbacks(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    inputs: &[usize],
    learned: &Learned,
    held_out: &[HeldOut],
) -> Result<Vec<Fallback>, String> {
    let own = Settings { method: settings.method.stand_in(), ..settings.clone() };
    let mut found = match own.method {
        method if method == settings.method => without_each(campaign, learner, &own, inputs),
        method => without_each(campaign, method.prepare(campaign, &own)?.as_ref(), &own, inputs),
    };
    if settings.method == Method::Difference {
        found.extend(alone(campaign, learner.bank(), learned, held_out));
    }
    found.sort_by(|one, other| one.means.mean_range_um.total_cmp(&other.means.mean_range_um));
    Ok(found)
}

/// A method that cannot do without a sensor has no stand-in for its loss.
fn without_each(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    inputs: &[usize],
) -> Vec<Fallback> {
    let runs: Vec<usize> = (0..learner.bank().runs.len()).collect();
    let without = |lost: &usize| {
        let learned = learner.learn(&runs, &[*lost]).ok()?;
        let gains = learned.sum().filter(|gains| !gains.is_empty())?;
        let held = leave_one_run_out(campaign, learner, settings, &[*lost], None, &|_, _| {}).ok()?;
        Some(Fallback {
            without: campaign.inputs[*lost].name.clone(),
            method: settings.method.name(),
            alone: None,
            terms: terms_of(campaign, gains),
            region: Region::of(campaign, learner.bank(), &learned.inputs()),
            means: Means::of(held.iter().map(|held| &held.score)),
        })
    };
    inputs.iter().filter_map(without).collect()
}

/// As the columns were recorded: what was rebuilt has no resolution.
fn columns(ready: &Ready<'_>, error: &str) -> Vec<ColumnShown> {
    let used = |name: &str| {
        if name == error {
            "error"
        } else if ready.campaign.inputs.iter().any(|input| input.name == name) {
            "input"
        } else if ready.notes.excluded.iter().any(|faulty| faulty.signal == name) {
            "left out: faulty"
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
            resolution: resolution(dataset, place),
            min: span.map(|(low, _)| low),
            max: span.map(|(_, high)| high),
        }
    };
    dataset.columns.iter().enumerate().map(shown).collect()
}
