//! Phase of a run: normal operation, stop, end of the lines.

use isotherm_profile::OnStop;

/// Phase of a run: normal operation, stop, or end of the line tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) enum RunPhase {
    /// No stop was requested.
    #[default]
    Running,
    /// A stop was requested, with the contained action.
    Stopping(OnStop),
    /// The tasks of the bus lines end now. They must reset every strobe signal before.
    Leaving(OnStop),
}

impl RunPhase {
    /// Returns the action of the requested stop. `None` if no stop was requested.
    pub(in crate::gateway) fn stop(self) -> Option<OnStop> {
        match self {
            RunPhase::Running => None,
            RunPhase::Stopping(action) | RunPhase::Leaving(action) => Some(action),
        }
    }

    /// Returns whether a stop was requested.
    pub(in crate::gateway) fn is_stopping(self) -> bool {
        self.stop().is_some()
    }

    /// Returns whether the tasks of the bus lines end now.
    pub(in crate::gateway) fn is_leaving(self) -> bool {
        matches!(self, RunPhase::Leaving(_))
    }

    /// Requests the tasks of the bus lines to end, if a stop was requested before.
    pub(in crate::gateway) fn leave(&mut self) {
        if let RunPhase::Stopping(action) = *self {
            *self = RunPhase::Leaving(action);
        }
    }
}
