//! Controllers whose turns are logged as JSON. They are the controllers of output sets, of corrected positions
//! (position plus Cz), and of a heartbeat in a separate register. A turn is one call of a controller by the line
//! task.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use isotherm_core::output::{
    Beat, HeartbeatController, PositionAction, PositionController, PositionTurn, SetAction, SetController,
    SetInput, SetSettings,
};
use isotherm_core::quantity::{Micron, Moment, Shift, Shifted};

const MOST_REPETITIONS: u64 = 100_000;
const SET: &str = "set";
const SET_BEGIN: &str = "set-begin";
const POSITION: &str = "position";
const POSITION_BEGIN: &str = "position-begin";
const HEARTBEAT: &str = "heartbeat";
const HEARTBEAT_BEGIN: &str = "heartbeat-begin";

/// State of a controller whose turns are logged as JSON, by the kind of controller.
#[derive(Clone, Debug, PartialEq)]
pub enum ControllerState {
    /// Controller of an output set (outputs that are written together).
    Set(Box<SetController>),
    /// Controller of an output that writes a position plus Cz (corrected position).
    Position(PositionController),
    /// Controller of a heartbeat in a separate register.
    Heartbeat(HeartbeatController),
}

impl ControllerState {
    /// Returns whether both states lead to the same decisions in the future.
    pub fn is_like(&self, other: &ControllerState) -> bool {
        match (self, other) {
            (ControllerState::Set(one), ControllerState::Set(other)) => one.is_like(other),
            (ControllerState::Position(one), ControllerState::Position(other)) => one.is_like(other),
            (one, other) => one == other,
        }
    }
}

/// Turn of a controller: one call by the line task. The turn contains the input and the action. It contains the
/// result if the result is known at the end of the turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Turn {
    /// Call of the controller of an output set.
    Set(Box<SetTurn>),
    /// Call of the controller of an output that writes a position plus Cz (corrected position).
    Position(PositionTurn),
    /// Call of the controller of a heartbeat in a separate register.
    Heartbeat(HeartbeatTurn),
}

/// One call of the controller of an output set by the line task: its input and its action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetTurn {
    /// Input of the controller in this call.
    pub input: SetInput,
    /// Action that the controller returned.
    pub action: SetAction,
}

/// One call of the controller of a heartbeat by the line task.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeartbeatTurn {
    /// Requested state of the heartbeat.
    pub beat: Beat,
    /// Count to write to the register; `None` if no heartbeat is sent.
    pub count: Option<u16>,
}

impl Turn {
    /// Returns the name of the log row for this turn.
    pub(super) fn row(&self) -> &'static str {
        match self {
            Turn::Set(_) => SET,
            Turn::Position(_) => POSITION,
            Turn::Heartbeat(_) => HEARTBEAT,
        }
    }

    /// Returns the name of the turn's action in the log.
    pub(super) fn action(&self) -> &'static str {
        match self {
            Turn::Set(turn) => turn.action.name(),
            Turn::Position(turn) => turn.action.name(),
            Turn::Heartbeat(HeartbeatTurn { count: Some(_), .. }) => "write",
            Turn::Heartbeat(HeartbeatTurn { count: None, .. }) => "nothing",
        }
    }

    /// Returns the maximum number of repeated turns that one log row may count. The limit is higher than the number
    /// of turns in one minute. The result is 0 for an output set, because each of its turns has its own row.
    pub(super) fn most_repetitions(&self) -> u64 {
        if matches!(self, Turn::Set(_)) { 0 } else { MOST_REPETITIONS }
    }

    /// Returns whether the controller has requested no action.
    pub(in crate::gateway) fn is_idle(&self) -> bool {
        match self {
            Turn::Set(turn) => matches!(turn.action, SetAction::Nothing { .. }),
            Turn::Position(turn) => turn.action == PositionAction::Nothing,
            Turn::Heartbeat(turn) => turn.count.is_none(),
        }
    }

    /// Returns whether this turn (call of the controller) repeats `last`, so that the log only counts it. `before` and
    /// `after` are the states of the controller before and after this turn.
    pub(in crate::gateway) fn repeats(
        &self,
        last: &Turn,
        before: &ControllerState,
        after: &ControllerState,
    ) -> bool {
        match (self, last, before, after) {
            (Turn::Heartbeat(turn), Turn::Heartbeat(last), ..) => turn.beat == last.beat,
            (
                Turn::Position(turn),
                Turn::Position(last),
                ControllerState::Position(before),
                ControllerState::Position(after),
            ) => turn.repeats(last, (before, after)),
            _ => false,
        }
    }

    /// Returns whether both turns (calls of a controller) have the same action. The counts of two heartbeats may
    /// differ.
    pub(super) fn is_same_action(&self, other: &Turn) -> bool {
        match (self, other) {
            (Turn::Heartbeat(one), Turn::Heartbeat(other)) => one.beat == other.beat,
            (one, other) => one == other,
        }
    }

    /// Formats the turn's action for a message.
    pub(super) fn in_words(&self) -> String {
        // Numbers, names and lists of them always have a JSON form.
        match self {
            Turn::Set(turn) => serde_json::to_string(&turn.action),
            Turn::Position(turn) => serde_json::to_string(&turn.action),
            Turn::Heartbeat(turn) => serde_json::to_string(&turn.count),
        }
        .unwrap_or_default()
    }

    /// Returns the turn (call of the controller) that would follow if this turn were repeated.
    pub(super) fn again(self) -> Turn {
        match self {
            Turn::Position(turn) => Turn::Position(turn.again()),
            turn => turn,
        }
    }

    /// Parses the column `detail` of a log row with this name. Returns `None` if rows of this name contain no turn
    /// (call of a controller).
    pub(super) fn parse(row: &str, detail: &str) -> Option<serde_json::Result<Turn>> {
        Some(match row {
            SET => parse(detail, Turn::Set),
            POSITION => parse(detail, Turn::Position),
            HEARTBEAT => parse(detail, Turn::Heartbeat),
            _ => return None,
        })
    }
}

impl Shifted for Turn {
    fn shift(&mut self, by: Shift) {
        match self {
            Turn::Set(turn) => {
                turn.input.shift(by);
                turn.action.shift(by);
            }
            Turn::Position(turn) => turn.shift(by),
            Turn::Heartbeat(_) => {}
        }
    }
}

/// Settings and state of a controller, from which a replay continues.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ControllerSnapshot {
    /// Controller of an output set (outputs that are written together).
    Set(Box<SetSnapshot>),
    /// Controller of an output that writes a position plus Cz (corrected position).
    Position(PositionSnapshot),
    /// Controller of a heartbeat in a separate register.
    Heartbeat(HeartbeatSnapshot),
}

/// Controller of an output set (outputs that are written together), with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetSnapshot {
    /// Settings of the output set and of its outputs.
    pub settings: SetSettings,
    /// State of the controller, from which a replay continues.
    pub set: SetController,
}

/// Controller of an output that writes a position plus Cz (corrected position), with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionSnapshot {
    /// Maximum change of Cz from one decision to the next.
    pub step: Micron,
    /// State of the controller, from which a replay continues.
    pub position: PositionController,
}

/// Controller of a heartbeat, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeartbeatSnapshot {
    /// Maximum count of the register.
    pub highest: u16,
    /// State of the controller, from which a replay continues.
    pub heartbeat: HeartbeatController,
}

impl ControllerSnapshot {
    /// Returns the name of the log row that contains the snapshot.
    pub(super) fn name(&self) -> &'static str {
        match self {
            ControllerSnapshot::Set(_) => SET_BEGIN,
            ControllerSnapshot::Position(_) => POSITION_BEGIN,
            ControllerSnapshot::Heartbeat(_) => HEARTBEAT_BEGIN,
        }
    }

    /// Returns the name of the log rows that contain the turns (calls) of this controller.
    pub(super) fn row(&self) -> &'static str {
        match self {
            ControllerSnapshot::Set(_) => SET,
            ControllerSnapshot::Position(_) => POSITION,
            ControllerSnapshot::Heartbeat(_) => HEARTBEAT,
        }
    }

    /// Parses the column `detail` of a log row with this name. Returns `None` if rows of this name contain no snapshot
    /// of a controller.
    pub(super) fn parse(row: &str, detail: &str) -> Option<serde_json::Result<ControllerSnapshot>> {
        Some(match row {
            SET_BEGIN => parse(detail, ControllerSnapshot::Set),
            POSITION_BEGIN => parse(detail, ControllerSnapshot::Position),
            HEARTBEAT_BEGIN => parse(detail, ControllerSnapshot::Heartbeat),
            _ => return None,
        })
    }

    /// Gives the input of a turn (recorded call) to the controller again, and returns the turn with the new action.
    /// Returns `None` if the turn belongs to another kind of controller.
    pub(super) fn again(&mut self, turn: &Turn, now: Moment) -> Option<Turn> {
        Some(match (self, turn) {
            (ControllerSnapshot::Set(snapshot), Turn::Set(turn)) => {
                let SetSnapshot { settings, set } = &mut **snapshot;
                let action = set.step(settings, &turn.input, now);
                for controller in set.members_mut() {
                    let _ = controller.take_events();
                }
                let _ = set.take_faults();
                Turn::Set(Box::new(SetTurn { input: turn.input.clone(), action }))
            }
            (ControllerSnapshot::Position(PositionSnapshot { step, position }), Turn::Position(turn)) => {
                let (action, _) = position.next(&turn.demand, *step, now);
                let turn = PositionTurn { action, ..*turn };
                let _ = position.result(&turn, now);
                Turn::Position(turn)
            }
            (
                ControllerSnapshot::Heartbeat(HeartbeatSnapshot { highest, heartbeat }),
                Turn::Heartbeat(turn),
            ) => {
                let count = heartbeat.next(turn.beat, *highest);
                Turn::Heartbeat(HeartbeatTurn { count, ..*turn })
            }
            _ => return None,
        })
    }
}

impl Shifted for ControllerSnapshot {
    fn shift(&mut self, by: Shift) {
        match self {
            ControllerSnapshot::Set(snapshot) => snapshot.set.shift(by),
            ControllerSnapshot::Position(snapshot) => snapshot.position.shift(by),
            ControllerSnapshot::Heartbeat(_) => {}
        }
    }
}

fn parse<T: DeserializeOwned, U>(detail: &str, of: fn(T) -> U) -> serde_json::Result<U> {
    serde_json::from_str(detail).map(of)
}
