//! Log of the outputs: CSV, one row for each input of a controller. [`OutputReplay`] computes the same actions from it.
//!
//! ```text
//! time, output, fact, value, moment, action, action_value, action_until, detail
//! ```
//!
//! - `time`: when the controller took the input; RFC 3339 in UTC with every nanosecond, like every moment here.
//! - `output`: name of the output in the profile.
//! - `fact`: the input ([`Input`]), with `value` and `moment` if it has them. Values are counts of the register. An
//!   empty moment never comes.
//! - `action`: the next action ([`Action`]): nothing, until `action_until`; read; keep; write `action_value`; or
//!   repeat, which writes the present register value again. The first byte of a write may be sent until `action_until`.
//!
//! | fact | value | moment |
//! |---|---|---|
//! | `demand`; `detail` (JSON) contains who armed the axis, the interlock if it is not met, the decision (target, time, mode), restarts and pauses | the offset, if there is a decision | a change may be sent until then |
//! | `look`, `goes-along`, `no-answer`, `refused`, `not-sent`, `kept`, `not-kept`, `restarted`, `interlocked`, `released`, `armed-by-person`, `armed-by-policy`, `off`, `paused`, `lapsed` | | |
//! | `on-disk`, `turn-ends`; `too-late`, `unreachable`, `rejected`, `backs-off`: why a write was not sent; `set-taken`, `set-open`, `set-failed`: whether the control took the set | | |
//! | `decided`; `detail` (JSON) contains the target of the offset, if it is known | the offset | a change may be sent until then |
//! | `read` | the register value | time of the request |
//! | `done`, `unknown` | | when the write was sent |
//! | `went-along`, `went-along-unknown` | the value that was sent along | when it was sent |
//! | `applied` | the value that the control applies, in thousandths of a count; empty if it is no number | time of the request |
//! | `applied-no-answer` | | time of the request |
//!
//! `begin` is no input: the controller resumes from the settings and the state in `detail` (JSON). It is the first row
//! of each output in a file and in a run. It is also the first row after rows that a disk did not store. Therefore each
//! file can be replayed by itself. An input that changed nothing and caused no action is left out.
//!
//! Outputs of a set have rows under the name of their set. `set-begin` has settings and state of the set in `detail`.
//! `set` has the input of its controller ([`SetInput`](isotherm_core::output::SetInput)) and the action in `detail`
//! (JSON). `action` is the name of the action: nothing, keep, read, write, write-own, acknowledge, raise, drop.
//!
//! A corrected position has the rows `position-begin` and `position`, with demand, action and result of a turn in
//! `detail`. A turn is one call of a controller by the line task. The Cz in `detail` and the decision to write are
//! replayed; the position itself is not in the log. A heartbeat in a separate register has the rows `heartbeat-begin`
//! and `heartbeat`. A turn has no row if it only repeats the previous one, with a newer position or the next count.
//! `value` of the next row contains the number of such turns, after one minute at the latest.
//!
//! Positions, heartbeats and control words are written repeatedly, whatever the last result was. They also have the
//! rows `fault` (the fault in `detail`, once until a write is answered), `writes` and `failures`. The last two have a
//! number in `value`, counted since `moment`, over one minute or more. If a file begins because the computer's clock
//! was set, its first row is `clock`, with the old and the new time.
//!
//! Earlier versions wrote two more rows. `cz`, of a corrected position, has a changed Cz in `value`, µm. `sealed`, of
//! no output, has the numbers of state and ledger. A replay ignores them.

use serde::{Deserialize, Serialize};

use isotherm_core::output::{
    Action, Condition, Demand, Fact, Input, Mode, NotSent, OutputDecision, Policy, SetCommit, Settings,
    State, Who,
};
use isotherm_core::quantity::{Counts, Moment, Shift, Shifted};

mod controllers;
mod reader;
mod recorder;
mod replay;
#[cfg(test)]
mod tests;

pub use controllers::{
    ControllerSnapshot, ControllerState, HeartbeatSnapshot, HeartbeatTurn, PositionSnapshot, SetSnapshot,
    SetTurn, Turn,
};
pub use reader::{Entry, OutputLogReader, OutputRow};
pub use recorder::OutputRecorder;
pub use replay::{OutputReplay, Replayed};

/// First line of the log, with its line break.
pub const HEADER: &str = "time,output,fact,value,moment,action,action_value,action_until,detail\n";
/// Ending of the file name of the log.
pub const ENDING: &str = ".outputs.csv";

const BEGIN: &str = "begin";
const FAULT: &str = "fault";
const WRITES: &str = "writes";
const FAILURES: &str = "failures";
const CLOCK: &str = "clock";
/// Rows in a log of an earlier version: Cz of a position, and numbers of state and ledger.
const EARLIER: [&str; 2] = ["cz", "sealed"];

/// State from which an output resumes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumeState {
    /// Settings of the output.
    pub settings: Settings,
    /// State of its register.
    pub state: State,
    /// Further state of its controller.
    #[serde(default)]
    pub policy: Policy,
}

/// Detail of a row: the parts of its input other than value and moment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum Detail {
    Demand(DemandDetail),
    Decided(Towards),
}

/// Detail of a decision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Towards {
    /// Target of the offset: counts from the bias, or the gateway share.
    target: Counts,
}

/// Detail of a demand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct DemandDetail {
    #[serde(skip_serializing_if = "Option::is_none")]
    armed: Option<Who>,
    /// `None` if the condition is met.
    #[serde(skip_serializing_if = "Option::is_none")]
    interlock: Option<Condition>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<Counts>,
    /// Time of the decision; `None` without a decision.
    #[serde(skip_serializing_if = "Option::is_none")]
    at: Option<Moment>,
    /// `None` if the axis follows its model.
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
    /// Detail of an input, with its moments as stamps of the file.
    fn of(input: Input, shift: Shift) -> Option<Detail> {
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
    /// Demand of a row. `None` if a decision lacks its offset.
    fn demand(self, offset: Option<Counts>, not_after: Moment) -> Option<Demand> {
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

/// Cells of an input or an action: name, value and moment. [`Moment::END`] is an empty cell.
type Cells = (&'static str, Option<Counts>, Moment);

/// Inputs without value and moment.
const PLAIN: [(&str, Input); 24] = [
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

fn cells_of_input(input: Input) -> Cells {
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

/// Input of this name. `None` if the name is unknown, or if the value is missing.
fn input(name: &str, value: Option<Counts>, moment: Moment) -> Option<Input> {
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

fn cells_of_action(action: Action) -> Cells {
    match action {
        Action::Nothing { until } => ("nothing", None, until),
        Action::Read => ("read", None, Moment::END),
        Action::Keep => ("keep", None, Moment::END),
        Action::Write { value, not_after, is_repeat: false } => ("write", Some(value), not_after),
        Action::Write { value, not_after, is_repeat: true } => ("repeat", Some(value), not_after),
    }
}

fn action(name: &str, value: Option<Counts>, moment: Moment) -> Option<Action> {
    Some(match name {
        "nothing" => Action::Nothing { until: moment },
        "read" => Action::Read,
        "keep" => Action::Keep,
        "write" => Action::Write { value: value?, not_after: moment, is_repeat: false },
        "repeat" => Action::Write { value: value?, not_after: moment, is_repeat: true },
        _ => return None,
    })
}

/// Action as text of a message: `write 120 until 2026-01-31T12:00:00Z`.
fn message(action: Action) -> String {
    let (name, value, moment) = cells_of_action(action);
    let value = value.map_or(String::new(), |value| format!(" {value}"));
    let until = if moment == Moment::END { String::new() } else { format!(" until {moment}") };
    format!("{name}{value}{until}")
}
