//! Sensors that must not be learnt from, found in the logs and told in words with times.
//!
//! One faulty sensor left in makes the worst run several times worse than no compensation. What counts as a fault:
//! - **jump**: more than 3 °C within a minute, and it stays. No casting does that; it is a new sensor, or a broken one.
//! - **spike**: more than 2 °C up or down, and back within five minutes: a bad contact.
//! - **stuck**: the same number for an hour or more while its neighbours move.
//! - **constant**: it tells nothing.
//! - **missing**: more than a fifth of a run.

use std::time::Duration;

use serde::Serialize;

use super::dataset::{Dataset, Run};
use super::gram::count;
use super::validate::range;

/// °C per minute that no casting reaches.
const JUMP: f64 = 3.0;
/// °C up or down, and back soon after.
const SPIKE: f64 = 2.0;
const SPIKE_LASTS: Duration = Duration::from_secs(300);
const STUCK: Duration = Duration::from_secs(3600);
/// What a stuck sensor would have moved, at least, °C; and in steps of its own resolution.
const MOVED: f64 = 0.1;
const MOVED_STEPS: f64 = 5.0;
const MISSING: f64 = 0.2;
/// A sensor that moves less, °C, in any run is constant.
const STANDS_STILL: f64 = 1e-6;

/// A sensor that is left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Excluded {
    /// The signal.
    pub signal: String,
    /// Why, with run and time.
    pub reason: String,
}

/// A sensor's minutes over one run.
#[derive(Clone, Debug)]
struct Minutes {
    seconds: Vec<f64>,
    values: Vec<f64>,
}

/// The faults of these columns of temperatures: at most one of each kind for each run.
pub fn find(dataset: &Dataset, columns: &[usize]) -> Vec<Excluded> {
    let series: Vec<Vec<Minutes>> =
        dataset.runs.iter().map(|run| columns.iter().map(|column| minutes(run, *column)).collect()).collect();
    let mut found = Vec::new();
    for (place, column) in columns.iter().enumerate() {
        let signal = &dataset.columns[*column].name;
        let reasons = reasons(dataset, &series, place, *column);
        found.extend(reasons.into_iter().map(|reason| Excluded { signal: signal.clone(), reason }));
    }
    found
}

fn reasons(dataset: &Dataset, series: &[Vec<Minutes>], place: usize, column: usize) -> Vec<String> {
    let resolution = resolution(dataset, column);
    let spans: Vec<f64> = series.iter().map(|run| range(&run[place].values)).collect();
    let least = (2.0 * resolution).clamp(STANDS_STILL, 0.05);
    if spans.iter().all(|span| *span < least) {
        return vec!["constant: it tells nothing".to_owned()];
    }
    let lively = liveliness(series, place);
    let mut reasons = Vec::new();
    for (run, sensors) in dataset.runs.iter().zip(series) {
        let own = &sensors[place];
        let gone = run.values[column].iter().filter(|value| !value.is_finite()).count();
        let share = count(gone) / count(run.times.len()).max(1.0);
        if share > MISSING {
            reasons.push(format!("missing in {:.0} % of the rows of {}", 100.0 * share, run.name));
        }
        reasons.extend(jump(own).map(|fault| format!("{fault} in {}", run.name)));
        reasons.extend(
            stuck(sensors, place, resolution, lively).map(|fault| format!("{fault} in {}", run.name)),
        );
    }
    reasons
}

/// Means of each minute in which there is a value.
fn minutes(run: &Run, column: usize) -> Minutes {
    let mut made = Minutes { seconds: Vec::new(), values: Vec::new() };
    let mut window = (f64::NEG_INFINITY, 0.0, 0.0, 0.0);
    let mut close = |(_, seconds, sum, rows): (f64, f64, f64, f64)| {
        if rows > 0.0 {
            made.seconds.push(seconds / rows);
            made.values.push(sum / rows);
        }
    };
    for (second, value) in run.seconds().zip(&run.values[column]).filter(|(_, value)| value.is_finite()) {
        let minute = (second / 60.0).floor();
        if minute > window.0 {
            close(window);
            window = (minute, 0.0, 0.0, 0.0);
        }
        window = (minute, window.1 + second, window.2 + value, window.3 + 1.0);
    }
    close(window);
    made
}

/// The first jump that stays, or spike that returns.
fn jump(own: &Minutes) -> Option<String> {
    for place in 1..own.values.len() {
        let step = own.values[place] - own.values[place - 1];
        let passed = (own.seconds[place] - own.seconds[place - 1]).max(60.0);
        let (before, at) = (own.values[place - 1], clock(own.seconds[place]));
        let soon = (place..own.values.len())
            .take_while(|next| own.seconds[*next] - own.seconds[place] <= SPIKE_LASTS.as_secs_f64());
        let returns = soon.clone().skip(1).any(|next| (own.values[next] - before).abs() < 0.5 * step.abs());
        if returns && step.abs() > SPIKE {
            let spikes = spikes(own);
            let more = if spikes > 1 { format!(", {spikes} times") } else { String::new() };
            return Some(format!("spikes of {step:+.1} °C, first at {at}{more}: a bad contact"));
        }
        if step.abs() * 60.0 / passed > JUMP && !returns {
            return Some(format!(
                "jumps by {step:+.1} °C at {at} and stays: no casting does that, it is another sensor since then"
            ));
        }
    }
    None
}

fn spikes(own: &Minutes) -> usize {
    let there = |place: &usize| {
        let step = own.values[*place] - own.values[*place - 1];
        let next = own.values.get(*place + 1..(*place + 6).min(own.values.len())).unwrap_or_default();
        step.abs() > SPIKE
            && next.iter().any(|value| (value - own.values[*place - 1]).abs() < 0.5 * step.abs())
    };
    (1..own.values.len()).filter(there).count()
}

/// The longest stretch at one number, where the neighbours say that it should have moved.
fn stuck(sensors: &[Minutes], place: usize, resolution: f64, lively: f64) -> Option<String> {
    let own = &sensors[place];
    let mut begin = 0;
    let mut longest: Option<(f64, f64, f64)> = None;
    for end in 1..=own.values.len() {
        let goes_on = end < own.values.len()
            && (own.values[end] - own.values[begin]).abs() < 1e-9 * own.values[begin].abs().max(1.0);
        if goes_on {
            continue;
        }
        let (from, to) = (own.seconds[begin], own.seconds[end - 1]);
        if to - from >= STUCK.as_secs_f64()
            && longest.is_none_or(|(from, to, _)| own.seconds[end - 1] - own.seconds[begin] > to - from)
        {
            let expected = lively * neighbours(sensors, place, from, to);
            if expected > MOVED.max(MOVED_STEPS * resolution) {
                longest = Some((from, to, expected));
            }
        }
        begin = end;
    }
    let (from, to, expected) = longest?;
    Some(format!(
        "stuck at one number from {} to {} while its neighbours moved as for {expected:.1} °C",
        clock(from),
        clock(to)
    ))
}

/// How far the other sensors moved in this time: the median of their ranges.
fn neighbours(sensors: &[Minutes], place: usize, from: f64, to: f64) -> f64 {
    let moved = |sensor: &Minutes| {
        let inside =
            sensor.seconds.iter().zip(&sensor.values).filter(|(second, _)| (from..=to).contains(*second));
        range(&inside.map(|(_, value)| *value).collect::<Vec<f64>>())
    };
    let others = sensors.iter().enumerate().filter(|(other, _)| *other != place);
    median(others.map(|(_, sensor)| moved(sensor)).collect())
}

/// How far this sensor moves where its neighbours move by one degree: the median over the runs.
fn liveliness(series: &[Vec<Minutes>], place: usize) -> f64 {
    let of_run = |run: &Vec<Minutes>| {
        let others = neighbours(run, place, f64::NEG_INFINITY, f64::INFINITY);
        (others > 0.0).then(|| range(&run[place].values) / others)
    };
    median(series.iter().filter_map(of_run).collect())
}

/// The smallest step between two values of a column.
fn resolution(dataset: &Dataset, column: usize) -> f64 {
    let pairs = dataset.runs.iter().flat_map(|run| run.values[column].windows(2));
    let steps = pairs.map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 1e-9);
    let smallest = steps.fold(f64::MAX, f64::min);
    if smallest < f64::MAX { smallest } else { 0.0 }
}

pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[count / 2],
        count => 0.5 * (values[count / 2 - 1] + values[count / 2]),
    }
}

/// `3:05 h` into the run.
fn clock(seconds: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a run's length")]
    let minutes = (seconds / 60.0).max(0.0) as u64;
    format!("{}:{:02} h", minutes / 60, minutes % 60)
}
