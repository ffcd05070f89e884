//! Learning from touches (measurements with a probe), one run after the other. A run with touches goes from
//! one datum (zero point of Cz, the compensation value) to the next. The Gram products (X'X, X'y, y'y) of
//! each run are stored. A candidate model is identified from the products of all runs. On each new run, the
//! candidate is first compared with the model in use.
//!
//! ```text
//! logs ── runs from datum to datum ── judge (in use, candidate) ── products ── candidate
//!                                         │                           │
//!                                  learning record            a file for each run
//! ```
//!
//! - The products of a run ([`RunProducts`]) are kept when its logs are deleted. Identifying a model from the runs of a
//!   year takes seconds.
//! - After each run, the weight of every older run is multiplied by 0.9.
//! - In the choice of a penalty, a run with touches counts as much as a run whose errors were recorded in each row.
//! - The two models are compared on a new day before the candidate learns from that day. [`isotherm_core::candidate`]
//!   decides whether the candidate is better.
//! - A touch that disagrees with the model, and with the touch after it, is left out ([`doubt`]).
//!
//! This module reads neither files nor a clock. The caller reads the logs, and stores the files that [`Learning`]
//! returns.

use std::time::Duration;

use serde::Serialize;

use crate::applied::Applied;
use crate::dataset::{BadLog, Dataset, Run};
use crate::fleet::{FleetModel, FleetTerm, NO_VALUES, RunProducts};
use crate::method::Settings;
use crate::setup::{Choice, without_cz};
use in_use::{fingerprint, settings};
use isotherm_core::candidate::{Gain, JudgedDay, Judgement, Offer, OfferedTerm};
use isotherm_core::compensation::model::{Expected, Growth};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::{Profile, counted};
use judged::{prepared, touches};
use record::{Record, read_record};

pub mod doubt;
mod in_use;
mod judged;
mod record;

pub use in_use::InUse;
pub use judged::{ModelRows, rows};

/// Factor for the weights of the runs: after each new run, the weights of all older runs are multiplied by this factor.
pub const FORGETTING: f64 = 0.9;
/// Maximum number of stored runs. The weight of an older run would be smaller than the rounding error.
pub const MOST_RUNS: usize = 400;
/// Minimum time after the last row of a run until the run counts as complete. Before that time, later logs may continue
/// the run.
const OVER: Duration = Duration::from_hours(1);
/// Time over which log rows are averaged.
const RESAMPLE: Duration = Duration::from_mins(1);

/// State of the learning for one axis: the learned runs, and the comparison of the candidate model with the model in
/// use.
#[derive(Clone, Debug)]
pub struct Learning {
    axis: String,
    /// Learned runs in the order of time.
    runs: Vec<LearnedRun>,
    record: Record,
}

/// Gram products of one run, as stored in a file.
#[derive(Clone, Debug)]
struct LearnedRun {
    name: String,
    products: RunProducts,
}

/// Result of the learning for one run of the logs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakenRun {
    /// Name of the run. For a run with touches, the name is the time of its datum (zero point); otherwise it is the
    /// name of its file.
    pub run: String,
    /// Number of accepted touches; `None` if the error was measured row by row.
    pub touches: Option<usize>,
    /// Number of rejected touches. A rejected touch disagrees with the model, and the next touch does not confirm it. A
    /// touch that deviates by more than `max_error` of the probe is always rejected.
    pub doubted: usize,
    /// Comparison of the two models on this run; `None` if the run was not compared.
    pub judged: Option<JudgedRun>,
    /// Reason why nothing was learned from the run; `None` if the run was used.
    pub skipped: Option<String>,
}

/// Residual errors at the touches of a run, as root mean squares in µm. They are calculated before the candidate learns
/// from the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JudgedRun {
    /// Residual error with the model in use.
    pub in_use_um: f64,
    /// Residual error with the candidate.
    pub candidate_um: f64,
}

/// Returns the columns from which a model is learned: every temperature and every speed of the profile.
/// Signals in `without`, and in the setting `learn_without` of the axis, are excluded. All runs must have the
/// same columns.
pub fn choice(profile: &Profile, axis: &str, without: &[String]) -> Choice {
    let is_input = |unit: &str| ["degC", "K", "rpm"].contains(&unit);
    let own = profile.axes.iter().find(|own| own.settings.name == axis);
    let left_out = own.and_then(|own| own.learning.as_ref()).map_or(&[][..], |learning| &learning.without);
    let left_out: Vec<&str> = left_out.iter().map(|id| profile.signal(*id).name.as_str()).collect();
    let inputs = profile.signals.iter().filter(|signal| is_input(signal.unit.0));
    let inputs = inputs.map(|signal| signal.name.clone());
    let inputs = inputs.filter(|name| !without.contains(name) && !left_out.contains(&name.as_str()));
    Choice { axis: Some(axis.to_owned()), inputs: inputs.collect(), resample: RESAMPLE, ..Choice::default() }
}

impl Learning {
    /// Restores the state of the learning from its files: the file of each run (its name and content) in any order, and
    /// the learning record. Also returns a message for each file that cannot be used.
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
            wrong.push(format!(
                "{}: {why}. The number of days on which the models were compared is reset to zero",
                Learning::record_name(axis)
            ));
            None
        });
        let mut record = record.unwrap_or_default();
        if runs.len() < record.runs {
            // The judged candidate was learned from runs that are lost. They are learned again if their logs are there.
            record.judgement.clear();
            record.until = Moment::default();
        }
        record.runs = runs.len();
        (Learning { axis: axis.to_owned(), runs, record }, wrong)
    }

    /// Returns the name of the file with the learning record of an axis. The record contains the results of the
    /// compared days.
    pub fn record_name(axis: &str) -> String {
        format!("{axis}.learning.json")
    }

    /// Returns whether `name` is the file name of a stored run of this axis.
    pub fn is_run(axis: &str, name: &str) -> bool {
        let rest = name.strip_prefix(axis).and_then(|rest| rest.strip_prefix('@'));
        rest.is_some_and(|rest| rest.ends_with(".products.json"))
    }

    /// Returns the first day of the logs that must be read, as text (2026-01-31). All runs that end before this day
    /// have been learned.
    pub fn first_day(&self) -> String {
        stamp(self.record.until).chars().take_while(|c| *c != 'T').collect()
    }

    /// Returns the file names of all stored runs.
    pub fn names(&self) -> Vec<String> {
        self.runs.iter().map(|run| run.name.clone()).collect()
    }

    /// Returns the number of stored runs.
    pub fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Sets the model in use, with which candidates are compared. If the model has changed, the results of all compared
    /// days are discarded. If the new model is the candidate that was offered last, that candidate has been adopted,
    /// and the results are kept.
    pub fn compare_with(&mut self, in_use: Option<&InUse>) {
        let fingerprint = in_use.map(InUse::fingerprint).unwrap_or_default();
        if self.record.in_use != fingerprint {
            match fingerprint == self.record.offered {
                true => self.record.judgement.adopted(),
                false => self.record.judgement.clear(),
            }
            self.record.in_use = fingerprint;
        }
    }

    /// Returns an offer of the candidate `model`, which a gateway can adopt. `compared_with` is the name of
    /// the learned model that is in use; `None` if the model of the profile is in use.
    pub fn offer(&mut self, profile: &Profile, model: &FleetModel, compared_with: Option<String>) -> Offer {
        self.record.offered = fingerprint(&model.prior());
        let slot = settings(profile, &self.axis).and_then(|own| own.learned.as_ref());
        let term = |term: &FleetTerm| OfferedTerm {
            signal: term.signal.clone(),
            lag_s: term.lag_s,
            squared: term.squared,
            gain: term.gain,
        };
        Offer {
            axis: self.axis.clone(),
            name: self.name_of(model),
            runs: model.from_runs,
            terms: model.terms.iter().filter(|term| term.gain.abs() > 0.0).map(term).collect(),
            judgement: self.record.judgement.clone(),
            compared_with,
            own: slot.map(|slot| slot.own.clone()).unwrap_or_default(),
        }
    }

    /// Returns the name of a candidate: the day of the last run, and the first four digits of the hash of its terms.
    fn name_of(&self, model: &FleetModel) -> String {
        let newest = self.runs.last().map(|run| run.name.as_str()).unwrap_or_default();
        let (_, begins) = newest.split_once('@').unwrap_or_default();
        let day: String = begins.chars().take_while(|c| *c != 'T').collect();
        let hash: String = fingerprint(&model.prior()).chars().take(4).collect();
        format!("learned-{day}-{hash}")
    }

    /// Records that the candidate is now the model in use. The results of the compared days are kept.
    pub fn adopted(&mut self, candidate: &InUse) {
        self.record.judgement.adopted();
        self.record.in_use = candidate.fingerprint();
    }

    /// Processes each new complete run of these logs in the order of time: first compares the models on the run, then
    /// learns from it. `now` is the present time. If `now` is `None`, later logs follow, so the last run of these logs
    /// may be incomplete.
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
            // The other runs of these logs say nothing about this run.
            let single = Dataset {
                runs: vec![run],
                remarks: Vec::new(),
                implausible: Vec::new(),
                repeats: Vec::new(),
                ..dataset.clone()
            };
            taken.push(self.digest(profile, single, file, (choice, in_use)));
        }
        Ok(taken)
    }

    /// Compares the models on a single run, then learns from it.
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
                    if taken.doubted > 0 && found.accepted() == 0 {
                        return TakenRun { skipped: Some(all_wrong(taken.doubted)), ..taken };
                    }
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
        if let Some(known) = self.runs.iter().find(|known| known.products.has_same_rows(&products)) {
            let why = format!(
                "this run has the same rows as the run in {}, from which the model has already learned",
                known.name
            );
            return TakenRun { skipped: Some(why), ..taken };
        }
        // A candidate that lacks a column of this run is no candidate for its days. The next candidate is learned from
        // the runs with these columns only, and no day has judged it.
        let is_like = self.runs.last().is_some_and(|newest| newest.products.is_like(&products));
        if !is_like {
            self.record.judgement.clear();
        }
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

    /// Returns the candidate: the model that is identified from all runs that have the columns of the newest run.
    /// `None` if there is no run.
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

    /// Returns the number of stored runs that the candidate does not use, because their columns differ from
    /// the columns of the newest run.
    pub fn unlike(&self) -> usize {
        let newest = self.runs.last();
        let differs =
            |run: &&LearnedRun| newest.is_some_and(|newest| !newest.products.is_like(&run.products));
        self.runs.iter().filter(differs).count()
    }

    /// Returns the result of the comparison of the candidate with the model in use.
    pub fn judgement(&self) -> &Judgement {
        &self.record.judgement
    }

    /// Returns the name and content of the file of each run. Files whose names are in `known` are left out.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn new_files(&self, known: &[String]) -> Result<Vec<(String, String)>, String> {
        let new = self.runs.iter().filter(|run| !known.contains(&run.name));
        new.map(|run| Ok((run.name.clone(), run.products.to_json()?))).collect()
    }

    /// Returns the file names of the oldest runs if there are more than [`MOST_RUNS`]. These files can be deleted.
    pub fn superfluous(&self) -> Vec<String> {
        let most = self.runs.len().saturating_sub(MOST_RUNS);
        self.runs.iter().take(most).map(|run| run.name.clone()).collect()
    }

    /// Returns the content of the file with the learning record: the results of the compared days, as JSON with a
    /// checksum.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn record(&self) -> Result<String, String> {
        Record { runs: self.runs.len().min(MOST_RUNS), ..self.record.clone() }.to_json()
    }

    /// Returns the candidate as TOML text for a profile. The text also contains the expected error of the model in use.
    /// Touches of the probe scale this error in the gateway.
    pub fn block(&self, model: &FleetModel, in_use: Option<&InUse>) -> String {
        let judged = self.record.judgement.gain().map(|gain: Gain| {
            format!(
                "# On {}, the residual error of this model would have been {:.1} µm RMS instead of {:.1} µm.\n",
                counted(gain.days, "judged day"),
                gain.candidate.get(),
                gain.in_use.get()
            )
        });
        let mut head = format!(
            "# Cz = −e, learned from {}, the newest with the largest weight.\n",
            counted(model.from_runs, "run")
        );
        head += &judged.unwrap_or_default();
        head += NO_VALUES;
        let pair = |growth: Growth| format!("[{:?}, {:?}]", growth.per_hour(), growth.at_once());
        let keys = match in_use.and_then(|in_use| in_use.expected) {
            None => "# The expected error is not known: the model in use has none.\n".to_owned(),
            Some(Expected { since_datum, since_touch }) => {
                let touch = since_touch.map(|growth| format!(", since_touch = {}", pair(growth)));
                format!(
                    "expected = {{ since_datum = {}{} }}   # of the previous model; probings scale these values\n",
                    pair(since_datum),
                    touch.unwrap_or_default()
                )
            }
        };
        model.block_of(&self.name_of(model), &head, &keys)
    }

    /// Returns the file name of a run. Sorted by name, the files are in the order of time.
    fn file_name(&self, run: &Run) -> String {
        let is_safe = |c: char| c.is_ascii_alphanumeric() || "-_.:".contains(c);
        let name: String = run.name.chars().map(|c| if is_safe(c) { c } else { '_' }).collect();
        let begins = stamp(datum(run));
        let more = if run.is_touched() { String::new() } else { format!("@{name}") };
        format!("{}@{begins}{more}.products.json", self.axis)
    }
}

/// Returns the reason why a run is not used if all its touches were rejected. `touches` is their number.
fn all_wrong(touches: usize) -> String {
    format!(
        "all touches of the run ({touches}) were rejected as wrong: another part was measured, or the error \
         of the model is larger than max_error"
    )
}

/// Returns the time of the datum (zero point) of a run. If the run was measured row by row, returns the time of its
/// first row.
fn datum(run: &Run) -> Moment {
    let row = run.datum().unwrap_or_default();
    run.times.get(row).or(run.times.first()).copied().unwrap_or_default()
}

/// Returns a name of the run that does not depend on the other files that were read with it.
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
