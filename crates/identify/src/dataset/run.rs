//! One run (a warm-up of the machine) as log columns of numbers.

use std::path::PathBuf;
use std::time::Duration;

use crate::statistics::range;
use isotherm_core::quantity::Moment;

/// One warm-up of the machine, with the log rows from the cold machine to the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Name of the file without extension. If the file was split, a number or the value of the splitting column
    /// follows.
    pub name: String,
    /// File of the run.
    pub file: PathBuf,
    /// Times of the log rows, ascending.
    pub times: Vec<Moment>,
    /// Values by log column and row; NaN if missing.
    pub values: Vec<Vec<f64>>,
}

impl Run {
    /// Returns the time of each row, in hours since the first row of the run.
    pub(crate) fn hours(&self) -> impl Iterator<Item = f64> + '_ {
        self.seconds().map(|second| second / 3600.0)
    }

    /// Returns the time of each row, in seconds since the first row of the run.
    pub fn seconds(&self) -> impl Iterator<Item = f64> + '_ {
        let first = self.times.first().copied().unwrap_or_default();
        self.times.iter().map(move |time| time.since(first).as_secs_f64())
    }

    /// Returns the range (maximum minus minimum) of a log column in this run; 0 if the column has no values.
    pub(crate) fn range(&self, column: usize) -> f64 {
        range(&self.values[column])
    }

    /// Returns the duration of the run: from its first log row to its last.
    pub fn lasts(&self) -> Duration {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => last.since(*first),
            _ => Duration::ZERO,
        }
    }
}
