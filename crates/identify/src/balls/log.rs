//! Writes the thermal terms as a log for `isotherm identify`.

use std::time::Duration;

use super::{DIRECTIONS, RoundTerms, Terms, one};
use crate::dataset::{BadLog, Dataset};
use isotherm_core::quantity::Moment;

/// Maximum time between a round of touches and the row of the recorded log to which its terms are added.
const NEAR: Duration = Duration::from_mins(10);

/// Writes a CSV log: `time` in seconds, the columns of `recorded`, then the terms. The terms of a round are in the row
/// that is nearest in time. In all other rows, these cells are empty.
///
/// The terms are d (`d_x_um` …), k or A (`k_z_um_per_mm`, `a_x_um_per_mm` …) and B (`b_x_um_per_mm` …). The errors of
/// the machine, from which a model is identified, are `x_error_um` … = −d and `x_slope_error_um_per_mm` … = −k or −A.
///
/// # Errors
/// A round has no recorded row within ten minutes, two rounds have the same nearest row, or `recorded` has more than one
/// run.
pub fn log(terms: &Terms, recorded: Option<&Dataset>) -> Result<String, BadLog> {
    let columns: Vec<Vec<(String, f64)>> = terms.rounds.iter().map(|round| columns(terms, round)).collect();
    let names: Vec<&str> = columns.iter().take(1).flatten().map(|(name, _)| name.as_str()).collect();
    let (own, rows) = match recorded {
        Some(recorded) => beside(terms, recorded, &names)?,
        None => {
            let rounds = terms.rounds.iter().enumerate();
            (Vec::new(), rounds.map(|(place, round)| (round.time, Vec::new(), Some(place))).collect())
        }
    };
    let mut table = csv::Writer::from_writer(Vec::new());
    let failed = |why: csv::Error| one(&why.to_string());
    table.write_record(["time"].iter().chain(&own).chain(&names)).map_err(failed)?;
    for (time, mut cells, round) in rows {
        let of_round = |place: usize| round.map_or(f64::NAN, |round| columns[round][place].1);
        cells.extend((0..names.len()).map(of_round));
        let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
        table.write_record([seconds(time)].into_iter().chain(cells.into_iter().map(cell))).map_err(failed)?;
    }
    let text = table.into_inner().map_err(|why| one(&why.to_string()))?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}

/// Row of the log: time, recorded cells, and the index of the round in this row; `None` if the row has no round.
type Row = (Moment, Vec<f64>, Option<usize>);

/// Returns the column names and the rows of a recorded log, without the columns in `names`. The row that is nearest in
/// time to a round also contains the index of that round.
fn beside<'a>(
    terms: &Terms,
    recorded: &'a Dataset,
    names: &[&str],
) -> Result<(Vec<&'a str>, Vec<Row>), BadLog> {
    let [run] = recorded.runs.as_slice() else {
        return Err(one(
            "the log after --recorded must contain exactly one run: name the log that was recorded during \
             the rounds",
        ));
    };
    let mut at: Vec<usize> = Vec::new();
    for round in &terms.rounds {
        let apart = |row: &usize| run.times[*row].since(round.time).max(round.time.since(run.times[*row]));
        let nearest = (0..run.times.len()).min_by_key(apart).filter(|row| apart(row) <= NEAR);
        let row = nearest.ok_or_else(|| {
            one(&format!(
                "no row of {} is within ten minutes of the round at {:.2} h. Both files need the same clock, \
                 and the log must run from the cold round to the last",
                run.file.display(),
                round.hours
            ))
        })?;
        if let Some(other) = at.iter().position(|known| *known == row) {
            return Err(one(&format!(
                "the rounds at {:.2} h and {:.2} h have the same nearest row of {}. Each round needs its own \
                 row: record at least one row for each round, or leave out the touches of one of them",
                terms.rounds[other].hours,
                round.hours,
                run.file.display()
            )));
        }
        at.push(row);
    }
    let own =
        recorded.columns.iter().enumerate().filter(|(_, column)| !names.contains(&column.name.as_str()));
    let (places, own): (Vec<usize>, Vec<&str>) =
        own.map(|(place, column)| (place, column.name.as_str())).unzip();
    let row = |(row, time): (usize, &Moment)| {
        let cells = places.iter().map(|column| run.values[*column].at(row)).collect();
        (*time, cells, at.iter().position(|place| *place == row))
    };
    Ok((own, run.times.iter().enumerate().map(row).collect()))
}

/// Returns the names and values of the thermal terms of a round.
fn columns(terms: &Terms, round: &RoundTerms) -> Vec<(String, f64)> {
    let each = |name: fn(&str, bool) -> String, values: [f64; 3]| {
        (0..3).map(move |place| (name(DIRECTIONS[place], place == terms.along), values[place]))
    };
    let slope = |axis: &str, is_along: bool| format!("{}_{axis}_um_per_mm", if is_along { "k" } else { "a" });
    let has_spindle = terms.rounds.iter().any(|round| round.spindle_um_per_mm.is_some());
    let spindle = round.spindle_um_per_mm.unwrap_or([f64::NAN; 3]);
    let across = each(|axis, _| format!("b_{axis}_um_per_mm"), spindle);
    // `0 − x` avoids a negative zero in the cold round.
    let minus = |values: [f64; 3]| values.map(|value| 0.0 - value);
    each(|axis, _| format!("d_{axis}_um"), round.drift_um)
        .chain(each(slope, round.slope_um_per_mm))
        .chain(
            across
                .enumerate()
                .filter(|(place, _)| has_spindle && *place != terms.along)
                .map(|(_, cell)| cell),
        )
        .chain(each(|axis, _| format!("{axis}_error_um"), minus(round.drift_um)))
        .chain(each(|axis, _| format!("{axis}_slope_error_um_per_mm"), minus(round.slope_um_per_mm)))
        .chain([("fit_rms_um".to_owned(), round.rms_um)])
        .collect()
}

/// Formats a time in seconds, exact to the nanosecond.
fn seconds(time: Moment) -> String {
    let nanos = time.as_nanos();
    let text = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
