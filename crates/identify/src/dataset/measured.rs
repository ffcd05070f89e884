//! Implausible values (not measured by the sensor) of measured errors, for the row reader of `isotherm replay`. The
//! command `isotherm identify` leaves out the same values.

use std::collections::HashMap;
use std::path::Path;

use super::formats::read_table;
use super::implausible::{Wrong, wrong};
use super::table::{Cells, Table, Units, Uses};
use super::{BadLog, Kind, Series, Split, unit};

/// Implausible values of the measured errors in one log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Implausible {
    /// Line numbers of these values, in ascending order. The map key is the name of the column.
    pub lines: HashMap<String, Vec<u64>>,
    /// Remarks with file, line and value.
    pub remarks: Vec<String>,
}

/// Finds the implausible values in the columns `split.displacements` of a log. If the log cannot be read here, the
/// result contains a remark instead, because `isotherm replay` may still be able to read it.
///
/// # Errors
/// A column has too many implausible values.
pub(super) fn in_file(
    file: &Path,
    split: &Split,
    (units, uses): (Units<'_>, Uses<'_>),
) -> Result<Implausible, BadLog> {
    // A displacement may jump while the machine moves.
    let is_mover =
        |name: &str| matches!(Kind::of_name(name, units(name)), Some(Kind::Speed | Kind::Position));
    match read_table(file, split, &|name: &str| uses(name) || is_mover(name)) {
        Ok(mut table) => leave_out(&mut table, split, units),
        Err(BadLog(why)) => {
            let why = why.first().map(String::as_str).unwrap_or_default();
            let remark = format!("the measured error was not checked for implausible values: {why}");
            Ok(Implausible { remarks: vec![remark], ..Implausible::default() })
        }
    }
}

/// Removes the implausible values from a table.
///
/// # Errors
/// A column has too many implausible values.
pub(super) fn leave_out(table: &mut Table, split: &Split, units: Units<'_>) -> Result<Implausible, BadLog> {
    let of_profile = |name: &str| {
        let logged = table.units.get(name).and_then(|logged| unit::of_profile(name, logged));
        units(name).or(logged)
    };
    let kind = |name: &str, values: &Series| match Kind::of_name(name, of_profile(name)) {
        None if split.displacements.iter().any(|known| known == name) => Kind::Displacement,
        _ => Kind::guess(name, of_profile(name), values.iter()),
    };
    let (found, lasting) = wrong(table, std::slice::from_ref(&(0..table.times.len())), &kind);
    let (mut implausible, mut refused) =
        (Implausible { remarks: lasting, ..Implausible::default() }, Vec::new());
    for wrong in found {
        let Wrong { place, rows, .. } = &wrong;
        let Some((name, Cells::Numbers(values))) = table.columns.get_mut(*place) else { continue };
        if !split.displacements.contains(name) {
            continue;
        }
        values.change(|values| rows.iter().for_each(|row| values[*row] = f64::NAN));
        implausible.lines.insert(name.clone(), rows.iter().map(|row| table.lines.of(*row)).collect());
        match wrong.refusal() {
            Some(why) => refused.push(why),
            None => implausible.remarks.push(wrong.left_out(false)),
        }
    }
    BadLog::unless(refused, implausible)
}
