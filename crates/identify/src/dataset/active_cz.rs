//! Cz that was active while a log was recorded. A log of the gateway contains the Cz that it decided in each row; a
//! measured error contains the Cz that was active.

use super::table::{Cells, Table};

/// Columns of an axis in a log of the gateway, besides `cz_um` and `slope_um`. They are not used for identification.
const DECIDED: [&str; 9] =
    ["permit", "from_um", "raw_um", "model", "state", "acted", "sign_um", "slope_from_um", "correction_um"];
/// Columns of the machine in a log of the gateway. Only the log of a dry run, which writes nothing, has the last one.
const MACHINE: [&str; 3] = ["machine_memory", "machine_zero", DRY_RUN];
const DRY_RUN: &str = "machine_dry_run";

/// Returns whether the texts in this log column are needed to determine the active Cz (Cz that acted during the
/// measurement).
pub(super) fn names_model_by_words(column: &str) -> bool {
    column.ends_with("_permit")
}

/// Returns whether this log column is needed to determine the active Cz (Cz that acted during the measurement).
pub(super) fn needs(column: &str) -> bool {
    ["_permit", "_cz_um", "_slope_um", "_from_um"].iter().any(|end| column.ends_with(end))
}

/// Replaces the decided values of each axis by the active ones: `<axis>_cz_um`, and `<axis>_slope_um` if the control
/// receives the slope. Each value is the register value when the row was read. `table.acted` lists these columns. A dry
/// run has no active values, so its columns are removed. Returns the `_permit` column of each axis without a known
/// active value.
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
                *cells = Cells::Numbers(values);
                table.acted.push(name);
            }
        }
        table.columns.retain(|(name, _)| !DECIDED.iter().any(|what| *name == format!("{axis}_{what}")));
    }
    if !axes.is_empty() {
        table.columns.retain(|(name, _)| !MACHINE.contains(&name.as_str()));
    }
    unknown
}

/// Returns the active Cz (Cz that acted during the measurement) of each log row. The readings of a row are older than
/// its decision, so the decision of the previous row was active. Until the gateway first took over the register, the
/// value found in the register was active. The result is NaN while the register was not verified.
fn acted(table: &Table, axis: &str) -> Vec<f64> {
    let mut acted = before(table, &format!("{axis}_cz_um"));
    let found = table.numbers(&format!("{axis}_from_um")).unwrap_or_default();
    if let Some(first) = found.iter().position(|from| from.is_finite()) {
        acted[..=first].fill(found[first]);
    }
    for (cz, from) in acted.iter_mut().zip(found).filter(|(_, from)| from.is_finite()) {
        *cz = *from;
    }
    if let Some(Cells::Text(permits)) = table.cells(&format!("{axis}_permit")) {
        for (cz, _) in acted.iter_mut().zip(permits.iter()).filter(|(_, permit)| *permit == "unverified") {
            *cz = f64::NAN;
        }
    }
    acted
}

fn before(table: &Table, name: &str) -> Vec<f64> {
    let decided = table.numbers(name).unwrap_or_default();
    decided.first().into_iter().chain(decided).take(decided.len()).copied().collect()
}
