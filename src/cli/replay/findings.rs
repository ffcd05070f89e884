//! Findings at one row of a log: sensors of an axis that are not used, and the reason why the axis is on hold.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use crate::gateway::log::LogRow;
use crate::gateway::why_by_decision;
use isotherm_core::compensation::model::{Model, StandIns};
use isotherm_core::compensation::{AxisState, Compensation, Permit, RejectedSensor};
use isotherm_core::explained::Explained;
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{Profile, duration_text};

/// Sensor whose value is calculated from other sensors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StandIn {
    /// Signal of the sensor.
    pub signal: String,
    /// Reason why the sensor itself is not used.
    pub kind: SensorFault,
    /// Duration of the fault at the start of the time span, s: time since the reading last changed (frozen) or was last
    /// good (lost).
    pub for_s: f64,
    /// Signals of the other sensors from which the value is calculated.
    pub by: Vec<String>,
}

/// Fault of a sensor whose value is calculated from other sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorFault {
    /// The reading does not change.
    Frozen,
    /// The sensor has no good reading; or its readings are good again, but have not yet agreed with the other sensors
    /// for long enough.
    Lost,
}

/// Sensor that is suspected of being frozen. Its reading is still used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Suspicion {
    /// Signal of the sensor.
    pub signal: String,
    /// Time since the last change of the reading, at the start of the time span, s.
    pub for_s: f64,
    /// Reason why the sensor was not replaced by a calculated value at the start of the time span.
    pub why: String,
}

/// Axis whose Cz does not follow a model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hold {
    /// State of the axis: holding, ramping or zeroed.
    pub state: &'static str,
    /// Cause of the state, as text.
    pub why: String,
}

/// Whether an axis is on hold after a log row. On hold means that its Cz does not follow a model.
#[derive(Debug)]
pub(super) enum HoldChange {
    /// The axis made no decision at this log row, so the earlier result remains valid.
    AsBefore,
    /// The axis follows a model, is off, or stops because the gateway stops.
    No,
    /// The axis keeps its Cz, or its Cz goes to zero or is zero.
    Yes(Hold),
}

/// Findings about one axis at one log row.
#[derive(Debug)]
pub(super) struct Findings {
    pub(super) stand_ins: Vec<StandIn>,
    pub(super) suspicions: Vec<Suspicion>,
    pub(super) held: HoldChange,
}

impl Findings {
    /// Returns the findings about an axis after the decisions at this log row.
    pub(super) fn of(profile: &Profile, compensation: &Compensation, axis: usize, row: &LogRow) -> Findings {
        let (mut stand_ins, mut suspicions) = (Vec::new(), Vec::new());
        let rejected: Vec<RejectedSensor> = compensation.rejected(axis).collect();
        let models = profile.axes.get(axis).map_or(&[][..], |axis| &axis.settings.models);
        let used = compensation.decision(axis).and_then(|decision| decision.model);
        for found in &rejected {
            let Some((place, watch)) = watching(models, used, found.signal) else { continue };
            let signal = profile.signal(found.signal).name.clone();
            let for_s = row.now.since(found.since).as_secs_f64();
            if found.others.is_some() {
                let kind = if found.frozen { SensorFault::Frozen } else { SensorFault::Lost };
                let others = predictors(watch, found.signal).into_iter();
                let by = others.map(|id| profile.signal(id).name.clone()).collect();
                stand_ins.push(StandIn { signal, kind, for_s, by });
            } else if found.frozen {
                let is_used = used.is_none_or(|used| used == place);
                let why = match is_used {
                    true => why_not_replaced(profile, watch, found.signal, &rejected, &row.readings),
                    false => "the model in use has no stand-in for this sensor".to_owned(),
                };
                suspicions.push(Suspicion { signal, for_s, why });
            }
        }
        Findings { stand_ins, suspicions, held: held(profile, compensation, axis, row) }
    }
}

/// Returns the stand-ins (calculated values for lost sensors) that supervise a sensor, with the index of
/// their model. The model in use has priority over the other models, which follow in their order. `None` if
/// no model has stand-ins that supervise the sensor.
fn watching(models: &[Model], used: Option<usize>, signal: SignalId) -> Option<(usize, &StandIns)> {
    let others = (0..models.len()).filter(|place| Some(*place) != used);
    let places = used.into_iter().chain(others);
    let mut all = places.filter_map(|place| Some((place, models.get(place)?.stand_ins.as_ref()?)));
    all.find(|(_, stand_ins)| stand_ins.watched().any(|(watched, _)| watched == signal))
}

/// Returns the signals from which the stand-in of a sensor is calculated, without duplicates.
fn predictors(stand_ins: &StandIns, signal: SignalId) -> Vec<SignalId> {
    let mut all = Vec::new();
    for id in stand_ins.predictors(signal) {
        if !all.contains(&id) {
            all.push(id);
        }
    }
    all
}

/// Returns why a suspected sensor was not replaced by a stand-in. `rejected`: all sensors of the axis that are
/// suspected, frozen or lost.
fn why_not_replaced(
    profile: &Profile,
    stand_ins: &StandIns,
    signal: SignalId,
    rejected: &[RejectedSensor],
    readings: &[Reading],
) -> String {
    let name = |id: SignalId| &profile.signal(id).name;
    let others = predictors(stand_ins, signal);
    if let [only] = others[..] {
        return format!("the stand-in depends on {} alone", name(only));
    }
    let is_distrusted = |id: &&SignalId| rejected.iter().any(|other| other.signal == **id);
    if let Some(doubted) = others.iter().find(is_distrusted) {
        return format!("the stand-in depends on {}, which is frozen or lost, too", name(*doubted));
    }
    let is_missing = |id: &&SignalId| readings.get(id.0).is_none_or(|reading| reading.usable().is_none());
    if let Some(missing) = others.iter().find(is_missing) {
        return format!("the stand-in depends on {}, which has no value", name(*missing));
    }
    "the stand-in would change the target of the axis by more than one `step`, or is outside the range of \
     the sensor"
        .to_owned()
}

/// Returns whether an axis is on hold after this log row, and why.
fn held(profile: &Profile, compensation: &Compensation, axis: usize, row: &LogRow) -> HoldChange {
    let decided = compensation.decision(axis).filter(|decision| decision.at == row.now);
    let Some((decision, control)) = decided.zip(row.controls.get(axis)) else { return HoldChange::AsBefore };
    let holds = matches!(decision.state, AxisState::Holding(_) | AxisState::Ramping | AxisState::Zeroed);
    if !holds || control.permit == Permit::Stopping {
        return HoldChange::No;
    }
    let has_run = compensation.machine().on_time(row.now).is_some();
    let bad = |id: SignalId| -> Explained {
        let name = &profile.signal(id).name;
        match row.readings.get(id.0).map(|reading| reading.quality) {
            Some(Quality::Bad(Reason::NotInLog)) => format!("{name} has no value in the log").into(),
            Some(Quality::Bad(reason)) => format!("{name}: {reason}").into(),
            Some(Quality::Good) | None => format!("{name} had no good value").into(),
        }
    };
    let why = match control.permit {
        Permit::Unverified if !decision.tripped => "the value of an output is not verified".to_owned(),
        Permit::Held if !decision.tripped => "an output is interlocked".to_owned(),
        _ => why_by_decision(profile, axis, decision, has_run, bad).cause,
    };
    let why = match (why.is_empty(), decision.model) {
        (false, _) => why,
        (true, Some(_)) => {
            "the inputs of the axis are not yet clearly back inside the envelope of the model".to_owned()
        }
        (true, None) => "no model of the axis has a value".to_owned(),
    };
    HoldChange::Yes(Hold { state: decision.state.name(), why })
}

/// Formats a time span in whole seconds.
pub(super) fn whole_seconds(seconds: f64) -> String {
    duration_text(Duration::try_from_secs_f64(seconds.round()).unwrap_or_default())
}

/// Formats names as a list: `bed`, `bed and column`, `bed, column and nut`.
fn listed(names: &[String]) -> String {
    match names {
        [] => "no other".to_owned(),
        [one] => one.clone(),
        [before @ .., last] => format!("{} and {last}", before.join(", ")),
    }
}

impl fmt::Display for StandIn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is = match self.kind {
            SensorFault::Frozen => "frozen",
            SensorFault::Lost => "lost",
        };
        let (span, by) = (whole_seconds(self.for_s), listed(&self.by));
        write!(f, "{}, {is} for {span}, replaced by the stand-in of {by}", self.signal)
    }
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = whole_seconds(self.for_s);
        write!(
            f,
            "{}, unchanged for {span}, suspected of being frozen and not replaced: {}",
            self.signal, self.why
        )
    }
}

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.state, self.why)
    }
}
