//! The terms as a log that `identify` takes.

use std::fmt::Write;
use std::time::Duration;

use super::{DIRECTIONS, Found, Terms, one};
use crate::dataset::{BadLog, Dataset};
use isotherm_core::quantity::Moment;

/// A round whose nearest recorded row is farther away has no temperatures.
const NEAR: Duration = Duration::from_secs(600);

/// CSV: `time` in seconds; the columns of `recorded`, row by row, where there is one; then the terms, in the row that is
/// nearest to each round and empty in the others. The terms are d (`d_x_um` …), k or A (`k_z_um_per_mm`, `a_x_um_per_mm` …)
/// and B (`b_x_um_per_mm` …); `x_error_um` … = −d and `x_slope_error_um_per_mm` … = −k or −A are the errors of the machine,
/// to which a model is identified.
///
/// # Errors
/// A round lies outside what was recorded.
pub fn log(terms: &Terms, recorded: Option<&Dataset>) -> Result<String, BadLog> {
    let spindle = terms.rounds.iter().any(|round| round.spindle_um_per_mm.is_some());
    let names = names(terms, spindle);
    let mut text = String::new();
    let Some(recorded) = recorded else {
        // Writing to a string never fails.
        let _ = writeln!(text, "time,{}", names.join(","));
        for round in &terms.rounds {
            let _ = writeln!(text, "{},{}", seconds(round.time), cells(terms, round, spindle));
        }
        return Ok(text);
    };
    let [run] = recorded.runs.as_slice() else {
        return Err(one("what was recorded is one run: give the one log that was running meanwhile"));
    };
    let mut at = Vec::new();
    for round in &terms.rounds {
        let apart = |time: &Moment| time.since(round.time).max(round.time.since(*time));
        let nearest = (0..run.times.len()).min_by_key(|row| apart(&run.times[*row]));
        match nearest.filter(|row| apart(&run.times[*row]) <= NEAR) {
            Some(row) => at.push(row),
            None => {
                return Err(one(&format!(
                    "no row of {} is within ten minutes of the round at {:.2} h: both files need the same clock, and \
                     the log must run from the cold round to the last",
                    run.file.display(),
                    round.hours
                )));
            }
        }
    }
    let kept = |name: &String| !names.contains(name);
    let columns: Vec<usize> =
        (0..recorded.columns.len()).filter(|column| kept(&recorded.columns[*column].name)).collect();
    let own: String = columns.iter().map(|column| format!("{},", recorded.columns[*column].name)).collect();
    let _ = writeln!(text, "time,{own}{}", names.join(","));
    let nothing = ",".repeat(names.len().saturating_sub(1));
    for (row, time) in run.times.iter().enumerate() {
        let own: String =
            columns.iter().map(|column| format!("{},", cell(run.values[*column][row]))).collect();
        let round = at.iter().position(|place| *place == row).map(|place| &terms.rounds[place]);
        let found = round.map_or_else(|| nothing.clone(), |round| cells(terms, round, spindle));
        let _ = writeln!(text, "{},{own}{found}", seconds(*time));
    }
    Ok(text)
}

fn names(terms: &Terms, spindle: bool) -> Vec<String> {
    let slope = |place: usize| if place == terms.along { "k" } else { "a" };
    let mut names: Vec<String> = DIRECTIONS.iter().map(|axis| format!("d_{axis}_um")).collect();
    names.extend((0..3).map(|place| format!("{}_{}_um_per_mm", slope(place), DIRECTIONS[place])));
    if spindle {
        names.extend(across(terms).map(|place| format!("b_{}_um_per_mm", DIRECTIONS[place])));
    }
    names.extend(DIRECTIONS.iter().map(|axis| format!("{axis}_error_um")));
    names.extend(DIRECTIONS.iter().map(|axis| format!("{axis}_slope_error_um_per_mm")));
    names.push("fit_rms_um".to_owned());
    names
}

fn cells(terms: &Terms, round: &Found, spindle: bool) -> String {
    let mut values: Vec<f64> = round.drift_um.iter().chain(&round.slope_um_per_mm).copied().collect();
    if spindle {
        let tilts = round.spindle_um_per_mm.unwrap_or([f64::NAN; 3]);
        values.extend(across(terms).map(|place| tilts[place]));
    }
    // 0 − x: a cold zero has no sign.
    values.extend(round.drift_um.iter().chain(&round.slope_um_per_mm).map(|value| 0.0 - value));
    values.push(round.rms_um);
    values.into_iter().map(cell).collect::<Vec<String>>().join(",")
}

fn across(terms: &Terms) -> impl Iterator<Item = usize> {
    let along = terms.along;
    (0..3).filter(move |place| *place != along)
}

fn cell(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}

/// Seconds, exact to the nanosecond.
fn seconds(time: Moment) -> String {
    let nanos = time.as_nanos();
    let text = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
