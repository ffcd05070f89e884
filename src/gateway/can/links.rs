//! The listener of a CAN line as its profile has it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::{Can, CanListener, Handed, Health, Nodes, Routes};
use crate::clock::Looks;
use crate::fieldbus::can::{Images, Link, Value};
use crate::fieldbus::trace::Tap;
use crate::gateway::line_handle::LineHandle;
use isotherm_core::codec::{Address, CanId};
use isotherm_profile::{BusId, Device, DeviceId, Output, Profile, Verify};

impl CanListener {
    /// The listener of a line and what it shares with it; `None` for a line that is not CAN. Opens the interface, if it
    /// is there.
    pub(in crate::gateway) fn of(
        shared: &LineHandle,
        bus: BusId,
        tap: &Tap,
    ) -> Option<(Arc<Can>, CanListener)> {
        let profile = &shared.profile;
        let settings = profile.bus(bus);
        if !settings.transport.is_can() {
            return None;
        }
        let now = shared.clock.now();
        let (routes, nodes) = (Routes::new(profile, bus), Nodes::new(profile, bus, now));
        let wanted = routes.wanted().chain(nodes.wanted()).collect();
        let link = Arc::new(Link::new(&settings.address, wanted, images(profile, bus)));
        let sleeper = shared.clock.join();
        let can = Arc::new(Can { link, wakeup: sleeper.wakeup(), handed: Mutex::new(Handed::default()) });
        let mut listener = CanListener {
            shared: shared.clone(),
            bus,
            can: can.clone(),
            sleeper,
            routes,
            nodes,
            health: Health::default(),
            unsent: VecDeque::new(),
            socket: None,
            is_up: false,
            tap: tap.clone(),
            measure_at: now,
            looks: Looks::begin(now, shared.profile.shortest_age()),
        };
        listener.try_interface();
        Some((can, listener))
    }
}

/// The frames that are written on a line.
fn images(profile: &Profile, bus: BusId) -> Images {
    let mut images = Images::default();
    let devices = profile.devices.iter().enumerate().filter(|(_, device)| device.bus == bus);
    for (place, device) in devices {
        for frame in device.can.iter().flat_map(|can| &can.written) {
            let own = profile.outputs.iter().filter(|output| output.device == DeviceId(place));
            let values = own.filter_map(|output| value(device, output, frame.id()));
            images.add(*frame, values.collect());
        }
    }
    images
}

/// The value of an output in the frame with this identifier.
fn value(device: &Device, output: &Output, id: CanId) -> Option<Value> {
    let Address::Frame(field) = &output.address else { return None };
    let node = device.can.as_ref().and_then(|can| can.node);
    let read_at = match output.verify {
        Verify::ReadBackAt(object) => node.map(|node| (node, object)),
        _ => None,
    };
    (field.frames.id == id).then(|| Value::new(field.bits, read_at))
}
