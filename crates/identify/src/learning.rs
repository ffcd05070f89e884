//! Learning from touches, one run after the other: products of each run, a candidate from all of them, and a judgement
//! of the candidate against the model in use.
//!
//! ```text
//! logs ── runs from datum to datum ── judge (in use, candidate) ── products ── candidate
//!                                         │                           │
//!                                  learning record            a file for each run
//! ```
//!
//! - The products of a run ([`RunProducts`]) outlive its logs. A year of runs gives a model in seconds.
//! - After each run, the weight of every older run is multiplied by 0.9.
//! - A day is judged before it is learned from. [`isotherm_core::candidate`] contains the decision.
//! - A touch that disagrees with the model, and with the touch after it, is left out ([`doubt`]).
//!
//! Nothing here reads a file or a clock. The caller reads the logs, and stores what [`Learning`] returns.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::applied::Applied;
use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::dataset::{BadLog, Dataset, Run};
use crate::faults::is_constant;
use crate::fleet::{FleetModel, RunProducts};
use crate::learn::Learned;
use crate::method::whitened::known;
use crate::method::{PriorTerm, Settings};
use crate::setup::{Choice, Ready, ready, without_cz};
use isotherm_core::candidate::{Gain, JudgedDay, Judgement};
use isotherm_core::compensation::model::{Expected, Growth, Kind, Linear};
use isotherm_core::compensation::settings::{AxisSettings, Filter};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::{Profile, counted, sha256};

pub mod doubt;

/// Factor by which the weight of each older run is multiplied after a run.
pub const FORGETTING: f64 = 0.9;
/// Maximum number of runs that are stored. The weight of an older one is less than rounding.
pub const MOST_RUNS: usize = 400;
/// Time after the last row of an open run at which the run counts as complete.
const OVER: Duration = Duration::from_hours(1);
/// Growth of the variance of a correction per hour if the profile does not name it, µm²/h.
const USUAL_WALK: f64 = 4.0;
/// Averaging time of log rows.
const RESAMPLE: Duration = Duration::from_mins(1);

const FORMAT: &str = "isotherm-learning";
const VERSION: u64 = 1;

/// Runs from which the model of one axis is learned, and the judgement of the candidate.
#[derive(Clone, Debug)]
pub struct Learning {
    axis: String,
    /// Runs in the order of time.
    runs: Vec<LearnedRun>,
    record: Record,
}

/// Products of one run, as stored in a file.
#[derive(Clone, Debug)]
struct LearnedRun {
    name: String,
    products: RunProducts,
}

/// Progress of the learning: judged days, and the model that they judged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    /// SHA-256 of the model in use when the days were judged.
    in_use: String,
    judgement: Judgement,
    /// Time of the last row that was used.
    until: Moment,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u64,
    /// SHA-256 of `record` as JSON without spaces.
    sha256: String,
    record: Record,
}

/// Result for one run of the logs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakenRun {
    /// Name of the run: its datum if it was measured by touches, otherwise the name of its file.
    pub run: String,
    /// Number of touches; `None` if the run was measured row by row.
    pub touches: Option<usize>,
    /// Number of touches that were left out, because they disagree with the model and with the touch after them.
    pub doubted: usize,
    /// Judgement of the run; `None` if it was not judged.
    pub judged: Option<JudgedRun>,
    /// Reason why the run is not used; `None` if it is used.
    pub skipped: Option<String>,
}

/// Residual error at the touches of a run before it was learned from, as root mean squares in µm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JudgedRun {
    /// Residual error with the model in use.
    pub in_use_um: f64,
    /// Residual error with the candidate.
    pub candidate_um: f64,
}

/// Model in use, as far as it can be compared with a candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct InUse {
    terms: Vec<PriorTerm>,
    expected: Option<Expected>,
}

impl InUse {
    /// Returns the first model of an axis. An axis without a model has no term.
    ///
    /// # Errors
    /// The model is no sum of terms. The message says so.
    pub fn of(profile: &Profile, axis: &str) -> Result<InUse, String> {
        let Some(model) = settings(profile, axis).and_then(|own| own.models.first()) else {
            return Ok(InUse { terms: Vec::new(), expected: None });
        };
        let Kind::Linear(Linear { terms, slope: None, .. }) = &model.kind else {
            return Err(format!(
                "model {} of axis {axis} is not a sum of terms without a slope: the candidate is not compared with it",
                model.name
            ));
        };
        let term = |term: &isotherm_core::compensation::model::Term| {
            let signal = profile.signals.get(term.input.signal.0)?;
            Some(PriorTerm {
                signal: signal.name.clone(),
                lag: term.input.time_constant(),
                squared: term.input.squared,
                gain: term.gain.get(),
            })
        };
        Ok(InUse { terms: terms.iter().filter_map(term).collect(), expected: model.expected })
    }

    fn fingerprint(&self) -> String {
        sha256(format!("{:?}", self.terms).as_bytes())
    }
}

/// Returns the columns from which a model is learned: every temperature and every speed of the profile, except those in
/// `without`. The columns of all runs must be the same.
pub fn choice(profile: &Profile, axis: &str, without: &[String]) -> Choice {
    let is_input = |unit: &str| ["degC", "K", "rpm"].contains(&unit);
    let inputs = profile.signals.iter().filter(|signal| is_input(signal.unit.0));
    let inputs = inputs.map(|signal| signal.name.clone()).filter(|name| !without.contains(name));
    Choice { axis: Some(axis.to_owned()), inputs: inputs.collect(), resample: RESAMPLE, ..Choice::default() }
}

impl Learning {
    /// Restores the learning from its files: name and content of each file of a run, and the record. The order of the
    /// files does not matter. Also returns a message for each file that cannot be used.
    pub fn restore(
        axis: &str,
        files: impl IntoIterator<Item = (String, Vec<u8>)>,
        record: Option<&[u8]>,
    ) -> (Learning, Vec<String>) {
        let mut wrong = Vec::new();
        let mut runs = Vec::new();
        for (name, bytes) in files {
            match RunProducts::from_json(&bytes) {
                Ok(products) => runs.push(LearnedRun { name, products }),
                Err(why) => wrong.push(format!("{name}: {why}")),
            }
        }
        runs.sort_by(|one, other| one.name.cmp(&other.name));
        let record = record.map(read_record).transpose().unwrap_or_else(|why| {
            wrong.push(format!("{}: {why}. The judged days are counted again", Learning::record_name(axis)));
            None
        });
        (Learning { axis: axis.to_owned(), runs, record: record.unwrap_or_default() }, wrong)
    }

    /// Returns the name of the file with the learning record of an axis.
    pub fn record_name(axis: &str) -> String {
        format!("{axis}.learning.json")
    }

    /// Returns whether a file has the name of a run of this axis.
    pub fn is_run(axis: &str, name: &str) -> bool {
        let rest = name.strip_prefix(axis).and_then(|rest| rest.strip_prefix('@'));
        rest.is_some_and(|rest| rest.ends_with(".products.json"))
    }

    /// Returns the first day of the logs that must be read, as text (2026-01-31). Runs that end on earlier days are
    /// known.
    pub fn first_day(&self) -> String {
        stamp(self.record.until).chars().take_while(|c| *c != 'T').collect()
    }

    /// Returns the number of runs.
    pub fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Sets the model in use. Days that judged another one are discarded.
    pub fn compare_with(&mut self, in_use: Option<&InUse>) {
        let fingerprint = in_use.map(InUse::fingerprint).unwrap_or_default();
        if self.record.in_use != fingerprint {
            self.record.judgement.clear();
            self.record.in_use = fingerprint;
        }
    }

    /// Judges and learns each complete run of these logs that is not known yet, in the order of time. `now`: present
    /// time; `None` if later logs follow, so that a run at the end of these logs is not complete.
    ///
    /// # Errors
    /// The touches of the logs cannot be read.
    pub fn take(
        &mut self,
        profile: &Profile,
        mut dataset: Dataset,
        (choice, in_use): (&Choice, Option<&InUse>),
        now: Option<Moment>,
    ) -> Result<Vec<TakenRun>, BadLog> {
        without_cz(profile, &mut dataset, choice, &Applied::AsLogged)?;
        self.compare_with(in_use);
        let mut runs = std::mem::take(&mut dataset.runs);
        runs.sort_by_key(datum);
        let error = dataset.column(&choice.error_column(profile));
        let has_error =
            |run: &Run| error.is_some_and(|error| run.values[error].iter().any(|value| value.is_finite()));
        let mut taken = Vec::new();
        for mut run in runs {
            let Some(last) = run.times.last().copied() else { continue };
            let is_touched = run.is_touched();
            // A recorded run is a file, which may still grow.
            let may_go_on = match now {
                None => run.origin.is_open,
                Some(now) => (run.origin.is_open || !is_touched) && now.since(last) < OVER,
            };
            // Rows before `until` have been learned from, perhaps as part of a run with another datum.
            let is_over = is_touched && datum(&run) < self.record.until;
            if may_go_on || is_over || !has_error(&run) {
                continue;
            }
            run.name = name(&run);
            let file = self.file_name(&run);
            if self.runs.iter().any(|known| known.name == file) {
                continue;
            }
            if is_touched {
                self.record.until = now.map_or(last, |now| last.min(now)).max(self.record.until);
            }
            let single = Dataset { runs: vec![run], remarks: Vec::new(), ..dataset.clone() };
            taken.push(self.digest(profile, single, file, (choice, in_use)));
        }
        Ok(taken)
    }

    /// Judges one run, and learns from it.
    fn digest(
        &mut self,
        profile: &Profile,
        mut single: Dataset,
        file: String,
        (choice, in_use): (&Choice, Option<&InUse>),
    ) -> TakenRun {
        let begins = single.runs.first().map(datum).unwrap_or_default();
        let is_touched = single.runs.first().is_some_and(Run::is_touched);
        let name = single.runs.first().map(|run| run.name.clone()).unwrap_or_default();
        let mut taken = TakenRun { run: name, touches: None, doubted: 0, judged: None, skipped: None };
        let candidate = is_touched.then(|| self.candidate()).flatten();
        let mut left = None;
        if is_touched {
            match touches(profile, &single, choice, in_use, candidate.as_ref()) {
                Ok(found) => {
                    taken.touches = Some(found.accepted());
                    taken.doubted = found.rejected.len();
                    left = found.left;
                    found.reject(&mut single, choice);
                }
                Err(why) => return TakenRun { skipped: Some(why), ..taken },
            }
        }
        let products = prepared(profile, &single, choice)
            .and_then(|ready| RunProducts::of(&ready, &profile.name, &Settings::default()));
        let products = match products {
            Ok(products) => products,
            Err(why) => return TakenRun { skipped: Some(why), ..taken },
        };
        // A candidate that lacks a column of this run is no candidate for its days.
        let is_like = self.runs.last().is_some_and(|newest| newest.products.is_like(&products));
        let candidate = candidate.filter(|_| is_like);
        let judges = candidate.zip(left).zip(taken.touches.and_then(|touches| u32::try_from(touches).ok()));
        if let Some(((candidate, in_use), touches)) = judges.filter(|(_, touches)| *touches > 0) {
            let candidate = products.left(&candidate) / f64::from(touches);
            if self.record.judgement.judge(JudgedDay { begins, touches, in_use, candidate }) {
                taken.judged = Some(JudgedRun { in_use_um: in_use.sqrt(), candidate_um: candidate.sqrt() });
            }
        }
        self.runs.push(LearnedRun { name: file, products });
        self.runs.sort_by(|one, other| one.name.cmp(&other.name));
        taken
    }

    /// Returns the model that is learned from all runs with the columns of the newest; `None` without a run.
    pub fn candidate(&self) -> Option<FleetModel> {
        let newest = &self.runs.last()?.products;
        let mut alike = self.runs.iter().map(|run| &run.products).filter(|products| newest.is_like(products));
        let mut all = alike.next()?.clone();
        for products in alike {
            // A run of the same name has been copied under another file name.
            let _ = all.add(products);
        }
        Some(all.learn_recent(FORGETTING))
    }

    /// Returns the number of runs whose columns differ from those of the newest, so that they are not used.
    pub fn unlike(&self) -> usize {
        let newest = self.runs.last();
        let differs =
            |run: &&LearnedRun| newest.is_some_and(|newest| !newest.products.is_like(&run.products));
        self.runs.iter().filter(differs).count()
    }

    /// Returns the judgement of the candidate.
    pub fn judgement(&self) -> &Judgement {
        &self.record.judgement
    }

    /// Returns the file of each run that is not in `known`: its name and its content.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn new_files(&self, known: &[String]) -> Result<Vec<(String, String)>, String> {
        let new = self.runs.iter().filter(|run| !known.contains(&run.name));
        new.map(|run| Ok((run.name.clone(), run.products.to_json()?))).collect()
    }

    /// Returns the names of the files of the oldest runs, which are more than [`MOST_RUNS`] runs old.
    pub fn superfluous(&self) -> Vec<String> {
        let most = self.runs.len().saturating_sub(MOST_RUNS);
        self.runs.iter().take(most).map(|run| run.name.clone()).collect()
    }

    /// Returns the content of the file with the learning record.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn record(&self) -> Result<String, String> {
        let record = self.record.clone();
        let file = File { format: FORMAT.to_owned(), version: VERSION, sha256: seal(&record)?, record };
        serde_json::to_string(&file).map_err(|why| why.to_string())
    }

    /// Returns the candidate as a block for a profile. It contains the expected error of the model in use, which the
    /// touches of the axis scale.
    pub fn block(&self, model: &FleetModel, in_use: Option<&InUse>) -> String {
        let judged = self.record.judgement.gain().map(|gain: Gain| {
            format!(
                "# On {}, it would have left {:.1} µm RMS instead of {:.1} µm.\n",
                counted(gain.days, "judged day"),
                gain.candidate.get(),
                gain.in_use.get()
            )
        });
        let head = format!(
            "# Cz = −e, learned from {}, the newest with the largest weight.\n{}\
             # No envelope and no stand-ins: products do not contain the values of the inputs.\n",
            counted(model.from_runs, "run"),
            judged.unwrap_or_default()
        );
        let pair = |growth: Growth| format!("[{:?}, {:?}]", growth.per_hour(), growth.at_once());
        let keys = match in_use.and_then(|in_use| in_use.expected) {
            None => "# No expected error: the model in use has none.\n".to_owned(),
            Some(Expected { since_datum, since_touch }) => {
                let touch = since_touch.map(|growth| format!(", since_touch = {}", pair(growth)));
                format!(
                    "expected = {{ since_datum = {}{} }}   # of the model before; probings scale it\n",
                    pair(since_datum),
                    touch.unwrap_or_default()
                )
            }
        };
        model.block_of("learned", &head, &keys)
    }

    /// Returns the name of the file of a run. The names sort in the order of time.
    fn file_name(&self, run: &Run) -> String {
        let is_safe = |c: char| c.is_ascii_alphanumeric() || "-_.:".contains(c);
        let name: String = run.name.chars().map(|c| if is_safe(c) { c } else { '_' }).collect();
        let begins = stamp(datum(run));
        let more = if run.is_touched() { String::new() } else { format!("@{name}") };
        format!("{}@{begins}{more}.products.json", self.axis)
    }
}

/// Touches of one run, with the model that judged them.
struct JudgedTouches {
    /// Numbers of the averaging windows of touches that are left out.
    rejected: Vec<u128>,
    /// Number of touches with those that are left out.
    all: usize,
    /// Mean square of the residual error with the model in use, µm²; `None` without a model in use to compare.
    left: Option<f64>,
    error: usize,
}

impl JudgedTouches {
    fn accepted(&self) -> usize {
        self.all - self.rejected.len()
    }

    /// Removes the rejected touches from the error of the run.
    fn reject(&self, single: &mut Dataset, choice: &Choice) {
        for run in &mut single.runs {
            let first = run.times.first().copied().unwrap_or_default();
            let window = |at: &Moment| at.since(first).as_nanos() / choice.resample.as_nanos().max(1);
            let errors = run.values[self.error].iter_mut().zip(&run.times);
            errors
                .filter(|(_, at)| self.rejected.contains(&window(at)))
                .for_each(|(error, _)| *error = f64::NAN);
        }
    }
}

/// Judges the touches of a single run by the model in use, or by the candidate if there is no model to compare.
fn touches(
    profile: &Profile,
    single: &Dataset,
    choice: &Choice,
    in_use: Option<&InUse>,
    candidate: Option<&FleetModel>,
) -> Result<JudgedTouches, String> {
    let ready = prepared(profile, single, choice)?;
    let campaign = &ready.campaign;
    let terms = match (in_use, candidate) {
        (Some(in_use), _) if !in_use.terms.is_empty() => in_use.terms.clone(),
        (_, Some(candidate)) => candidate.prior(),
        (_, None) => Vec::new(),
    };
    let is_input = |name: &str| campaign.inputs.iter().any(|input| input.name == name);
    if let Some(term) = terms.iter().find(|term| !is_input(&term.signal)) {
        return Err(format!("the model in use needs {}, which is no input of the candidate", term.signal));
    }
    let (bank, residuals) = residuals(campaign, &terms)?;
    let own = in_use.map(|in_use| residuals_of(campaign, &bank, &in_use.terms)).transpose()?;
    let run = bank.runs.first().ok_or("the run has no row")?;
    let hours: Vec<f64> = run.seconds.iter().map(|second| second / 3600.0).collect();
    // Without any model, the residual is the whole drift, and nothing can be doubted.
    let accepted = match terms.is_empty() {
        true => vec![true; residuals.len()],
        false => doubt::accepted(&hours, &residuals, scatter(profile, choice)),
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

/// Returns the rows of the only run of a campaign, and the residual error of a model in each.
fn residuals(campaign: &Campaign<'_>, terms: &[PriorTerm]) -> Result<(Bank, Vec<f64>), String> {
    let candidates = known(campaign, terms)?.iter().map(|(candidate, _)| *candidate).collect();
    let bank = Bank::new(campaign, candidates);
    let left = residuals_of(campaign, &bank, terms)?;
    Ok((bank, left))
}

/// Returns the residual error of a model in each row of the only run of a campaign.
fn residuals_of(campaign: &Campaign<'_>, bank: &Bank, terms: &[PriorTerm]) -> Result<Vec<f64>, String> {
    let model = Learned::Sum(known(campaign, terms)?);
    let run = bank.runs.first().ok_or("the run has no row")?;
    Ok(run.error().iter().zip(model.predict(campaign, bank, 0)).map(|(error, cz)| error + cz).collect())
}

/// Checks a single run. A constant sensor is used: it has no effect. A run with another faulty sensor is refused,
/// because nothing in it shows the true reading.
fn prepared<'a>(profile: &Profile, single: &'a Dataset, choice: &Choice) -> Result<Ready<'a>, String> {
    let in_words = |wrong: BadLog| wrong.0.join("; ");
    let constant = |name: &&String| single.column(name).is_some_and(|column| is_constant(single, column));
    let keep = choice.inputs.iter().filter(constant).cloned().collect();
    let ready = ready(profile, single, &Choice { keep, ..choice.clone() }).map_err(in_words)?;
    match ready.notes.excluded.first() {
        None => Ok(ready),
        Some(faulty) => Err(format!("{}: {}", faulty.signal, faulty.reason)),
    }
}

fn settings<'a>(profile: &'a Profile, axis: &str) -> Option<&'a AxisSettings> {
    profile.axes.iter().map(|axis| &axis.settings).find(|own| own.name == axis)
}

/// Returns the standard deviation of a probing, µm, and the growth of the variance of a correction per hour, µm²/h.
fn scatter(profile: &Profile, choice: &Choice) -> (f64, f64) {
    let axis = choice.axis.as_deref().unwrap_or_default();
    match settings(profile, axis).and_then(|own| own.probe).map(|probe| probe.filter) {
        Some(Filter::Weighed { repeat, walk }) => (repeat, walk),
        Some(Filter::Share(_)) | None => (Filter::REPEAT, USUAL_WALK),
    }
}

/// Returns the time of the datum of a run; its first row if it was measured row by row.
fn datum(run: &Run) -> Moment {
    let row = run.datum().unwrap_or_default();
    run.times.get(row).or(run.times.first()).copied().unwrap_or_default()
}

/// Returns the name of a run that does not depend on the files that were read with it.
fn name(run: &Run) -> String {
    if run.is_touched() { stamp(datum(run)) } else { run.name.clone() }
}

/// Returns a time in the form of RFC 3339, to the second.
fn stamp(at: Moment) -> String {
    let mut text = Vec::new();
    time::write(&mut text, at);
    let text = String::from_utf8_lossy(&text).into_owned();
    let seconds = text.split_once('.').map_or(text.trim_end_matches('Z'), |(seconds, _)| seconds);
    format!("{seconds}Z")
}

fn seal(record: &Record) -> Result<String, String> {
    serde_json::to_vec(record).map(|bytes| sha256(&bytes)).map_err(|why| why.to_string())
}

fn read_record(bytes: &[u8]) -> Result<Record, String> {
    let file: File = serde_json::from_slice(bytes).map_err(|why| format!("no learning record: {why}"))?;
    if file.format != FORMAT || file.version != VERSION {
        return Err(format!("no learning record of version {VERSION}"));
    }
    if file.sha256 != seal(&file.record)? {
        return Err("the checksum is wrong: the file was changed or damaged".to_owned());
    }
    Ok(file.record)
}
