//! What is odd about logs, in sentences that say what to do.

use std::time::Duration;

use crate::campaign::{Input, temperatures_of};
use crate::dataset::{Dataset, Kind, Run};
use crate::statistics::{count, range};

/// A shop is not warmer than this when its machine is cold: all sensors above it are in °F.
const COLD_SHOP: f64 = 45.0;
/// No drift can be learnt from less.
const SHORTEST_RUN: Duration = Duration::from_secs(20 * 60);
/// Four hours of seconds that are called minutes.
const LONGEST_RUN: Duration = Duration::from_secs(10 * 24 * 3600);
/// An error that moves less is noise or a column of zeros, µm.
const STANDS_STILL: f64 = 1e-6;

pub(super) fn check_runs(dataset: &Dataset, wrong: &mut Vec<String>) {
    if let [only] = dataset.runs.as_slice() {
        wrong.push(format!(
            "there is one run only, {}: a model must be judged on a run that it never saw; record another day, or \
             split this log with --run-column COLUMN or --gap 1h",
            only.name
        ));
    }
    wrong.extend(dataset.runs.iter().filter_map(odd_length));
}

/// What a run's length says about its time column, where that is odd.
pub(super) fn odd_length(run: &Run) -> Option<String> {
    let (name, lasts, rows) = (&run.name, run.lasts(), run.times.len());
    let shown = humantime::format_duration(Duration::from_secs(lasts.as_secs()));
    if lasts < SHORTEST_RUN {
        return Some(format!(
            "{name} lasts {shown} ({rows} rows): too short for any drift; where its time counts minutes, name the column \
             time_min"
        ));
    }
    (lasts > LONGEST_RUN).then(|| {
        format!(
            "{name} lasts {shown} ({rows} rows): where its time counts seconds, name the column time; else split it \
             with --gap 1h"
        )
    })
}

pub(super) fn check_units(dataset: &Dataset, inputs: &[Input], wrong: &mut Vec<String>) {
    wrong.extend(fahrenheit(dataset, &temperatures_of(dataset, inputs)));
}

/// What these temperatures begin at says that they are no °C.
pub(super) fn fahrenheit(dataset: &Dataset, temperatures: &[usize]) -> Option<String> {
    let first = |column: &usize| {
        let mut values = dataset.runs.iter().flat_map(|run| &run.values[*column]);
        values.find(|value| value.is_finite()).copied()
    };
    let begins: Vec<f64> = temperatures.iter().filter_map(first).collect();
    let coldest = begins.iter().copied().fold(f64::MAX, f64::min);
    (!begins.is_empty() && coldest > COLD_SHOP).then(|| {
        let as_celsius = (coldest - 32.0) / 1.8;
        format!(
            "every temperature begins at {coldest:.0} or more: that is °F ({coldest:.0} °F = {as_celsius:.0} °C), or \
             another unit; write °C: (F − 32) / 1.8"
        )
    })
}

pub(super) fn check_error(dataset: &Dataset, error: usize, wrong: &mut Vec<String>) {
    let name = &dataset.columns[error].name;
    let values = |run: &Run| -> Vec<f64> {
        run.values[error].iter().copied().filter(|value| value.is_finite()).collect()
    };
    for run in &dataset.runs {
        let rows = values(run).len();
        if rows == 0 {
            wrong.push(format!(
                "{} has no number under {name}: leave that log out, or fill the column",
                run.name
            ));
        }
    }
    let widest = dataset.runs.iter().map(|run| range(&values(run))).fold(0.0, f64::max);
    if widest < STANDS_STILL {
        wrong.push(format!(
            "{name} stands still in every run: there is nothing to compensate, or the probe was not connected"
        ));
    } else if widest < 0.05 && dataset.columns[error].kind != Kind::Other {
        let rows: usize = dataset.runs.iter().map(|run| values(run).len()).sum();
        let mean =
            dataset.runs.iter().map(|run| range(&values(run))).sum::<f64>() / count(dataset.runs.len());
        wrong.push(format!("{name} moves by {mean:.4} over {rows} rows: that looks like mm; write µm"));
    }
}

/// The column of this name.
pub(super) fn column_of(dataset: &Dataset, name: &str, wrong: &mut Vec<String>) -> Option<usize> {
    let found = dataset.column(name);
    if found.is_none() {
        let names: Vec<&str> = dataset.columns.iter().map(|column| column.name.as_str()).collect();
        wrong.push(format!("no log has a column of numbers `{name}`{}", nearest(name, &names)));
    }
    found
}

/// "; did you mean …", or what there is.
pub(super) fn nearest(wanted: &str, known: &[&str]) -> String {
    let best = known.iter().max_by(|one, other| {
        strsim::jaro_winkler(wanted, one).total_cmp(&strsim::jaro_winkler(wanted, other))
    });
    match best {
        Some(best) if strsim::jaro_winkler(wanted, best) > 0.8 => format!("; did you mean `{best}`?"),
        Some(_) => format!("; there are {}", known.join(", ")),
        None => String::new(),
    }
}
