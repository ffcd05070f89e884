//! Checks the chosen temperature measuring points against the logs, without a profile.

use crate::ambient;
use crate::campaign::{Campaign, Input, temperatures_of, without};
use crate::checks;
use crate::dataset::{BadLog, Column, Dataset, Kind};
use crate::faults::mend::{Mended, mend};
use crate::faults::{self, Fault, Finding, Frozen, Notes};
use crate::resolution;
use crate::setup::Choice;
use crate::stand_in::freeze::{freezes, untested};
use crate::{incomplete, omission};
use isotherm_core::reading::SignalId;
use isotherm_profile::Unit;

/// Checked measuring points, with the logged runs from which points are selected.
#[derive(Clone, Debug)]
pub struct Pointed<'a> {
    /// Logged runs, in which every column is a signal.
    pub(crate) campaign: Campaign<'a>,
    /// Remarks about the points and the logs.
    pub notes: Notes,
}

/// Checks the chosen points. Leaves faulty sensors out, and masks the rows in which a sensor was frozen.
///
/// # Errors
/// The choice does not fit the logs, or a log is unusual. All errors are returned as messages.
pub fn points<'a>(dataset: &'a Dataset, choice: &Choice) -> Result<Pointed<'a>, BadLog> {
    let mut wrong = Vec::new();
    let error = checks::column_of(dataset, choice.error.as_deref().unwrap_or_default(), &mut wrong);
    wrong.extend(checks::one_run_only(dataset));
    checks::check_runs(dataset, &mut wrong);
    let inputs = inputs(dataset, choice, error, &mut wrong);
    checks::check_plausible(dataset, inputs.iter().map(|input| input.column).chain(error), &mut wrong);
    wrong.extend(checks::fahrenheit(dataset, &temperatures_of(dataset, &inputs)));
    if let Some(error) = error {
        checks::check_error(dataset, error, &mut wrong);
    }
    let (Some(error), true) = (error, wrong.is_empty()) else { return Err(BadLog(wrong)) };
    let columns: Vec<usize> = inputs.iter().map(|input| input.column).collect();
    let (found, remark) = find_freezes(dataset, choice, error, &inputs);
    let is_kept = |faulty: &Finding| choice.keep.contains(&faulty.signal);
    let (mut kept, mut excluded): (Vec<Finding>, Vec<Finding>) =
        faults::find(dataset, &columns, &found).into_iter().partition(is_kept);
    let is_kept = |column: usize| choice.keep.contains(&dataset.columns[column].name);
    let (staying, frozen): (Vec<Frozen>, Vec<Frozen>) =
        found.into_iter().partition(|frozen| is_kept(frozen.column));
    kept.extend(staying.iter().map(|frozen| Fault::frozen(dataset, frozen).finding(dataset, "")));
    let assessed = without(&inputs, &excluded).into_iter().map(|input| input.column);
    let assessed: Vec<usize> = assessed.filter(|column| !is_kept(*column)).collect();
    let Mended { mending, excluded: lost, repaired } = mend(dataset, &assessed, &frozen);
    excluded.extend(lost);
    let mut remarks = dataset.remarks.clone();
    remarks.extend(remark);
    remarks.extend(kept.iter().map(checks::stays));
    remarks.extend(
        repaired.iter().map(|own| format!("{} {} in {}: {}", own.signal, own.fault, own.run, own.done)),
    );
    let good = without(&inputs, &excluded);
    if good.len() < 2 {
        let left_out: Vec<String> =
            excluded.iter().map(|faulty| format!("{} {}", faulty.signal, faulty.reason)).collect();
        let left_out =
            if left_out.is_empty() { String::new() } else { format!(" ({} left out)", left_out.join("; ")) };
        return Err(BadLog(vec![format!(
            "only {} of the temperature points can be used{left_out}, but a selection needs at least two. \
             Name more columns with --inputs, or use a faulty point nevertheless with --keep",
            good.len()
        )]));
    }
    let ambient = ambient::find(dataset, &temperatures_of(dataset, &good), error);
    let campaign = Campaign::of_columns(dataset, error, good, choice.resample).with_mending(mending);
    Ok(Pointed { campaign, notes: Notes { excluded, omissions: Vec::new(), ambient, remarks } })
}

/// Handles incomplete runs: a run may lack a point that other runs have. Leaves out either these runs or the
/// point, whichever gives the smaller error. A remark of the dataset states the choice.
pub fn without_incomplete(dataset: &mut Dataset, choice: &Choice) {
    let error = choice.error.as_deref().and_then(|name| dataset.column(name));
    let Some(error) = error.filter(|_| dataset.repeats.is_empty()) else { return };
    let inputs_of = |dataset: &Dataset| inputs(dataset, choice, Some(error), &mut Vec::new());
    let columns: Vec<usize> = inputs_of(dataset).iter().map(|input| input.column).collect();
    let left = |dataset: &Dataset, tested: &[usize]| {
        let all = inputs_of(dataset);
        let mut assessed: Vec<usize> = all.iter().map(|input| input.column).collect();
        assessed.retain(|column| !choice.keep.contains(&dataset.columns[*column].name));
        let Mended { mending, excluded, .. } = mend(dataset, &assessed, &[]);
        let good = without(&all, &excluded);
        if good.is_empty() {
            return None;
        }
        let campaign = Campaign::of_columns(dataset, error, good, choice.resample).with_mending(mending);
        omission::left_in(&campaign, tested)
    };
    incomplete::leave_out(dataset, &columns, &left);
}

/// Returns all freezes of these points. Points that have another fault are not searched. Also returns a remark if some
/// constant readings could not be tested.
fn find_freezes(
    dataset: &Dataset,
    choice: &Choice,
    error: usize,
    inputs: &[Input],
) -> (Vec<Frozen>, Option<String>) {
    let columns: Vec<usize> = inputs.iter().map(|input| input.column).collect();
    let levelled = faults::levelled(dataset, &columns);
    let mut excluded = faults::find(&levelled, &columns, &[]);
    excluded.retain(|faulty| !choice.keep.contains(&faulty.signal));
    let campaign = Campaign::of_columns(&levelled, error, without(inputs, &excluded), choice.resample);
    let count_of = |column: usize| resolution::estimated(dataset, column);
    (freezes(&campaign, dataset, &count_of), untested(&campaign))
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
            "no column of the logs is a temperature. Columns: {}. Name the columns of the measuring points \
             with --inputs",
            columns.collect::<Vec<String>>().join(", ")
        ));
    }
    found
}
