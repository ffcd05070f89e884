//! One column over a run, as means of each minute: a probe's noise is no drift.

use crate::dataset::Run;
use crate::statistics::{count, range};

const HOUR: f64 = 3600.0;
/// A log of an hour in minute rows ends one row before the hour does.
const NEARLY: f64 = 90.0;
/// What begin and end are the mean over.
const EDGE: f64 = 180.0;

/// Minutes in which there is a value: seconds since the run's first row, and means.
#[derive(Clone, Debug, Default)]
pub(super) struct Minutes {
    pub(super) seconds: Vec<f64>,
    pub(super) values: Vec<f64>,
}

impl Minutes {
    pub(super) fn of(run: &Run, column: usize) -> Minutes {
        let mut made = Minutes::default();
        let mut open: Option<(f64, f64, f64, f64)> = None;
        let mut close = |(_, seconds, sum, rows): (f64, f64, f64, f64)| {
            made.seconds.push(seconds / rows);
            made.values.push(sum / rows);
        };
        for (second, value) in run.seconds().zip(&run.values[column]).filter(|(_, value)| value.is_finite()) {
            let minute = (second / 60.0).floor();
            open = match open {
                Some((same, seconds, sum, rows)) if minute <= same => {
                    Some((same, seconds + second, sum + value, rows + 1.0))
                }
                before => {
                    before.into_iter().for_each(&mut close);
                    Some((minute, second, *value, 1.0))
                }
            };
        }
        open.into_iter().for_each(close);
        made
    }

    /// Mean time and value of the first minutes.
    pub(super) fn begin(&self) -> (f64, f64) {
        let first = self.seconds.first().copied().unwrap_or_default();
        self.mean(|second| second < first + EDGE)
    }

    /// Mean time and value of the last minutes.
    pub(super) fn end(&self) -> (f64, f64) {
        let last = self.seconds.last().copied().unwrap_or_default();
        self.mean(|second| second > last - EDGE)
    }

    fn mean(&self, within: impl Fn(f64) -> bool) -> (f64, f64) {
        let inside = self.seconds.iter().zip(&self.values).filter(|(second, _)| within(**second));
        let (seconds, sum, rows) = inside
            .fold((0.0, 0.0, 0_usize), |(seconds, sum, rows), (second, value)| {
                (seconds + second, sum + value, rows + 1)
            });
        let rows = count(rows).max(1.0);
        (seconds / rows, sum / rows)
    }

    fn lasts_an_hour(&self) -> bool {
        match (self.seconds.first(), self.seconds.last()) {
            (Some(first), Some(last)) => last - first >= HOUR - NEARLY,
            _ => false,
        }
    }

    fn range_within(&self, from: f64, to: f64) -> f64 {
        let inside =
            self.seconds.iter().zip(&self.values).filter(|(second, _)| (from..=to).contains(*second));
        range(&inside.map(|(_, value)| *value).collect::<Vec<f64>>())
    }

    pub(super) fn first_hour(&self) -> Option<f64> {
        let first = self.seconds.first().filter(|_| self.lasts_an_hour())?;
        Some(self.range_within(*first, first + HOUR))
    }

    pub(super) fn last_hour(&self) -> Option<f64> {
        let last = self.seconds.last().filter(|_| self.lasts_an_hour())?;
        Some(self.range_within(last - HOUR, *last))
    }

    /// The hour with the largest range: where it begins, s, and the range. The first of equals.
    pub(super) fn largest_hour(&self) -> Option<(f64, f64)> {
        let mut largest: Option<(f64, f64)> = None;
        for (place, from) in self.seconds.iter().enumerate().filter(|_| self.lasts_an_hour()) {
            let after = self.seconds[place..].partition_point(|second| second - from <= HOUR);
            let range = range(&self.values[place..place + after]);
            if largest.is_none_or(|(_, most)| range > most) {
                largest = Some((*from, range));
            }
        }
        largest
    }

    /// From the value at or after `from` to the last at or before `to`.
    pub(super) fn change(&self, from: f64, to: f64) -> Option<f64> {
        // A minute's mean stands in its middle.
        let begin = self.seconds.partition_point(|second| *second < from - 1e-6);
        let end = self.seconds.partition_point(|second| *second <= to + 1e-6);
        (end > begin).then(|| self.values[end - 1] - self.values[begin])
    }
}
