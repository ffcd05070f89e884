//! What is asked, checked against the logs alone.

use crate::ambient;
use crate::campaign::{Campaign, Input, temperatures_of};
use crate::checks;
use crate::dataset::{BadLog, Column, Dataset, Kind};
use crate::faults::{self, Finding, Notes};
use crate::setup::Choice;
use isotherm_core::reading::SignalId;
use isotherm_profile::Unit;

/// Points that can be looked at.
#[derive(Clone, Debug)]
pub struct Pointed<'a> {
    /// The runs, every column a signal of its own.
    pub(crate) campaign: Campaign<'a>,
    /// What is odd about the points and the logs.
    pub notes: Notes,
}

/// Checks the choice, and leaves faulty sensors out.
///
/// # Errors
/// Everything that is wrong, in sentences.
pub fn points<'a>(dataset: &'a Dataset, choice: &Choice) -> Result<Pointed<'a>, BadLog> {
    let mut wrong = Vec::new();
    let error = checks::column_of(dataset, choice.error.as_deref().unwrap_or_default(), &mut wrong);
    wrong.extend(checks::one_run_only(dataset));
    checks::check_runs(dataset, &mut wrong);
    let inputs = inputs(dataset, choice, error, &mut wrong);
    wrong.extend(checks::fahrenheit(dataset, &temperatures_of(dataset, &inputs)));
    if let Some(error) = error {
        checks::check_error(dataset, error, &mut wrong);
    }
    let (Some(error), true) = (error, wrong.is_empty()) else { return Err(BadLog(wrong)) };
    let columns: Vec<usize> = inputs.iter().map(|input| input.column).collect();
    let (kept, excluded): (Vec<Finding>, Vec<Finding>) =
        faults::find(dataset, &columns).into_iter().partition(|faulty| choice.keep.contains(&faulty.signal));
    let remarks = dataset.remarks.iter().cloned().chain(kept.iter().map(checks::stays)).collect();
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
    let campaign = Campaign::of_columns(dataset, error, good, choice.resample);
    Ok(Pointed { campaign, notes: Notes { excluded, ambient, remarks } })
}

fn inputs(dataset: &Dataset, choice: &Choice, error: Option<usize>, wrong: &mut Vec<String>) -> Vec<Input> {
    for name in choice.inputs.iter().chain(&choice.without).chain(&choice.keep) {
        checks::column_of(dataset, name, wrong);
    }
    let is_meant = |(place, column): &(usize, &Column)| {
        let is_asked = match choice.inputs.as_slice() {
            [] => column.kind == Kind::Temperature,
            named => named.contains(&column.name),
        };
        is_asked && error != Some(*place) && !choice.without.contains(&column.name)
    };
    let columns = dataset.columns.iter().enumerate().filter(is_meant);
    let input = |(place, column): (usize, &Column)| Input {
        name: column.name.clone(),
        signal: SignalId(place),
        column: place,
        unit: Unit("degC"),
    };
    let found: Vec<Input> = columns.map(input).collect();
    if found.is_empty() && choice.inputs.is_empty() {
        let columns = dataset.columns.iter().chain(&dataset.unread);
        let columns = columns.map(|column| format!("{} ({})", column.name, column.kind));
        wrong.push(format!(
            "no column of the logs is taken for a temperature: there are {}; name the points with --inputs",
            columns.collect::<Vec<String>>().join(", ")
        ));
    }
    found
}
