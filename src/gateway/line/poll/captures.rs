//! Counters that copy their count to their registers only on command.

use crate::fieldbus::error::Fault;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use isotherm_core::codec::Table;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Capture, DeviceId};

/// Capture commands of one device, without repetitions. For each: the time at which it was last sent, or the reason why
/// it could not be sent. `None` before the first attempt.
///
/// The commands are part of reading. Therefore they are also sent in a dry run, and before anything is armed.
#[derive(Debug)]
pub(super) struct Captures(Vec<(Capture, Option<Result<Moment, Fault>>)>);

impl Captures {
    pub(super) fn new(commands: impl Iterator<Item = Capture>) -> Captures {
        let mut captures: Vec<(Capture, Option<Result<Moment, Fault>>)> = Vec::new();
        for command in commands {
            if captures.iter().all(|(known, _)| *known != command) {
                captures.push((command, None));
            }
        }
        Captures(captures)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Sends all capture commands, and records the time or the fault of each.
    pub(super) async fn send(&mut self, line: &mut DeviceLine, shared: &LineHandle, device: DeviceId) {
        for (capture, sent) in &mut self.0 {
            let (at, value) = (capture.address.offset, [capture.value]);
            let request = match capture.address.table {
                Table::Coil => Request::write_coil(at, capture.value != 0),
                _ => Request::write_holding(at, &value, shared.profile.device(device).functions),
            };
            *sent =
                Some(line.request(device, request, SendDeadline::None).await.map(|answered| answered.asked));
        }
    }

    /// Returns the time at which the present value was captured. `None` if the value needs no capture command. An error
    /// means that the command failed: the value in the register is then from another time.
    pub(super) fn captured(&self, capture: Option<Capture>) -> Result<Option<Moment>, Fault> {
        self.0.iter().find(|(own, _)| Some(*own) == capture).and_then(|(_, sent)| *sent).transpose()
    }
}
