//! Means of one log column over each minute of a run. The averaging reduces the noise of a probe, which would
//! otherwise count as drift.

use std::ops::Range;

use crate::dataset::Run;
use crate::statistics::{mean, range};

const HOUR: f64 = 3600.0;
/// Tolerance for the duration of an hour, s. In a log of an hour with one row per minute, the last row is one minute
/// before the end of the hour.
const NEARLY: f64 = 90.0;
/// Time at the start and at the end of a run over which the values are averaged, s.
const EDGE: f64 = 180.0;

/// Mean value of a column in each minute that contains a value. Each mean has the mean time of its values, in seconds
/// since the first row of the run, ascending.
#[derive(Clone, Debug, Default)]
pub(crate) struct Minutes {
    pub(crate) seconds: Vec<f64>,
    pub(crate) values: Vec<f64>,
}

impl Minutes {
    pub(crate) fn of(run: &Run, column: usize) -> Minutes {
        let rows = run.seconds().zip(&run.values[column]);
        let (seconds, values): (Vec<f64>, Vec<f64>) = rows.filter(|(_, value)| value.is_finite()).unzip();
        let mut all = Minutes::default();
        let mut begin = 0;
        for minute in seconds.chunk_by(|one, other| (one / 60.0).floor() >= (other / 60.0).floor()) {
            all.seconds.push(mean(minute));
            all.values.push(mean(&values[begin..begin + minute.len()]));
            begin += minute.len();
        }
        all
    }

    /// Returns the range of indices of the minutes between two times in seconds. Both times are included.
    fn within(&self, from: f64, to: f64) -> Range<usize> {
        let begin = self.seconds.partition_point(|second| *second < from);
        begin..self.seconds.partition_point(|second| *second <= to).max(begin)
    }

    /// Returns the range (maximum minus minimum) of the values between two times in seconds.
    pub(crate) fn range_within(&self, from: f64, to: f64) -> f64 {
        range(&self.values[self.within(from, to)])
    }

    /// Returns the mean time in seconds and the mean value of the first three minutes.
    pub(crate) fn begin(&self) -> (f64, f64) {
        let first = self.seconds.first().copied().unwrap_or_default();
        self.mean(0..self.seconds.partition_point(|second| *second < first + EDGE))
    }

    /// Returns the mean time in seconds and the mean value of the last three minutes.
    pub(crate) fn end(&self) -> (f64, f64) {
        let last = self.seconds.last().copied().unwrap_or_default();
        self.mean(self.seconds.partition_point(|second| *second <= last - EDGE)..self.seconds.len())
    }

    fn mean(&self, inside: Range<usize>) -> (f64, f64) {
        (mean(&self.seconds[inside.clone()]), mean(&self.values[inside]))
    }

    /// Returns the times of the first and of the last minute, s; `None` if the run is shorter than an hour.
    fn hours(&self) -> Option<(f64, f64)> {
        let (first, last) = (*self.seconds.first()?, *self.seconds.last()?);
        (last - first >= HOUR - NEARLY).then_some((first, last))
    }

    /// Returns the ranges of the values in the first and in the last hour; `None` if the run is shorter than an hour.
    pub(crate) fn first_and_last_hour(&self) -> Option<(f64, f64)> {
        let (first, last) = self.hours()?;
        Some((self.range_within(first, first + HOUR), self.range_within(last - HOUR, last)))
    }

    /// Returns the start of the hour with the largest range of the values, in seconds, and that range. If several hours
    /// have the same range, returns the first of these hours. `None` if the run is shorter than an hour.
    pub(crate) fn largest_hour(&self) -> Option<(f64, f64)> {
        self.hours()?;
        let hour = |(place, from): (usize, &f64)| {
            let after = self.seconds[place..].partition_point(|second| second - from <= HOUR);
            (*from, range(&self.values[place..place + after]))
        };
        let hours = self.seconds.iter().enumerate().map(hour);
        hours.reduce(|largest, next| if next.1 > largest.1 { next } else { largest })
    }

    /// Returns the change of the value from the first value at or after `from` to the last value at or before `to`.
    /// `None` if there is no value between these times.
    pub(crate) fn change(&self, from: f64, to: f64) -> Option<f64> {
        // The time of a minute's mean is its middle.
        let inside = &self.values[self.within(from - 1e-6, to + 1e-6)];
        Some(inside.last()? - inside.first()?)
    }
}
