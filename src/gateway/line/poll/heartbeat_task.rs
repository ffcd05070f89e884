//! Heartbeat in a separate register or node. The heartbeat is a count that the gateway increases, so that the control
//! can detect whether the gateway runs.

use crate::fieldbus::error::Fault;
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::seen::{Asked, Seen};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::store::log::outputs::{
    ControllerSnapshot, ControllerState, HeartbeatSnapshot, HeartbeatTurn, Turn,
};
use crate::gateway::store::storage::{CountedWrite, TurnRecord};
use crate::observe::events::Event;
use isotherm_core::explained::Cause;
use isotherm_core::output::HeartbeatController;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, Heartbeat, Profile};

/// Number of consecutive failures with a new cause, after which the task reports this cause.
const CHANGED_AFTER: u32 = 20;
/// Number of consecutive unanswered heartbeats after which the task reports the failure, although the device answers
/// all other requests.
const DEAF: u32 = 3;

/// Writes the heartbeat of one bus line, and reports its failures.
pub(super) struct HeartbeatTask {
    heartbeat: Heartbeat,
    pub(super) due: Moment,
    controller: HeartbeatController,
    /// Number of consecutive heartbeats that could not be written.
    missed: u32,
    /// Fault that was reported last. `None` if no fault was reported, or if the end of the last fault was reported.
    reported: Option<Cause<Fault>>,
}

impl HeartbeatTask {
    /// Creates the heartbeat task of a line. Returns `None` if the line has no heartbeat.
    pub(super) fn of(profile: &Profile, bus: BusId, start: Moment) -> Option<HeartbeatTask> {
        let heartbeat = profile.heartbeat.as_ref();
        let heartbeat = heartbeat.filter(|heartbeat| profile.device(heartbeat.device).bus == bus)?.clone();
        Some(HeartbeatTask {
            heartbeat,
            due: start,
            controller: HeartbeatController::default(),
            missed: 0,
            reported: None,
        })
    }

    pub(super) async fn beat(&mut self, line: &mut DeviceLine, shared: &LineHandle, now: Moment) {
        self.due = now.next_tick(self.due, self.heartbeat.every);
        let beat = shared.beat(now);
        let (before, highest) = (self.controller, self.heartbeat.highest());
        let Some(count) = self.controller.next(beat, highest) else { return };
        let state = ControllerState::Heartbeat;
        let turn = Turn::Heartbeat(HeartbeatTurn { beat, count: Some(count) });
        let ended = TurnRecord { before: state(before), turn, after: state(self.controller) };
        let snapshot = || ControllerSnapshot::Heartbeat(HeartbeatSnapshot { highest, heartbeat: before });
        shared.core().storage.outputs.turned(CountedWrite::Heartbeat, ended, snapshot, now);
        let Heartbeat { device, address, .. } = &self.heartbeat;
        let functions = shared.profile.device(*device).functions;
        let count = self.heartbeat.data_type().encode(u64::from(count));
        let request = Request::write(address, count.registers(), functions);
        // The next beat replaces a failed one. No beat is sent later.
        let sent = line.request(*device, request, SendDeadline::By(self.due)).await.err();
        self.report(shared, sent);
        let log = &mut shared.core().storage.outputs;
        match sent {
            None => log.wrote(CountedWrite::Heartbeat, now),
            Some(fault) => log.not_written(CountedWrite::Heartbeat, &fault, now),
        }
    }

    /// Reports that the device refuses the heartbeat. Also reports that the device does not answer the
    /// heartbeat, although it answers other requests. A lost device is reported by other code.
    fn report(&mut self, shared: &LineHandle, sent: Option<Fault>) {
        let Some(fault) = sent.filter(|fault| !fault.has_lapsed()) else {
            if sent.is_none() {
                self.missed = 0;
                if self.reported.take().is_some() {
                    let (device, place) = self.names(shared);
                    shared.report(&Event::HeartbeatWritten { device, place });
                }
            }
            return;
        };
        self.missed += 1;
        let device = self.heartbeat.device;
        let is_deaf = self.missed >= DEAF && shared.core().device_health.devices[device.0].is_here();
        if (fault.is_refusal() || is_deaf) && Cause::is_news(&mut self.reported, fault, CHANGED_AFTER) {
            let transport = shared.profile.bus(shared.profile.device(device).bus).transport;
            let (device, place) = self.names(shared);
            let function = shared.profile.device(self.heartbeat.device).functions.writes(1);
            let asked = function.map_or(Asked::Any, |function| Asked::Write(function.code()));
            let fault = explain_on(transport, Seen::of(fault, asked));
            shared.report(&Event::HeartbeatFailed { device, place, fault });
        }
    }

    fn names(&self, shared: &LineHandle) -> (String, String) {
        let Heartbeat { device, address, .. } = &self.heartbeat;
        (shared.profile.device(*device).name.clone(), address.to_string())
    }
}
