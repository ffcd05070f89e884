//! Takes the facts of a log in again, and compares what is to be done next.

use std::collections::BTreeMap;

use super::{Beginning, Entry, OutputRow, message};
use isotherm_core::output::step;

/// The outputs of a log as they go on.
#[derive(Clone, Debug, Default)]
pub struct OutputReplay {
    running: BTreeMap<String, Box<Beginning>>,
}

/// What a row came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Replayed {
    /// There was nothing to be done again.
    Nothing,
    /// The action of the log came out again.
    Same,
    /// Another one did.
    Different {
        /// What the log says, in words.
        recorded: String,
        /// What came out.
        replayed: String,
    },
    /// The output has not begun: nobody knows from where it went on.
    Unknown,
}

impl OutputReplay {
    /// Takes the next row in.
    pub fn row(&mut self, row: &OutputRow) -> Replayed {
        let (fact, recorded) = match &row.entry {
            Entry::Begins(beginning) => {
                self.running.insert(row.output.clone(), beginning.clone());
                return Replayed::Nothing;
            }
            Entry::Noted => return Replayed::Nothing,
            Entry::Step { fact, action } => (*fact, *action),
        };
        let Some(running) = self.running.get_mut(&row.output) else { return Replayed::Unknown };
        let replayed = step(&mut running.state, &running.settings, fact, row.now);
        let _ = running.state.take_events();
        if replayed == recorded {
            return Replayed::Same;
        }
        Replayed::Different { recorded: message(recorded), replayed: message(replayed) }
    }
}
