//! What was: the gateway's own logs of decisions, read in the background and bounded, whatever their size.
//!
//! For a chart a span is cut into as many stretches as there are points; of each its smallest and its largest value are
//! kept, so that no peak is lost. For a download the rows are handed on as they stand.

mod rows;
#[cfg(test)]
mod tests;

use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use serde::Serialize;

use isotherm_core::quantity::Moment;
use rows::{Row, rows};

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Question {
    pub(super) from: Moment,
    pub(super) to: Moment,
    pub(super) columns: Vec<Column>,
}

/// A column of the logs, with the unit of its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) unit: &'static str,
}

/// The course of some columns.
#[derive(Debug, Serialize)]
pub(super) struct Course {
    /// Seconds since 1970; between rows that lie far apart stands one at which every column is null.
    time: Vec<f64>,
    columns: Vec<Extremes>,
    /// So many rows were found.
    rows: u64,
}

/// The smallest and the largest value at each time; null where there is none.
#[derive(Debug, Serialize)]
struct Extremes {
    name: String,
    unit: &'static str,
    min: Vec<f64>,
    max: Vec<f64>,
}

/// One stretch of the span: when its first and last row were, in nanoseconds.
#[derive(Clone, Copy)]
struct Stretch {
    first: u64,
    last: u64,
}

const EMPTY: Stretch = Stretch { first: u64::MAX, last: 0 };

/// How often rows lay so many powers of two of nanoseconds apart.
struct Distances([u64; 64]);

impl Distances {
    fn note(&mut self, distance: u64) {
        let power = 63 - distance.max(1).leading_zeros();
        self.0[power as usize] += 1;
    }

    /// Rows further apart than this have a gap between them: much further than nine in ten of them.
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

/// The course of what is asked for, in at most so many points. `goes_on` is asked at each row.
///
/// # Errors
/// A log cannot be read.
pub(super) fn course(
    logs: &[PathBuf],
    question: &Question,
    points: usize,
    goes_on: &dyn Fn() -> bool,
) -> io::Result<Course> {
    let (from, to) = (question.from.as_nanos(), question.to.as_nanos());
    let span = u128::from((to - from).max(1));
    let mut stretches = vec![EMPTY; points];
    let mut extremes = vec![vec![(f64::NAN, f64::NAN); points]; question.columns.len()];
    let (mut count, mut distances) = (0, Distances([0; 64]));
    let mut values = vec![None; question.columns.len()];
    for log in logs {
        let mut before = None;
        each_row(log, question, goes_on, |at, row, places| {
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
                // The other one where one is not a number.
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

/// Hands on the rows of what is asked for as CSV, in pieces, until `take` wants no more.
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

/// Each whole row in the span, with the places of the columns in it.
fn each_row(
    log: &Path,
    question: &Question,
    goes_on: &dyn Fn() -> bool,
    mut each: impl FnMut(Moment, &Row, &[Option<usize>]),
) -> io::Result<()> {
    // One that was deleted meanwhile is past.
    let Some((header, rows)) = rows(log, question.from) else { return Ok(()) };
    let place = |column: &Column| header.iter().position(|name| *name == column.name);
    let places: Vec<Option<usize>> = question.columns.iter().map(place).collect();
    let step = |row: Row| {
        let Some(at) = row.at().filter(|at| *at >= question.from) else { return ControlFlow::Continue(()) };
        if at > question.to {
            return ControlFlow::Break(Ok(()));
        }
        if !goes_on() {
            return ControlFlow::Break(Err(io::ErrorKind::Interrupted.into()));
        }
        // The last one may be half written.
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
