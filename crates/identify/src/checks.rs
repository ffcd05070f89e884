//! Checks for unusual logs. The messages tell the operator what to do.

use std::time::Duration;

use crate::dataset::{Dataset, Kind, Run};
use crate::faults::Finding;
use crate::statistics::{least_and_most, mean};
use isotherm_profile::{counted, duration_text};

/// Maximum temperature of a cold workshop, °C. If the first value of every sensor is above this limit, the values are
/// probably in °F or K.
const COLD_SHOP: f64 = 45.0;
/// Temperature in °C above which the first values of all sensors are certainly in K.
const KELVIN: f64 = 200.0;
/// Minimum duration of a run. A shorter run shows no measurable drift.
pub(super) const SHORTEST_RUN: Duration = Duration::from_secs(20 * 60);
/// Maximum duration of a run. A run of more than four hours exceeds this limit if its times in seconds are
/// read as minutes.
const LONGEST_RUN: Duration = Duration::from_secs(10 * 24 * 3600);
/// Maximum range of the position, mm, for which the error counts as measured at one position.
const LONGEST_AT_ONE_PLACE: f64 = 1.0;
/// Minimum range of an error, µm. A column with a smaller range is constant.
const STANDS_STILL: f64 = 1e-6;

pub(super) fn check_runs(dataset: &Dataset, wrong: &mut Vec<String>) {
    wrong.extend(dataset.repeats.iter().cloned());
    wrong.extend(dataset.runs.iter().filter_map(odd_length));
}

/// Adds a message to `wrong` for each of these columns that contains too many implausible values (not measured by the
/// sensor).
pub(super) fn check_plausible(
    dataset: &Dataset,
    columns: impl Iterator<Item = usize>,
    wrong: &mut Vec<String>,
) {
    for column in columns {
        let name = &dataset.columns[column].name;
        let own = dataset.implausible.iter().filter(|refusal| refusal.column == *name);
        wrong.extend(own.map(|refusal| refusal.message.clone()));
    }
}

/// Returns a message if there is only one run, because then a model cannot be tested; `None` with more runs.
pub(super) fn one_run_only(dataset: &Dataset) -> Option<String> {
    let [only] = dataset.runs.as_slice() else { return None };
    Some(format!(
        "there is only one run, {}, but a model must be tested on a run that was not used to identify it. \
         Record another day, or split this log with --run-column COLUMN or --gap 1h",
        only.name
    ))
}

/// Returns a message if a run is so short or so long that the unit of its time column is probably wrong; `None`
/// otherwise.
pub(super) fn odd_length(run: &Run) -> Option<String> {
    let odd = match run.lasts() {
        lasts if lasts < SHORTEST_RUN => {
            "too short to show a thermal drift. If the name of the time column has no unit, its numbers are \
             read as seconds. State another unit with --time-unit min, h, d or excel"
        }
        lasts if lasts > LONGEST_RUN => {
            "too long for one run. If the times have another unit, state this unit with --time-unit; \
             otherwise split the log with --gap 1h"
        }
        _ => return None,
    };
    let shown = duration_text(Duration::from_secs(run.lasts().as_secs()));
    Some(format!("{} lasts {shown} ({}): {odd}", run.name, counted(run.times.len(), "row")))
}

/// Returns a message if the first values of all temperatures are too high for °C, because the values are in °F or K.
/// `None` otherwise.
pub(super) fn fahrenheit(dataset: &Dataset, temperatures: &[usize]) -> Option<String> {
    let first = |column: &usize| {
        let mut values = dataset.runs.iter().flat_map(|run| &run.values[*column]);
        values.find(|value| value.is_finite())
    };
    let (coldest, _) = least_and_most(temperatures.iter().filter_map(first))?;
    let (unit, as_celsius, how) = match coldest > KELVIN {
        true => ("K", coldest - 273.15, "K − 273.15"),
        false => ("°F", (coldest - 32.0) / 1.8, "(F − 32) / 1.8"),
    };
    (coldest > COLD_SHOP).then(|| {
        format!(
            "the first value of every temperature is {coldest:.0} or more: these values are in {unit} \
             ({coldest:.0} {unit} = {as_celsius:.0} °C), or in another unit. Write the unit after the names \
             of the columns, as in `bed [{unit}]`, or convert the values to °C: {how}"
        )
    })
}

/// Returns the message that a displacement column is in mm, although the error is needed in µm.
pub(super) fn in_mm(name: &str) -> String {
    format!(
        "{name} is in mm according to its name or unit, but the error is needed in µm. Write the values in \
         µm. Or let the name of the column end with `_um [mm]`: then the values are converted"
    )
}

pub(super) fn check_error(dataset: &Dataset, error: usize, wrong: &mut Vec<String>) {
    let name = &dataset.columns[error].name;
    let rows = |run: &Run| run.values[error].iter().filter(|value| value.is_finite()).count();
    for run in dataset.runs.iter().filter(|run| rows(run) == 0) {
        wrong.push(format!(
            "{} has no number in the column {name}: leave that log out, or fill in the column",
            run.name
        ));
    }
    let ranges: Vec<f64> = dataset.runs.iter().map(|run| run.range(error)).collect();
    let widest = ranges.iter().copied().fold(0.0, f64::max);
    if dataset.columns[error].kind == Kind::Position {
        wrong.push(in_mm(name));
    }
    if widest < STANDS_STILL {
        wrong.push(format!(
            "{name} is constant in every run: there is nothing to compensate, or the probe was not connected"
        ));
    } else if widest < 0.05 && dataset.columns[error].kind != Kind::Other {
        let rows: usize = dataset.runs.iter().map(rows).sum();
        let mean = mean(&ranges);
        wrong.push(format!(
            "{name} changes by only {mean:.4} over {rows} rows: the values are probably in mm; write them in \
             µm"
        ));
    }
}

/// Returns a message if the error was measured over a range of positions, but no model uses the position. `None`
/// otherwise.
pub(super) fn unused_position(dataset: &Dataset, error: usize) -> Option<String> {
    let moved = |column: &usize| {
        let places = dataset.runs.iter().flat_map(|run| {
            let measured = run.values[*column].iter().zip(&run.values[error]);
            measured.filter(|(_, error)| error.is_finite()).map(|(place, _)| place)
        });
        least_and_most(places.filter(|place| place.is_finite())).map_or(0.0, |(least, most)| most - least)
    };
    let widest = dataset.of_kind(Kind::Position).max_by(|one, other| moved(one).total_cmp(&moved(other)))?;
    let name = &dataset.columns[widest].name;
    let travel = moved(&widest);
    (travel > LONGEST_AT_ONE_PLACE).then(|| {
        format!(
            "the error was measured over {travel:.0} mm of {name}, but no term of the model uses this \
             position. Add --method position --position {name} to model how the error changes along the axis"
        )
    })
}

/// Returns the reason why the log column of this name was not used. The text begins with a colon and is appended to a
/// sentence. The text is empty if no log has that column.
pub(super) fn why_lost(dataset: &Dataset, name: &str) -> String {
    let lost = dataset.lost.iter().find(|lost| lost.column == name);
    lost.map(|lost| format!(": {}", lost.message)).unwrap_or_default()
}

/// Returns the index of the log column of this name. If the column is missing, adds a message to `wrong` and returns
/// `None`.
pub(super) fn column_of(dataset: &Dataset, name: &str, wrong: &mut Vec<String>) -> Option<usize> {
    let found = dataset.column(name);
    if found.is_none() {
        let why = match why_lost(dataset, name) {
            why if why.is_empty() => nearest(name, &dataset.names()),
            why => why,
        };
        wrong.push(format!("no log has a column `{name}` that contains numbers{why}"));
    }
    found
}

/// Returns the remark about a sensor that appears to be faulty. The sensor is used nevertheless, because the operator
/// requested it.
pub(super) fn stays(faulty: &Finding) -> String {
    format!("{} is used as requested, although it was found faulty: {}", faulty.signal, faulty.reason)
}

/// Returns the text "; did you mean …" with the most similar name, or a list of the known names.
pub(super) fn nearest(name: &str, known: &[&str]) -> String {
    let alike = known.iter().map(|known| (strsim::jaro_winkler(name, known), known));
    match alike.max_by(|one, other| one.0.total_cmp(&other.0)) {
        Some((alike, best)) if alike > 0.8 => format!("; did you mean `{best}`?"),
        Some(_) => format!("; there are {}", known.join(", ")),
        None => String::new(),
    }
}
