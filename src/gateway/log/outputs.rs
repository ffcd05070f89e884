//! The log of what stands between decisions and registers: CSV, one row per fact that an output took, from which
//! [`OutputReplay`] gives the same actions again.
//!
//! ```text
//! time, output, fact, value, moment, action, action_value, action_until, detail
//! ```
//!
//! - `time`: when the output took the fact; RFC 3339 in UTC with every nanosecond, like every moment here.
//! - `output`: its name in the profile.
//! - `fact`: what had happened ([`Fact`]), with `value` and `moment` as far as it has them. Values are counts of the
//!   register. A moment that is empty never comes.
//! - `action`: what was to be done next ([`Action`]): nothing, until `action_until`; read; keep; write `action_value`,
//!   whose first byte may leave until `action_until`; repeat, the same of what stands there already.
//!
//! | fact | value | moment |
//! |---|---|---|
//! | `look`, `goes-along`, `no-answer`, `refused`, `not-sent`, `kept`, `not-kept`, `restarted`, `interlocked`, `released`, `armed-by-person`, `armed-by-policy`, `off`, `paused` | | |
//! | `decided`; in `detail` the target that the offset is on its way to (JSON), if it is known | the offset | a change may be sent until then |
//! | `read` | what stands there | when that was asked |
//! | `done`, `unknown` | | when the write had left |
//! | `went-along`, `went-along-unknown` | what went along | when it had left |
//!
//! `begin` is no fact: from here on the output goes on from `detail`, its settings and its state (JSON). It is the first
//! row of each output in a file and in a run, and the first after rows that a disk did not take: so each file is replayed
//! by itself. A fact that changed nothing and asked for nothing is left out.
//!
//! Positions, heartbeats and control words are written again and again, whatever came of the last time. Of these there are
//! the rows `cz` (in `value`, µm, where it has changed), `fault` (in `detail`, once until a write is answered),
//! and `writes` and `failures` (how many since `moment`, a minute or more). A file that begins because the computer's clock
//! was set says in its first row, `clock`, from when to when. `sealed`, of no output, is a row of an earlier version, with the numbers
//! of state and ledger. A replay passes over them.

use serde::{Deserialize, Serialize};

use isotherm_core::output::{Action, Fact, Settings, State, Who};
use isotherm_core::quantity::{Counts, Moment};

mod reader;
mod recorder;
mod replay;
#[cfg(test)]
mod tests;

pub use reader::{Entry, OutputLogReader, OutputRow};
pub use recorder::OutputRecorder;
pub use replay::{OutputReplay, Replayed};

/// The first line of such a log, with its line break.
pub const HEADER: &str = "time,output,fact,value,moment,action,action_value,action_until,detail\n";
/// What the name of such a log ends with.
pub const ENDING: &str = ".outputs.csv";

const BEGIN: &str = "begin";
const CZ: &str = "cz";
const FAULT: &str = "fault";
const WRITES: &str = "writes";
const FAILURES: &str = "failures";
const CLOCK: &str = "clock";
/// Numbers of state and ledger in a log of an earlier version.
const SEALED: &str = "sealed";

/// From what an output goes on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beginning {
    /// What it is.
    pub settings: Settings,
    /// What is known of it.
    pub state: State,
}

/// The detail of a decision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Towards {
    /// Target of the offset: counts from the bias, or the gateway share.
    target: Counts,
}

impl Towards {
    fn of(fact: Fact) -> Option<Towards> {
        match fact {
            Fact::Decided { target, .. } => target.map(|target| Towards { target }),
            _ => None,
        }
    }
}

/// How a fact or an action stands in a row: its name, its value and its moment, which may never come.
type Cells = (&'static str, Option<Counts>, Moment);

/// The facts that are no more than their name.
const PLAIN: [Fact; 14] = [
    Fact::Look,
    Fact::GoesAlong,
    Fact::NoAnswer,
    Fact::Refused,
    Fact::NotSent,
    Fact::Kept,
    Fact::NotKept,
    Fact::Restarted,
    Fact::Interlocked,
    Fact::Released,
    Fact::Armed { by: Who::Person },
    Fact::Armed { by: Who::Policy },
    Fact::Off,
    Fact::Paused,
];

fn cells_of_fact(fact: Fact) -> Cells {
    let name = match fact {
        Fact::Decided { offset, target: _, not_after } => return ("decided", Some(offset), not_after),
        Fact::WentAlong { value, left, is_done: true } => return ("went-along", Some(value), left),
        Fact::WentAlong { value, left, is_done: false } => return ("went-along-unknown", Some(value), left),
        Fact::Read { found, asked } => return ("read", Some(found), asked),
        Fact::Done { left } => return ("done", None, left),
        Fact::Unknown { left } => return ("unknown", None, left),
        Fact::Look => "look",
        Fact::GoesAlong => "goes-along",
        Fact::NoAnswer => "no-answer",
        Fact::Refused => "refused",
        Fact::NotSent => "not-sent",
        Fact::Kept => "kept",
        Fact::NotKept => "not-kept",
        Fact::Restarted => "restarted",
        Fact::Interlocked => "interlocked",
        Fact::Released => "released",
        Fact::Armed { by: Who::Person } => "armed-by-person",
        Fact::Armed { by: Who::Policy } => "armed-by-policy",
        Fact::Off => "off",
        Fact::Paused => "paused",
    };
    (name, None, Moment::END)
}

/// The fact of this name; `None` where there is none, or it lacks its value.
fn fact(name: &str, value: Option<Counts>, moment: Moment) -> Option<Fact> {
    Some(match name {
        "decided" => Fact::Decided { offset: value?, target: None, not_after: moment },
        "went-along" => Fact::WentAlong { value: value?, left: moment, is_done: true },
        "went-along-unknown" => Fact::WentAlong { value: value?, left: moment, is_done: false },
        "read" => Fact::Read { found: value?, asked: moment },
        "done" => Fact::Done { left: moment },
        "unknown" => Fact::Unknown { left: moment },
        _ => return PLAIN.into_iter().find(|fact| cells_of_fact(*fact).0 == name),
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

/// An action as a message says it: `write 120 until 2026-01-31T12:00:00Z`.
fn message(action: Action) -> String {
    let (name, value, moment) = cells_of_action(action);
    let value = value.map_or(String::new(), |value| format!(" {value}"));
    let until = if moment == Moment::END { String::new() } else { format!(" until {moment}") };
    format!("{name}{value}{until}")
}
