//! Finds the periods in which the reading of a sensor was constant, and how each period ends.
//!
//! The reading is constant at thermal equilibrium, but also if the sensor is frozen. The end of the constant period
//! distinguishes the two. The next reading of a good sensor differs by one or two counts (smallest steps). The next
//! reading of a frozen sensor differs by the whole change that the sensor missed.

use crate::dataset::Run;
use crate::statistics::median;

/// Minimum duration of a period of constant readings, s.
const LEAST: f64 = 180.0;
/// Maximum time between two readings that count as consecutive, as a multiple of the median time between readings.
const FOLLOWS: f64 = 2.0;
/// Longest time over which one log row may be averaged, s. Such a mean may contain readings from before and after a
/// step. A part of the step is then only visible in the next row.
const MEAN: f64 = 60.0;

/// Period of at least three minutes with constant readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Standstill {
    /// First log row with the constant value.
    pub(crate) first: usize,
    /// Last log row with the constant value.
    pub(crate) last: usize,
    /// Time of the first row, s since the run's first row.
    pub(crate) from: f64,
    /// Time of the last row, s since the run's first row.
    pub(crate) to: f64,
    /// Event that follows the constant readings.
    pub(crate) end: End,
}

/// Event that follows a period of constant readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum End {
    /// The next reading has another value.
    Step {
        /// Log row of the next reading, which differs from the constant value.
        row: usize,
        /// Absolute difference between the next reading and the constant value, °C.
        size: f64,
    },
    /// The next readings are missing, so the end is unknown.
    Gap,
    /// The run has no later reading.
    OfRun,
}

/// Log rows of one sensor in a run that have a reading, with their times.
struct Readings {
    /// Time of each row, s since the run's first row.
    seconds: Vec<f64>,
    /// Log rows in which the sensor has a reading.
    good: Vec<usize>,
    /// Maximum time between two readings that count as consecutive, s.
    apart: f64,
}

impl Readings {
    fn of(run: &Run, column: usize) -> Readings {
        let seconds: Vec<f64> = run.seconds().collect();
        let values = run.values[column].to_vec();
        let good: Vec<usize> = (0..values.len()).filter(|row| values[*row].is_finite()).collect();
        let steps = good.windows(2).map(|pair| seconds[pair[1]] - seconds[pair[0]]);
        let apart = FOLLOWS * median(steps.collect());
        Readings { seconds, good, apart }
    }
}

/// Returns every period of constant readings in a log column, in order of time. Missing readings do not end a period.
pub(crate) fn standstills(run: &Run, column: usize) -> Vec<Standstill> {
    let Readings { seconds, good, apart } = Readings::of(run, column);
    let values = run.values[column].to_vec();
    let is_same = |one: &usize, other: &usize| values[*one].to_bits() == values[*other].to_bits();
    let (mut found, mut place) = (Vec::new(), 0);
    for stretch in good.chunk_by(is_same) {
        place += stretch.len();
        let (Some(&first), Some(&last)) = (stretch.first(), stretch.last()) else { continue };
        let (from, to) = (seconds[first], seconds[last]);
        if to - from < LEAST {
            continue;
        }
        let end = match good.get(place) {
            None => End::OfRun,
            Some(&row) if seconds[row] - to <= apart => {
                End::Step { row, size: (values[row] - values[last]).abs() }
            }
            Some(_) => End::Gap,
        };
        found.push(Standstill { first, last, from, to, end });
    }
    found
}

/// Returns the largest step between two consecutive readings in a log column; 0 if there is no step. Steps near the
/// ends of constant readings are ignored, because they may result from a freeze.
pub(crate) fn largest_step(run: &Run, column: usize) -> f64 {
    let Readings { seconds, good, apart } = Readings::of(run, column);
    let values = run.values[column].to_vec();
    let ends: Vec<f64> = standstills(run, column).iter().map(|still| still.to).collect();
    let is_at_an_end = |second: f64| {
        let before = ends.partition_point(|end| *end <= second);
        before.checked_sub(1).is_some_and(|place| second - ends[place] <= MEAN)
    };
    let mut largest = 0.0;
    for pair in good.windows(2) {
        let (from, to) = (seconds[pair[0]], seconds[pair[1]]);
        if to - from <= apart && !is_at_an_end(from) {
            largest = f64::max(largest, (values[pair[1]] - values[pair[0]]).abs());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::dataset::Origin;
    use isotherm_core::quantity::Moment;

    /// Run with one row per minute.
    fn run(values: &[f64]) -> Run {
        let minutes = 0..values.len() as u64;
        let times = minutes.map(|minute| Moment::from_nanos(minute * 60_000_000_000)).collect();
        Run {
            name: "day".to_owned(),
            file: PathBuf::from("day.csv"),
            times,
            values: vec![values.to_vec().into()],
            origin: Origin::default(),
        }
    }

    fn ends(values: &[f64]) -> Vec<(usize, usize, End)> {
        standstills(&run(values), 0).iter().map(|still| (still.first, still.last, still.end)).collect()
    }

    #[test]
    fn a_standstill_ends_by_the_step_to_the_reading_that_follows() {
        let found = ends(&[20.0, 21.0, 21.0, 21.0, 21.0, 23.5, 23.6]);
        assert_eq!(found, [(1, 4, End::Step { row: 5, size: 2.5 })]);
        assert_eq!(ends(&[20.0, 21.0, 21.0, 21.0, 22.0]), [], "two minutes are none");
    }

    #[test]
    fn what_a_sensor_does_by_itself_is_its_largest_step_away_from_standstills() {
        let values = [20.0, 20.5, 21.5, 21.5, 21.5, 21.5, 24.0, 26.0, 26.75, 26.5];
        assert!((largest_step(&run(&values), 0) - 1.0).abs() < 1e-12, "24 and 26 are a thaw within a mean");
        assert!(largest_step(&run(&[21.0; 9]), 0).abs() < 1e-12);
    }

    #[test]
    fn a_sensor_that_is_dead_to_the_end_has_no_step() {
        assert_eq!(ends(&[20.0, 21.0, 21.0, 21.0, 21.0]), [(1, 4, End::OfRun)]);
        let missing = [20.0, 21.0, 21.0, 21.0, 21.0, f64::NAN, f64::NAN];
        assert_eq!(ends(&missing), [(1, 4, End::OfRun)]);
    }

    #[test]
    fn missing_readings_do_not_end_a_standstill_and_hide_how_it_ends() {
        let within = [20.0, 21.0, 21.0, f64::NAN, 21.0, 21.0, 25.0];
        assert_eq!(ends(&within), [(1, 5, End::Step { row: 6, size: 4.0 })]);
        let after = [20.0, 21.0, 21.0, 21.0, 21.0, f64::NAN, f64::NAN, 25.0];
        assert_eq!(ends(&after), [(1, 4, End::Gap)]);
    }
}
