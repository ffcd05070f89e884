//! Sensors that must not be learnt from as they are, found in the logs and named with their times.
//!
//! One faulty sensor left in makes the worst run several times worse than no compensation. What counts as a fault:
//! - **jump**: more than 3 °C within a minute, and it stays. No casting does that; it is a new sensor, or a broken one.
//! - **spike**: more than 2 °C up or down, and back within five minutes: a bad contact.
//! - **frozen**: one number while the other sensors say that it should have moved. The virtual sensors (`stand_in`) find it.
//! - **constant**: it says nothing.
//! - **missing**: more than a fifth of a run.
//!
//! The first three spoil one run, not the sensor in every other: what they spoilt is rebuilt where the good runs show
//! that it can be, the rows of a freeze are masked, and the sensor is left out of everything only where neither will do.

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

/// °C per minute that no casting reaches.
const JUMP: f64 = 3.0;
/// °C up or down, and back soon after.
const SPIKE: f64 = 2.0;
const SPIKE_LASTS: Duration = Duration::from_secs(300);
/// s between the step with which a frozen sensor thaws, and the minute that shows it.
const THAWS: f64 = 120.0;
/// Of the rows of a run.
pub(super) const MISSING: f64 = 0.2;
/// A sensor that moves less, °C, in any run is constant.
const STANDS_STILL: f64 = 1e-6;

/// What was found about a sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The signal.
    pub signal: String,
    /// Why it is said, with run, time or figures.
    pub reason: String,
}

/// What leaving one sensor out costs, or gains: root mean square of what a `whitened` model leaves on held-out rows, µm.
/// Both models are judged by the same rows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Omission {
    /// The signal that is left out.
    pub signal: String,
    /// With it, as its readings were recorded but for masked rows.
    pub with_um: f64,
    /// Without it.
    pub without_um: f64,
}

/// What a person must know of the logs beside the figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Notes {
    /// Sensors left out, with the reason.
    pub excluded: Vec<Finding>,
    /// What each sensor that is left out costs; none for one of which it cannot be known.
    pub omissions: Vec<Omission>,
    /// Sensors that behave like the air, with the reason.
    pub ambient: Vec<Finding>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// A sensor that was faulty in one run, and stays in: what its readings of that run were replaced by.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Repaired {
    /// The signal.
    pub signal: String,
    /// The run.
    pub run: String,
    /// What was found, with its time.
    pub fault: String,
    /// What was done about it.
    pub done: String,
}

impl Repaired {
    /// As it stands beside the sensors that were left out.
    pub(super) fn finding(&self) -> Finding {
        let reason = format!("{} ({}) in {}", self.fault, self.done, self.run);
        Finding { signal: self.signal.clone(), reason }
    }
}

/// A fault of one column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) column: usize,
    /// `None`: of every run.
    pub(super) run: Option<usize>,
    /// What was found, with its time.
    pub(super) message: String,
    pub(super) damage: Damage,
    /// The rows of the run that it spoils.
    pub(super) rows: Vec<usize>,
}

/// How a fault spoils a run; in the order in which it is mended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Damage {
    /// Some rows here and there.
    Spikes,
    /// All rows from one on, by a step.
    Jump,
    /// A stretch at one number. Its rows are masked; for what lags behind them they are rebuilt.
    Frozen,
    /// A stretch at one number that is most of its run. It is rebuilt and learnt from: masked, it would leave too little.
    Rebuilt,
    /// A stretch at one number that no other sensor can rebuild. Its rows are masked, and its readings are missing.
    Missing,
    /// Nobody knows which rows.
    Whole,
}

impl Damage {
    /// Whether the reading stood still, whatever was done about it.
    pub(super) fn is_frozen(self) -> bool {
        matches!(self, Damage::Frozen | Damage::Rebuilt | Damage::Missing)
    }
}

/// Every fault of these columns of temperatures but freezes, as reasons to leave them out. A jump with which one of
/// `frozen` thaws is no fault.
pub(super) fn find(dataset: &Dataset, columns: &[usize], frozen: &[Frozen]) -> Vec<Finding> {
    faults(dataset, columns, frozen).iter().map(|fault| fault.finding(dataset, "")).collect()
}

/// Rows in which a reading stood still while the other sensors said that it should have moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frozen {
    /// Of the dataset.
    pub(crate) column: usize,
    /// Of the dataset.
    pub(crate) run: usize,
    /// The first row with the number: a true reading.
    pub(crate) first: usize,
    /// The last row with the number.
    pub(crate) last: usize,
    /// No reading of the run comes after it.
    pub(crate) lasts_to_the_end: bool,
    /// °C that the other sensors say it moved by.
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

    /// With what else is to be said behind the message.
    pub(super) fn finding(&self, dataset: &Dataset, more: &str) -> Finding {
        let run = self.run.map(|run| format!(" in {}", dataset.runs[run].name)).unwrap_or_default();
        let signal = dataset.columns[self.column].name.clone();
        Finding { signal, reason: format!("{}{more}{run}", self.message) }
    }
}

/// Every fault of these columns of temperatures but freezes, column by column, run by run.
pub(super) fn faults(dataset: &Dataset, columns: &[usize], frozen: &[Frozen]) -> Vec<Fault> {
    columns.iter().flat_map(|column| of_column(dataset, *column, frozen)).collect()
}

fn of_column(dataset: &Dataset, column: usize, frozen: &[Frozen]) -> Vec<Fault> {
    let series: Vec<Minutes> = dataset.runs.iter().map(|run| Minutes::of(run, column)).collect();
    let least = (2.0 * resolution(dataset, column)).clamp(STANDS_STILL, 0.05);
    if series.iter().all(|run| range(&run.values) < least) {
        let message = "constant: it gives no information".to_owned();
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
            let message = format!("spikes of {step:+.1} °C, first at {at}{more}: a bad contact");
            add(Damage::Spikes, rows_of_spikes(run, own, &spikes), message);
        }
        let own_frozen = frozen.iter().filter(|frozen| frozen.column == column && frozen.run == number);
        let thaws: Vec<f64> = own_frozen.filter_map(|frozen| run.seconds().nth(frozen.last + 1)).collect();
        for (step, place) in jumps(own, &spikes) {
            // A sensor that thaws jumps, too: that belongs to its having been frozen.
            if is_near(own.seconds[place], &thaws) {
                continue;
            }
            let at = clock(own.seconds[place]);
            let message = format!(
                "jumps by {step:+.1} °C at {at} and keeps this offset: a casting cannot change so fast"
            );
            add(Damage::Jump, rows_of_step(run, column, own.seconds[place]), message);
        }
    }
    found
}

/// The logs without the jumps with which a reading leaves a number at which it stood still. Only the other sensors tell
/// whether such a jump is the thaw of a frozen sensor, and they must not be learnt from with the jump in them.
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
                    let values = &mut levelled.to_mut().runs[number].values[*column];
                    rows.into_iter().for_each(|row| values[row] -= step);
                }
            }
        }
    }
    levelled
}

/// Whether a minute is that of one of these steps.
fn is_near(minute: f64, steps: &[f64]) -> bool {
    steps.iter().any(|step| (step - minute).abs() <= THAWS)
}

/// The share of a run's rows that have no value here.
pub(super) fn missing(run: &Run, column: usize) -> f64 {
    let gone = run.values[column].iter().filter(|value| !value.is_finite()).count();
    count(gone) / count(run.times.len()).max(1.0)
}

/// When the minute of this second begins, s.
fn minute(second: f64) -> f64 {
    (second / 60.0).floor() * 60.0
}

/// The rows from the first to before the second of any of these spans, s.
fn rows_within(run: &Run, spans: &[(f64, f64)]) -> Vec<usize> {
    let is_inside = |second: f64| spans.iter().any(|(from, to)| (*from..*to).contains(&second));
    run.seconds().enumerate().filter(|(_, second)| is_inside(*second)).map(|(row, _)| row).collect()
}

/// A minute that is a mean of several rows has rows of the spike in the minutes beside it, too.
fn rows_of_spikes(run: &Run, own: &Minutes, spikes: &[(usize, usize)]) -> Vec<usize> {
    let seconds: Vec<f64> = run.seconds().collect();
    let step = median(seconds.windows(2).map(|pair| pair[1] - pair[0]).collect());
    let beside = if step < 45.0 { 60.0 } else { 0.0 };
    let at = |place: usize| minute(own.seconds[place]);
    let spans = spikes.iter().map(|(from, to)| (at(*from) - beside, at(*to) + beside));
    rows_within(run, &spans.collect::<Vec<_>>())
}

/// The rows from the largest step of this column within two minutes of this time on.
fn rows_of_step(run: &Run, column: usize, at: f64) -> Vec<usize> {
    let values = run.values[column].iter().copied().enumerate().zip(run.seconds());
    let is_near = |value: f64, second: f64| value.is_finite() && (second - at).abs() <= 120.0;
    let near: Vec<(usize, f64)> =
        values.filter(|((_, value), second)| is_near(*value, *second)).map(|(row, _)| row).collect();
    let steps = near.windows(2).map(|pair| ((pair[1].1 - pair[0].1).abs(), pair[1].0));
    let first = steps.max_by(|one, other| one.0.total_cmp(&other.0)).map_or(0, |(_, row)| row);
    (first..run.times.len()).collect()
}

/// Where spikes begin, and where the first good minute after each is.
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

/// Jumps that stay, with the minute after each.
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

/// The smallest step between two values of a column.
pub(super) fn resolution(dataset: &Dataset, column: usize) -> f64 {
    let pairs = dataset.runs.iter().flat_map(|run| run.values[column].windows(2));
    let steps = pairs.map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 1e-9);
    let smallest = steps.fold(f64::MAX, f64::min);
    if smallest < f64::MAX { smallest } else { 0.0 }
}

/// `3:05 h` into the run.
fn clock(seconds: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a run's length")]
    let minutes = (seconds / 60.0).max(0.0) as u64;
    format!("{}:{:02} h", minutes / 60, minutes % 60)
}
