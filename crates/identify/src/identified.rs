//! What was found, and how far it may be believed.

use serde::Serialize;

use crate::ambient::AmbientLike;
use crate::bank::Candidate;
use crate::campaign::Campaign;
use crate::collinear::collinearity;
use crate::dataset::{Column, Kind};
use crate::faults::{Excluded, Repaired, resolution};
use crate::learn::{Learned, Learner};
use crate::method::{Method, Settings};
use crate::region::Region;
use crate::setup::Ready;
use crate::statistics::{count, least_and_most};
use crate::uncertainty::standard_errors;
use crate::validate::{HeldOut, RunScore, leave_one_run_out};
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
    /// Mean over the runs of the held-out range, µm.
    pub mean_range_um: f64,
    /// The worst run's range, µm.
    pub worst_range_um: f64,
    /// Mean over the runs of the held-out root mean square, µm.
    pub mean_rmse_um: f64,
    /// The same means of the bare machine, µm.
    pub uncompensated: Means,
    /// The interval of the probe, s, where the residual is taken out at one.
    pub probe_s: Option<f64>,
    /// Sensors left out, with the reason.
    pub excluded: Vec<Excluded>,
    /// Sensors that behave like the air, with the reason.
    pub ambient: Vec<AmbientLike>,
    /// Sensors that were faulty in a run, and what was done about it.
    pub repaired: Vec<Repaired>,
    /// What each column of the logs was taken for.
    pub columns: Vec<ColumnShown>,
    /// Models for the loss of each sensor, the best first.
    pub fallbacks: Vec<Fallback>,
    /// What is odd.
    pub remarks: Vec<String>,
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
    /// µm per unit of the signal, for Cz = −e; a term of the slope: µm/mm per unit.
    pub gain: f64,
    /// The gain's standard error.
    pub se: f64,
    /// How many times the variance of the gain is what it were if no other term resembled it; none as for the condition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inflation: Option<f64>,
    /// It belongs to the slope over the position.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub slope: bool,
}

/// Figures over all runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Means {
    /// Mean range, µm.
    pub mean_range_um: f64,
    /// Worst range, µm.
    pub worst_range_um: f64,
    /// Mean of the root mean squares, µm.
    pub mean_rmse_um: f64,
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
    /// The sensor that is left, with machine-on time.
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
            Some(alone) => format!("{} alone, with machine-on time", alone.signal),
            None => self.method.to_owned(),
        }
    }
}

/// Finds the model, validates it, and looks for its stand-ins. `progress` is told what is done, out of how much.
///
/// # Errors
/// What the method says: a sentence that says what to do.
pub fn identify(
    ready: &Ready<'_>,
    settings: &Settings,
    probe: Option<f64>,
    fallbacks: bool,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Identified, String> {
    let campaign = &ready.campaign;
    let learner = settings.method.prepare(campaign, settings)?;
    check_rows(learner.as_ref())?;
    check_count(learner.as_ref(), settings.method)?;
    let held_out = leave_one_run_out(campaign, learner.as_ref(), settings, &[], probe, progress)?;
    let runs: Vec<usize> = (0..learner.bank().runs.len()).collect();
    let learned = learner.learn(&runs, &[])?;
    let inputs = inputs_of(&learned);
    let stand_ins = if fallbacks && inputs.len() > 1 {
        let own = Settings { method: settings.method.stand_in(), ..settings.clone() };
        let mut found = match own.method {
            method if method == settings.method => stand_ins(campaign, learner.as_ref(), &own, &inputs),
            method => stand_ins(campaign, method.prepare(campaign, &own)?.as_ref(), &own, &inputs),
        };
        if settings.method == Method::Difference {
            found.extend(alone(campaign, learner.bank(), &learned, &held_out));
        }
        found.sort_by(|one, other| one.means.mean_range_um.total_cmp(&other.means.mean_range_um));
        found
    } else {
        Vec::new()
    };
    let error = campaign.dataset.columns[campaign.error].name.clone();
    let means = means(held_out.iter().map(|held| (held.score.range_um, held.score.rmse_um)));
    let mut terms = terms(campaign, learner.as_ref(), &learned, &held_out, settings.method);
    let apart = match &learned {
        Learned::Sum(gains) => collinearity(campaign, learner.bank(), gains),
        Learned::Net { .. } => None,
    };
    for (term, inflation) in terms.iter_mut().zip(apart.iter().flat_map(|apart| &apart.inflation)) {
        term.inflation = Some(*inflation);
    }
    let bare = |held: &HeldOut| (held.score.uncompensated_range_um, held.score.uncompensated_rmse_um);
    Ok(Identified {
        method: settings.method.name(),
        axis: ready.axis.clone(),
        terms,
        condition: apart.map(|apart| apart.condition),
        network: match &learned {
            Learned::Net { net, .. } => Some(net.what()),
            Learned::Sum(_) => None,
        },
        runs: held_out.iter().map(|held| held.score.clone()).collect(),
        mean_range_um: means.mean_range_um,
        worst_range_um: means.worst_range_um,
        mean_rmse_um: means.mean_rmse_um,
        uncompensated: self::means(held_out.iter().map(bare)),
        probe_s: probe,
        excluded: ready.excluded.clone(),
        ambient: ready.ambient.clone(),
        repaired: ready.repaired.clone(),
        columns: columns(ready, &error),
        fallbacks: stand_ins,
        remarks: ready.remarks.clone(),
        region: Region::of(campaign, learner.bank(), &inputs),
        position: campaign.position.as_ref().map(|position| (position.name.clone(), position.reference)),
        settle_s: campaign.machine.settle.as_secs_f64(),
        error,
        held_out,
        learned,
    })
}

fn check_rows(learner: &dyn Learner) -> Result<(), String> {
    match learner.bank().runs.iter().find(|run| run.wanted.is_empty()) {
        None => Ok(()),
        Some(run) => Err(format!(
            "{} has no row in which the error and every sensor are there: leave it out, or leave the sensor out that \
             is missing with --without",
            run.name
        )),
    }
}

/// Least squares on all columns needs more rows than columns, also where the longest run is held out.
fn check_count(learner: &dyn Learner, method: Method) -> Result<(), String> {
    let terms = learner.bank().width();
    let rows = learner.bank().runs.iter().map(|run| run.wanted.len());
    let left = rows.clone().sum::<usize>() - rows.max().unwrap_or(0);
    if method != Method::Ols || left > terms {
        return Ok(());
    }
    Err(format!(
        "{terms} terms cannot be learnt from {left} rows, which is what is left while the longest run is held out: name fewer \
         inputs with --inputs, record longer, average less with --resample, or let --method sparse-lag choose"
    ))
}

/// The places of the inputs that a model needs.
fn inputs_of(learned: &Learned) -> Vec<usize> {
    let mut inputs: Vec<usize> = match learned {
        Learned::Sum(gains) => gains.iter().map(|(candidate, _)| candidate.input).collect(),
        Learned::Net { inputs, .. } => inputs.iter().map(|candidate| candidate.input).collect(),
    };
    inputs.sort_unstable();
    inputs.dedup();
    inputs
}

fn terms(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    learned: &Learned,
    held_out: &[HeldOut],
    method: Method,
) -> Vec<TermFound> {
    let Learned::Sum(gains) = learned else { return Vec::new() };
    let left_out: Vec<&Learned> = held_out.iter().map(|held| &held.learned).collect();
    let errors = standard_errors(learner.bank(), gains, &left_out, method.is_penalized());
    gains.iter().zip(errors).map(|((candidate, gain), se)| shown(campaign, candidate, *gain, se)).collect()
}

fn shown(campaign: &Campaign<'_>, candidate: &Candidate, gain: f64, se: f64) -> TermFound {
    TermFound {
        signal: campaign.inputs[candidate.input].name.clone(),
        lag_s: candidate.lag.map_or(0.0, |lag| lag.as_secs_f64()),
        gain,
        se,
        inflation: None,
        slope: candidate.along,
    }
}

fn stand_ins(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    inputs: &[usize],
) -> Vec<Fallback> {
    let runs: Vec<usize> = (0..learner.bank().runs.len()).collect();
    let mut found = Vec::new();
    for lost in inputs {
        // A method that cannot do without this sensor has no stand-in for its loss.
        let Ok(learned @ Learned::Sum(_)) = learner.learn(&runs, &[*lost]) else { continue };
        let needed = inputs_of(&learned);
        let Learned::Sum(gains) = learned else { continue };
        if gains.is_empty() {
            continue;
        }
        let held = leave_one_run_out(campaign, learner, settings, &[*lost], None, &|_, _| {});
        let Ok(held) = held else { continue };
        found.push(Fallback {
            without: campaign.inputs[*lost].name.clone(),
            method: settings.method.name(),
            alone: None,
            terms: gains.iter().map(|(candidate, gain)| shown(campaign, candidate, *gain, 0.0)).collect(),
            region: Region::of(campaign, learner.bank(), &needed),
            means: means(held.iter().map(|held| (held.score.range_um, held.score.rmse_um))),
        });
    }
    found
}

fn means(scores: impl Iterator<Item = (f64, f64)>) -> Means {
    let (mut ranges, mut squares, mut worst, mut runs) = (0.0, 0.0, 0.0_f64, 0_usize);
    for (range, rms) in scores {
        ranges += range;
        squares += rms;
        worst = worst.max(range);
        runs += 1;
    }
    let runs = count(runs).max(1.0);
    Means { mean_range_um: ranges / runs, worst_range_um: worst, mean_rmse_um: squares / runs }
}

/// As the columns were recorded: what was rebuilt has no resolution.
fn columns(ready: &Ready<'_>, error: &str) -> Vec<ColumnShown> {
    let used = |name: &str| {
        if name == error {
            "error"
        } else if ready.campaign.inputs.iter().any(|input| input.name == name) {
            "input"
        } else if ready.excluded.iter().any(|faulty| faulty.signal == name) {
            "left out: faulty"
        } else {
            "not used"
        }
    };
    let dataset = ready.logs;
    let shown = |(place, column): (usize, &Column)| {
        let span = least_and_most(dataset.runs.iter().flat_map(|run| run.values[place].iter().copied()));
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
