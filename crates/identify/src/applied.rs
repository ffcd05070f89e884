//! Errors that were measured while a compensation acted have its Cz in them: e + Cz. A model is learnt from e alone.

use crate::dataset::{BadLog, Column, Dataset, Kind, Run};
use crate::statistics::range;
use isotherm_profile::{Profile, Writes};

/// Where the Cz stands that acted on the measured error.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Applied {
    /// In the columns that a log of the gateway has; elsewhere there is none.
    #[default]
    AsLogged,
    /// Nothing acted.
    Nothing,
    /// In this column, µm.
    Column(String),
}

impl Applied {
    /// `none`, or a column.
    pub fn named(text: &str) -> Applied {
        if text == "none" { Applied::Nothing } else { Applied::Column(text.to_owned()) }
    }
}

/// Whether the outputs of an axis move the machine, as far as its profile tells; one that only corrects a readout moves
/// nothing by itself. `None`: it depends on how the error was measured.
pub fn moves_the_machine(profile: &Profile, axis: &str) -> Option<bool> {
    let place = profile.axes.iter().position(|known| known.settings.name == axis)?;
    let outputs = profile.outputs.iter().filter(|output| output.axis.0 == place);
    let corrects = |writes: Writes| matches!(writes, Writes::Corrected { .. });
    let of_readout = outputs.clone().filter(|output| corrects(output.writes)).count();
    match (outputs.count(), of_readout) {
        (0, _) => Some(false),
        (_, 0) => Some(true),
        _ => None,
    }
}

/// The column with the Cz that acted on this error, if any moved. `axis` where it is known; `moves` as
/// [`moves_the_machine`] says.
///
/// # Errors
/// What acted cannot be known: a sentence that says which option tells it.
pub fn acting(
    dataset: &Dataset,
    error: &str,
    axis: Option<&str>,
    moves: Option<bool>,
    applied: &Applied,
) -> Result<Option<usize>, BadLog> {
    let refused = |why: String| Err(BadLog(vec![why]));
    let axis = axis.or_else(|| ["_error_um", "_measured_um"].iter().find_map(|end| error.strip_suffix(end)));
    match applied {
        Applied::Nothing => return Ok(None),
        Applied::Column(name) => {
            return match dataset.column(name) {
                Some(column) => Ok(Some(column)),
                None => refused(format!("no log has a column of numbers `{name}`, which --cz names")),
            };
        }
        Applied::AsLogged => {}
    }
    let (mut logged, mut foreign) = (Vec::new(), Vec::new());
    for (place, column) in dataset.columns.iter().enumerate() {
        let of_axis = |end: &str| match axis {
            Some(axis) => column.name == format!("{axis}{end}"),
            None => column.name.ends_with(end),
        };
        if !moved(dataset, place) {
            continue;
        }
        match column.kind {
            Kind::Compensation if of_axis("_slope_um") => {
                return refused(format!(
                    "{} moved: the control applied a slope, whose part in {error} depends on where the axis was; leave \
                     these logs out, or say --cz none where nothing acted on it",
                    column.name
                ));
            }
            Kind::Compensation if of_axis("_cz_um") => logged.push(place),
            kind if kind != Kind::Compensation && of_axis("_cz_um") => foreign.push(place),
            _ => {}
        }
    }
    let names = |places: &[usize]| {
        let names: Vec<&str> = places.iter().map(|place| dataset.columns[*place].name.as_str()).collect();
        names.join(", ")
    };
    if !foreign.is_empty() {
        return refused(format!(
            "{} moved, but the log is not as the gateway writes it: whether that Cz acted on {error} is not known; say \
             --cz {} where it did, or --cz none",
            names(&foreign),
            dataset.columns[foreign[0]].name
        ));
    }
    match (logged.as_slice(), moves) {
        ([], _) | (_, Some(false)) => Ok(None),
        ([one], Some(true)) => Ok(Some(*one)),
        ([one], None) => {
            let name = &dataset.columns[*one].name;
            refused(format!(
                "{name} moved, and whether it is in {error} is not known without the profile, or where a readout was \
                 corrected: say --cz {name} where the axis went by it, or --cz none where the error was measured on the \
                 machine as it is"
            ))
        }
        (several, _) => refused(format!(
            "{} moved, and which of them acted on {error} is not known; name it with --cz, or say --cz none",
            names(several)
        )),
    }
}

fn moved(dataset: &Dataset, column: usize) -> bool {
    const STANDS: f64 = 1e-9;
    let finite = |run: &Run| -> Vec<f64> {
        run.values[column].iter().copied().filter(|value| value.is_finite()).collect()
    };
    dataset.runs.iter().any(|run| range(&finite(run)) > STANDS)
}

/// Takes the Cz of this column out of the measured error, row by row: from where to where it went, µm. A run without the
/// column was measured without it. Rows in which it is not known have no error.
pub fn take_out(dataset: &mut Dataset, error: usize, column: usize) -> Option<(f64, f64)> {
    let mut least_and_most: Option<(f64, f64)> = None;
    for run in &mut dataset.runs {
        let cz = run.values[column].clone();
        if !cz.iter().any(|cz| cz.is_finite()) {
            continue;
        }
        for (error, cz) in run.values[error].iter_mut().zip(cz) {
            *error -= cz;
            if cz.is_finite() {
                let (least, most) = least_and_most.unwrap_or((cz, cz));
                least_and_most = Some((least.min(cz), most.max(cz)));
            }
        }
    }
    least_and_most
}

/// The error as it is without the Cz that acted on it; a sentence among the remarks says so.
///
/// # Errors
/// As [`acting`].
pub fn bare(
    dataset: &mut Dataset,
    error: &str,
    axis: Option<&str>,
    moves: Option<bool>,
    applied: &Applied,
) -> Result<(), BadLog> {
    // An error that is not there is told by whoever looks for it.
    let Some(place) = dataset.column(error) else { return Ok(()) };
    let Some(column) = acting(dataset, error, axis, moves, applied)? else { return Ok(()) };
    if let Some((least, most)) = take_out(dataset, place, column) {
        let cz = &dataset.columns[column].name;
        dataset.remarks.push(format!(
            "{error} was measured while {cz} of {least:.1} … {most:.1} µm acted, which is in it; it was taken out again: \
             e = {error} − {cz}"
        ));
    }
    Ok(())
}

/// Beside each displacement in which a Cz acted, the same without it, as a column of its own; what cannot be known is
/// remarked. `asked`: the columns, where they are named; those beside them are added.
pub fn beside(
    dataset: &mut Dataset,
    profile: Option<&Profile>,
    asked: &mut Vec<String>,
    applied: &Applied,
) -> Result<(), BadLog> {
    let is_meant = |column: &Column| match asked.as_slice() {
        [] => column.kind == Kind::Displacement,
        asked => asked.contains(&column.name),
    };
    let places: Vec<usize> =
        (0..dataset.columns.len()).filter(|place| is_meant(&dataset.columns[*place])).collect();
    for place in places {
        let name = dataset.columns[place].name.clone();
        let axis = ["_error_um", "_measured_um"].iter().find_map(|end| name.strip_suffix(end));
        let moves = profile.and_then(|profile| moves_the_machine(profile, axis?));
        let column = match acting(dataset, &name, axis, moves, applied) {
            Ok(Some(column)) => column,
            Ok(None) => continue,
            Err(wrong) if *applied == Applied::AsLogged => {
                dataset.remarks.extend(wrong.0);
                continue;
            }
            Err(wrong) => return Err(wrong),
        };
        let bare = format!("{name} without Cz");
        let copied = Column { name: bare.clone(), kind: Kind::Displacement };
        dataset.columns.push(copied);
        for run in &mut dataset.runs {
            run.values.push(run.values[place].clone());
        }
        let added = dataset.columns.len() - 1;
        if let Some((least, most)) = take_out(dataset, added, column) {
            let cz = &dataset.columns[column].name;
            dataset.remarks.push(format!(
                "{name} was measured while {cz} of {least:.1} … {most:.1} µm acted, so it is what the compensation left; \
                 {bare} is the machine as it is"
            ));
        }
        if !asked.is_empty() {
            asked.push(bare);
        }
    }
    Ok(())
}
