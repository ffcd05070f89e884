//! Replay of an output log. The replay gives the logged inputs to the controllers again, and compares the actions.

use std::collections::BTreeMap;

use super::cells::message;
use super::controllers::{ControllerSnapshot, Turn};
use super::reader::{Entry, OutputRow};
use isotherm_core::output::{Controller, Settings};
use isotherm_core::quantity::Moment;

/// Replay of an output log, with the present state of the replayed controllers.
#[derive(Clone, Debug, Default)]
pub struct OutputReplay {
    running: BTreeMap<String, Box<(Settings, Controller)>>,
    /// Controllers of output sets, corrected positions and heartbeats. The key is the name and the kind of log row.
    /// Each controller has its last turn (call by the line task).
    resumed: BTreeMap<(String, &'static str), Resumed>,
}

/// Controller of an output set, corrected position or heartbeat, and its last turn (call by the line task).
type Resumed = (Box<ControllerSnapshot>, Option<Turn>);

/// Result of the replay of one row of the output log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Replayed {
    /// The log row has no action to compare.
    Nothing,
    /// The controller in the replay returned the same action as in the log.
    Same,
    /// The controller in the replay returned another action than in the log.
    Different {
        /// Action in the log, as text.
        recorded: String,
        /// Action of the replay, as text.
        replayed: String,
    },
    /// The log does not contain the state from which the output continues.
    Unknown,
}

impl OutputReplay {
    /// Replays the next row of the output log.
    pub fn row(&mut self, row: &OutputRow) -> Replayed {
        let (input, recorded) = match &row.entry {
            Entry::Begins(beginning) => {
                let controller = Controller::resumed(beginning.state, beginning.policy);
                self.running.insert(row.output.clone(), Box::new((beginning.settings, controller)));
                return Replayed::Nothing;
            }
            Entry::Resumes(snapshot) => {
                let key = (row.output.clone(), snapshot.row());
                self.resumed.insert(key, (snapshot.clone(), None));
                return Replayed::Nothing;
            }
            Entry::Turn { repetitions, turn } => {
                return self.turn(&row.output, (*repetitions, turn), row.now);
            }
            Entry::Noted => return Replayed::Nothing,
            Entry::Step { input, action } => (*input, *action),
        };
        let Some(running) = self.running.get_mut(&row.output) else { return Replayed::Unknown };
        let (settings, controller) = &mut **running;
        let replayed = controller.step(settings, input, row.now);
        let _ = controller.take_events();
        if replayed == recorded {
            return Replayed::Same;
        }
        Replayed::Different { recorded: message(recorded), replayed: message(replayed) }
    }

    /// Replays the repetitions of the previous turn (recorded call of a controller), and then this turn. Returns the
    /// first difference.
    fn turn(&mut self, name: &str, (repetitions, recorded): (u64, &Turn), now: Moment) -> Replayed {
        let key = (name.to_owned(), recorded.row());
        let Some((snapshot, last)) = self.resumed.get_mut(&key) else { return Replayed::Unknown };
        let different = |recorded: &Turn, replayed: &Turn| Replayed::Different {
            recorded: recorded.in_words(),
            replayed: replayed.in_words(),
        };
        let mut first = None;
        for _ in 0..repetitions {
            let Some(turn) = last.take().map(Turn::again) else { return Replayed::Unknown };
            let Some(replayed) = snapshot.again(&turn, now) else { return Replayed::Unknown };
            if first.is_none() && !replayed.is_same_action(&turn) {
                first = Some(different(&turn, &replayed));
            }
            *last = Some(turn);
        }
        let Some(replayed) = snapshot.again(recorded, now) else { return Replayed::Unknown };
        *last = Some(recorded.clone());
        first.unwrap_or_else(|| match replayed == *recorded {
            true => Replayed::Same,
            false => different(recorded, &replayed),
        })
    }
}
