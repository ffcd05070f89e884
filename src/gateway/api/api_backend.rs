//! Implementation of [`GatewayApi`](crate::observe::status::GatewayApi) for the web page, the API and the command
//! socket. It returns the state of the gateway, accepts measured errors, and executes commands such as arm, disarm and
//! zero.

use std::path::PathBuf;
use std::sync::Arc;

use super::command_handle::CommandHandle;
use super::status::status;
use crate::gateway::shared::carry_out::reported;
use crate::gateway::shared::shared_state::Shared;
use crate::gateway::store::storage::retention::of_decisions;
use crate::observe::events::file::{self, FileItem};
use crate::observe::events::{Entry, Event};
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, Command, GatewayApi, ReleaseRequest, Status};
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::{Moment, time};

/// Implementation of the interface for the web page, the API and the command socket. The field `page` reads the
/// state, and the field `commands` carries out commands.
pub(in crate::gateway) struct ApiBackend {
    page: PageHandle,
    commands: CommandHandle,
}

/// Handle that reads the state of the gateway for the web page. It carries out no commands.
struct PageHandle {
    shared: Arc<Shared>,
    /// Directory in which the events are stored; `None` if they are not stored.
    directory: Option<PathBuf>,
}

impl ApiBackend {
    pub(in crate::gateway) fn new(shared: Arc<Shared>, directory: Option<PathBuf>) -> ApiBackend {
        let page = PageHandle { shared: Arc::clone(&shared), directory };
        ApiBackend { page, commands: CommandHandle(shared) }
    }
}

impl GatewayApi for ApiBackend {
    fn status(&self) -> Status {
        status(&self.page.shared)
    }

    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String> {
        let answer = self.commands.command(command, axis, requester)?;
        Ok(if command == Command::Arm { self.commands.reminding(answer, axis) } else { answer })
    }

    fn arming(&self, axis: Option<&str>) -> Result<Answer, String> {
        let answer = self.commands.arming(axis).map_err(|why| why.to_string())?;
        Ok(self.commands.reminding(answer, axis))
    }

    fn signing(&self, axis: Option<&str>) -> Result<Answer, String> {
        self.commands.signing(axis)
    }

    fn measured(
        &self,
        axis: &str,
        report: Option<MeasuredReport>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        self.commands.measured(axis, report, requester)
    }

    fn acknowledge(&self, alarm: Option<&str>, requester: &Requester) -> Result<Answer, String> {
        self.commands.acknowledge(alarm, requester)
    }

    fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String> {
        self.commands.confirm(device, requester)
    }

    fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        self.commands.release(output, wish, requester)
    }

    fn logs(&self, from: Moment, to: Moment) -> Option<Vec<PathBuf>> {
        let machine = &self.page.shared.profile.name;
        self.page.directory.as_deref().map(|directory| of_decisions(directory, machine, from, to))
    }

    fn turned_away(&self, command: &str, requester: &Requester, why: &str) {
        self.commands.0.report(&reported(command.to_owned(), Vec::new(), requester, Err(why.into())));
    }

    fn report(&self, event: &Event) {
        self.page.shared.report(event);
    }

    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()> {
        self.page.events(since, found)
    }
}

impl PageHandle {
    /// Passes all events since `since` to `found`: first the events on disk, then the events that are not yet
    /// on disk. Stops when `found` returns `false`. Returns an error if the stored events cannot be read.
    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()> {
        let journal = &self.shared.journal;
        let is_since = |entry: &Entry| time::parse(&entry.at).is_ok_and(|at| at >= since);
        let Some(directory) = &self.directory else {
            let _ = journal.read().0.into_iter().filter(is_since).all(|entry| found(FileItem::Event(entry)));
            return Ok(());
        };
        let unkept = journal.unkept(usize::MAX);
        let (mut kept_since, mut is_wanted) = (Vec::new(), true);
        file::since(directory, &self.shared.profile.name, since, |one| {
            if let FileItem::Event(entry) = &one
                && unkept.contains(entry)
            {
                kept_since.push(entry.clone());
            }
            is_wanted = found(one);
            is_wanted
        })?;
        let unkept = unkept.into_iter().filter(|entry| is_since(entry) && !kept_since.contains(entry));
        let _ = is_wanted && unkept.map(FileItem::Event).all(found);
        Ok(())
    }
}
