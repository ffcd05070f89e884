//! What the page, the API and the metrics see of the gateway: its state, and nothing to touch.

use std::sync::Arc;

use super::command_handle::CommandHandle;
use super::shared::Shared;
use super::status::status;
use crate::observe::status::{Command, Source, Status};

/// A watcher's hold on what the lines share.
pub(super) struct PageHandle(Arc<Shared>);

impl PageHandle {
    pub(super) fn new(shared: Arc<Shared>) -> PageHandle {
        PageHandle(shared)
    }

    /// The state now.
    pub(super) fn status(&self) -> Status {
        status(&self.0)
    }
}

/// Both in one, for whoever may watch and command.
pub(super) struct Panel {
    pub(super) page: PageHandle,
    pub(super) commands: CommandHandle,
}

impl Source for Panel {
    fn status(&self) -> Status {
        self.page.status()
    }

    fn command(&self, command: Command) -> Result<String, String> {
        self.commands.execute(command)
    }

    fn arming(&self) -> Option<Result<String, String>> {
        self.commands.arming()
    }

    fn measured(&self, axis: &str, error_um: Option<f64>) -> Result<String, String> {
        self.commands.take_measured(axis, error_um)
    }
}
