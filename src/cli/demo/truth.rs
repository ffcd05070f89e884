//! True error and residual error of each axis. Only a virtual machine knows them; the demo adds them to its web page.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use crate::clock::Clock;
use crate::observe::events::Event;
use crate::observe::events::file::FileItem;
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, Command, GatewayApi, ReleaseRequest, Status, TruthStatus};
use crate::virtual_machine::Window;
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::{Moment, time};

/// State of the gateway with the true errors added, for the web page.
pub(super) struct WithTruth {
    pub(super) source: Arc<dyn GatewayApi>,
    pub(super) window: Window,
    /// Log file of the true errors, in the directory of the gateway's logs; `None`: no log.
    pub(super) log: Option<PathBuf>,
}

impl WithTruth {
    /// Appends the new rows to the log of the true errors. If that fails, the charts of the web page lack these rows.
    pub(super) fn keep(&self, clock: &Clock) {
        let (Some(log), rows) = (&self.log, self.window.take_course()) else { return };
        let axes = self.window.summary().axes;
        let Ok(mut file) = std::fs::OpenOptions::new().create(true).append(true).open(log) else { return };
        let mut text = Vec::new();
        if file.metadata().is_ok_and(|metadata| metadata.len() == 0) {
            text.extend_from_slice(b"time");
            axes.iter().for_each(|axis| text.extend(format!(",{0}_error_um,{0}_left_um", axis.axis).bytes()));
            text.push(b'\n');
        }
        for row in rows {
            time::write(&mut text, clock.stamp(row.at));
            for truth in row.axes {
                text.extend(format!(",{:.3},{:.3}", truth.error_um, truth.residual_um()).bytes());
            }
            text.push(b'\n');
        }
        let _ = file.write_all(&text);
    }
}

impl GatewayApi for WithTruth {
    fn status(&self) -> Status {
        let mut status = self.source.status();
        let summary = self.window.summary();
        let truth = self.window.latest_truth();
        for axis in &mut status.axes {
            let place = summary.axes.iter().position(|known| known.axis == axis.name);
            let known = place.zip(truth.as_ref()).and_then(|(place, truth)| truth.axes.get(place));
            axis.truth =
                known.map(|known| TruthStatus { error_um: known.error_um, left_um: known.residual_um() });
        }
        status
    }

    fn logs(&self, from: Moment, to: Moment) -> Option<Vec<PathBuf>> {
        let logs = self.source.logs(from, to)?;
        Some(logs.into_iter().chain(self.log.clone()).collect())
    }

    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String> {
        self.source.command(command, axis, requester)
    }

    fn arming(&self, axis: Option<&str>) -> Result<Answer, String> {
        self.source.arming(axis)
    }

    fn signing(&self, axis: Option<&str>) -> Result<Answer, String> {
        self.source.signing(axis)
    }

    fn measured(
        &self,
        axis: &str,
        report: Option<MeasuredReport>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        self.source.measured(axis, report, requester)
    }

    fn acknowledge(&self, alarm: Option<&str>, requester: &Requester) -> Result<Answer, String> {
        self.source.acknowledge(alarm, requester)
    }

    fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String> {
        self.source.confirm(device, requester)
    }

    fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        self.source.release(output, wish, requester)
    }

    fn turned_away(&self, command: &str, requester: &Requester, why: &str) {
        self.source.turned_away(command, requester, why);
    }

    fn report(&self, event: &Event) {
        self.source.report(event);
    }

    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()> {
        self.source.events(since, found)
    }
}
