//! The interface comes and goes.

use super::health::Change;
use super::{Can, CanListener};
use crate::fieldbus::can::Interface;
use crate::fieldbus::error::Fault;
use crate::gateway::core::Core;
use crate::observe::events::Event;
use isotherm_core::reading::Reason;
use isotherm_profile::DeviceId;

impl Can {
    /// These need not rest any longer: a device, or the whole line.
    pub(super) fn revive(&self, what: Option<DeviceId>) {
        self.handed().revived.push(what);
    }
}

impl CanListener {
    /// Opens the interface, or finds it up again. Whatever hangs on it begins anew.
    pub(super) fn try_interface(&mut self) {
        let socket = match self.can.link.open() {
            Ok(socket) => socket,
            Err(fault) => return self.is_without(fault),
        };
        let is_new = self.socket.as_ref().is_none_or(|(known, _)| !std::sync::Arc::ptr_eq(known, &socket));
        if is_new {
            // Where the process has no descriptor left, virtual time does without.
            let inlet = self.shared.clock.inlet(socket.as_ref()).ok();
            self.socket = Some((socket, inlet));
        }
        self.is_up = true;
        self.nodes.begin_anew(self.shared.clock.now());
        let mut core = self.shared.core();
        let Core { contact, commissioning, events, .. } = &mut *core;
        contact.buses[self.bus.0].connected = true;
        contact.link_is_up(&self.shared.profile, self.bus, events);
        for device in self.nodes.devices() {
            commissioning.forget(&self.shared.profile, device);
        }
        drop(core);
        self.can.revive(None);
        self.shared.wake_line(self.bus);
    }

    /// A call to the socket failed: the interface is down, or gone.
    pub(super) fn lose_interface(&mut self, fault: Fault) {
        self.can.link.failed(fault);
        if self.can.link.socket().is_none() {
            self.socket = None;
        }
        self.is_up = false;
        self.unsent.clear();
        self.is_without(fault);
    }

    /// There is no interface to listen to: told once, and its readings say why.
    fn is_without(&mut self, fault: Fault) {
        if self.can.link.socket().is_none() {
            self.socket = None;
        }
        let mut core = self.shared.core();
        let Core { contact, board, events, .. } = &mut *core;
        let count = &mut contact.buses[self.bus.0];
        count.connected = false;
        let attempts = count.down.unwrap_or_default() + 1;
        contact.link_is_down(&self.shared.profile, self.bus, attempts, fault, events);
        for device in self.nodes.devices() {
            let lost = contact.devices[device.0].lost.get_or_insert_default();
            lost.fault = fault.to_string();
            lost.answers_since = None;
        }
        for signal in self.routes.signals() {
            board.fail(signal, Reason::LinkDown);
        }
    }

    pub(super) fn tell_health(&self, changes: Vec<Change>) {
        for change in changes {
            let bus = self.shared.profile.bus(self.bus);
            let (name, address) = (bus.name.clone(), bus.address.clone());
            let event = match change {
                Change::Worse { what, is_off } => {
                    let stays = is_off && Interface::look(&address).is_ok_and(|found| found.stays_off());
                    let hint = if stays {
                        format!(
                            "; it stays off: `ip link set {address} type can restart-ms 100` lets it come back"
                        )
                    } else {
                        String::new()
                    };
                    Event::BusTrouble { bus: name, address, what: what + &hint }
                }
                Change::Over { count, what, within } => {
                    Event::BusWell { bus: name, address, count, what, within }
                }
            };
            self.shared.report(&event);
        }
    }
}
