//! The interlock of an output: `when = "cnc_on == 1"`.

use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_profile::Output;

/// What was taken note of.
#[derive(Debug, Default)]
pub(super) struct Interlock {
    /// It keeps the output from being written, or cannot be known.
    pub(super) is_held: bool,
    /// That was told.
    is_told: bool,
}

impl Interlock {
    /// As the task before this one left it.
    pub(super) fn held(is_held: bool) -> Interlock {
        Interlock { is_held, is_told: is_held }
    }

    /// Takes note of whether it allows writing, and tells it; whether that has changed. Where its condition cannot be known
    /// that is a fault, which the lost signal has told.
    pub(super) fn hear(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        is_armed: bool,
        allowed: Option<bool>,
    ) -> bool {
        let is_held = is_armed && allowed != Some(true);
        if is_held && allowed == Some(false) && !std::mem::replace(&mut self.is_told, true) {
            let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
            shared.report(&Event::Interlocked { output: output.name.clone(), when });
        }
        if !is_held && std::mem::take(&mut self.is_told) && is_armed {
            shared.report(&Event::Released { output: output.name.clone() });
        }
        std::mem::replace(&mut self.is_held, is_held) != is_held
    }
}
