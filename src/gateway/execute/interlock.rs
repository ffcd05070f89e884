//! The interlock of an output: `when = "cnc_on == 1"`.

use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_profile::OutputId;

#[derive(Debug, Default)]
pub(super) struct Interlock {
    /// It keeps the output from being written, or cannot be known.
    pub(super) is_held: bool,
    is_reported: bool,
}

impl Interlock {
    /// As the task before this one left it.
    pub(super) fn held(is_held: bool) -> Interlock {
        Interlock { is_held, is_reported: is_held }
    }

    /// Takes note of whether it allows writing, and reports it; whether that has changed. Where its condition cannot be known
    /// that is a fault, which is reported of the lost signal.
    pub(super) fn hear(
        &mut self,
        shared: &LineHandle,
        id: OutputId,
        is_armed: bool,
        allowed: Option<bool>,
    ) -> bool {
        let is_held = is_armed && allowed != Some(true);
        let output = shared.profile.output(id);
        if is_held && allowed == Some(false) && !std::mem::replace(&mut self.is_reported, true) {
            let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
            shared.report(&Event::Interlocked { output: output.name.clone(), when });
        }
        if !is_held && std::mem::take(&mut self.is_reported) && is_armed {
            shared.report(&Event::Released { output: output.name.clone() });
        }
        std::mem::replace(&mut self.is_held, is_held) != is_held
    }
}
