//! What happens to the devices of a CAN line: what is sent, what is told, what their readings are worth.

use super::CanListener;
use super::nodes::Do;
use crate::fieldbus::canopen::master::NodeEvent;
use crate::gateway::core::Core;
use crate::observe::events::Event;
use isotherm_core::reading::Reason;
use isotherm_profile::DeviceId;

impl CanListener {
    /// A frame of a device came that is not of a value.
    pub(super) fn is_spoken_to_by(&self, device: DeviceId) {
        let mut core = self.shared.core();
        let Core { contact, events, .. } = &mut *core;
        contact.answers(&self.shared.profile, device, self.shared.clock.now(), events);
    }

    /// Does what follows from a frame or from time.
    pub(super) fn act(&mut self, follows: &mut Vec<Do>) {
        for follow in follows.drain(..) {
            match follow {
                Do::Send(frame) => self.queue(frame),
                Do::Node(device, event) => self.happened(device, event),
                Do::Silent(device, patience, was_heard) => {
                    let patience = humantime::format_duration(patience);
                    let words = if was_heard { "nothing comes any more" } else { "nothing has come" };
                    self.lost(device, format!("{words}, for {patience}"));
                }
                Do::Complains(device, emergency) => {
                    let own = self.shared.profile.device(device);
                    let means = own.can.as_ref().map_or(String::new(), |can| can.emergency(emergency.code));
                    let (device, what) = (own.name.clone(), format!("{means} ({emergency})"));
                    self.shared.report(&Event::Emergency { device, what });
                }
                Do::Content(device, count) => {
                    let device = self.shared.profile.device(device).name.clone();
                    self.shared.report(&Event::EmergencyOver { device, count });
                }
            }
        }
        self.send();
    }

    fn happened(&mut self, device: DeviceId, event: NodeEvent) {
        let own = self.shared.profile.device(device);
        let (name, node) = (own.name.clone(), own.unit);
        let what = event.to_string();
        let is_reset = match event {
            NodeEvent::BootedUp { again } => {
                self.begins_anew(device, again);
                again
            }
            NodeEvent::FellBack => {
                self.begins_anew(device, true);
                true
            }
            NodeEvent::Stopped => true,
            NodeEvent::Lost { .. } => {
                self.lost(device, what);
                return;
            }
            NodeEvent::Back { .. } => {
                self.can.revive(Some(device));
                self.is_spoken_to_by(device);
                self.shared.wake_line(self.bus);
                false
            }
            // Sifted before.
            NodeEvent::Emergency(_) => false,
        };
        if is_reset {
            self.shared.report(&Event::NodeReset { device: name, node, what });
        }
    }

    fn lost(&self, device: DeviceId, what: String) {
        self.condemn(device, Reason::Timeout);
        let mut core = self.shared.core();
        let Core { contact, commissioning, events, .. } = &mut *core;
        if contact.is_silent(&self.shared.profile, device, what, events) {
            commissioning.forget(&self.shared.profile, device);
        }
    }

    /// A node came up: it is set up and looked at as at the beginning. What it said before its reset is not believed any
    /// more, and what stands in its registers is read anew.
    fn begins_anew(&mut self, device: DeviceId, was_there: bool) {
        if was_there {
            self.condemn(device, Reason::NotAsExpected);
        }
        let mut core = self.shared.core();
        core.commissioning.forget(&self.shared.profile, device);
        if was_there {
            core.restarts.device_restarted(&self.shared.profile, device);
        }
        drop(core);
        self.can.revive(Some(device));
        self.shared.wake_line(self.bus);
    }

    fn condemn(&self, device: DeviceId, reason: Reason) {
        let now = self.shared.clock.now();
        let mut core = self.shared.core();
        for signal in self.routes.of_device(device) {
            core.board.store(&self.shared.profile, signal, Err(reason), now);
            core.board.fail(signal, reason);
        }
    }
}
