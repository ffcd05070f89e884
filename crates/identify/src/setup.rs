//! What is asked, checked against the profile and the logs: every mistake in a sentence that says what to do.

use std::time::Duration;

use crate::ambient::{self, AmbientLike};
use crate::applied::{self, Applied};
use crate::campaign::{Campaign, Input, Position, temperatures_of};
use crate::checks::{check_error, check_runs, check_units, nearest};
use crate::dataset::{BadLog, Dataset, Kind};
use crate::faults::mend::{Mended, mend};
use crate::faults::{self, Excluded, Repaired};
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;

/// Which columns are what.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// The axis's name; `None`: the profile's only one.
    pub axis: Option<String>,
    /// The column with the measured error; `None`: `<axis>_error_um`.
    pub error: Option<String>,
    /// The inputs; empty: every temperature of the profile that is in the logs.
    pub inputs: Vec<String>,
    /// Inputs that are left out.
    pub without: Vec<String>,
    /// Inputs that stay in though they look faulty.
    pub keep: Vec<String>,
    /// Rows are averaged over this long.
    pub resample: Duration,
    /// The signal that says where the axis was, and where the slope adds nothing, mm.
    pub position: Option<(String, f64)>,
}

/// A campaign that can be learnt from.
#[derive(Clone, Debug)]
pub struct Ready<'a> {
    /// The runs through the profile's signals.
    pub campaign: Campaign<'a>,
    /// The axis's name.
    pub axis: String,
    /// The logs as they were recorded.
    pub logs: &'a Dataset,
    /// Sensors that were left out.
    pub excluded: Vec<Excluded>,
    /// Inputs that behave like the air.
    pub ambient: Vec<AmbientLike>,
    /// Sensors that were faulty in a run, and what their readings were replaced by.
    pub repaired: Vec<Repaired>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// Takes out of the measured error the Cz that acted on it, where a log of the gateway or `applied` has it.
///
/// # Errors
/// What acted cannot be known.
pub fn without_cz(
    profile: &Profile,
    dataset: &mut Dataset,
    choice: &Choice,
    applied: &Applied,
) -> Result<(), BadLog> {
    // An axis or a column that is not there is told by `ready`.
    let Some(axis) = axis(profile, choice, &mut Vec::new()) else { return Ok(()) };
    let error = choice.error.clone().unwrap_or_else(|| format!("{axis}_error_um"));
    applied::bare(dataset, &error, Some(&axis), applied::moves_the_machine(profile, &axis), applied)
}

/// Checks the choice, and mends what faulty sensors spoilt or leaves them out.
///
/// # Errors
/// Everything that is wrong, in sentences.
pub fn ready<'a>(profile: &Profile, dataset: &'a Dataset, choice: &Choice) -> Result<Ready<'a>, BadLog> {
    let mut wrong = Vec::new();
    let axis = axis(profile, choice, &mut wrong);
    let error = error_column(dataset, choice, axis.as_deref(), &mut wrong);
    check_runs(dataset, &mut wrong);
    let mut remarks = dataset.remarks.clone();
    let inputs = inputs(profile, dataset, choice, &mut wrong, &mut remarks);
    check_units(dataset, &inputs, &mut wrong);
    let position = position(profile, dataset, choice, &mut wrong);
    if let Some(error) = error {
        check_error(dataset, error, &mut wrong);
    }
    let (Some(axis), Some(error), true) = (axis, error, wrong.is_empty()) else { return Err(BadLog(wrong)) };
    let temperatures = temperatures_of(dataset, &inputs);
    let (kept, judged): (Vec<usize>, Vec<usize>) =
        (temperatures.iter()).partition(|column| choice.keep.contains(&dataset.columns[**column].name));
    if !kept.is_empty() {
        let found = faults::find(dataset, &temperatures);
        for faulty in found.iter().filter(|faulty| choice.keep.contains(&faulty.signal)) {
            remarks.push(format!("{} stays in as asked, though it {}", faulty.signal, faulty.reason));
        }
    }
    let Mended { mending, excluded, repaired } = mend(dataset, &judged);
    let good: Vec<Input> = inputs
        .into_iter()
        .filter(|input| !excluded.iter().any(|faulty| faulty.signal == input.name))
        .collect();
    if good.is_empty() {
        let reasons = excluded.iter().map(|faulty| format!("{}: {}", faulty.signal, faulty.reason));
        let reasons: Vec<String> = reasons.collect();
        return Err(BadLog(vec![format!(
            "no sensor is left to learn from: {}; --keep NAME keeps one in all the same",
            reasons.join("; ")
        )]));
    }
    if profile.machine.settle.is_zero() {
        remarks.push(
            "the profile has no machine.settle; references were taken as the mean of the first 3 minutes: write \
             settle = \"3min\" under [machine]"
                .to_owned(),
        );
    }
    let ambient = ambient::find(dataset, &temperatures_of(dataset, &good), error);
    let mut campaign =
        Campaign::new(profile, dataset, error, choice.resample).with_inputs(good).with_mending(mending);
    if position.is_some() {
        // Places that are visited in turn must not be averaged.
        campaign.resample = Duration::ZERO;
        campaign.position = position;
    }
    Ok(Ready { campaign, axis, logs: dataset, excluded, ambient, repaired, remarks })
}

fn axis(profile: &Profile, choice: &Choice, wrong: &mut Vec<String>) -> Option<String> {
    let names: Vec<&str> = profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    match (&choice.axis, names.as_slice()) {
        (Some(wanted), _) if names.contains(&wanted.as_str()) => return Some(wanted.clone()),
        (Some(wanted), _) => {
            wrong.push(format!("the profile has no axis `{wanted}`{}", nearest(wanted, &names)))
        }
        (None, [only]) => return Some((*only).to_owned()),
        (None, []) => wrong.push("the profile has no axis; add [axis.z]".to_owned()),
        (None, _) => wrong.push(format!("name the axis with --axis: one of {}", names.join(", "))),
    }
    None
}

fn error_column(
    dataset: &Dataset,
    choice: &Choice,
    axis: Option<&str>,
    wrong: &mut Vec<String>,
) -> Option<usize> {
    let name = match (&choice.error, axis) {
        (Some(name), _) => name.clone(),
        (None, Some(axis)) => format!("{axis}_error_um"),
        (None, None) => return None,
    };
    let found = dataset.column(&name);
    if found.is_none() {
        let names: Vec<&str> = dataset.columns.iter().map(|column| column.name.as_str()).collect();
        wrong.push(format!(
            "no log has a column `{name}` with the measured error in µm{}; name it with --error",
            nearest(&name, &names)
        ));
    }
    found
}

fn inputs(
    profile: &Profile,
    dataset: &Dataset,
    choice: &Choice,
    wrong: &mut Vec<String>,
    remarks: &mut Vec<String>,
) -> Vec<Input> {
    let signals: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
    let mut found = Vec::new();
    if choice.inputs.is_empty() {
        let mut missing = Vec::new();
        for (place, signal) in profile.signals.iter().enumerate() {
            let is_temperature = ["degC", "K"].contains(&signal.unit.0);
            match dataset.column(&signal.name) {
                Some(column) if is_temperature => {
                    found.push(Input { name: signal.name.clone(), signal: SignalId(place), column });
                }
                None if is_temperature => missing.push(signal.name.as_str()),
                _ => {}
            }
        }
        if !missing.is_empty() && !found.is_empty() {
            remarks.push(format!("in the profile, but not in the logs: {}", missing.join(", ")));
        }
        let unknown: Vec<&str> = dataset
            .columns
            .iter()
            .filter(|column| column.kind == Kind::Temperature && !signals.contains(&column.name.as_str()))
            .map(|column| column.name.as_str())
            .collect();
        if !unknown.is_empty() {
            remarks.push(format!(
                "in the logs, but not in the profile, and so left out: {}; a [signal.…] each lets them be used",
                unknown.join(", ")
            ));
        }
        if found.is_empty() {
            let columns: Vec<&str> = dataset.columns.iter().map(|column| column.name.as_str()).collect();
            wrong.push(format!(
                "no temperature of the profile ({}) is a column of the logs ({}): give both the same names",
                signals.join(", "),
                columns.join(", ")
            ));
        }
    }
    for name in &choice.inputs {
        let place = signals.iter().position(|signal| signal == name);
        match (place, dataset.column(name)) {
            (Some(place), Some(column)) => {
                found.push(Input { name: name.clone(), signal: SignalId(place), column });
            }
            (None, _) => wrong.push(format!("the profile has no signal `{name}`{}", nearest(name, &signals))),
            (_, None) => wrong.push(format!("no log has a column `{name}`")),
        }
    }
    for name in choice.without.iter().chain(&choice.keep) {
        if !signals.contains(&name.as_str()) {
            wrong.push(format!("the profile has no signal `{name}`{}", nearest(name, &signals)));
        }
    }
    found.retain(|input| !choice.without.contains(&input.name));
    found
}

fn position(
    profile: &Profile,
    dataset: &Dataset,
    choice: &Choice,
    wrong: &mut Vec<String>,
) -> Option<Position> {
    let (name, reference) = choice.position.as_ref()?;
    let signal = profile.signals.iter().position(|signal| signal.name == *name);
    match (signal, dataset.column(name)) {
        (Some(signal), Some(column)) => {
            Some(Position { name: name.clone(), signal: SignalId(signal), column, reference: *reference })
        }
        (None, _) => {
            let signals: Vec<&str> = profile.signals.iter().map(|signal| signal.name.as_str()).collect();
            wrong.push(format!("the profile has no signal `{name}`{}", nearest(name, &signals)));
            None
        }
        (_, None) => {
            wrong.push(format!("no log has a column `{name}` with the position of the axis"));
            None
        }
    }
}
