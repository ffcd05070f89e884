//! Checks the chosen log columns against the profile and the logs. Every error is a message that tells the operator
//! what to do.

use std::time::Duration;

use crate::ambient;
use crate::applied::{self, Applied};
use crate::campaign::{Campaign, Input, Position, temperatures_of, without};
use crate::checks::{
    check_error, check_plausible, check_runs, fahrenheit, nearest, unused_position, why_lost,
};
use crate::dataset::{BadLog, Dataset, Kind, Run};
use crate::faults::mend::{Mended, mend};
use crate::faults::{self, Notes, Repaired};
use crate::{incomplete, omission, touches};
use isotherm_core::reading::SignalId;
use isotherm_profile::{Profile, Signal};
use sound_sensors::{SoundSensors, examine};

mod sound_sensors;

/// Choice of the operator: log columns and their use. Without a profile, `axis` and `position` are ignored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// Name of the axis; `None` means the only axis of the profile.
    pub axis: Option<String>,
    /// Log column with the measured error; `None` means `<axis>_error_um`.
    pub error: Option<String>,
    /// Names of the inputs. If the list is empty, every temperature of the profile that the logs contain is an input.
    pub inputs: Vec<String>,
    /// Whether the speeds of the profile are also inputs, if all logs contain them.
    pub speeds: bool,
    /// Inputs that are left out.
    pub without: Vec<String>,
    /// Names of inputs that are used although they appear to be faulty.
    pub keep: Vec<String>,
    /// Time over which log rows are averaged; zero means no averaging.
    pub resample: Duration,
    /// Name of the position signal of the axis, and the position at which the slope adds nothing to Cz (the
    /// compensation value), mm. `None` without a slope.
    pub position: Option<(String, f64)>,
}

/// Checked runs and inputs, from which a model can be identified.
#[derive(Clone, Debug)]
pub struct Ready<'a> {
    /// Runs, as the gateway would read them through the signals of the profile.
    pub(crate) campaign: Campaign<'a>,
    /// Name of the axis.
    pub axis: String,
    /// Logs as they were recorded, without repairs.
    pub logs: &'a Dataset,
    /// Remarks about the sensors and the logs.
    pub notes: Notes,
    /// Sensors that were faulty in a run, with the repair of their readings.
    pub repaired: Vec<Repaired>,
}

impl Ready<'_> {
    /// Returns half a count (smallest step) of the offset register of the axis, µm. If the axis has no output, a count
    /// of 0.1 µm is assumed, which is usual for a CNC.
    pub(crate) fn half_a_count(&self) -> f64 {
        const USUAL: f64 = 0.1;
        let own = self.campaign.axes.iter().find(|axis| axis.name == self.axis);
        0.5 * own.and_then(|axis| axis.guard.count).map_or(USUAL, |count| count.get())
    }
}

/// Removes the active Cz (the compensation value that was active during the measurement) from the measured error. The
/// Cz is in a log of the gateway, or in the column that `applied` names. Touches of a probe are converted to measured
/// errors, too. Runs with touches are divided at each datum (zero point).
///
/// # Errors
/// Returns a message if the active Cz cannot be determined.
pub fn without_cz(
    profile: &Profile,
    dataset: &mut Dataset,
    choice: &Choice,
    applied: &Applied,
) -> Result<(), BadLog> {
    // `ready` reports a missing axis or column.
    let Some(axis) = axis(profile, choice, &mut Vec::new()) else { return Ok(()) };
    let (moves, error) = (applied::moves_the_machine(profile, &axis), choice.error_of(&axis));
    touches::merge(profile, dataset, (&axis, &error), applied)?;
    applied::without_cz(dataset, &error, Some(&axis), moves, applied)
}

/// Handles incomplete runs: a run may lack an input that other runs have. Leaves out either these runs or the
/// input, whichever gives the smaller error. A remark of the dataset states the choice.
pub fn without_incomplete(profile: &Profile, dataset: &mut Dataset, choice: &Choice) {
    let Some(error) = dataset.column(&choice.error_column(profile)) else { return };
    // `ready` refuses copies. With a moving axis, the error must first be separated by place.
    if !dataset.repeats.is_empty() || choice.position.is_some() {
        return;
    }
    let inputs_of = |dataset: &Dataset| inputs(profile, dataset, choice, &mut Vec::new(), &mut Vec::new());
    let mut columns: Vec<usize> = inputs_of(dataset).iter().map(|input| input.column).collect();
    if choice.speeds && choice.inputs.is_empty() {
        let names = profile.signals.iter().filter(|signal| signal.unit.0 == "rpm").map(|signal| &signal.name);
        columns.extend(
            names.filter(|name| !choice.without.contains(name)).filter_map(|name| dataset.column(name)),
        );
    }
    let left = |dataset: &Dataset, tested: &[usize]| {
        let all = inputs_of(dataset);
        let mut assessed = temperatures_of(dataset, &all);
        assessed.retain(|column| !choice.keep.contains(&dataset.columns[*column].name));
        let Mended { mending, excluded, .. } = mend(dataset, &assessed, &[]);
        let good = without(&all, &excluded);
        if good.is_empty() {
            return None;
        }
        let campaign = Campaign::new(profile, dataset, error, good, choice.resample).with_mending(mending);
        omission::left_in(&campaign, tested)
    };
    incomplete::leave_out(dataset, &columns, &left);
}

impl Choice {
    /// Returns the name of the log column with the measured error: the name that the operator chose, or
    /// `<axis>_error_um`.
    #[must_use]
    pub fn error_column(&self, profile: &Profile) -> String {
        // `ready` reports a missing axis.
        self.error_of(&axis(profile, self, &mut Vec::new()).unwrap_or_default())
    }

    /// Returns the names of two log columns: the touches of the axis, and the Cz (compensation value) that was active
    /// during each touch.
    #[must_use]
    pub(crate) fn touch_columns(&self, profile: &Profile) -> [String; 2] {
        touches::columns(&axis(profile, self, &mut Vec::new()).unwrap_or_default())
    }

    fn error_of(&self, axis: &str) -> String {
        self.error.clone().unwrap_or_else(|| format!("{axis}_error_um"))
    }
}

/// Returns a function that returns the unit of a log column in the profile; `None` if the column is not a signal of the
/// profile.
pub fn units(profile: &Profile) -> impl Fn(&str) -> Option<&'static str> + '_ {
    |name| profile.signals.iter().find(|signal| signal.name == name).map(|signal| signal.unit.0)
}

/// Checks the choice of the operator. Repairs faulty sensors, or leaves them out.
///
/// # Errors
/// The choice does not fit the profile or the logs, or a log is unusual. All errors are returned as messages.
pub fn ready<'a>(profile: &Profile, dataset: &'a Dataset, choice: &Choice) -> Result<Ready<'a>, BadLog> {
    let mut wrong = Vec::new();
    let axis = axis(profile, choice, &mut wrong);
    let error = match (&choice.error, &axis) {
        (None, None) => None,
        (name, axis) => {
            let name = name.clone().unwrap_or_else(|| choice.error_of(axis.as_deref().unwrap_or_default()));
            let found = dataset.column(&name);
            if found.is_none() {
                let why = match why_lost(dataset, &name) {
                    why if why.is_empty() => nearest(&name, &dataset.names()),
                    why => why,
                };
                wrong.push(format!(
                    "no log has a column `{name}` with the measured error in µm (write the name of that column \
                     after --error){why}"
                ));
            }
            found
        }
    };
    check_runs(dataset, &mut wrong);
    let mut remarks = dataset.remarks.clone();
    let inputs = inputs(profile, dataset, choice, &mut wrong, &mut remarks);
    let temperatures = temperatures_of(dataset, &inputs);
    check_plausible(dataset, inputs.iter().map(|input| input.column).chain(error), &mut wrong);
    wrong.extend(fahrenheit(dataset, &temperatures));
    let position = choice.position.as_ref().and_then(|(name, reference)| {
        let input = input(profile, dataset, name, " with the position of the axis", &mut wrong)?;
        Some(Position { input, reference: *reference })
    });
    if let Some(error) = error {
        check_error(dataset, error, &mut wrong);
    }
    let (Some(axis), Some(error), true) = (axis, error, wrong.is_empty()) else { return Err(BadLog(wrong)) };
    if position.is_none() {
        remarks.extend(unused_position(dataset, error));
    }
    let SoundSensors { mut campaign, excluded, omissions, repaired, remarks: found } =
        examine(profile, dataset, choice, error, &inputs)?;
    remarks.extend(found);
    if profile.machine.settle.is_zero() {
        remarks.push(
            "the profile has no machine.settle, so each reference is the mean of the first 3 minutes: write \
             settle = \"3min\" under [machine]"
                .to_owned(),
        );
    }
    let ambient = ambient::find(dataset, &temperatures_of(dataset, &campaign.inputs), error);
    if position.is_some() {
        // Places that are visited in turn must not be averaged.
        campaign.resample = Duration::ZERO;
        campaign.position = position;
    }
    let notes = Notes { excluded, omissions, ambient, remarks };
    Ok(Ready { campaign, axis, logs: dataset, notes, repaired })
}

fn axis(profile: &Profile, choice: &Choice, wrong: &mut Vec<String>) -> Option<String> {
    let names: Vec<&str> = profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    let why = match (&choice.axis, names.as_slice()) {
        (Some(asked), _) if names.contains(&asked.as_str()) => return Some(asked.clone()),
        (Some(asked), _) => format!("the profile has no axis `{asked}`{}", nearest(asked, &names)),
        (None, [only]) => return Some((*only).to_owned()),
        (None, []) => "the profile has no axis; add [axis.z]".to_owned(),
        (None, _) => {
            format!("the profile has several axes: write one of them after --axis: {}", names.join(", "))
        }
    };
    wrong.push(why);
    None
}

fn signals(profile: &Profile) -> Vec<&str> {
    profile.signals.iter().map(|signal| signal.name.as_str()).collect()
}

/// Returns the index of the signal with this name. If the profile has no such signal, adds a message to `wrong` and
/// returns `None`.
fn signal(profile: &Profile, name: &str, wrong: &mut Vec<String>) -> Option<SignalId> {
    let signals = signals(profile);
    let found = signals.iter().position(|signal| *signal == name);
    if found.is_none() {
        wrong.push(format!("the profile has no signal `{name}`{}", nearest(name, &signals)));
    }
    found.map(SignalId)
}

/// Returns the input for a signal that is in the profile and in the logs. Otherwise, adds a message to `wrong` and
/// returns `None`.
fn input(
    profile: &Profile,
    dataset: &Dataset,
    name: &str,
    what: &str,
    wrong: &mut Vec<String>,
) -> Option<Input> {
    let signal = signal(profile, name, wrong)?;
    let column = dataset.column(name);
    if column.is_none() {
        wrong.push(format!("no log has a column `{name}`{what}{}", why_lost(dataset, name)));
    }
    let unit = profile.signals[signal.0].unit;
    Some(Input { name: name.to_owned(), signal, column: column?, unit })
}

fn inputs(
    profile: &Profile,
    dataset: &Dataset,
    choice: &Choice,
    wrong: &mut Vec<String>,
    remarks: &mut Vec<String>,
) -> Vec<Input> {
    let mut found: Vec<Input> =
        choice.inputs.iter().filter_map(|name| input(profile, dataset, name, "", wrong)).collect();
    if choice.inputs.is_empty() {
        let is_temperature = |signal: &&Signal| ["degC", "K"].contains(&signal.unit.0);
        let temperatures = profile.signals.iter().filter(is_temperature).map(|signal| signal.name.as_str());
        let (there, missing): (Vec<&str>, Vec<&str>) =
            temperatures.partition(|name| dataset.column(name).is_some());
        found = there.into_iter().filter_map(|name| input(profile, dataset, name, "", wrong)).collect();
        if !missing.is_empty() && !found.is_empty() {
            remarks.push(format!("temperatures of the profile that no log contains: {}", missing.join(", ")));
        }
        let signals = signals(profile);
        let logged = dataset.columns.iter().chain(&dataset.unread);
        let logged =
            logged.filter(|column| column.kind == Kind::Temperature).map(|column| column.name.as_str());
        let unknown: Vec<&str> = logged.filter(|name| !signals.contains(name)).collect();
        if !unknown.is_empty() {
            remarks.push(format!(
                "columns that are not used, because the profile has no signal with this name: {}. To use such \
                 a column, add a table [signal.…] for it",
                unknown.join(", ")
            ));
        }
        if found.is_empty() {
            wrong.push(format!(
                "no temperature of the profile ({}) has the same name as a column of the logs ({}). Use the \
                 same names in the profile and in the logs",
                signals.join(", "),
                dataset.names().join(", ")
            ));
        }
    }
    for name in choice.without.iter().chain(&choice.keep) {
        signal(profile, name, wrong);
    }
    if choice.speeds && !found.is_empty() {
        let speeds = speeds(profile, dataset, choice, remarks);
        found.extend(speeds.iter().filter_map(|name| input(profile, dataset, name, "", wrong)));
    }
    found.retain(|input| !choice.without.contains(&input.name));
    found
}

/// Returns the speeds that change in at least one run, and have values in all runs. A speed that is missing in a run is
/// left out, because a model cannot use a row in which an input is missing.
fn speeds<'a>(
    profile: &'a Profile,
    dataset: &Dataset,
    choice: &Choice,
    remarks: &mut Vec<String>,
) -> Vec<&'a str> {
    let mut speeds = Vec::new();
    let names = profile.signals.iter().filter(|signal| signal.unit.0 == "rpm").map(|signal| &signal.name);
    for name in names.filter(|name| !choice.inputs.contains(name) && !choice.without.contains(name)) {
        let turns = |column: &usize| dataset.runs.iter().any(|run| run.range(*column) > 0.0);
        let Some(column) = dataset.column(name).filter(turns) else { continue };
        let share = |run: &Run| faults::missing(run, column);
        if !choice.inputs.is_empty() {
            remarks.push(format!("{name} is not an input, because it is not in the list after --inputs"));
        } else if let Some(run) = dataset.runs.iter().find(|run| share(run) > faults::MISSING) {
            remarks.push(format!(
                "{name} is not an input, because it is missing in {:.0} % of the rows in {}",
                100.0 * share(run),
                run.name
            ));
        } else {
            speeds.push(name.as_str());
        }
    }
    speeds
}
