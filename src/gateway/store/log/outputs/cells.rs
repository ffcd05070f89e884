//! Cells of the output log: names of inputs and actions, and their details as JSON.

use serde::{Deserialize, Serialize};

use isotherm_core::output::{
    Action, Condition, Demand, Fact, Input, Mode, NotSent, OutputDecision, Policy, SetCommit, Settings,
    State, Who,
};
use isotherm_core::quantity::{Counts, Moment, Shift, Shifted};

/// First line of the output log, with its line break.
pub const HEADER: &str = "time,output,fact,value,moment,action,action_value,action_until,detail\n";
/// End of the file name of an output log.
pub const ENDING: &str = ".outputs.csv";

pub(super) const BEGIN: &str = "begin";
pub(super) const FAULT: &str = "fault";
pub(super) const WRITES: &str = "writes";
pub(super) const FAILURES: &str = "failures";
pub(super) const CLOCK: &str = "clock";

/// Settings and state from which the controller of an output continues. They are written to the log.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumeState {
    /// Settings of the output.
    pub settings: Settings,
    /// State of the output's register.
    pub state: State,
    /// Further state of the controller of the output, which is not part of the register state.
    #[serde(default)]
    pub policy: Policy,
}

/// Content of the log column `detail`: all parts of an input except value and moment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Detail {
    Demand(DemandDetail),
    Decided(Towards),
}

/// Content of the log column `detail` for the input `decided`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Towards {
    /// Target of the offset, in counts without the bias of the register. For a shared register, this is the target of
    /// the gateway share.
    pub(super) target: Counts,
}

/// Content of the log column `detail` for the input `demand`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct DemandDetail {
    #[serde(skip_serializing_if = "Option::is_none")]
    armed: Option<Who>,
    /// State of the interlock; `None` if its condition is met.
    #[serde(skip_serializing_if = "Option::is_none")]
    interlock: Option<Condition>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<Counts>,
    /// Time of the axis's decision; `None` without a decision.
    #[serde(skip_serializing_if = "Option::is_none")]
    at: Option<Moment>,
    /// Mode of the axis; `None` if it follows its model.
    #[serde(skip_serializing_if = "Option::is_none")]
    mode: Option<Mode>,
    #[serde(skip_serializing_if = "is_zero")]
    restarts: u64,
    #[serde(skip_serializing_if = "is_zero")]
    pauses: u64,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Detail {
    /// Returns the detail of an input; `None` if the input has no detail. `shift` converts the moments to time stamps
    /// of the file.
    pub(super) fn of(input: Input, shift: Shift) -> Option<Detail> {
        match input {
            Input::Fact(Fact::Decided { target, .. }) => {
                target.map(|target| Detail::Decided(Towards { target }))
            }
            Input::Demand(Demand { armed, interlock, decision, restarts, pauses }) => {
                Some(Detail::Demand(DemandDetail {
                    armed,
                    interlock: (interlock != Condition::Met).then_some(interlock),
                    target: decision.and_then(|decision| decision.target),
                    at: decision.map(|decision| decision.at.shifted(shift)),
                    mode: decision.map(|decision| decision.mode).filter(|mode| *mode != Mode::Follow),
                    restarts,
                    pauses,
                }))
            }
            _ => None,
        }
    }
}

impl DemandDetail {
    /// Returns the demand in a log row. `None` if the row contains a decision, but no offset.
    pub(super) fn demand(self, offset: Option<Counts>, not_after: Moment) -> Option<Demand> {
        let DemandDetail { armed, interlock, target, at, mode, restarts, pauses } = self;
        let decision = match at {
            Some(at) => Some(OutputDecision {
                offset: offset?,
                target,
                at,
                not_after,
                mode: mode.unwrap_or_default(),
            }),
            None => None,
        };
        Some(Demand { armed, interlock: interlock.unwrap_or(Condition::Met), decision, restarts, pauses })
    }
}

/// Cells of a log row for an input or an action: name, value and moment. The moment [`Moment::END`] is an empty cell.
type Cells = (&'static str, Option<Counts>, Moment);

/// Names of the inputs without value and moment.
pub(super) const PLAIN: [(&str, Input); 24] = [
    ("look", Input::Fact(Fact::Look)),
    ("goes-along", Input::Fact(Fact::PiggybackAsked)),
    ("no-answer", Input::Fact(Fact::NoAnswer)),
    ("refused", Input::Fact(Fact::Refused)),
    ("not-sent", Input::Fact(Fact::NotSent)),
    ("kept", Input::Fact(Fact::Kept)),
    ("not-kept", Input::Fact(Fact::NotKept)),
    ("restarted", Input::Fact(Fact::Restarted)),
    ("interlocked", Input::Fact(Fact::Interlocked)),
    ("released", Input::Fact(Fact::Released)),
    ("armed-by-person", Input::Fact(Fact::Armed { by: Who::Person })),
    ("armed-by-policy", Input::Fact(Fact::Armed { by: Who::Policy })),
    ("off", Input::Fact(Fact::Off)),
    ("paused", Input::Fact(Fact::Paused)),
    ("lapsed", Input::Fact(Fact::Lapsed)),
    ("on-disk", Input::OnDisk),
    ("turn-ends", Input::TurnEnds),
    ("too-late", Input::NotSent(NotSent::TooLate)),
    ("unreachable", Input::NotSent(NotSent::Unreachable)),
    ("rejected", Input::NotSent(NotSent::Rejected)),
    ("backs-off", Input::NotSent(NotSent::BacksOff)),
    ("set-taken", Input::Set(SetCommit::Taken)),
    ("set-open", Input::Set(SetCommit::Open)),
    ("set-failed", Input::Set(SetCommit::Failed)),
];

pub(super) fn cells_of_input(input: Input) -> Cells {
    match input {
        Input::Demand(demand) => {
            let decision = demand.decision;
            ("demand", decision.map(|one| one.offset), decision.map_or(Moment::END, |one| one.not_after))
        }
        Input::Fact(Fact::Decided { offset, target: _, not_after }) => ("decided", Some(offset), not_after),
        Input::Fact(Fact::Piggybacked { value, left, is_done: true }) => ("went-along", Some(value), left),
        Input::Fact(Fact::Piggybacked { value, left, is_done: false }) => {
            ("went-along-unknown", Some(value), left)
        }
        Input::Fact(Fact::Read { found, asked }) => ("read", Some(found), asked),
        Input::Fact(Fact::Done { left }) => ("done", None, left),
        Input::Fact(Fact::Unknown { left }) => ("unknown", None, left),
        Input::Applied { found, asked } => ("applied", found.map(Counts), asked),
        Input::AppliedNoAnswer { asked } => ("applied-no-answer", None, asked),
        Input::Fact(_) | Input::NotSent(_) | Input::OnDisk | Input::Set(_) | Input::TurnEnds => {
            let named = PLAIN.iter().find(|(_, plain)| *plain == input);
            (named.map_or("", |(name, _)| *name), None, Moment::END)
        }
    }
}

/// Returns the input with this name. `None` if the name is unknown, or if the value is missing.
pub(super) fn input(name: &str, value: Option<Counts>, moment: Moment) -> Option<Input> {
    Some(match name {
        // The caller adds the detail.
        "demand" => Input::Demand(DemandDetail::default().demand(value, moment)?),
        "decided" => Input::Fact(Fact::Decided { offset: value?, target: None, not_after: moment }),
        "went-along" => Input::Fact(Fact::Piggybacked { value: value?, left: moment, is_done: true }),
        "went-along-unknown" => {
            Input::Fact(Fact::Piggybacked { value: value?, left: moment, is_done: false })
        }
        "read" => Input::Fact(Fact::Read { found: value?, asked: moment }),
        "done" => Input::Fact(Fact::Done { left: moment }),
        "unknown" => Input::Fact(Fact::Unknown { left: moment }),
        "applied" => Input::Applied { found: value.map(|value| value.0), asked: moment },
        "applied-no-answer" => Input::AppliedNoAnswer { asked: moment },
        _ => return PLAIN.iter().find(|(plain, _)| *plain == name).map(|(_, input)| *input),
    })
}

pub(super) fn cells_of_action(action: Action) -> Cells {
    match action {
        Action::Nothing { until } => ("nothing", None, until),
        Action::Read => ("read", None, Moment::END),
        Action::Keep => ("keep", None, Moment::END),
        Action::Write { value, not_after, is_repeat: false } => ("write", Some(value), not_after),
        Action::Write { value, not_after, is_repeat: true } => ("repeat", Some(value), not_after),
    }
}

pub(super) fn action(name: &str, value: Option<Counts>, moment: Moment) -> Option<Action> {
    Some(match name {
        "nothing" => Action::Nothing { until: moment },
        "read" => Action::Read,
        "keep" => Action::Keep,
        "write" => Action::Write { value: value?, not_after: moment, is_repeat: false },
        "repeat" => Action::Write { value: value?, not_after: moment, is_repeat: true },
        _ => return None,
    })
}

/// Formats an action for a message, for example `write 120 until 2026-01-31T12:00:00Z`.
pub(super) fn message(action: Action) -> String {
    let (name, value, moment) = cells_of_action(action);
    let value = value.map_or(String::new(), |value| format!(" {value}"));
    let until = if moment == Moment::END { String::new() } else { format!(" until {moment}") };
    format!("{name}{value}{until}")
}
