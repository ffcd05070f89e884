//! Devices of a CAN line. The CANopen master controls the nodes. A device without a heartbeat counts as lost if it
//! sends nothing for longer than its timeout.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::fieldbus::kinds::can::canopen::NodeId;
use crate::fieldbus::kinds::can::canopen::emergency::{Emergency, SERVICE};
use crate::fieldbus::kinds::can::canopen::master::{Master, NodeEvent, Output, Start, Supervision};
use crate::fieldbus::kinds::can::canopen::node::HEARTBEAT;
use crate::fieldbus::kinds::can::canopen::sdo;
use isotherm_core::codec::{Address, CanId, CanMatch, Frame};
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, CanDevice, DeviceId, Profile, Sync};

/// Maximum number of emergency codes that are recorded for one device.
const MOST_CODES: usize = 16;

/// Supervision of all devices of one CAN line.
#[derive(Debug)]
pub(super) struct Nodes {
    settings: Vec<(NodeId, Supervision)>,
    sync: Option<Sync>,
    master: Master,
    devices: Vec<(DeviceId, Option<NodeId>)>,
    sdo: Vec<CanId>,
    silences: Vec<Silence>,
    emergencies: BTreeMap<(NodeId, u16), u64>,
    outputs: Vec<Output>,
}

/// Supervision of a device without a heartbeat. The device counts as lost if it sends nothing for the largest
/// `max_age` of its signals.
#[derive(Debug)]
struct Silence {
    device: DeviceId,
    patience: Duration,
    received: Moment,
    was_heard: bool,
    is_lost: bool,
}

/// Action or report that the listener must carry out after a received frame or an elapsed timeout.
#[derive(Debug)]
pub(super) enum Reaction {
    Send(Frame),
    Node(DeviceId, NodeEvent),
    /// A device without a heartbeat has sent nothing for the contained time. The `bool` is whether the gateway has
    /// received a frame of the device before.
    Silent(DeviceId, Duration, bool),
    /// The device has sent an emergency message with a code that was not reported yet.
    Emergency(DeviceId, Emergency),
    /// All reported emergencies of the device are over. Contains the number of emergency messages that the device had
    /// sent.
    EmergencyOver(DeviceId, u64),
}

impl Nodes {
    pub(super) fn new(profile: &Profile, bus: BusId, now: Moment) -> Nodes {
        let here = profile.devices_on(bus).filter_map(|(id, device)| Some((id, device.can.as_ref()?)));
        let node = |can: &CanDevice| can.node.and_then(NodeId::new);
        let settings: Vec<(NodeId, Supervision)> = here
            .clone()
            .filter_map(|(id, can)| {
                let start = start(can, profile.device(id).verify.is_empty());
                Some((node(can)?, Supervision { heartbeat: can.heartbeat, start }))
            })
            .collect();
        let sync = profile.bus(bus).sync;
        let silences = here.clone().filter(|(_, can)| can.heartbeat.is_none()).filter_map(|(id, _)| {
            let own = profile.signals_of(id).map(|(_, signal)| signal);
            let sent = own.filter(|signal| matches!(signal.address, Address::Frame(_)));
            let patience = sent.map(|signal| signal.max_age).max()?;
            Some(Silence { device: id, patience, received: now, was_heard: false, is_lost: false })
        });
        Nodes {
            master: Master::new(settings.iter().copied(), sync, now),
            silences: silences.collect(),
            devices: here.map(|(id, can)| (id, node(can))).collect(),
            sdo: settings.iter().flat_map(|(node, _)| sdo::identifiers(*node)).collect(),
            emergencies: BTreeMap::new(),
            outputs: Vec::new(),
            settings,
            sync,
        }
    }

    /// Begins the supervision of the nodes again after the interface was down, because the nodes may have been reset
    /// meanwhile.
    pub(super) fn restart(&mut self, now: Moment) {
        self.master = Master::new(self.settings.iter().copied(), self.sync, now);
        self.silences.iter_mut().for_each(|silence| silence.received = now);
    }

    /// Returns the filters for the frames that the CANopen master evaluates, and for SDO requests and responses.
    pub(super) fn wanted(&self) -> impl Iterator<Item = CanMatch> {
        self.master.identifiers().chain(self.sdo.iter().copied()).map(CanMatch::exactly)
    }

    /// Returns whether the frame with this identifier is an SDO request to a node of this line, or an SDO response.
    pub(super) fn is_sdo(&self, id: CanId) -> bool {
        self.sdo.contains(&id)
    }

    pub(super) fn devices(&self) -> impl Iterator<Item = DeviceId> {
        self.devices.iter().map(|(device, _)| *device)
    }

    /// Returns whether the device counts as lost, because it has sent nothing within its timeout.
    pub(super) fn is_lost(&self, device: DeviceId) -> bool {
        match self.devices.iter().find(|(id, _)| *id == device) {
            Some((_, Some(node))) if self.master.is_lost(*node) => true,
            _ => self.silences.iter().any(|silence| silence.device == device && silence.is_lost),
        }
    }

    /// Returns the device that has sent this frame, if the frame is a heartbeat or an emergency message. `None` for
    /// any other frame.
    pub(super) fn speaker(&self, frame: &Frame) -> Option<DeviceId> {
        let node = [HEARTBEAT, SERVICE].into_iter().find_map(|service| NodeId::sender(frame, service))?;
        self.device(node)
    }

    pub(super) fn heard(&mut self, device: DeviceId, now: Moment) {
        if let Some(silence) = self.silences.iter_mut().find(|silence| silence.device == device) {
            silence.is_lost = false;
            (silence.received, silence.was_heard) = (now, true);
        }
    }

    pub(super) fn take(&mut self, frame: &Frame, now: Moment) -> Vec<Reaction> {
        self.master.take(frame, now, &mut self.outputs);
        self.follow()
    }

    /// Handles the timeouts that have elapsed at `now`. `set_up` contains the devices whose setup list has
    /// been written, and whose checks have been read.
    pub(super) fn tick(&mut self, set_up: Vec<DeviceId>, now: Moment) -> Vec<Reaction> {
        for device in set_up {
            if let Some((_, Some(node))) = self.devices.iter().find(|(id, _)| *id == device) {
                self.master.set_up(*node, &mut self.outputs);
            }
        }
        self.master.tick(now, &mut self.outputs);
        let mut follows = self.follow();
        for silence in self.silences.iter_mut().filter(|silence| silence.due().is_some_and(|due| due <= now))
        {
            silence.is_lost = true;
            follows.push(Reaction::Silent(silence.device, silence.patience, silence.was_heard));
        }
        follows
    }

    pub(super) fn due(&self) -> Option<Moment> {
        self.silences.iter().filter_map(Silence::due).chain(self.master.due()).min()
    }

    fn follow(&mut self) -> Vec<Reaction> {
        let mut follows = Vec::new();
        for output in std::mem::take(&mut self.outputs) {
            match output {
                Output::Send(frame) => follows.push(Reaction::Send(frame)),
                Output::Tell(node, event) => {
                    let Some(device) = self.device(node) else { continue };
                    match event {
                        NodeEvent::Emergency(emergency) => {
                            follows.extend(self.complains(node, device, emergency))
                        }
                        event => follows.push(Reaction::Node(device, event)),
                    }
                }
            }
        }
        follows
    }

    /// Counts an emergency message. Each code is reported once, until the node reports that its error is over.
    fn complains(&mut self, node: NodeId, device: DeviceId, emergency: Emergency) -> Option<Reaction> {
        let known = self.emergencies.range((node, 0)..=(node, u16::MAX)).count();
        if emergency.is_over() {
            let counts = self.emergencies.range((node, 0)..=(node, u16::MAX)).map(|(_, count)| count).sum();
            self.emergencies.retain(|(other, _), _| *other != node);
            return (known > 0).then_some(Reaction::EmergencyOver(device, counts));
        }
        let is_new = known < MOST_CODES && !self.emergencies.contains_key(&(node, emergency.code));
        if is_new || self.emergencies.contains_key(&(node, emergency.code)) {
            *self.emergencies.entry((node, emergency.code)).or_default() += 1;
        }
        is_new.then_some(Reaction::Emergency(device, emergency))
    }

    fn device(&self, node: NodeId) -> Option<DeviceId> {
        self.devices.iter().find(|(_, known)| *known == Some(node)).map(|(device, _)| *device)
    }
}

impl Silence {
    fn due(&self) -> Option<Moment> {
        (!self.is_lost).then(|| self.received.after(self.patience))
    }
}

/// Returns the condition under which the master starts a device. If the device has a setup list or checks,
/// the gateway first writes the list and reads the checks.
fn start(can: &CanDevice, is_unchecked: bool) -> Start {
    match can.start {
        false => Start::Never,
        true if can.setup.is_empty() && is_unchecked => Start::AtOnce,
        true => Start::WhenSetUp,
    }
}

#[cfg(test)]
mod tests;
