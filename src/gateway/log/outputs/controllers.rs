//! Controllers whose rows have their turns as JSON: sets, corrected positions, and the heartbeat in a register of its own.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use isotherm_core::output::{
    Beat, HeartbeatController, PositionAction, PositionController, PositionTurn, SetAction, SetController,
    SetInput, SetSettings,
};
use isotherm_core::quantity::{Micron, Moment, Shift, Shifted};

const SET: &str = "set";
const SET_BEGIN: &str = "set-begin";
const POSITION: &str = "position";
const POSITION_BEGIN: &str = "position-begin";
const HEARTBEAT: &str = "heartbeat";
const HEARTBEAT_BEGIN: &str = "heartbeat-begin";

/// State of a controller.
#[derive(Clone, Debug, PartialEq)]
pub enum ControllerState {
    /// Of a set.
    Set(Box<SetController>),
    /// Of a corrected position.
    Position(PositionController),
    /// Of the heartbeat in a register of its own.
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
    /// Of a set.
    Set(Box<SetTurn>),
    /// Of a corrected position.
    Position(PositionTurn),
    /// Of the heartbeat in a register of its own.
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
    /// Whether it counts.
    pub beat: Beat,
    /// Count to write.
    pub count: Option<u16>,
}

impl Turn {
    /// Name of the row, and that of the action.
    pub(super) fn names(&self) -> (&'static str, &'static str) {
        match self {
            Turn::Set(turn) => (SET, turn.action.name()),
            Turn::Position(turn) => (POSITION, turn.action.name()),
            Turn::Heartbeat(turn) => (HEARTBEAT, if turn.count.is_some() { "write" } else { "nothing" }),
        }
    }

    /// Returns whether it asked for nothing.
    pub(in crate::gateway) fn is_idle(&self) -> bool {
        match self {
            Turn::Set(turn) => matches!(turn.action, SetAction::Nothing { .. }),
            Turn::Position(turn) => turn.action == PositionAction::Nothing,
            Turn::Heartbeat(turn) => turn.count.is_none(),
        }
    }

    /// Returns whether it repeats the last one, so that it is counted instead of recorded. `before`, `after`: state after each of them.
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

    /// The action, as a message says it.
    pub(super) fn in_words(&self) -> String {
        // Numbers, names and lists of them always have a JSON form.
        match self {
            Turn::Set(turn) => serde_json::to_string(&turn.action),
            Turn::Position(turn) => serde_json::to_string(&turn.action),
            Turn::Heartbeat(turn) => serde_json::to_string(&turn.count),
        }
        .unwrap_or_default()
    }

    /// The turn that repeats this one.
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
pub enum Resumed {
    /// Of a set.
    Set(Box<ResumedSet>),
    /// Of a corrected position.
    Position(ResumedPosition),
    /// Of the heartbeat in a register of its own.
    Heartbeat(ResumedHeartbeat),
}

/// Controller of a set, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumedSet {
    /// Settings.
    pub settings: SetSettings,
    /// State.
    pub set: SetController,
}

/// Controller of a corrected position, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumedPosition {
    /// Largest change of Cz from one decision to the next.
    pub step: Micron,
    /// State.
    pub position: PositionController,
}

/// Controller of a heartbeat, with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResumedHeartbeat {
    /// Largest count of the register.
    pub highest: u16,
    /// State.
    pub heartbeat: HeartbeatController,
}

impl Resumed {
    /// Name of the row.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Resumed::Set(_) => SET_BEGIN,
            Resumed::Position(_) => POSITION_BEGIN,
            Resumed::Heartbeat(_) => HEARTBEAT_BEGIN,
        }
    }

    /// Reads the detail of a row. `None` if no controller begins with rows of this name.
    pub(super) fn parse(row: &str, detail: &str) -> Option<serde_json::Result<Resumed>> {
        Some(match row {
            SET_BEGIN => parse(detail, Resumed::Set),
            POSITION_BEGIN => parse(detail, Resumed::Position),
            HEARTBEAT_BEGIN => parse(detail, Resumed::Heartbeat),
            _ => return None,
        })
    }

    /// Carries out the input of a turn again, and returns the turn with the action that comes out. `None` if it is that of another
    /// kind of controller.
    pub(super) fn again(&mut self, turn: &Turn, now: Moment) -> Option<Turn> {
        Some(match (self, turn) {
            (Resumed::Set(resumed), Turn::Set(turn)) => {
                let ResumedSet { settings, set } = &mut **resumed;
                let action = set.step(settings, &turn.input, now);
                for controller in set.members_mut() {
                    let _ = controller.take_events();
                }
                let _ = set.take_faults();
                Turn::Set(Box::new(SetTurn { input: turn.input.clone(), action }))
            }
            (Resumed::Position(ResumedPosition { step, position }), Turn::Position(turn)) => {
                let (action, _) = position.next(&turn.demand, *step, now);
                let turn = PositionTurn { action, ..*turn };
                let _ = position.result(&turn, now);
                Turn::Position(turn)
            }
            (Resumed::Heartbeat(ResumedHeartbeat { highest, heartbeat }), Turn::Heartbeat(turn)) => {
                let count = heartbeat.next(turn.beat, *highest);
                Turn::Heartbeat(HeartbeatTurn { count, ..*turn })
            }
            _ => return None,
        })
    }
}

impl Shifted for Resumed {
    fn shift(&mut self, by: Shift) {
        match self {
            Resumed::Set(resumed) => resumed.set.shift(by),
            Resumed::Position(resumed) => resumed.position.shift(by),
            Resumed::Heartbeat(_) => {}
        }
    }
}

fn parse<T: DeserializeOwned, U>(detail: &str, of: fn(T) -> U) -> serde_json::Result<U> {
    serde_json::from_str(detail).map(of)
}
