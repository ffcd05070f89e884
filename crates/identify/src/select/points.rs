//! What is asked, checked against the logs alone.

use std::time::Duration;

use crate::ambient;
use crate::campaign::{Campaign, Input, temperatures_of};
use crate::checks;
use crate::dataset::{BadLog, Dataset, Kind};
use crate::faults::{self, Finding};
use isotherm_core::reading::SignalId;

/// Which columns are what.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// The column with the measured error.
    pub error: String,
    /// The points; empty: every temperature of the logs.
    pub inputs: Vec<String>,
    /// Points that are left out.
    pub without: Vec<String>,
    /// Points that stay in though they look faulty.
    pub keep: Vec<String>,
    /// Rows are averaged over this long.
    pub resample: Duration,
}

/// Points that can be looked at.
#[derive(Clone, Debug)]
pub struct Pointed<'a> {
    /// The runs, every column a signal of its own.
    pub campaign: Campaign<'a>,
    /// Sensors that were left out.
    pub excluded: Vec<Finding>,
    /// Points that behave like the air.
    pub ambient: Vec<Finding>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// Checks the choice, and leaves faulty sensors out.
///
/// # Errors
/// Everything that is wrong, in sentences.
pub fn points<'a>(dataset: &'a Dataset, choice: &Choice) -> Result<Pointed<'a>, BadLog> {
    let mut wrong = Vec::new();
    let error = checks::column_of(dataset, &choice.error, &mut wrong);
    checks::check_runs(dataset, &mut wrong);
    let inputs = inputs(dataset, choice, &mut wrong);
    wrong.extend(checks::fahrenheit(dataset, &temperatures_of(dataset, &inputs)));
    if let Some(error) = error {
        checks::check_error(dataset, error, &mut wrong);
    }
    let (Some(error), true) = (error, wrong.is_empty()) else { return Err(BadLog(wrong)) };
    let mut remarks = dataset.remarks.clone();
    let columns: Vec<usize> = inputs.iter().map(|input| input.column).collect();
    let mut excluded = faults::find(dataset, &columns);
    remarks.extend(excluded.iter().filter(|faulty| choice.keep.contains(&faulty.signal)).map(checks::stays));
    excluded.retain(|faulty| !choice.keep.contains(&faulty.signal));
    let is_good = |input: &Input| !excluded.iter().any(|faulty| faulty.signal == input.name);
    let good: Vec<Input> = inputs.into_iter().filter(is_good).collect();
    if good.len() < 2 {
        let left_out: Vec<String> =
            excluded.iter().map(|faulty| format!("{} {}", faulty.signal, faulty.reason)).collect();
        let left_out =
            if left_out.is_empty() { String::new() } else { format!(" ({} left out)", left_out.join("; ")) };
        return Err(BadLog(vec![format!(
            "{} temperature points are left{left_out}: there is nothing to choose from; name columns with --inputs, or \
             keep one in with --keep",
            good.len()
        )]));
    }
    let ambient = ambient::find(dataset, &temperatures_of(dataset, &good), error);
    Ok(Pointed {
        campaign: Campaign::of_columns(dataset, error, choice.resample).with_inputs(good),
        excluded,
        ambient,
        remarks,
    })
}

fn inputs(dataset: &Dataset, choice: &Choice, wrong: &mut Vec<String>) -> Vec<Input> {
    for name in choice.inputs.iter().chain(&choice.without).chain(&choice.keep) {
        checks::column_of(dataset, name, wrong);
    }
    let is_asked = |name: &String, kind: Kind| match choice.inputs.as_slice() {
        [] => kind == Kind::Temperature,
        named => named.contains(name),
    };
    let columns = dataset.columns.iter().enumerate();
    let found: Vec<Input> = columns
        .filter(|(_, column)| column.name != choice.error && is_asked(&column.name, column.kind))
        .filter(|(_, column)| !choice.without.contains(&column.name))
        .map(|(place, column)| Input { name: column.name.clone(), signal: SignalId(place), column: place })
        .collect();
    if found.is_empty() && choice.inputs.is_empty() {
        let columns = dataset.columns.iter().map(|column| format!("{} ({})", column.name, column.kind));
        wrong.push(format!(
            "no column of the logs is taken for a temperature: there are {}; name the points with --inputs",
            columns.collect::<Vec<String>>().join(", ")
        ));
    }
    found
}
