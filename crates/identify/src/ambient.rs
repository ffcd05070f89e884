//! Finds sensors that behave like the air around the machine, regardless of their names.
//!
//! The load is the speed that exceeds 1 rpm in the most rows, usually the spindle speed. A sensor is reported only if
//! all of these are true:
//! - The load does not warm the sensor: neither after a start of the load, nor through a first-order lag.
//! - The sensor changes slowly.
//! - The sensor correlates with time more than with the error.
//!
//! If the hall and the machine warm at the same time, the air cannot be distinguished from the machine.

use crate::dataset::{Dataset, Kind, Run};
use crate::faults::Finding;
use crate::minutes::Minutes;
use crate::statistics::{count, mean, median, range};

const MINUTE: f64 = 60.0;
/// Time after a start of the load within which the heat of the load reaches the sensors of the machine, min.
const AFTER_START: usize = 20;
/// Minimum number of starts of the load in all runs. With fewer starts, no sensor is reported.
const STARTS: usize = 3;
/// Time constants that are tried for the lag between the load and the temperature of a part that it warms, min.
const LAGS_MIN: [f64; 4] = [6.0, 25.0, 75.0, 200.0];
/// Maximum ratio of two parts of the variance of an air sensor: the part that the load explains, divided by the part
/// that time explains. The limit is not zero: with few runs, every slow signal also correlates a little with a slow lag
/// of the load.
const UNRELATED: f64 = 0.5;
/// Maximum rise of an air sensor after a start of the load, as a ratio to the largest rise of any sensor.
const COLD_AT_STARTS: f64 = 0.15;
/// Maximum change of an air sensor within 20 min, as a ratio to the largest change of any sensor.
const SLOW: f64 = 1.0 / 3.0;
/// Limit of the temperature change of an air sensor within 20 min, °C. The air of a hall cannot change faster while its
/// doors are closed.
const NO_AIR: f64 = 1.0;
/// Minimum range (maximum minus minimum) of the readings of a sensor, °C. A sensor that changes less is not reported.
const MOVES: f64 = 0.2;

/// Load, measured error and temperatures of one run, with one value for each minute. A minute without a value repeats
/// the value of the previous minute.
struct Courses {
    load: Vec<f64>,
    error: Vec<f64>,
    sensors: Vec<Vec<f64>>,
}

/// Statistics of one sensor that decide whether it behaves like the air.
#[derive(Clone, Copy, Debug)]
struct Figures {
    /// Median rise of the temperature in the [`AFTER_START`] minutes after a start of the load, minus the rise in the
    /// same time before the start, °C.
    start: f64,
    /// Largest temperature change within 20 min, °C.
    fastest: f64,
    /// Share of the variance that the load explains through the best of the tried lags, 0 to 1.
    load: f64,
    /// Share of the variance that a parabola over the time of each run explains, 0 to 1.
    time: f64,
    /// Correlation of the sensor with the measured error, −1 to 1.
    error: f64,
    /// Largest range (maximum minus minimum) of the readings within a run, °C.
    range: f64,
}

/// Returns the index of the log column of the temperature whose name means ambient air. If no temperature has such a
/// name, returns the first temperature that is in `like`, the list of sensors that behave like the air. `None` if no
/// temperature is in this list.
pub(crate) fn ambient_column(dataset: &Dataset, like: &[Finding]) -> Option<usize> {
    let name = |place: usize| dataset.columns[place].name.as_str();
    let is_named = |place: &usize| is_named_for_the_air(name(*place));
    let behaves = |place: &usize| like.iter().any(|like| like.signal == name(*place));
    let mut temperatures = dataset.of_kind(Kind::Temperature);
    temperatures.find(is_named).or_else(|| dataset.of_kind(Kind::Temperature).find(behaves))
}

/// Returns whether the name contains a word for the air around the machine, for example `ambient`.
pub(crate) fn is_named_for_the_air(name: &str) -> bool {
    let name = name.to_lowercase();
    let mut words = name.split(|letter: char| !letter.is_alphabetic());
    words.any(|word| ["ambient", "air", "room", "hall", "shop", "environment"].contains(&word))
}

/// Finds the sensors that behave like the air. The result is empty if the logs have no speed column, or too few starts
/// of the load.
pub(crate) fn find(dataset: &Dataset, columns: &[usize], error: usize) -> Vec<Finding> {
    let Some(load) = load(dataset) else { return Vec::new() };
    let runs: Vec<Courses> = dataset.runs.iter().map(|run| courses(run, load, error, columns)).collect();
    let starts: usize = runs.iter().map(|run| starts(run).len()).sum();
    if starts < STARTS {
        return Vec::new();
    }
    let all: Vec<Figures> = (0..columns.len()).map(|sensor| figures(&runs, sensor)).collect();
    let most = |of: fn(&Figures) -> f64| all.iter().map(of).fold(0.0, f64::max);
    let (start, fastest) = (most(|of| of.start), most(|of| of.fastest));
    let is_air = |of: &Figures| {
        of.range > MOVES
            && of.start < COLD_AT_STARTS * start
            && of.fastest < NO_AIR.min(SLOW * fastest)
            && of.load < UNRELATED * of.time
            && of.time > of.error * of.error
    };
    let like = |(column, of): (&usize, &Figures)| Finding {
        signal: dataset.columns[*column].name.clone(),
        reason: format!(
            "behaves like the air around the machine. After the {starts} starts of {}, this sensor warms by \
             {:+.2} °C in {AFTER_START} min (the fastest sensor by {start:+.1} °C). The speed of {} \
             explains at most {:.0} % of its variance, with any lag. The sensor never changes faster than \
             {:.1} °C in 20 min. A smooth curve over time explains {:.0} % of its variance; its correlation with the error \
             is r = {:+.2}",
            dataset.columns[load].name,
            of.start,
            dataset.columns[load].name,
            100.0 * of.load,
            of.fastest,
            100.0 * of.time,
            of.error
        ),
    };
    columns.iter().zip(&all).filter(|(_, of)| is_air(of)).map(like).collect()
}

/// Returns the index of the log column of the load: the speed that exceeds 1 rpm in the most rows. `None` if no speed
/// exceeds 1 rpm.
fn load(dataset: &Dataset) -> Option<usize> {
    let turns = |column: &usize| {
        let values = dataset.runs.iter().flat_map(|run| &run.values[*column]);
        values.filter(|value| value.abs() > 1.0).count()
    };
    dataset.of_kind(Kind::Speed).filter(|column| turns(column) > 0).max_by_key(turns)
}

fn courses(run: &Run, load: usize, error: usize, columns: &[usize]) -> Courses {
    Courses {
        load: by_minute(run, load).into_iter().map(f64::abs).collect(),
        error: by_minute(run, error),
        sensors: columns.iter().map(|column| by_minute(run, *column)).collect(),
    }
}

fn by_minute(run: &Run, column: usize) -> Vec<f64> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a run's length in minutes")]
    let minute = |second: f64| (second / MINUTE).clamp(0.0, 1e6) as usize;
    let minutes = Minutes::of(run, column);
    let mut course = vec![f64::NAN; minute(run.lasts().as_secs_f64()) + 1];
    for (second, value) in minutes.seconds.iter().zip(&minutes.values) {
        course[minute(*second)] = *value;
    }
    let mut last = minutes.values.first().copied().unwrap_or(0.0);
    for value in &mut course {
        last = if value.is_nan() { last } else { *value };
        *value = last;
    }
    course
}

/// Returns the minutes in which the load starts after a standstill of at least [`AFTER_START`] minutes. A start counts
/// only if the run lasts at least as long after it.
fn starts(run: &Courses) -> Vec<usize> {
    let fastest = run.load.iter().copied().fold(0.0, f64::max);
    let turns = |minute: usize| run.load[minute] > 0.1 * fastest && run.load[minute] > 1.0;
    let begins = |minute: &usize| {
        turns(*minute) && (minute.saturating_sub(AFTER_START)..*minute).all(|before| !turns(before))
    };
    (AFTER_START..run.load.len().saturating_sub(AFTER_START)).filter(begins).collect()
}

fn figures(runs: &[Courses], sensor: usize) -> Figures {
    let own = |run: &Courses| run.sensors[sensor].clone();
    let kick = |run: &Courses, start: usize| {
        let own = &run.sensors[sensor];
        let (before, at, after) = (own[start - AFTER_START], own[start], own[start + AFTER_START]);
        (after - at) - (at - before)
    };
    let kicks = runs.iter().flat_map(|run| starts(run).into_iter().map(|start| kick(run, start)));
    let changes = runs.iter().flat_map(|run| {
        let own = &run.sensors[sensor];
        own.iter().zip(own.iter().skip(AFTER_START)).map(|(now, then)| (then - now).abs())
    });
    let centred = |of: &dyn Fn(&Courses) -> Vec<f64>| -> Vec<Vec<f64>> {
        runs.iter().map(|run| self::centred(&of(run))).collect()
    };
    let rises = centred(&own);
    let by_lag = |minutes: &f64| correlation(&rises, &centred(&|run| lagged(&run.load, *minutes))).powi(2);
    Figures {
        start: median(kicks.collect()),
        fastest: changes.fold(0.0, f64::max),
        load: LAGS_MIN.iter().map(by_lag).fold(0.0, f64::max),
        time: parabolic(&rises),
        error: correlation(&rises, &centred(&|run| run.error.clone())),
        range: runs.iter().map(|run| range(&run.sensors[sensor])).fold(0.0, f64::max),
    }
}

/// Returns the load after a first-order lag with a time constant of `minutes`. The initial value is zero.
fn lagged(load: &[f64], minutes: f64) -> Vec<f64> {
    let gone = 1.0 - (-1.0 / minutes).exp();
    let mut state = 0.0;
    let mut follow = |now: &f64| {
        state += gone * (now - state);
        state
    };
    load.iter().map(&mut follow).collect()
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = mean(values);
    values.iter().map(|value| value - mean).collect()
}

fn product(one: &[Vec<f64>], other: &[Vec<f64>]) -> f64 {
    one.iter().flatten().zip(other.iter().flatten()).map(|(one, other)| one * other).sum()
}

/// Returns the correlation coefficient of two series. The mean of each run is subtracted from the series first.
fn correlation(one: &[Vec<f64>], other: &[Vec<f64>]) -> f64 {
    let size = (product(one, one) * product(other, other)).sqrt();
    if size > 0.0 { product(one, other) / size } else { 0.0 }
}

/// Returns the share of the variance that a parabola over the time of each run explains. The parabola is a sum of the
/// first two Legendre polynomials.
fn parabolic(rises: &[Vec<f64>]) -> f64 {
    let taken = |values: &Vec<f64>| -> f64 {
        let last = count(values.len().max(2) - 1);
        let along = |shape: fn(f64) -> f64| {
            let places = (0..values.len()).map(|place| shape(2.0 * count(place) / last - 1.0));
            let shape = centred(&places.collect::<Vec<f64>>());
            let own: f64 = shape.iter().map(|value| value * value).sum();
            let with: f64 = shape.iter().zip(values).map(|(shape, value)| shape * value).sum();
            if own > 0.0 { with * with / own } else { 0.0 }
        };
        along(|place| place) + along(|place| 1.5 * place * place - 0.5)
    };
    let all = product(rises, rises);
    if all > 0.0 { rises.iter().map(taken).sum::<f64>() / all } else { 0.0 }
}
