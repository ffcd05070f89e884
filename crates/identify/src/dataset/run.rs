//! One run: a warm-up of the machine, as log columns of numbers. Errors and rises are counted from its datum (zero
//! point). A rise is a sensor reading minus its reference value.

use std::path::PathBuf;
use std::time::Duration;

use super::Series;
use crate::statistics::range;
use isotherm_core::quantity::Moment;

/// One warm-up of the machine, with the log rows from the cold machine to the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Name of the file without extension. If the file contains several runs, a number or the value of the dividing
    /// column follows.
    pub name: String,
    /// Path of the log file that contains the run.
    pub file: PathBuf,
    /// Times of the log rows, ascending.
    pub times: Vec<Moment>,
    /// Values by log column and row; NaN if missing.
    pub values: Vec<Series>,
    /// Datums (zero points) that the log of the run states, and the source of its errors and times.
    pub(crate) origin: Origin,
}

/// Datums (zero points) that the log of a run states: rows from which the errors and rises are counted. This structure
/// also states how the errors and times were recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Origin {
    /// Rows directly after a zero command, ascending, each with the axis of the command; `None` for all axes. Only logs
    /// of the gateway contain zero commands.
    pub(crate) zeros: Vec<(usize, Option<String>)>,
    /// Whether the machine was already on before the first row, according to a gateway log. In this case, the gateway
    /// captured the references during an earlier file.
    pub(crate) continues: bool,
    /// Source of the measured errors.
    pub(crate) errors: Errors,
    /// Whether the run is the last run of a record of touches. Logs that are recorded later may add touches to it.
    pub(crate) is_open: bool,
    /// Whether the times are numbers from the start of the log whose unit is not stated. They are read as seconds.
    pub(crate) is_unit_assumed: bool,
}

/// Source of the measured errors of a run: a sensor, or touches of a probe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Errors {
    /// A sensor measured the error in each row. The errors are counted from their mean while the references settle.
    #[default]
    Recorded,
    /// A probe measured the error by touches. The errors are counted from this datum.
    Touched(Datum),
}

/// Datum (zero point) of a run with touches: the row at which the error is zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Datum {
    /// The error is zero at machine start.
    Start,
    /// The error is zero at the zero command directly before this row. The rises are counted from this row, too.
    Zero(usize),
    /// The log has no datum, so the error counts as zero at the first touch at or after this row. The rises are counted
    /// from the row of that touch, too.
    Touch(usize),
}

impl Run {
    /// Creates a run whose errors were measured row by row. `values` are by log column and row.
    pub fn recorded(name: String, file: PathBuf, times: Vec<Moment>, values: Vec<Vec<f64>>) -> Run {
        let values = values.into_iter().map(Series::from).collect();
        Run { name, file, times, values, origin: Origin::default() }
    }

    /// Returns the time of each row, in hours since the first row of the run.
    pub(crate) fn hours(&self) -> impl Iterator<Item = f64> + '_ {
        self.seconds().map(|second| second / 3600.0)
    }

    /// Returns the time of each row, in seconds since the first row of the run.
    pub fn seconds(&self) -> impl Iterator<Item = f64> + '_ {
        let first = self.times.first().copied().unwrap_or_default();
        self.times.iter().map(move |time| time.since(first).as_secs_f64())
    }

    /// Returns the range (maximum minus minimum) of a log column in this run; 0 if the column has no values in the run.
    pub(crate) fn range(&self, column: usize) -> f64 {
        range(&self.values[column])
    }

    /// Returns the index of the first row that may be the datum (zero point) of the touches; `None` if the error was
    /// measured row by row.
    pub(crate) fn datum(&self) -> Option<usize> {
        match self.origin.errors {
            Errors::Recorded => None,
            Errors::Touched(Datum::Start) => Some(0),
            Errors::Touched(Datum::Zero(row) | Datum::Touch(row)) => Some(row),
        }
    }

    /// Returns whether the errors of the run are touches of a probe.
    pub(crate) fn is_touched(&self) -> bool {
        matches!(self.origin.errors, Errors::Touched(_))
    }

    /// Returns the duration of the run, from its first log row to its last log row.
    pub fn lasts(&self) -> Duration {
        match (self.times.first(), self.times.last()) {
            (Some(first), Some(last)) => last.since(*first),
            _ => Duration::ZERO,
        }
    }
}
