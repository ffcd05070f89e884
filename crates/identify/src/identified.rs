//! What was found, and how far it may be believed.

use serde::Serialize;

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::checks::one_run_only;
use crate::collinear::collinearity;
use crate::coverage;
use crate::dataset::{Column, Kind};
use crate::expected::{Expected, expected, inside};
use crate::faults::{Notes, Repaired, resolution};
use crate::lean::lean;
use crate::learn::Learned;
use crate::method::{Method, Settings};
use crate::region::Region;
use crate::select::{Counted, counted};
use crate::setup::Ready;
use crate::stand_in::{self, StandIn};
use crate::statistics::least_and_most;
use crate::uncertainty::standard_errors;
use crate::validate::{HeldOut, Means, Progress, RunScore, leave_one_run_out};
use crate::wander::wander;
use lost::{fallbacks, irreplaceable, keep_the_better};

mod alone;
mod harm;
mod lost;

pub use alone::Alone;
pub use lost::Fallback;

/// Most sensors for the curve over how many are kept.
const MOST_COUNTED: usize = 8;

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
    /// What to expect of it: one standard deviation that grows with the hours.
    pub expected: Option<Expected>,
    /// How fast what it leaves wanders, µm²/h: the probe's q.
    pub probe_q: Option<f64>,
    /// Runs that it left worse than they were without compensation.
    pub worse_runs: Vec<String>,
    /// Held out, by how many sensors are kept, from none on; empty where it was not asked for.
    pub by_sensors: Vec<Counted>,
    /// Sensors of which no other tells: where one is lost, a run's range grows by more than a quarter.
    pub irreplaceable: Vec<String>,
    /// What stands in for each sensor that is frozen or lost.
    pub stand_ins: Vec<StandIn>,
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
    /// The gain's standard error; none where too few runs say nothing of it.
    pub se: Option<f64>,
    /// The most that it adds to Cz on any row, µm.
    pub largest_um: f64,
    /// How many times the variance of the gain is what it were if no other term resembled it; none as for the condition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inflation: Option<f64>,
    /// It belongs to the slope over the position.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub slope: bool,
    /// The square of the signal counts.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub squared: bool,
    /// It counts from standing still, not from the start.
    #[serde(skip)]
    pub is_speed: bool,
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
    /// The smallest step between two of its values; 0 where it never moved. None where it was not read, as its least and
    /// its largest value.
    pub resolution: Option<f64>,
    /// Its least value.
    pub min: Option<f64>,
    /// Its largest value.
    pub max: Option<f64>,
}

/// Finds the model and validates it; where the whole is wanted also what stands in for its sensors, and how many it needs.
///
/// # Errors
/// What the method says: a sentence that says what to do.
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
        learned = lean(learned, bank, half_a_count);
        if learned.inputs().is_empty() {
            notes.remarks.push(format!(
                "Cz does not reach half a count of the register ({half_a_count} µm) in any row: there is \
                 nothing to compensate, and no model is written"
            ));
        }
    }
    let inputs = learned.inputs();
    // Where the machine keeps a few sensors, nothing may need another one.
    let among = match settings.sensors {
        Some(_) => inputs.clone(),
        None => (0..campaign.inputs.len()).collect(),
    };
    let is_judged = is_whole && settings.method == Method::Whitened && !held_out.is_empty();
    let mut stand_ins = match is_judged {
        true => stand_in::stand_ins(campaign, &among, &inputs, &held_out),
        false => Vec::new(),
    };
    let mut fallbacks = match is_whole && campaign.inputs.len() > 1 {
        true => fallbacks(campaign, learner, settings, (&among, &inputs), &learned, &held_out)?,
        false => Vec::new(),
    };
    keep_the_better(&mut stand_ins, &mut fallbacks);
    let by_sensors = match is_judged {
        true => counted(campaign, bank, &campaign.sensors(), MOST_COUNTED, &|_, _| {}).table,
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
    for (place, run) in runs.iter_mut().enumerate() {
        run.expected_um = inside(&held_out, place);
    }
    let irreplaceable = match is_judged {
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
        expected,
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
    /// The terms, those first that come to most: gains of different units cannot be compared.
    pub fn by_size(&self) -> Vec<&TermFound> {
        let mut terms: Vec<&TermFound> = self.terms.iter().collect();
        terms.sort_by(|one, other| other.largest_um.total_cmp(&one.largest_um));
        terms
    }
}

/// How a model of some runs, by their numbers, fares on each of the others.
///
/// # Errors
/// What the method says.
pub fn judged_on_the_others(
    ready: &Ready<'_>,
    settings: &Settings,
    runs: &[usize],
) -> Result<Vec<RunScore>, String> {
    let campaign = &ready.campaign;
    let learner = settings.method.prepare(campaign, settings)?;
    let (bank, learned) = (learner.bank(), learner.learn(runs, &[])?);
    let others = (0..bank.runs.len()).filter(|run| !runs.contains(run));
    let judged = |run: usize| {
        let error = bank.runs[run].error();
        let cz = learned.predict(campaign, bank, run);
        let left: Vec<f64> = error.iter().zip(cz).map(|(error, cz)| error + cz).collect();
        RunScore::new(&bank.runs[run].name, &error, &left)
    };
    Ok(others.map(judged).collect())
}

/// What a model of so few runs is worth.
fn worth(runs: usize, has_prior: bool) -> Option<String> {
    let share = match (runs, has_prior) {
        (1, false) => {
            ". One in four such models made a later run worse than without compensation. Therefore each gain \
             was reduced to seven tenths. Also,"
        }
        (1, true) => ", and",
        (2, false) => " alone, with each gain reduced to seven tenths",
        (2, true) => " alone",
        _ => return None,
    };
    Some(match runs {
        1 => format!(
            "one run: no run could be held out, so the error of this model is not known{share} no sensor \
             that fails can be replaced. Record another day before you rely on the model"
        ),
        _ => format!(
            "two runs: each was judged with a model of the other run{share}. The model of both runs, which \
             is written, was not judged. Record a third day"
        ),
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
        "{terms} terms cannot be learnt from the {left} rows that remain while the longest run is held out. \
         Name fewer inputs with --inputs, record longer, average less with --resample, or let --method \
         sparse-lag choose"
    ))
}

fn terms_of(campaign: &Campaign<'_>, bank: &Bank, gains: &[(Candidate, f64)]) -> Vec<TermFound> {
    let unit = |candidate: &Candidate| {
        let (of, per) = (if candidate.along { "µm/mm" } else { "µm" }, campaign.inputs[candidate.input].unit);
        let square = if candidate.squared { "²" } else { "" };
        if per.0 == "1" { of.to_owned() } else { format!("{of}/{per}{square}") }
    };
    let largest = |(candidate, gain): &(Candidate, f64)| {
        // A time constant that was fitted is in no bank: what is late moves no more than what it follows.
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
