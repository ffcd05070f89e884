//! Reports of the interlock of a corrected position: `when = "cnc_on == 1"`.

use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_core::output::Condition;
use isotherm_profile::OutputId;

#[derive(Debug, Default)]
pub(super) struct Interlock {
    is_reported: bool,
}

impl Interlock {
    /// Takes note of the condition, and reports it. If it cannot be known, the lost signal is reported.
    pub(super) fn hear(&mut self, shared: &LineHandle, id: OutputId, condition: Condition) {
        let output = shared.profile.output(id);
        if condition == Condition::NotMet && !std::mem::replace(&mut self.is_reported, true) {
            let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
            shared.report(&Event::Interlocked { output: output.name.clone(), when });
        }
        if condition == Condition::Met && std::mem::take(&mut self.is_reported) {
            shared.report(&Event::Released { output: output.name.clone() });
        }
    }
}
