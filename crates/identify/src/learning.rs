//! Learning from touches (measurements with a probe), one run after the other. The Gram products of each run are
//! stored, and all of them give a candidate model. Each run then compares the candidate with the model in use.
//!
//! ```text
//! logs ── runs from datum to datum ── judge (in use, candidate) ── products ── candidate
//!                                         │                           │
//!                                  learning record            a file for each run
//! ```
//!
//! - The products of a run ([`RunProducts`]) are kept when its logs are deleted. A model from a year of runs takes
//!   seconds.
//! - After each run, the weight of every older run is multiplied by 0.9.
//! - When a penalty is chosen, a run with touches counts as much as a run that was recorded row by row.
//! - The two models are compared on a day before that day is learned from. [`isotherm_core::candidate`] decides about
//!   the candidate.
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

/// Factor by which the weight of each older run is multiplied after a run.
pub const FORGETTING: f64 = 0.9;
/// Maximum number of runs that are stored. The weight of an older run is smaller than the rounding error.
pub const MOST_RUNS: usize = 400;
/// Time after the last row of an open run after which the run counts as complete.
const OVER: Duration = Duration::from_hours(1);
/// Averaging time of log rows.
const RESAMPLE: Duration = Duration::from_mins(1);

/// Runs from which the model of one axis is learned, and the comparison of the candidate model with the model in use.
#[derive(Clone, Debug)]
pub struct Learning {
    axis: String,
    /// Runs in the order of time.
    runs: Vec<LearnedRun>,
    record: Record,
}

/// Gram products of one run, as stored in a file.
#[derive(Clone, Debug)]
struct LearnedRun {
    name: String,
    products: RunProducts,
}

/// Result for one run of the logs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TakenRun {
    /// Name of the run: the time of its datum (zero point) if it was measured by touches, otherwise the name of its
    /// file.
    pub run: String,
    /// Number of touches; `None` if the run was measured row by row.
    pub touches: Option<usize>,
    /// Number of touches that were left out because they disagree with the model and with the next touch.
    pub doubted: usize,
    /// Comparison of the two models on this run; `None` if the run was not compared.
    pub judged: Option<JudgedRun>,
    /// Reason why the run is not used; `None` if it is used.
    pub skipped: Option<String>,
}

/// Residual errors at the touches of a run before the run was learned from, as root mean squares in µm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct JudgedRun {
    /// Residual error with the model in use.
    pub in_use_um: f64,
    /// Residual error with the candidate.
    pub candidate_um: f64,
}

/// Returns the columns from which a model is learned: every temperature and every speed of the profile, except those in
/// `without` and in `learn_without` of the axis. The columns of all runs must be the same.
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
    /// Restores the learning from its files. The arguments are the name and content of the file of each run, and the
    /// learning record. The order of the files does not matter. Also returns a message for each file that cannot be
    /// used.
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
                "{}: {why}. The count of judged days begins again at zero",
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
    /// known already.
    pub fn first_day(&self) -> String {
        stamp(self.record.until).chars().take_while(|c| *c != 'T').collect()
    }

    /// Returns the names of the files of the runs.
    pub fn names(&self) -> Vec<String> {
        self.runs.iter().map(|run| run.name.clone()).collect()
    }

    /// Returns the number of runs.
    pub fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Sets the model in use. Days that were compared with another model are discarded. An exception is the candidate
    /// that was offered last: then that candidate was adopted.
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

    /// Returns a candidate in the form in which a gateway can adopt it. `compared_with` is the name of the learned
    /// model in use; `None` if the model of the profile is in use.
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

    /// Returns the name of a candidate: the day of its last run, and a part of the hash of its terms.
    fn name_of(&self, model: &FleetModel) -> String {
        let newest = self.runs.last().map(|run| run.name.as_str()).unwrap_or_default();
        let (_, begins) = newest.split_once('@').unwrap_or_default();
        let day: String = begins.chars().take_while(|c| *c != 'T').collect();
        let hash: String = fingerprint(&model.prior()).chars().take(4).collect();
        format!("learned-{day}-{hash}")
    }

    /// Records that the candidate is now the model in use. The days that were compared with it remain.
    pub fn adopted(&mut self, candidate: &InUse) {
        self.record.judgement.adopted();
        self.record.in_use = candidate.fingerprint();
    }

    /// Compares the models on each complete run of these logs that is not known yet, in the order of time. Then learns
    /// from that run. `now` is the present time; `None` if later logs follow. A run at the end of these logs is then
    /// not complete.
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

    /// Compares the models on one run, and learns from it.
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
            let why = format!("it has the same rows as the run in {}, which was learned before", known.name);
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

    /// Returns the model that is learned from all runs with the columns of the newest run; `None` if there is no run.
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

    /// Returns the number of runs that are not used, because their columns differ from those of the newest run.
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

    /// Returns the file of each run that is not in `known`: its name and its content.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn new_files(&self, known: &[String]) -> Result<Vec<(String, String)>, String> {
        let new = self.runs.iter().filter(|run| !known.contains(&run.name));
        new.map(|run| Ok((run.name.clone(), run.products.to_json()?))).collect()
    }

    /// Returns the file names of the oldest runs, beyond the newest [`MOST_RUNS`] runs. These files can be deleted.
    pub fn superfluous(&self) -> Vec<String> {
        let most = self.runs.len().saturating_sub(MOST_RUNS);
        self.runs.iter().take(most).map(|run| run.name.clone()).collect()
    }

    /// Returns the content of the file with the learning record.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn record(&self) -> Result<String, String> {
        Record { runs: self.runs.len().min(MOST_RUNS), ..self.record.clone() }.to_json()
    }

    /// Returns the candidate as a block for a profile. It contains the expected error of the model in use, which the
    /// touches of the axis scale.
    pub fn block(&self, model: &FleetModel, in_use: Option<&InUse>) -> String {
        let judged = self.record.judgement.gain().map(|gain: Gain| {
            format!(
                "# On {}, this model would have left {:.1} µm RMS instead of {:.1} µm.\n",
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
            None => "# No expected error: the model in use has none.\n".to_owned(),
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

/// Returns the reason why a run without an accepted touch is not used.
fn all_wrong(touches: usize) -> String {
    format!(
        "its touches ({touches}) were all left out as wrong: another part was measured, or the model is wrong by more \
         than max_error"
    )
}

/// Returns the time of the datum (zero point) of a run, or of its first row if it was measured row by row.
fn datum(run: &Run) -> Moment {
    let row = run.datum().unwrap_or_default();
    run.times.get(row).or(run.times.first()).copied().unwrap_or_default()
}

/// Returns a name of the run that is the same whichever other files were read with it.
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
