//! Finds faults of temperature sensors in the logs, with their times.
//!
//! With one faulty sensor in a model, the error of the worst run is several times larger than without compensation.
//! These kinds of readings are faults:
//! - **jump**: a permanent change of more than 3 °C within a minute. A casting cannot change so fast; the sensor was
//!   replaced or is broken.
//! - **spike**: a change of more than 2 °C, and back within five minutes. The cause is a bad contact.
//! - **frozen**: a constant reading, while the prediction from the other sensors changes. The module
//!   `stand_in` finds this fault.
//! - **constant**: a reading that never changes, so the sensor gives no information.
//! - **missing**: no value in more than a fifth of a run.
//!
//! Jumps, spikes and freezes affect the sensor in one run only. Readings with jumps or spikes are corrected if the good
//! runs show that this is possible. The rows of a freeze are masked: no model uses them. The sensor is left out only if
//! its readings cannot be corrected or masked.

use std::borrow::Cow;
use std::time::Duration;

use serde::Serialize;

use crate::dataset::{Dataset, Run};
use crate::minutes::Minutes;
use crate::statistics::{count, median, range};
use standstill::{End, standstills};

pub(super) mod mend;
mod rebuild;
pub(crate) mod standstill;

/// Rate of temperature change that no casting reaches, °C per minute.
const JUMP: f64 = 3.0;
/// Minimum height of a spike, °C.
const SPIKE: f64 = 2.0;
const SPIKE_LASTS: Duration = Duration::from_secs(300);
/// Maximum time between the end of a freeze and the minute in which the resulting step of the reading appears, s.
const THAWS: f64 = 120.0;
/// Maximum share of the rows of a run in which the reading of a sensor may be missing.
pub(super) const MISSING: f64 = 0.2;
/// Minimum change of the readings of a sensor within some run, °C. A sensor whose readings change less in every run is
/// constant.
const STANDS_STILL: f64 = 1e-6;

/// Sensor with a special property, for example a fault, and the reason.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Name of the sensor's signal.
    pub signal: String,
    /// Reason for the finding, with run, time or numbers.
    pub reason: String,
}

/// Effect of leaving one sensor out: the residual error (root mean square) of a `whitened` model with and without this
/// sensor, µm. Both models are tested on the same held-out rows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Omission {
    /// Signal that is left out.
    pub signal: String,
    /// Residual error of the model with the signal. The readings are used as recorded, except in masked log rows.
    pub with_um: f64,
    /// Residual error without the signal.
    pub without_um: f64,
}

/// Facts about the logs that the operator must know, in addition to the results.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Notes {
    /// Sensors that are left out, each with the reason.
    pub excluded: Vec<Finding>,
    /// Effects of leaving out these sensors on the residual error. A sensor is missing in this list if its
    /// effect cannot be calculated.
    pub omissions: Vec<Omission>,
    /// Sensors that behave like the air around the machine, each with the reason.
    pub ambient: Vec<Finding>,
    /// Remarks for the operator about unusual findings.
    pub remarks: Vec<String>,
}

/// Repair of the readings of one sensor in one run. The sensor had a fault in that run, but is still used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Repaired {
    /// Name of the sensor's signal.
    pub signal: String,
    /// Name of the run with the fault.
    pub run: String,
    /// Description of the fault, with its time.
    pub fault: String,
    /// Description of the repair for the operator.
    pub done: String,
}

impl Repaired {
    /// Returns the finding for the list of sensors with faults.
    pub(super) fn finding(&self) -> Finding {
        let reason = format!("{} ({}) in {}", self.fault, self.done, self.run);
        Finding { signal: self.signal.clone(), reason }
    }
}

/// Fault of one temperature sensor (log column).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) column: usize,
    /// Run of the fault; `None` means every run.
    pub(super) run: Option<usize>,
    /// Description of the fault for a message, with the time of the fault.
    pub(super) message: String,
    pub(super) damage: Damage,
    /// Rows of the run that the fault affects.
    pub(super) rows: Vec<usize>,
}

/// Kind of damage that a fault causes in a run. The kinds are in the order in which they are repaired.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Damage {
    /// Spikes: a few successive log rows with wrong readings, after which the readings return.
    Spikes,
    /// Jump: a step that shifts the readings in all later log rows.
    Jump,
    /// Constant readings for a part of the run. These rows are masked, so no model uses them directly. The readings are
    /// rebuilt only because the lagged values of later rows depend on them.
    Frozen,
    /// Constant readings for most of the run. The readings are rebuilt and used for identification, because too few
    /// rows would remain if these rows were masked.
    Rebuilt,
    /// Constant readings that no other sensor can rebuild. These rows are masked, and the readings are treated as
    /// missing.
    Missing,
    /// Fault in unknown log rows. The sensor must be left out.
    Whole,
}

impl Damage {
    /// Returns whether the damage is a freeze (constant readings), independent of the repair.
    pub(super) fn is_frozen(self) -> bool {
        matches!(self, Damage::Frozen | Damage::Rebuilt | Damage::Missing)
    }
}

/// Returns the faults of the sensors in these log columns, except freezes, as findings with reasons. `frozen` contains
/// the known freezes. A jump at the end of a freeze is not a fault.
pub(super) fn find(dataset: &Dataset, columns: &[usize], frozen: &[Frozen]) -> Vec<Finding> {
    faults(dataset, columns, frozen).iter().map(|fault| fault.finding(dataset, "")).collect()
}

/// Freeze: log rows in which a reading was constant, while the prediction from the other sensors changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frozen {
    /// Index of the log column in the dataset.
    pub(crate) column: usize,
    /// Index of the run in the dataset.
    pub(crate) run: usize,
    /// First log row with the constant value. The reading in this row is valid.
    pub(crate) first: usize,
    /// Last log row with the constant value.
    pub(crate) last: usize,
    /// Whether the run has no reading after `last`.
    pub(crate) lasts_to_the_end: bool,
    /// Temperature change from the first of these log rows to the last, °C. The change is predicted from the
    /// other sensors.
    pub(crate) missed: f64,
}

impl Fault {
    pub(super) fn frozen(dataset: &Dataset, frozen: &Frozen) -> Fault {
        let Frozen { column, run, first, last, lasts_to_the_end, missed } = *frozen;
        let at = |row: usize| clock(dataset.runs[run].seconds().nth(row).unwrap_or_default());
        let end = if lasts_to_the_end { "the end".to_owned() } else { at(last) };
        let begin = at(first);
        let message = format!(
            "frozen from {begin} to {end} while the other sensors indicate a change of {missed:.1} °C"
        );
        let rows = (first + 1..=last).collect();
        Fault { column, run: Some(run), message, damage: Damage::Frozen, rows }
    }

    /// Returns the fault as a finding about the sensor. The text `more` is added to the message.
    pub(super) fn finding(&self, dataset: &Dataset, more: &str) -> Finding {
        let run = self.run.map(|run| format!(" in {}", dataset.runs[run].name)).unwrap_or_default();
        let signal = dataset.columns[self.column].name.clone();
        Finding { signal, reason: format!("{}{more}{run}", self.message) }
    }
}

/// Returns the faults of these temperature columns, except freezes, sorted by column and run. A jump at the end of a
/// freeze in `frozen` is not a fault.
pub(super) fn faults(dataset: &Dataset, columns: &[usize], frozen: &[Frozen]) -> Vec<Fault> {
    columns.iter().flat_map(|column| of_column(dataset, *column, frozen)).collect()
}

/// Returns whether the readings of a log column hardly change in any run.
pub(super) fn is_constant(dataset: &Dataset, column: usize) -> bool {
    let series: Vec<Minutes> = dataset.runs.iter().map(|run| Minutes::of(run, column)).collect();
    are_constant(dataset, column, &series)
}

fn are_constant(dataset: &Dataset, column: usize, series: &[Minutes]) -> bool {
    let least = (2.0 * resolution(dataset, column)).clamp(STANDS_STILL, 0.05);
    series.iter().all(|run| range(&run.values) < least)
}

fn of_column(dataset: &Dataset, column: usize, frozen: &[Frozen]) -> Vec<Fault> {
    let series: Vec<Minutes> = dataset.runs.iter().map(|run| Minutes::of(run, column)).collect();
    if are_constant(dataset, column, &series) {
        let message = "constant: this sensor gives no information".to_owned();
        return vec![Fault { column, run: None, message, damage: Damage::Whole, rows: Vec::new() }];
    }
    let mut found = Vec::new();
    for (number, (run, own)) in dataset.runs.iter().zip(&series).enumerate() {
        let mut add = |damage: Damage, rows: Vec<usize>, message: String| {
            found.push(Fault { column, run: Some(number), message, damage, rows });
        };
        let share = missing(run, column);
        if share > MISSING {
            add(Damage::Whole, Vec::new(), format!("missing in {:.0} % of the rows", 100.0 * share));
        }
        let spikes = spikes(own);
        if let Some((first, _)) = spikes.first() {
            let (step, at) = (own.values[*first] - own.values[*first - 1], clock(own.seconds[*first]));
            let more = if spikes.len() > 1 { format!(", {} times", spikes.len()) } else { String::new() };
            let message =
                format!("spikes of {step:+.1} °C, first at {at}{more}, probably from a bad contact");
            add(Damage::Spikes, rows_of_spikes(run, own, &spikes), message);
        }
        let own_frozen = frozen.iter().filter(|frozen| frozen.column == column && frozen.run == number);
        let thaws: Vec<f64> = own_frozen.filter_map(|frozen| run.seconds().nth(frozen.last + 1)).collect();
        for (step, place) in jumps(own, &spikes) {
            // A jump at the end of a freeze belongs to the freeze.
            if is_near(own.seconds[place], &thaws) {
                continue;
            }
            let at = clock(own.seconds[place]);
            let message = format!(
                "jumps by {step:+.1} °C at {at}, faster than a casting can change, and the readings stay \
                 shifted"
            );
            add(Damage::Jump, rows_of_step(run, column, own.seconds[place]), message);
        }
    }
    found
}

/// Returns the logs without the jumps at the ends of constant readings. Such a jump may be the end of a
/// freeze. Only a prediction from the other sensors can show whether the sensor was frozen. The gains of the
/// prediction must be fitted to readings without the jump.
pub(super) fn levelled<'a>(dataset: &'a Dataset, columns: &[usize]) -> Cow<'a, Dataset> {
    let mut levelled = Cow::Borrowed(dataset);
    for (number, run) in dataset.runs.iter().enumerate() {
        for column in columns {
            let steps = standstills(run, *column).into_iter().filter_map(|still| match still.end {
                End::Step { row, size } if size > JUMP / 2.0 => run.seconds().nth(row),
                _ => None,
            });
            let steps: Vec<f64> = steps.collect();
            if steps.is_empty() {
                continue;
            }
            let own = Minutes::of(run, *column);
            for (step, place) in jumps(&own, &spikes(&own)) {
                if is_near(own.seconds[place], &steps) {
                    let rows = rows_of_step(run, *column, own.seconds[place]);
                    levelled.to_mut().runs[number].values[*column]
                        .change(|values| rows.into_iter().for_each(|row| values[row] -= step));
                }
            }
        }
    }
    levelled
}

/// Returns whether a minute is within [`THAWS`] of any of these steps. All times are in s.
fn is_near(minute: f64, steps: &[f64]) -> bool {
    steps.iter().any(|step| (step - minute).abs() <= THAWS)
}

/// Returns the share of a run's log rows without a value in this column.
pub(super) fn missing(run: &Run, column: usize) -> f64 {
    let gone = run.values[column].iter().filter(|value| !value.is_finite()).count();
    count(gone) / count(run.times.len()).max(1.0)
}

/// Returns the start of the minute that contains this time, s.
fn minute(second: f64) -> f64 {
    (second / 60.0).floor() * 60.0
}

/// Returns the log rows within any of these time spans. A span is a start and an end in s; the end is excluded.
fn rows_within(run: &Run, spans: &[(f64, f64)]) -> Vec<usize> {
    let is_inside = |second: f64| spans.iter().any(|(from, to)| (*from..*to).contains(&second));
    run.seconds().enumerate().filter(|(_, second)| is_inside(*second)).map(|(row, _)| row).collect()
}

/// Returns the log rows of spikes. The minutes next to a spike are also searched, because rows of the spike may be part
/// of their means.
fn rows_of_spikes(run: &Run, own: &Minutes, spikes: &[(usize, usize)]) -> Vec<usize> {
    let seconds: Vec<f64> = run.seconds().collect();
    let step = median(seconds.windows(2).map(|pair| pair[1] - pair[0]).collect());
    let beside = if step < 45.0 { 60.0 } else { 0.0 };
    let at = |place: usize| minute(own.seconds[place]);
    let spans = spikes.iter().map(|(from, to)| (at(*from) - beside, at(*to) + beside));
    rows_within(run, &spans.collect::<Vec<_>>())
}

/// Returns all rows of the run from a step of this column onwards. The step is the largest one within two minutes of
/// the time `at`, s.
fn rows_of_step(run: &Run, column: usize, at: f64) -> Vec<usize> {
    let values = run.values[column].iter().enumerate().zip(run.seconds());
    let is_near = |value: f64, second: f64| value.is_finite() && (second - at).abs() <= 120.0;
    let near: Vec<(usize, f64)> =
        values.filter(|((_, value), second)| is_near(*value, *second)).map(|(row, _)| row).collect();
    let steps = near.windows(2).map(|pair| ((pair[1].1 - pair[0].1).abs(), pair[1].0));
    let first = steps.max_by(|one, other| one.0.total_cmp(&other.0)).map_or(0, |(_, row)| row);
    (first..run.times.len()).collect()
}

/// Returns for each spike the index of its first minute, and the index of the first good minute after the spike.
fn spikes(own: &Minutes) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut place = 1;
    while place < own.values.len() {
        let before = own.values[place - 1];
        let step = own.values[place] - before;
        let soon = (place + 1..own.values.len())
            .take_while(|next| own.seconds[*next] - own.seconds[place] <= SPIKE_LASTS.as_secs_f64());
        let back = soon.into_iter().find(|next| (own.values[*next] - before).abs() < 0.5 * step.abs());
        match back.filter(|_| step.abs() > SPIKE) {
            Some(back) => {
                found.push((place, back));
                place = back + 1;
            }
            None => place += 1,
        }
    }
    found
}

/// Returns the size of each permanent jump, °C, with the index of the minute after the jump.
fn jumps(own: &Minutes, spikes: &[(usize, usize)]) -> Vec<(f64, usize)> {
    let is_spike = |place: &usize| spikes.iter().any(|(from, to)| (from..to).contains(&place));
    let good: Vec<usize> = (0..own.values.len()).filter(|place| !is_spike(place)).collect();
    let step = |pair: &[usize]| {
        let (before, after) = (pair[0], pair[1]);
        let step = own.values[after] - own.values[before];
        let passed = (own.seconds[after] - own.seconds[before]).max(60.0);
        (step.abs() * 60.0 / passed > JUMP).then_some((step, after))
    };
    good.windows(2).filter_map(step).collect()
}

/// Returns the smallest step between two values of a log column; 0 if its values never change.
pub(super) fn resolution(dataset: &Dataset, column: usize) -> f64 {
    let values = dataset.runs.iter().map(|run| &run.values[column]);
    let pairs = values.flat_map(|values| values.iter().zip(values.iter().skip(1)));
    let steps = pairs.map(|(one, next)| (next - one).abs()).filter(|step| *step > 1e-9);
    let smallest = steps.fold(f64::MAX, f64::min);
    if smallest < f64::MAX { smallest } else { 0.0 }
}

/// Returns the time in a run as text: `3:05 h`.
fn clock(seconds: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a run's length")]
    let minutes = (seconds / 60.0).max(0.0) as u64;
    format!("{}:{:02} h", minutes / 60, minutes % 60)
}
