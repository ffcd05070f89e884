//! The heartbeat in a register of its own.

use std::time::Duration;

use super::LineTask;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::wire::Request;
use crate::gateway::storage::Steady;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId, Profile};

/// The heartbeat.
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
}

impl LineTask {
    pub(super) async fn beat(&mut self, now: Moment) {
        let Some(pulse) = &mut self.pulse else { return };
        pulse.due = now.next_tick(pulse.due, pulse.every);
        if !self.shared.may_beat() {
            return;
        }
        let next = pulse.due;
        pulse.count = pulse.count.wrapping_add(u16::from(self.shared.head_lives(now)));
        let (device, count) = (pulse.device, [pulse.count]);
        let functions = self.shared.profile.device(device).functions;
        let request = Request::write_holding(pulse.register, &count, functions);
        // A failure is counted and told where every request fails; the next beat is the repetition, and none is made up for.
        let sent = self.line.request(device, request, Leave::By(next)).await;
        let storage = &mut self.shared.core().storage;
        match sent {
            Ok(_) => storage.wrote(Steady::Heartbeat, None, now),
            Err(fault) => storage.not_written(Steady::Heartbeat, &fault, now),
        }
    }
}
