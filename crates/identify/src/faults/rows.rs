//! From the minutes in which a fault is seen to the rows that it spoils.

use crate::dataset::Run;
use crate::minutes::Minutes;
use crate::statistics::median;

/// The rows of these minutes, each from its first to before its second. A minute that is a mean of several rows has
/// rows of the fault in the minutes beside it, too.
pub(super) fn spoilt(run: &Run, own: &Minutes, spikes: &[(usize, usize)]) -> Vec<usize> {
    let beside = if step(run) < 45.0 { 60.0 } else { 0.0 };
    let minute = |place: usize| (own.seconds[place] / 60.0).floor() * 60.0;
    let spans: Vec<(f64, f64)> =
        spikes.iter().map(|(from, to)| (minute(*from) - beside, minute(*to) + beside)).collect();
    let is_inside = |second: f64| spans.iter().any(|(from, to)| (*from..*to).contains(&second));
    run.seconds().enumerate().filter(|(_, second)| is_inside(*second)).map(|(row, _)| row).collect()
}

/// The rows from the largest step of this column within two minutes of this time on.
pub(super) fn of_step(run: &Run, column: usize, at: f64) -> Vec<usize> {
    let near: Vec<(usize, f64)> = run
        .seconds()
        .zip(&run.values[column])
        .enumerate()
        .filter(|(_, (second, value))| value.is_finite() && (second - at).abs() <= 120.0)
        .map(|(row, (_, value))| (row, *value))
        .collect();
    let steps = near.windows(2).map(|pair| ((pair[1].1 - pair[0].1).abs(), pair[1].0));
    let first = steps.max_by(|one, other| one.0.total_cmp(&other.0)).map_or(0, |(_, row)| row);
    (first..run.times.len()).collect()
}

/// The rows of the minutes from the one to the other.
pub(super) fn of_span(run: &Run, from: f64, to: f64) -> Vec<usize> {
    let (from, to) = ((from / 60.0).floor() * 60.0, (to / 60.0).floor() * 60.0 + 60.0);
    let inside = run.seconds().enumerate().filter(|(_, second)| (from..to).contains(second));
    inside.map(|(row, _)| row).collect()
}

/// The usual time between two rows, s.
fn step(run: &Run) -> f64 {
    let seconds: Vec<f64> = run.seconds().collect();
    median(seconds.windows(2).map(|pair| pair[1] - pair[0]).collect())
}

/// Straight lines over what is missing; what is missing at an end has the value next to it.
pub(super) fn bridged(seconds: &[f64], values: &[f64]) -> Vec<f64> {
    let good: Vec<usize> = (0..values.len()).filter(|row| values[*row].is_finite()).collect();
    let at = |row: usize| {
        let next = good.partition_point(|other| *other < row);
        let (before, after) = (next.checked_sub(1).map(|place| good[place]), good.get(next).copied());
        match (before, after) {
            (_, Some(after)) if after == row => values[row],
            (Some(before), Some(after)) => {
                let share = (seconds[row] - seconds[before]) / (seconds[after] - seconds[before]).max(1e-9);
                values[before] + share * (values[after] - values[before])
            }
            (Some(only), None) | (None, Some(only)) => values[only],
            (None, None) => f64::NAN,
        }
    };
    (0..values.len()).map(at).collect()
}
