//! Readings of a dial gauge, which a person or another logger recorded. Each reading is added to the log row of the
//! machine that is nearest in time.

use std::path::Path;
use std::time::Duration;

use isotherm_core::quantity::{Conversion, Moment, time};

use super::formats::read_table;
use super::implausible::leave_out;
use super::table::Cells;
use super::{BadLog, Column, Dataset, Kind, Run, Split, every_column};
use isotherm_profile::duration_text;

/// Adds the readings of a dial gauge; see [`Dataset::add_gauge`].
pub(super) fn add(
    dataset: &mut Dataset,
    file: &Path,
    (error, within): (&str, Duration),
    split: &Split,
) -> Result<(), BadLog> {
    let refused = |why: String| BadLog(vec![format!("{}: {why}", file.display())]);
    if dataset.column(error).is_some() {
        let why = "already: do not use --gauge, or name another column with --error";
        return Err(refused(format!("the logs have a column {error} {why}")));
    }
    let split = Split { column: None, gap: None, ..split.clone() };
    let mut gauge = read_table(file, &split, &every_column)?;
    let columns: Vec<&str> = gauge.names_of_numbers().collect();
    let [column] = columns.as_slice() else {
        let there = if columns.is_empty() { "no column of numbers".to_owned() } else { columns.join(", ") };
        let why = "the file of a dial gauge must have two columns, time and error. Besides the time column, \
                   this file has:";
        return Err(refused(format!("{why} {there}")));
    };
    if let Some((one, other)) = overlapping(&dataset.runs) {
        return Err(refused(format!(
            "{one} and {other} overlap in time, so it is not known to which run a reading of the gauge \
             belongs. Use only one of the two logs, or logs whose times have dates"
        )));
    }
    let column = (*column).to_owned();
    let states_mm = gauge.units.get(&column).is_some_and(|unit| unit.eq_ignore_ascii_case("mm"));
    let is_in_mm = (column.ends_with("_mm") || states_mm) && !gauge.conversions.contains_key(&column);
    if is_in_mm && let Some(Cells::Numbers(values)) = gauge.cells_mut(&column) {
        values.change(|values| values.iter_mut().for_each(|value| *value *= 1000.0));
        gauge.conversions.insert(column.clone(), Conversion::Factor(1000.0));
    }
    let rows = 0..gauge.times.len();
    let (left_out, implausible) =
        leave_out(&mut gauge, std::slice::from_ref(&rows), &|_, _| Kind::Displacement);
    BadLog::unless(implausible.into_iter().map(|refusal| refusal.message).collect(), ())?;
    let mut added: Vec<Vec<f64>> = dataset.runs.iter().map(|run| vec![f64::NAN; run.times.len()]).collect();
    let (mut read, mut far) = (0, Vec::new());
    let values = gauge.numbers(&column).into_iter().flatten();
    for (place, (at, value)) in gauge.times.iter().zip(values).enumerate() {
        if !value.is_finite() {
            continue;
        }
        read += 1;
        match nearest_row(&dataset.runs, *at, within) {
            // If two readings belong to one row, the later one is used.
            Some((run, row)) => added[run][row] = value,
            None => far.push(gauge.lines.of(place)),
        }
    }
    let shown = duration_text(within);
    if far.len() == read {
        let [of_gauge, of_logs] =
            [span(&mut gauge.times.iter()), span(&mut dataset.runs.iter().flat_map(|run| &run.times))];
        return Err(refused(format!(
            "no log row is within {shown} of a reading of the gauge. The times of the gauge are {of_gauge}; \
             the times of the logs are {of_logs}. Check the time zone (--zone) and the clocks"
        )));
    }
    if let Some(first) = far.first() {
        let remark = format!(
            "{}: {} of {read} readings are left out, because no log row is within {shown}. The first of them \
             is in line {first}. --within allows a larger distance in time",
            file.display(),
            far.len()
        );
        dataset.remarks.push(remark);
    }
    dataset.remarks.extend(left_out);
    dataset.columns.push(Column { name: error.to_owned(), kind: Kind::Displacement });
    dataset.runs.iter_mut().zip(added).for_each(|(run, column)| run.values.push(column.into()));
    Ok(())
}

/// Returns the indices of the run and of its row that are nearest to the time `at`. `None` if no row is within the
/// duration `within` of that time.
fn nearest_row(runs: &[Run], at: Moment, within: Duration) -> Option<(usize, usize)> {
    let near = runs.iter().enumerate().flat_map(|(run, recorded)| {
        let times = &recorded.times;
        let next = times.partition_point(|time| *time < at);
        let away = move |row: usize| {
            let time = *times.get(row)?;
            Some((if time < at { at.since(time) } else { time.since(at) }, run, row))
        };
        [next.checked_sub(1).and_then(away), away(next)].into_iter().flatten()
    });
    near.min().filter(|(away, ..)| *away <= within).map(|(_, run, row)| (run, row))
}

/// Returns the names of the first two runs whose times overlap, for example because the times of both runs begin at
/// zero. `None` if no runs overlap.
fn overlapping(runs: &[Run]) -> Option<(&str, &str)> {
    let span = |run| {
        let Run { name, times, .. }: &Run = run;
        Some((*times.first()?, *times.last()?, name.as_str()))
    };
    let mut spans: Vec<(Moment, Moment, &str)> = runs.iter().filter_map(span).collect();
    spans.sort_unstable();
    spans.windows(2).find(|pair| pair[1].0 < pair[0].1).map(|pair| (pair[0].2, pair[1].2))
}

/// Returns the earliest and the latest of these times as text, for example `… to …`; empty if there are no times.
fn span(times: &mut dyn Iterator<Item = &Moment>) -> String {
    let text = |at: Moment| {
        let mut text = Vec::new();
        time::write(&mut text, Moment::from_nanos(at.as_nanos() / 1_000_000_000 * 1_000_000_000));
        String::from_utf8_lossy(&text).replace(".000000000", "")
    };
    let ends = times.fold(None, |ends: Option<(Moment, Moment)>, at| {
        Some(ends.map_or((*at, *at), |(first, last)| (first.min(*at), last.max(*at))))
    });
    ends.map(|(first, last)| format!("{} to {}", text(first), text(last))).unwrap_or_default()
}
