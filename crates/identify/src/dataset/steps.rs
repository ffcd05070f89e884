//! Check of times that are numbers without a unit. The steps between successive times show whether they may be
//! milliseconds, which must not be read as seconds.

use super::BadLog;
use isotherm_core::quantity::{Moment, TimeColumns, TimeUnit};
use isotherm_profile::safe_file::quoted;

/// Maximum number of rows from whose steps the unit is checked.
pub(super) const COMPARED: usize = 1000;
/// Smallest number that is read as a date, s since 1970. It is at the start of 1980.
const FIRST_DATE: f64 = 315_532_800.0;
/// Limit of the step between two rows, s. If a larger step were in seconds, the rows would be more than two
/// hours apart.
const HOURS: f64 = 7200.0;
/// Steps that loggers often use, s. A log in milliseconds with about one row per second has steps of a similar size.
const USUAL: [f64; 3] = [1200.0, 1800.0, 3600.0];
/// Minimum number of rows of a log that a logger must have written. A person does not write so many rows by hand.
const OF_LOGGER: usize = 100;

/// Returns whether a time that is a number counts from the start of the log. If not, it is a date.
pub(super) fn is_count(time: Moment) -> bool {
    time.since(Moment::default()).as_secs_f64() < FIRST_DATE
}

/// Returns the usual step between times without a unit if the times may be milliseconds; `None` if they are seconds.
/// They may be milliseconds in three cases: the step is more than two hours, all steps are multiples of 1000, or the
/// step of a logger is above 950 and not usual.
fn step_in_question(times: &[f64]) -> Option<f64> {
    if times.len() < 3 || times[0] >= FIRST_DATE {
        return None;
    }
    let mut steps: Vec<f64> =
        times.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let usual = *steps.get(steps.len() / 2)?;
    let is_thousands = |step: &f64| (step / 1000.0 - (step / 1000.0).round()).abs() < 1e-9;
    let is_usual = USUAL.iter().any(|known| (usual - known).abs() < 0.01 * known);
    let is_of_logger = times.len() >= OF_LOGGER && usual > 950.0 && !is_usual;
    (usual > HOURS || (steps.len() > 1 && steps.iter().all(is_thousands)) || is_of_logger).then_some(usual)
}

/// Returns a question to the operator about the unit of these times; `None` if they are certainly seconds. Times
/// without a unit are read as seconds.
pub(super) fn question(name: &str, times: &[f64]) -> Option<String> {
    let step = step_in_question(times)?;
    Some(format!(
        "if column {} is in seconds, the rows are {step} s apart: state the unit of the times with \
         --time-unit s, ms or min",
        quoted(name)
    ))
}

/// Checks the times in the first rows of a log. `names` contains the column names with their units, and `rows` the
/// cells as texts.
///
/// # Errors
/// The unit of the times is not certain, so the operator must state it.
pub(super) fn check(
    place: &str,
    (names, rows): (&[String], &[Vec<String>]),
    time_unit: Option<TimeUnit>,
) -> Result<(), BadLog> {
    let Some(columns) = TimeColumns::find(names, time_unit) else { return Ok(()) };
    let time = |cells: &Vec<String>| cells.get(columns.time)?.replace(',', ".").parse::<f64>().ok();
    let times: Vec<f64> = rows.iter().take(COMPARED).map_while(time).collect();
    let first = times.first().map(f64::to_string).unwrap_or_default();
    let name = &names[columns.time];
    if columns.is_stated || columns.unit_of(name, &first) != TimeUnit::Seconds {
        return Ok(());
    }
    match question(name, &times) {
        Some(why) => Err(BadLog(vec![format!("{place}: {why}")])),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_may_be_milliseconds_are_in_question() {
        let every = |step: f64, rows: u32| (0..rows).map(|row| step * f64::from(row)).collect::<Vec<f64>>();
        for (step, rows) in
            [(1000.0, 3), (2000.0, 300), (5000.0, 4), (10_000.0, 300), (60_000.0, 300), (86_400.0, 10)]
        {
            assert_eq!(step_in_question(&every(step, rows)), Some(step), "{step}");
        }
        for (step, rows) in [
            (1.0, 300),
            (10.0, 300),
            (60.0, 300),
            (100.0, 300),
            (300.0, 300),
            (900.0, 300),
            (1800.0, 300),
            (3600.0, 300),
            (7200.0, 5),
            (60_000.0, 2),
        ] {
            assert_eq!(step_in_question(&every(step, rows)), None, "{step}");
        }
        let uneven: Vec<f64> =
            (0..300u32).map(|row| 1000.0 * f64::from(row) + f64::from(row * 7 % 5)).collect();
        assert!(step_in_question(&uneven).is_some(), "a logger is late by some milliseconds");
        let by_hand = [0.0, 1500.0, 4000.0, 9100.0];
        assert_eq!(step_in_question(&by_hand), None);
        let dates: Vec<f64> = every(86_400.0, 10).iter().map(|time| 1_767_592_800.0 + time).collect();
        assert_eq!(step_in_question(&dates), None);
        assert_eq!(step_in_question(&[5.0; 10]), None);
    }
}
