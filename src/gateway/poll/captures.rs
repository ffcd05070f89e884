//! Counters that copy their count into their registers only when they are told to.

use crate::codec::Table;
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::Line;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::Shared;
use crate::profile::{Capture, DeviceId};
use crate::quantity::Moment;

/// The commands of one device, each once, and why the last one failed.
///
/// They are part of reading, so they are sent in a dry run and before anything is armed, too.
#[derive(Debug)]
pub(super) struct Captures(Vec<(Capture, Option<Fault>)>);

impl Captures {
    pub(super) fn new(commands: impl Iterator<Item = Capture>) -> Captures {
        let mut captures: Vec<(Capture, Option<Fault>)> = Vec::new();
        for command in commands {
            if captures.iter().all(|(known, _)| *known != command) {
                captures.push((command, None));
            }
        }
        Captures(captures)
    }

    /// Sends them; the moment after the last one.
    pub(super) async fn send(
        &mut self,
        line: &mut Line,
        shared: &Shared,
        device: DeviceId,
        mut now: Moment,
    ) -> Moment {
        for (capture, fault) in &mut self.0 {
            let (at, word) = (capture.address.offset, [capture.value]);
            let request = match capture.address.table {
                Table::Coil => Request::WriteCoil { at, value: capture.value != 0 },
                _ if shared.profile.device(device).functions.write_single => {
                    Request::WriteSingle { at, word: word[0] }
                }
                _ => Request::WriteMultiple { at, words: &word },
            };
            *fault = super::call(line, shared, device, request, now).await.err();
            now = shared.clock.now();
        }
        now
    }

    /// Why there is nothing new to read: what was captured another time is no reading of now.
    pub(super) fn failed(&self, capture: Option<Capture>) -> Option<Fault> {
        self.0.iter().find(|(own, _)| Some(*own) == capture).and_then(|(_, fault)| *fault)
    }
}
