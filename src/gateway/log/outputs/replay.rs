//! Gives the inputs of a log to the controllers again, and compares what is to be done next.

use std::collections::BTreeMap;

use super::{Entry, OutputRow, SetBeginning, message};
use isotherm_core::output::{Controller, SetAction, SetInput, Settings};

/// The outputs of a log as they go on.
#[derive(Clone, Debug, Default)]
pub struct OutputReplay {
    running: BTreeMap<String, Box<(Settings, Controller)>>,
    sets: BTreeMap<String, Box<SetBeginning>>,
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
        let (input, recorded) = match &row.entry {
            Entry::Begins(beginning) => {
                let controller = Controller::resumed(beginning.state, beginning.policy);
                self.running.insert(row.output.clone(), Box::new((beginning.settings, controller)));
                return Replayed::Nothing;
            }
            Entry::SetBegins(beginning) => {
                self.sets.insert(row.output.clone(), beginning.clone());
                return Replayed::Nothing;
            }
            Entry::SetStep { input, action } => return self.set_row(row, input, action),
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

    fn set_row(&mut self, row: &OutputRow, input: &SetInput, recorded: &SetAction) -> Replayed {
        let Some(running) = self.sets.get_mut(&row.output) else { return Replayed::Unknown };
        let SetBeginning { settings, set } = &mut **running;
        let replayed = set.step(settings, input, row.now);
        for controller in set.members_mut() {
            let _ = controller.take_events();
        }
        let _ = set.take_faults();
        if replayed == *recorded {
            return Replayed::Same;
        }
        // Numbers, names and lists of them always have a JSON form.
        let words = |action: &SetAction| serde_json::to_string(action).unwrap_or_default();
        Replayed::Different { recorded: words(recorded), replayed: words(&replayed) }
    }
}
