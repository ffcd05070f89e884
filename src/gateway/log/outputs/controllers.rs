//! Controllers whose rows have their turns as JSON: sets, corrected positions, and the heartbeat in a register of its own.

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

/// State of a controller.
#[derive(Clone, Debug, PartialEq)]
pub enum ControllerState {
    /// Set.
    Set(Box<SetController>),
    /// Corrected position.
    Position(PositionController),
    /// Heartbeat in a register of its own.
    Heartbeat(HeartbeatController),
}

impl ControllerState {
    /// Returns whether both decide alike from the next turn on.
    pub fn is_like(&self, other: &ControllerState) -> bool {
        match (self, other) {
            (ControllerState::Set(one), ControllerState::Set(other)) => one.is_like(other),
            (ControllerState::Position(one), ControllerState::Position(other)) => one.is_like(other),
            (one, other) => one == other,
        }
    }
}

/// Turn of a controller: input, action and, if the controller takes it in the same turn, result.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Turn {
    /// Set.
    Set(Box<SetTurn>),
    /// Corrected position.
    Position(PositionTurn),
    /// Heartbeat in a register of its own.
    Heartbeat(HeartbeatTurn),
}

/// Input of the controller of a set, and its action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetTurn {
    /// Input.
    pub input: SetInput,
    /// Action.
    pub action: SetAction,
}

/// Turn of a heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeartbeatTurn {
    /// Heartbeat of the turn.
    pub beat: Beat,
    /// Count to write.
    pub count: Option<u16>,
}

impl Turn {
    /// Name of the row.
    pub(super) fn row(&self) -> &'static str {
        match self {
            Turn::Set(_) => SET,
            Turn::Position(_) => POSITION,
            Turn::Heartbeat(_) => HEARTBEAT,
        }
    }

    /// Name of the action.
    pub(super) fn action(&self) -> &'static str {
        match self {
            Turn::Set(turn) => turn.action.name(),
            Turn::Position(turn) => turn.action.name(),
            Turn::Heartbeat(HeartbeatTurn { count: Some(_), .. }) => "write",
            Turn::Heartbeat(HeartbeatTurn { count: None, .. }) => "nothing",
        }
    }

    /// Largest number of repetitions that its row may count. Those of a minute are fewer. Turns of a set are never counted.
    pub(super) fn most_repetitions(&self) -> u64 {
        if matches!(self, Turn::Set(_)) { 0 } else { MOST_REPETITIONS }
    }

    /// Returns whether the action is to do nothing.
    pub(in crate::gateway) fn is_idle(&self) -> bool {
        match self {
            Turn::Set(turn) => matches!(turn.action, SetAction::Nothing { .. }),
            Turn::Position(turn) => turn.action == PositionAction::Nothing,
            Turn::Heartbeat(turn) => turn.count.is_none(),
        }
    }

    /// Returns whether this turn repeats `last`: the log counts such turns. `before`, `after`: state after each of them.
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

    /// Returns whether both ask for the same. Each turn of a heartbeat has its own count.
    pub(super) fn is_same_action(&self, other: &Turn) -> bool {
        match (self, other) {
            (Turn::Heartbeat(one), Turn::Heartbeat(other)) => one.beat == other.beat,
            (one, other) => one == other,
        }
    }

    /// Returns the action, as a message says it.
    pub(super) fn in_words(&self) -> String {
        // Numbers, names and lists of them always have a JSON form.
        match self {
            Turn::Set(turn) => serde_json::to_string(&turn.action),
            Turn::Position(turn) => serde_json::to_string(&turn.action),
            Turn::Heartbeat(turn) => serde_json::to_string(&turn.count),
        }
        .unwrap_or_default()
    }

    /// Returns the turn that repeats this one.
    pub(super) fn again(self) -> Turn {
        match self {
            Turn::Position(turn) => Turn::Position(turn.again()),
            turn => turn,
        }
    }

    /// Reads the detail of a row. `None` if no controller has rows of this name.
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

/// Controller that resumes, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ControllerSnapshot {
    /// Set.
    Set(Box<SetSnapshot>),
    /// Corrected position.
    Position(PositionSnapshot),
    /// Heartbeat in a register of its own.
    Heartbeat(HeartbeatSnapshot),
}

/// Controller of a set, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetSnapshot {
    /// Settings.
    pub settings: SetSettings,
    /// State.
    pub set: SetController,
}

/// Controller of a corrected position, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionSnapshot {
    /// Largest change of Cz from one decision to the next.
    pub step: Micron,
    /// State.
    pub position: PositionController,
}

/// Controller of a heartbeat, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeartbeatSnapshot {
    /// Largest count of the register.
    pub highest: u16,
    /// State.
    pub heartbeat: HeartbeatController,
}

impl ControllerSnapshot {
    /// Name of the row that has it.
    pub(super) fn name(&self) -> &'static str {
        match self {
            ControllerSnapshot::Set(_) => SET_BEGIN,
            ControllerSnapshot::Position(_) => POSITION_BEGIN,
            ControllerSnapshot::Heartbeat(_) => HEARTBEAT_BEGIN,
        }
    }

    /// Name of the rows of its turns.
    pub(super) fn row(&self) -> &'static str {
        match self {
            ControllerSnapshot::Set(_) => SET,
            ControllerSnapshot::Position(_) => POSITION,
            ControllerSnapshot::Heartbeat(_) => HEARTBEAT,
        }
    }

    /// Reads the detail of a row. `None` if no controller begins with rows of this name.
    pub(super) fn parse(row: &str, detail: &str) -> Option<serde_json::Result<ControllerSnapshot>> {
        Some(match row {
            SET_BEGIN => parse(detail, ControllerSnapshot::Set),
            POSITION_BEGIN => parse(detail, ControllerSnapshot::Position),
            HEARTBEAT_BEGIN => parse(detail, ControllerSnapshot::Heartbeat),
            _ => return None,
        })
    }

    /// Carries out the input of a turn again, and returns the turn with the action that comes out. `None` if it is that of another
    /// kind of controller.
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
