//! Reception on a CAN line (bus): one task receives every frame, and stores the values in the table of
//! signals.
//!
//! ```text
//! frames ─► routes ─► signal table; wakes the line that corrects a position
//!        ├► nodes   heartbeats, boot-ups, emergencies, silence: reported; nodes are started, their readings rejected
//!        ├► answers of SDO ─► the line, which sends requests as on any other line
//!        └► health  error frames, full queue, lost frames: reported at their beginning and at their end
//! ```
//!
//! The network interface may be missing, go down or be removed at any time. The task opens it again without an
//! operator.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::clock::Wakeup;
use crate::fieldbus::kinds::can::{CanDial, Images, Link, Value};
use isotherm_core::codec::{Address, CanId};
use isotherm_profile::{Bus, BusId, Device, DeviceId, Output, Profile, Verify};

mod health;
mod listener;
mod nodes;
mod routes;

pub(in crate::gateway) use listener::CanListener;

/// State that a CAN line and its listener share.
pub(in crate::gateway) struct Can {
    pub(super) link: Arc<Link>,
    wakeup: Wakeup,
    handed: Mutex<PendingNodeReports>,
}

/// Reports about devices that the line task and the listener have not exchanged yet.
#[derive(Debug, Default)]
struct PendingNodeReports {
    /// Devices whose setup list (objects to write before the node starts) has been written, and whose checks
    /// have been read.
    set_up: Vec<DeviceId>,
    /// Devices whose back-off (waiting time after failures) must end now. `None` means all devices of the line.
    revived: Vec<Option<DeviceId>>,
}

impl Can {
    pub(in crate::gateway) fn dial(&self, bus: &Bus) -> CanDial {
        CanDial::new(self.link.clone(), bus.timeout)
    }

    pub(super) fn is_set_up(&self, device: DeviceId) {
        self.handed().set_up.push(device);
        self.wakeup.wake();
    }

    /// Removes and returns the devices whose back-off (waiting time after failures) must end now. `None`
    /// means all devices of the line.
    pub(super) fn revived(&self) -> Vec<Option<DeviceId>> {
        std::mem::take(&mut self.handed().revived)
    }

    fn revive(&self, what: Option<DeviceId>) {
        self.handed().revived.push(what);
    }

    fn handed(&self) -> MutexGuard<'_, PendingNodeReports> {
        self.handed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the images of a CAN line: the frames that the gateway writes, and the bits of each output in these frames.
fn images(profile: &Profile, bus: BusId) -> Images {
    let mut images = Images::default();
    for (id, device) in profile.devices_on(bus) {
        for frame in device.can.iter().flat_map(|can| &can.written) {
            let own = profile.outputs.iter().filter(|output| output.device == id);
            let values = own.filter_map(|output| value(device, output, frame.id()));
            images.add(*frame, values.collect());
        }
    }
    images
}

/// Returns the bits of an output in the frame with this identifier, and the object with which the gateway reads the
/// output back. `None` if the frame does not contain the output.
fn value(device: &Device, output: &Output, id: CanId) -> Option<Value> {
    let Address::Frame(field) = &output.address else { return None };
    let node = device.can.as_ref().and_then(|can| can.node);
    let read_at = match output.verify {
        Verify::ReadBackAt(object) => node.map(|node| (node, object)),
        _ => None,
    };
    (field.frames.id == id).then(|| Value::new(field.bits, read_at))
}
