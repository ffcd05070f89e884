//! Reader of the decision logs, for charts and downloads of the web page. A decision log has one row for each step of
//! the axes, with the values of the signals and axes. The reader works in the background, and limits memory and time
//! even if the logs are large.
//!
//! A chart divides the time range into as many intervals as it has points. It shows the smallest and the largest value
//! of each interval, so that no peak is lost. A download contains the original rows.

mod rows;
#[cfg(test)]
mod tests;

use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;

use isotherm_core::quantity::Moment;
use rows::{Row, rows};

/// Requested time range and columns of the decision log.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Question {
    pub(super) from: Moment,
    pub(super) to: Moment,
    pub(super) columns: Vec<Column>,
}

/// Column of the logs, with the unit of its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) unit: &'static str,
}

/// Values of the requested log columns over time, for a chart.
#[derive(Debug, JsonSchema, Serialize)]
#[schemars(rename = "History")]
pub(super) struct Course {
    /// Times of the points, in seconds since 1970. A gap between log rows is one point, at which every column is null.
    time: Vec<f64>,
    /// Values of the requested columns at the points in `time`.
    columns: Vec<Extremes>,
    /// Number of log rows in the time range.
    rows: u64,
}

/// Smallest and largest value of one log column at each point of the chart; null if the column has no value there.
#[derive(Debug, JsonSchema, Serialize)]
#[schemars(rename = "HistoryColumn")]
struct Extremes {
    /// Name of the column in the log.
    name: String,
    /// Unit of the values.
    unit: &'static str,
    /// Smallest value at each point.
    #[schemars(with = "Vec<Option<f64>>")]
    min: Vec<f64>,
    /// Largest value at each point.
    #[schemars(with = "Vec<Option<f64>>")]
    max: Vec<f64>,
}

/// Part of the time range that becomes one point of the chart. The times of its first and last log row are in
/// nanoseconds.
#[derive(Clone, Copy)]
struct Stretch {
    first: u64,
    last: u64,
}

const EMPTY: Stretch = Stretch { first: u64::MAX, last: 0 };

/// Histogram of the times between two consecutive log rows, in nanoseconds. Each class of the histogram is a power of
/// two.
struct Distances([u64; 64]);

impl Distances {
    fn note(&mut self, distance: u64) {
        let power = 63 - distance.max(1).leading_zeros();
        self.0[power as usize] += 1;
    }

    /// Returns the limit, in nanoseconds, above which the time between two consecutive log rows is a gap. Nine in ten
    /// of the measured times are at most a quarter of this limit.
    fn gap(&self) -> u64 {
        let most = self.0.iter().sum::<u64>() * 9 / 10;
        let mut seen = 0;
        let usual = self.0.iter().position(|count| {
            seen += count;
            seen > most
        });
        usual.map_or(u64::MAX, |power| {
            1_u64.checked_shl(u32::try_from(power).unwrap_or(64) + 3).unwrap_or(u64::MAX)
        })
    }
}

/// Reads the values in the time range, and reduces them to at most `points` points. `continues` is called for each row.
/// If `continues` returns `false`, reading ends with an error.
///
/// # Errors
/// A log cannot be read, or `continues` has returned `false`.
pub(super) fn course(
    logs: &[PathBuf],
    question: &Question,
    points: usize,
    continues: &dyn Fn() -> bool,
) -> io::Result<Course> {
    let (from, to) = (question.from.as_nanos(), question.to.as_nanos());
    let span = u128::from((to - from).max(1));
    let mut stretches = vec![EMPTY; points];
    let mut extremes = vec![vec![(f64::NAN, f64::NAN); points]; question.columns.len()];
    let (mut count, mut distances) = (0, Distances([0; 64]));
    let mut values = vec![None; question.columns.len()];
    for log in logs {
        let mut before = None;
        each_row(log, question, continues, |at, row, places| {
            let at = at.as_nanos();
            let place = u128::from(at - from) * (points as u128) / span;
            let place = usize::try_from(place).unwrap_or(usize::MAX).min(points - 1);
            count += 1;
            before.into_iter().for_each(|before| distances.note(at.saturating_sub(before)));
            before = Some(at);
            let stretch = &mut stretches[place];
            (stretch.first, stretch.last) = (stretch.first.min(at), stretch.last.max(at));
            row.numbers(places, &mut values);
            for (value, extremes) in values.iter().zip(&mut extremes) {
                // `min` and `max` ignore NaN.
                let (low, high) = extremes[place];
                extremes[place] = value.map_or((low, high), |value| (low.min(value), high.max(value)));
            }
        })?;
    }
    let gap = distances.gap().max(2 * u64::try_from(span / points as u128).unwrap_or(u64::MAX));
    Ok(drawn(question, &stretches, &extremes, gap, count))
}

fn drawn(
    question: &Question,
    stretches: &[Stretch],
    extremes: &[Vec<(f64, f64)>],
    gap: u64,
    rows: u64,
) -> Course {
    let seconds = |nanos: u64| Moment::from_nanos(nanos).as_secs_f64();
    let mut course = Course {
        time: Vec::new(),
        columns: (question.columns.iter())
            .map(|Column { name, unit }| Extremes {
                name: name.clone(),
                unit,
                min: Vec::new(),
                max: Vec::new(),
            })
            .collect(),
        rows,
    };
    let mut before: Option<u64> = None;
    for (place, stretch) in stretches.iter().enumerate().filter(|(_, stretch)| stretch.first <= stretch.last)
    {
        if let Some(last) = before.filter(|last| stretch.first.saturating_sub(*last) > gap) {
            course.time.push(seconds(last + (stretch.first - last) / 2));
            course.columns.iter_mut().for_each(|column| column.push((f64::NAN, f64::NAN)));
        }
        before = Some(stretch.last);
        course.time.push(seconds(stretch.first + (stretch.last - stretch.first) / 2));
        for (column, extremes) in course.columns.iter_mut().zip(extremes) {
            column.push(extremes[place]);
        }
    }
    course
}

impl Extremes {
    fn push(&mut self, (min, max): (f64, f64)) {
        self.min.push(min);
        self.max.push(max);
    }
}

/// Passes the rows in the time range to `take`, as CSV in pieces, until `take` returns `false`.
///
/// # Errors
/// A log cannot be read.
pub(super) fn download(
    logs: &[PathBuf],
    question: &Question,
    take: &mut dyn FnMut(Vec<u8>) -> bool,
) -> io::Result<()> {
    const PIECE: usize = 64 * 1024;
    let mut logs: Vec<(Moment, &PathBuf)> =
        logs.iter().filter_map(|log| Some((rows(log, question.from)?.1.next()?.at()?, log))).collect();
    logs.sort();
    let names: Vec<&str> = question.columns.iter().map(|column| column.name.as_str()).collect();
    let mut piece = format!("time,{}\n", names.join(",")).into_bytes();
    let is_wanted = std::cell::Cell::new(true);
    for (_, log) in logs {
        each_row(log, question, &|| is_wanted.get(), |_, row, places| {
            row.write(places, &mut piece);
            if piece.len() >= PIECE {
                is_wanted.set(take(std::mem::take(&mut piece)));
            }
        })?;
    }
    if is_wanted.get() {
        take(piece);
    }
    Ok(())
}

/// Calls `each` for every complete log row in the time range, with the indices of the requested columns.
fn each_row(
    log: &Path,
    question: &Question,
    continues: &dyn Fn() -> bool,
    mut each: impl FnMut(Moment, &Row, &[Option<usize>]),
) -> io::Result<()> {
    // A log that was deleted meanwhile is skipped.
    let Some((header, rows)) = rows(log, question.from) else { return Ok(()) };
    let place = |column: &Column| header.iter().position(|name| *name == column.name);
    let places: Vec<Option<usize>> = question.columns.iter().map(place).collect();
    let step = |row: Row| {
        let Some(at) = row.at().filter(|at| *at >= question.from) else { return ControlFlow::Continue(()) };
        if at > question.to {
            return ControlFlow::Break(Ok(()));
        }
        if !continues() {
            return ControlFlow::Break(Err(io::ErrorKind::Interrupted.into()));
        }
        // The last row may be incomplete.
        if row.len() == header.len() {
            each(at, &row, &places);
        }
        ControlFlow::Continue(())
    };
    let mut rows = rows;
    match rows.try_for_each(step) {
        ControlFlow::Break(ended) => ended,
        ControlFlow::Continue(()) => Ok(()),
    }
}
