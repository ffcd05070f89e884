//! The heartbeat in a register of its own.

use std::time::Duration;

use crate::fieldbus::departure::Leave;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::storage::Steady;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId, Profile};

pub(super) struct Pulse {
    device: DeviceId,
    register: u16,
    every: Duration,
    pub(super) due: Moment,
    count: u16,
}

impl Pulse {
    /// That of a line, if it has one.
    pub(super) fn of(profile: &Profile, bus: BusId, start: Moment) -> Option<Pulse> {
        let heartbeat = profile.heartbeat.as_ref();
        let heartbeat = heartbeat.filter(|heartbeat| profile.device(heartbeat.device).bus == bus)?;
        Some(Pulse {
            device: heartbeat.device,
            register: heartbeat.address.offset,
            every: heartbeat.every,
            due: start,
            count: 0,
        })
    }

    pub(super) async fn beat(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        self.due = now.next_tick(self.due, self.every);
        if !shared.may_beat() {
            return;
        }
        self.count = self.count.wrapping_add(u16::from(shared.head_lives(now)));
        let functions = shared.profile.device(self.device).functions;
        let count = [self.count];
        let request = Request::write_holding(self.register, &count, functions);
        // A failure is counted and reported where every request fails; the next beat is the repetition, and none is made
        // up for.
        let sent = line.request(self.device, request, Leave::By(self.due)).await;
        let log = &mut shared.core().storage.outputs;
        match sent {
            Ok(_) => log.wrote(Steady::Heartbeat, None, now),
            Err(fault) => log.not_written(Steady::Heartbeat, &fault, now),
        }
    }
}
