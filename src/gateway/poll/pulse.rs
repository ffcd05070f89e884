//! The heartbeat in a register or node of its own.

use crate::fieldbus::departure::Leave;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::storage::Steady;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, Heartbeat, Profile};

pub(super) struct Pulse {
    heartbeat: Heartbeat,
    pub(super) due: Moment,
    count: u16,
}

impl Pulse {
    /// That of a line, if it has one.
    pub(super) fn of(profile: &Profile, bus: BusId, start: Moment) -> Option<Pulse> {
        let heartbeat = profile.heartbeat.as_ref();
        let heartbeat = heartbeat.filter(|heartbeat| profile.device(heartbeat.device).bus == bus)?;
        Some(Pulse { heartbeat: heartbeat.clone(), due: start, count: 0 })
    }

    pub(super) async fn beat(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        self.due = now.next_tick(self.due, self.heartbeat.every);
        if !shared.may_beat() {
            return;
        }
        let Heartbeat { device, address, .. } = &self.heartbeat;
        if shared.head_lives(now) {
            self.count = self.heartbeat.after(self.count);
        }
        let functions = shared.profile.device(*device).functions;
        let count = self.heartbeat.data_type().encode(u64::from(self.count));
        let request = Request::write(address, count.registers(), functions);
        // A failure is counted and reported where every request fails; the next beat is the repetition, and none is made
        // up for.
        let sent = line.request(*device, request, Leave::By(self.due)).await;
        let log = &mut shared.core().storage.outputs;
        match sent {
            Ok(_) => log.wrote(Steady::Heartbeat, None, now),
            Err(fault) => log.not_written(Steady::Heartbeat, &fault, now),
        }
    }
}
