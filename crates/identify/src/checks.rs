//! What is odd about logs, in sentences that say what to do.

use std::time::Duration;

use crate::dataset::{Dataset, Kind, Run};
use crate::faults::Finding;
use crate::statistics::{least_and_most, mean};
use isotherm_profile::{counted, duration_text};

/// A shop is not warmer than this when its machine is cold: all sensors above it are in °F.
const COLD_SHOP: f64 = 45.0;
/// No drift can be learnt from less.
const SHORTEST_RUN: Duration = Duration::from_secs(20 * 60);
/// Four hours of seconds that are called minutes.
const LONGEST_RUN: Duration = Duration::from_secs(10 * 24 * 3600);
/// A probe that comes back to one place finds it to this, mm.
const LONGEST_AT_ONE_PLACE: f64 = 1.0;
/// An error that moves less is noise or a column of zeros, µm.
const STANDS_STILL: f64 = 1e-6;

pub(super) fn check_runs(dataset: &Dataset, wrong: &mut Vec<String>) {
    wrong.extend(dataset.runs.iter().filter_map(odd_length));
}

/// What only one method makes something of.
pub(super) fn one_run_only(dataset: &Dataset) -> Option<String> {
    let [only] = dataset.runs.as_slice() else { return None };
    Some(format!(
        "there is one run only, {}: a model must be judged on a run that it never saw; record another day, or split this \
         log with --run-column COLUMN or --gap 1h",
        only.name
    ))
}

/// What a run's length says about its time column, where that is odd.
pub(super) fn odd_length(run: &Run) -> Option<String> {
    let odd = match run.lasts() {
        lasts if lasts < SHORTEST_RUN => {
            "too short for any drift; where its time counts minutes, name the column time_min"
        }
        lasts if lasts > LONGEST_RUN => {
            "where its time counts seconds, name the column time; else split it with --gap 1h"
        }
        _ => return None,
    };
    let shown = duration_text(Duration::from_secs(run.lasts().as_secs()));
    Some(format!("{} lasts {shown} ({}): {odd}", run.name, counted(run.times.len(), "row")))
}

/// What these temperatures begin at says that they are no °C.
pub(super) fn fahrenheit(dataset: &Dataset, temperatures: &[usize]) -> Option<String> {
    let first = |column: &usize| {
        let mut values = dataset.runs.iter().flat_map(|run| &run.values[*column]);
        values.find(|value| value.is_finite()).copied()
    };
    let (coldest, _) = least_and_most(temperatures.iter().filter_map(first))?;
    let as_celsius = (coldest - 32.0) / 1.8;
    (coldest > COLD_SHOP).then(|| {
        format!(
            "every temperature begins at {coldest:.0} or more: that is °F ({coldest:.0} °F = {as_celsius:.0} °C), or \
             another unit; write °C: (F − 32) / 1.8"
        )
    })
}

pub(super) fn check_error(dataset: &Dataset, error: usize, wrong: &mut Vec<String>) {
    let name = &dataset.columns[error].name;
    let rows = |run: &Run| run.values[error].iter().filter(|value| value.is_finite()).count();
    for run in dataset.runs.iter().filter(|run| rows(run) == 0) {
        wrong
            .push(format!("{} has no number under {name}: leave that log out, or fill the column", run.name));
    }
    let ranges: Vec<f64> = dataset.runs.iter().map(|run| run.range(error)).collect();
    let widest = ranges.iter().copied().fold(0.0, f64::max);
    if widest < STANDS_STILL {
        wrong.push(format!(
            "{name} stands still in every run: there is nothing to compensate, or the probe was not connected"
        ));
    } else if widest < 0.05 && dataset.columns[error].kind != Kind::Other {
        let rows: usize = dataset.runs.iter().map(rows).sum();
        let mean = mean(&ranges);
        wrong.push(format!("{name} moves by {mean:.4} over {rows} rows: that looks like mm; write µm"));
    }
}

/// A recorded position that the error may go with, and that no model was asked to look at.
pub(super) fn unused_position(dataset: &Dataset, error: usize) -> Option<String> {
    let moved = |column: &usize| {
        let places = dataset.runs.iter().flat_map(|run| {
            let measured = run.values[*column].iter().zip(&run.values[error]);
            measured.filter(|(_, error)| error.is_finite()).map(|(place, _)| *place)
        });
        least_and_most(places.filter(|place| place.is_finite())).map_or(0.0, |(least, most)| most - least)
    };
    let widest = dataset.of_kind(Kind::Position).max_by(|one, other| moved(one).total_cmp(&moved(other)))?;
    let name = &dataset.columns[widest].name;
    let travel = moved(&widest);
    (travel > LONGEST_AT_ONE_PLACE).then(|| {
        format!(
            "the error was measured over {travel:.0} mm of {name}, which no term uses: --method position --position {name} finds \
             how it changes along the axis"
        )
    })
}

/// The column of this name.
pub(super) fn column_of(dataset: &Dataset, name: &str, wrong: &mut Vec<String>) -> Option<usize> {
    let found = dataset.column(name);
    if found.is_none() {
        wrong.push(format!("no log has a column of numbers `{name}`{}", nearest(name, &dataset.names())));
    }
    found
}

/// The remark about a sensor that looks faulty and is kept.
pub(super) fn stays(faulty: &Finding) -> String {
    format!("{} stays in as asked: {}", faulty.signal, faulty.reason)
}

/// "; did you mean …", or what there is.
pub(super) fn nearest(name: &str, known: &[&str]) -> String {
    let alike = known.iter().map(|known| (strsim::jaro_winkler(name, known), known));
    match alike.max_by(|one, other| one.0.total_cmp(&other.0)) {
        Some((alike, best)) if alike > 0.8 => format!("; did you mean `{best}`?"),
        Some(_) => format!("; there are {}", known.join(", ")),
        None => String::new(),
    }
}
