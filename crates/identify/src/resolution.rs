//! Resolution (count) of a sensor: the smallest step that its readings can make.
//!
//! If the raw value of a sensor is a whole number, the scale in the profile is the count. Otherwise the count is
//! estimated from plateaus. A plateau is a value that several consecutive readings have. The difference of two plateaus
//! is a whole number of counts, even if the rows of the log are means of several readings.

use crate::dataset::Dataset;
use crate::faults;
use crate::statistics::count;
use isotherm_core::codec::DataType;
use isotherm_profile::Signal;

/// Minimum number of consecutive equal readings that form a plateau. Means of a fluctuating reading are rarely equal so
/// often.
const PLATEAU: usize = 5;
/// Minimum share of the readings of a sensor that are on plateaus. From this share on, the counts of the
/// sensor are treated as coarse.
const COARSE: f64 = 0.2;
/// Number of plateaus from which the counts of a sensor are treated as coarse, even if few readings are on plateaus. A
/// fine sensor has only one plateau for each time that it froze.
const MANY: usize = 10;
/// Difference below which two readings count as equal, °C.
const SAME: f64 = 1e-6;
/// Largest count that is assumed for a temperature sensor of a machine, °C.
const MOST: f64 = 1.0;
/// Count of a typical temperature input module, °C. It is assumed for a coarse sensor whose reading never changed.
const USUAL: f64 = 0.1;

/// Returns the count of a signal in its unit. `None` if the raw value of the signal is not a whole number, or if the
/// device may change the scale.
pub(crate) fn scale(signal: &Signal) -> Option<f64> {
    if signal.scale_from.is_some() {
        return None;
    }
    match signal.encoding.data_type {
        DataType::F32 | DataType::F64 | DataType::Bool | DataType::Bit(_) | DataType::Decimal24(_) => None,
        _ => Some(signal.encoding.scale.get().abs()),
    }
}

/// Estimates the count (smallest step) of a sensor from the plateaus in its log column, in the unit of the column.
/// Returns 0 if there are too few plateaus.
pub(crate) fn estimated(dataset: &Dataset, column: usize) -> f64 {
    let (mut levels, mut still, mut all) = (Vec::new(), 0, 0);
    for run in &dataset.runs {
        let readings: Vec<f64> = run.values[column].iter().filter(|value| value.is_finite()).collect();
        all += readings.len();
        for plateau in readings.chunk_by(|one, other| one.to_bits() == other.to_bits()) {
            if plateau.len() >= PLATEAU {
                still += plateau.len();
                levels.push(plateau[0]);
            }
        }
    }
    let is_coarse = levels.len() >= MANY || count(still) >= COARSE * count(all);
    if levels.is_empty() || !is_coarse {
        return 0.0;
    }
    levels.sort_by(f64::total_cmp);
    let steps = levels.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > SAME);
    let smallest = steps.fold(f64::INFINITY, f64::min);
    if smallest.is_finite() { smallest.min(MOST) } else { USUAL }
}

/// Returns the smallest step between two successive rows of a log column, in the unit of the column; 0 if the column
/// never changes. If the rows are not means, this step is the count of the sensor.
pub(crate) fn finest_step(dataset: &Dataset, column: usize) -> f64 {
    faults::resolution(dataset, column).min(MOST)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::dataset::{Column, Kind, Origin, Run};
    use isotherm_core::quantity::Moment;

    fn dataset(values: Vec<f64>) -> Dataset {
        let minutes = 0..values.len() as u64;
        let times = minutes.map(|minute| Moment::from_nanos(minute * 60_000_000_000)).collect();
        let run = Run {
            name: "day".to_owned(),
            file: PathBuf::from("day.csv"),
            times,
            values: vec![values.into()],
            origin: Origin::default(),
        };
        let columns = vec![Column { name: "bed".to_owned(), kind: Kind::Temperature }];
        Dataset { columns, runs: vec![run], ..Dataset::default() }
    }

    fn near(one: f64, other: f64) -> bool {
        (one - other).abs() < 1e-9
    }

    #[test]
    fn means_of_a_coarse_sensor_have_the_count_of_its_plateaus() {
        // A count of 0.5 °C; on the way between two of them a mean of twelve readings has any twelfth of it.
        let mut values = Vec::new();
        for level in 0..6 {
            let level = 20.0 + 0.5 * f64::from(level);
            values.extend([level; 20]);
            values.extend([level + 0.5 / 12.0, level + 3.5 / 12.0, level + 5.0 / 12.0]);
        }
        assert!(near(estimated(&dataset(values), 0), 0.5));
    }

    #[test]
    fn many_short_plateaus_show_the_count_of_a_sensor_that_nearly_always_moves() {
        let mut values = Vec::new();
        for level in 0..MANY {
            let level = 20.0 + 0.1 * count(level);
            values.extend([level; PLATEAU]);
            values.extend((1..36).map(|part| level + 0.1 * f64::from(part) / 36.0));
        }
        assert!(near(estimated(&dataset(values), 0), 0.1));
    }

    #[test]
    fn a_fine_sensor_that_froze_once_has_no_count() {
        let mut values: Vec<f64> = (0..400).map(|row| 20.0 + 0.013 * f64::from(row)).collect();
        values.extend([25.2; 60]);
        assert!(near(estimated(&dataset(values), 0), 0.0));
    }

    #[test]
    fn a_sensor_that_never_left_its_number_has_the_usual_count() {
        assert!(near(estimated(&dataset(vec![21.0; 100]), 0), USUAL));
    }

    #[test]
    fn the_finest_step_is_that_of_the_readings_whatever_their_scale_is() {
        let sixteenths = (0..50).map(|row| 20.0 + f64::from(row / 3) / 16.0).collect();
        assert!(near(finest_step(&dataset(sixteenths), 0), 1.0 / 16.0));
        assert!(near(finest_step(&dataset(vec![21.0; 9]), 0), 0.0));
    }
}
