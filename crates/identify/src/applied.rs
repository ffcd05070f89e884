//! Removal of Cz (the compensation value) from errors that were measured while a compensation was active. The measured
//! value is then e + Cz. A model must be identified from e, the error of the machine without compensation.

use crate::dataset::{BadLog, Column, Dataset, Kind, Run};
use crate::statistics::least_and_most;
use crate::touches::is_acting;
use isotherm_profile::{Profile, Writes};

/// Maximum range of the Cz in a log, µm, up to which the Cz counts as constant. A constant Cz only shifts the measured
/// errors by the same amount, so their drift is correct.
const STANDS_STILL: f64 = 1e-9;

/// Source of the Cz (compensation value) that was active during the measurement of the error.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Applied {
    /// The Cz columns of a log of the gateway. Other logs have no such columns.
    #[default]
    AsLogged,
    /// No Cz was active.
    Nothing,
    /// The log column of this name, µm.
    Column(String),
}

impl Applied {
    /// Parses the value of the option `--cz`: `none` or the name of a log column.
    pub fn named(text: &str) -> Applied {
        if text == "none" { Applied::Nothing } else { Applied::Column(text.to_owned()) }
    }

    /// Returns whether the operator stated with `--cz` that this log column contains the active Cz.
    pub(crate) fn names(&self, column: &str) -> bool {
        matches!(self, Applied::Column(name) if name == column)
    }
}

/// Returns whether the outputs of an axis move the machine, according to the profile. An output that only corrects a
/// readout (DRO) does not move it. `None` if the profile cannot decide this, because the answer depends on how the
/// error was measured.
pub(crate) fn moves_the_machine(profile: &Profile, axis: &str) -> Option<bool> {
    let place = profile.axes.iter().position(|known| known.settings.name == axis)?;
    let outputs = profile.outputs.iter().filter(|output| output.axis.0 == place);
    let corrects: Vec<bool> =
        outputs.map(|output| matches!(output.writes, Writes::Corrected { .. })).collect();
    match corrects.contains(&true) {
        true => None,
        false => Some(!corrects.is_empty()),
    }
}

/// Returns the axis name in the name of a log column with measured errors, for example `z` for `z_error_um`; `None` if
/// the column name has another form.
fn axis_of(error: &str) -> Option<&str> {
    ["_error_um", "_measured_um"].iter().find_map(|end| error.strip_suffix(end))
}

/// Returns the index of the log column that the operator named as the source of the active Cz. Returns an error if no
/// log has a column of numbers with this name.
pub(crate) fn named(dataset: &Dataset, name: &str) -> Result<usize, BadLog> {
    let missing = || {
        BadLog(vec![format!(
            "the option --cz names the column `{name}`, but no log has a column of numbers with this name"
        )])
    };
    dataset.column(name).ok_or_else(missing)
}

/// Returns the index of the log column of the Cz that this measured error contains. `None` if the error contains no Cz,
/// or only a constant Cz.
fn acting(
    dataset: &Dataset,
    error: &str,
    axis: Option<&str>,
    moves: Option<bool>,
    applied: &Applied,
) -> Result<Option<usize>, BadLog> {
    let refused = |why: String| Err(BadLog(vec![why]));
    let axis = axis.or_else(|| axis_of(error));
    match applied {
        Applied::Nothing => return Ok(None),
        Applied::Column(name) => return named(dataset, name).map(Some),
        Applied::AsLogged => {}
    }
    let moved = |end: &str| -> Vec<usize> {
        let is_of_axis =
            |name: &str| name.strip_suffix(end).is_some_and(|own| axis.is_none_or(|axis| own == axis));
        let moved = |place: usize| recorded(dataset).any(|run| run.range(place) > STANDS_STILL);
        let columns = dataset.columns.iter().enumerate().filter(|(_, column)| is_of_axis(&column.name));
        columns.map(|(place, _)| place).filter(|place| moved(*place)).collect()
    };
    let is_logged = |place: &usize| dataset.columns[*place].kind == Kind::Compensation;
    let names = |places: &[usize]| {
        let names: Vec<&str> = places.iter().map(|place| dataset.columns[*place].name.as_str()).collect();
        names.join(", ")
    };
    if let Some(slope) = moved("_slope_um").into_iter().find(is_logged) {
        return refused(format!(
            "{} changed: the control applied a slope, so the Cz in {error} depends on the position of the \
             axis. Leave these logs out, or add --cz none if {error} contains no Cz",
            names(&[slope])
        ));
    }
    let (logged, foreign): (Vec<usize>, Vec<usize>) = moved("_cz_um").into_iter().partition(is_logged);
    if let Some(first) = foreign.first() {
        return refused(format!(
            "{} changed, but this log does not have the columns of a gateway log: it is not known whether \
             {error} contains this Cz. Add --cz {} if it does, otherwise --cz none",
            names(&foreign),
            names(&[*first])
        ));
    }
    match (logged.as_slice(), moves) {
        ([], _) | (_, Some(false)) => Ok(None),
        ([one], Some(true)) => Ok(Some(*one)),
        ([one], None) => {
            let name = names(&[*one]);
            refused(format!(
                "{name} changed. It is not known whether {error} contains this Cz, because no profile was \
                 given, or because an output only corrects a readout. Add --cz {name} if the Cz moved the \
                 axis, or --cz none if the error was measured without compensation"
            ))
        }
        (several, _) => refused(format!(
            "{} changed. It is not known which of these columns contains the Cz that was active while \
             {error} was measured. Add --cz with the name of this column, or --cz none if no Cz was active",
            names(several)
        )),
    }
}

/// Returns the runs whose errors were recorded row by row. In all other runs, a probe measured the errors by touches.
/// Cz was already removed from the errors of touches.
fn recorded(dataset: &Dataset) -> impl Iterator<Item = &Run> {
    dataset.runs.iter().filter(|run| !run.is_touched())
}

/// Subtracts the Cz of a log column from the measured error in each row. Returns the minimum and the maximum Cz, µm;
/// `None` if no run was measured with Cz. A run counts as measured without Cz if the column has no values in that run.
/// In all other runs, the error is removed from each row without a Cz value.
fn take_out(dataset: &mut Dataset, error: usize, column: usize) -> Option<(f64, f64)> {
    for run in dataset.runs.iter_mut().filter(|run| !run.is_touched()) {
        let cz = run.values[column].to_vec();
        if cz.iter().any(|cz| cz.is_finite()) {
            run.values[error].change(|errors| errors.iter_mut().zip(cz).for_each(|(error, cz)| *error -= cz));
        }
    }
    least_and_most(recorded(dataset).flat_map(|run| &run.values[column]))
}

/// Removes the Cz that was active during the measurement from the error, and adds a remark about it. `axis` is the axis
/// of the error, if known. `moves` is the result of `moves_the_machine`.
///
/// # Errors
/// The Cz cannot be determined. The message names the option that specifies it.
pub fn without_cz(
    dataset: &mut Dataset,
    error: &str,
    axis: Option<&str>,
    moves: Option<bool>,
    applied: &Applied,
) -> Result<(), BadLog> {
    // The code that requires the error column reports a missing one.
    let Some(place) = dataset.column(error) else { return Ok(()) };
    let Some(column) = acting(dataset, error, axis, moves, applied)? else { return Ok(()) };
    if let Some((least, most)) = take_out(dataset, place, column) {
        let cz = &dataset.columns[column].name;
        dataset.remarks.push(format!(
            "{error} was measured while {cz} of {least:.1} … {most:.1} µm was active, so the error contained \
             this Cz. The Cz was removed: e = {error} − {cz}"
        ));
    }
    Ok(())
}

/// For each displacement that was measured while a Cz was active, adds a column with the displacement without this Cz.
/// If the Cz cannot be determined, a remark is added instead. `asked` contains the names of the columns to process, or
/// is empty for all displacements. The names of the new columns are appended to `asked`, unless it is empty.
///
/// # Errors
/// `applied` names a column that no log has.
pub fn add_without_cz(
    dataset: &mut Dataset,
    profile: Option<&Profile>,
    asked: &mut Vec<String>,
    applied: &Applied,
) -> Result<(), BadLog> {
    let is_meant = |column: &Column| match asked.as_slice() {
        [] => column.kind == Kind::Displacement && !is_acting(dataset, &column.name),
        asked => asked.contains(&column.name),
    };
    let places: Vec<usize> =
        (0..dataset.columns.len()).filter(|place| is_meant(&dataset.columns[*place])).collect();
    for place in places {
        let name = dataset.columns[place].name.clone();
        let moves = profile.and_then(|profile| moves_the_machine(profile, axis_of(&name)?));
        let column = match acting(dataset, &name, None, moves, applied) {
            Ok(Some(column)) => column,
            Ok(None) => continue,
            Err(wrong) if *applied == Applied::AsLogged => {
                dataset.remarks.extend(wrong.0);
                continue;
            }
            Err(wrong) => return Err(wrong),
        };
        let without = format!("{name} without Cz");
        dataset.columns.push(Column { name: without.clone(), kind: Kind::Displacement });
        for run in &mut dataset.runs {
            run.values.push(run.values[place].clone());
        }
        if let Some((least, most)) = take_out(dataset, dataset.columns.len() - 1, column) {
            let cz = &dataset.columns[column].name;
            dataset.remarks.push(format!(
                "{name} was measured while {cz} of {least:.1} … {most:.1} µm was active: {name} is the \
                 residual displacement, and {without} is the displacement without compensation"
            ));
        }
        if !asked.is_empty() {
            asked.push(without);
        }
    }
    Ok(())
}
