//! Active Cz: the compensation value that acted on the machine while a log was recorded. A log of the gateway contains
//! the Cz that the gateway decided in each row, and the register value. The measured error of a row contains the active
//! Cz, which is the register value.

use super::Series;
use super::table::{Cells, Table};
use isotherm_profile::log_columns::{
    ACTING, CZ, DRY_RUN, MEASURED, MEMORY, OF_AXIS, OF_MACHINE, SLOPE, ZERO,
};

/// Ends of the names of those columns of an axis in a gateway log that identification uses. The other columns of an
/// axis are not used.
const USED: [&str; 4] = [CZ, SLOPE, MEASURED, ACTING];

/// Returns whether the texts in this log column are needed to determine the active Cz, or the datums (zero points) of
/// the log.
pub(super) fn needs_words(column: &str) -> bool {
    column.ends_with("_permit") || is_of_machine(column)
}

/// Returns whether this log column contains the state of the machine or its zero commands, from which the datums (zero
/// points) follow. Such cells are texts, never numbers.
pub(super) fn is_of_machine(column: &str) -> bool {
    [MEMORY, ZERO].contains(&column)
}

/// Returns whether this column of a gateway log contains touches (measurements with a probe), or the Cz that acted
/// during each touch. Most of its cells are empty. `acted` contains the names of the columns with the active Cz.
pub(super) fn is_of_touches(column: &str, acted: &[String]) -> bool {
    let axis = ["_measured_um", "_acting_um"].iter().find_map(|end| column.strip_suffix(end));
    axis.is_some_and(|axis| acted.contains(&format!("{axis}_cz_um")))
}

/// Returns whether this log column is needed to determine the active Cz.
pub(super) fn needs(column: &str) -> bool {
    ["_permit", "_cz_um", "_slope_um", "_from_um"].iter().any(|end| column.ends_with(end))
}

/// Replaces the decided values of each axis by the active values in the columns `<axis>_cz_um` and, if the control
/// receives the slope, `<axis>_slope_um`. The active value of a row is the register value when the row was read.
/// `table.acted` lists these columns. In a dry run, nothing was active, so these columns are removed. Returns the names
/// of the `_permit` columns of the axes whose active value is never known.
pub(super) fn keep_what_acted(table: &mut Table) -> Vec<String> {
    let mut unknown = Vec::new();
    let axes: Vec<String> = (table.columns.iter())
        .filter_map(|(name, _)| name.strip_suffix("_permit").map(str::to_owned))
        .filter(|axis| table.numbers(&format!("{axis}_cz_um")).is_some())
        .collect();
    let was_dry = table.cells(DRY_RUN).is_some();
    for axis in &axes {
        let acted = acted(table, axis);
        if !acted.iter().any(|cz| cz.is_finite()) && !was_dry {
            unknown.push(format!("{axis}_permit"));
        }
        for (what, values) in [("cz_um", acted), ("slope_um", before(table, &format!("{axis}_slope_um")))] {
            let name = format!("{axis}_{what}");
            if was_dry {
                table.columns.retain(|(known, _)| *known != name);
            } else if let Some((_, cells)) = table.columns.iter_mut().find(|(known, _)| *known == name) {
                *cells = Cells::Numbers(values.into());
                table.acted.push(name);
            }
        }
        let unused = OF_AXIS.iter().filter(|what| !USED.contains(what));
        let unused: Vec<String> = unused.map(|what| format!("{axis}_{what}")).collect();
        table.columns.retain(|(name, _)| !unused.contains(name));
    }
    if !axes.is_empty() {
        (table.zeros, table.continues) = (zeros(table), continues(table));
        table.columns.retain(|(name, _)| !OF_MACHINE.contains(&name.as_str()));
    }
    table.columns.retain(|(name, _)| !is_of_machine(name));
    unknown
}

/// Returns for each zero command the index of the first row after the command, and the axis of the command; `None` if
/// it concerns all axes.
fn zeros(table: &Table) -> Vec<(usize, Option<String>)> {
    let Some(Cells::Text(commands)) = table.cells(ZERO) else { return Vec::new() };
    let mut zeros = Vec::new();
    for (row, commands) in commands.iter().enumerate().filter(|(_, commands)| !commands.is_empty()) {
        let axis = |command: &str| command.trim().split_once(' ').map(|(_, axis)| axis.trim().to_owned());
        zeros.extend(commands.split(';').map(|command| (row, axis(command))));
    }
    zeros
}

/// Returns whether the machine was already on before the first row, according to the recorded state. A long state is
/// truncated, but it begins with the time of the machine start. The result is also true if the log has no column with
/// that state, as in an exported log.
fn continues(table: &Table) -> bool {
    const ON: &str = "\"on_since\":";
    let states = match table.cells(MEMORY) {
        None => return true,
        Some(Cells::Text(states)) => states,
        Some(Cells::Numbers(_) | Cells::Unread(_)) => return false,
    };
    let first = states.iter().next().and_then(|state| state.split_once(ON));
    first.is_some_and(|(_, since)| !since.trim_start().starts_with("null"))
}

/// Returns the active Cz of each log row. The readings of a row are older than the decision in that row, so the
/// decision of the previous row was active. Before the gateway first wrote the register, the value found in the
/// register was active. The result is NaN in rows in which the register value was not verified.
fn acted(table: &Table, axis: &str) -> Vec<f64> {
    let mut acted = before(table, &format!("{axis}_cz_um"));
    let found = numbers(table, &format!("{axis}_from_um"));
    if let Some(first) = found.iter().position(|from| from.is_finite()) {
        acted[..=first].fill(found[first]);
    }
    for (cz, from) in acted.iter_mut().zip(found).filter(|(_, from)| from.is_finite()) {
        *cz = from;
    }
    if let Some(Cells::Text(permits)) = table.cells(&format!("{axis}_permit")) {
        for (cz, _) in acted.iter_mut().zip(permits.iter()).filter(|(_, permit)| *permit == "unverified") {
            *cz = f64::NAN;
        }
    }
    acted
}

fn before(table: &Table, name: &str) -> Vec<f64> {
    let decided = numbers(table, name);
    decided.first().into_iter().chain(&decided).take(decided.len()).copied().collect()
}

fn numbers(table: &Table, name: &str) -> Vec<f64> {
    table.numbers(name).map(Series::to_vec).unwrap_or_default()
}
