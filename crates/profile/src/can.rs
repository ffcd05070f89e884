//! What hangs on a CAN line: nodes, what they are set up with, and the frames that are written to them.

use std::time::Duration;

use crate::{DeviceId, Profile, Verify};
use isotherm_core::codec::{Address, CanId, Frame, Object};

mod emergency;

pub use emergency::Emergency;

/// What a device on a CAN line has beside what every device has.
#[derive(Clone, Debug, PartialEq)]
pub struct CanDevice {
    /// CANopen node number, 1 to 127; `None`: a device that only sends frames.
    pub node: Option<u8>,
    /// Whether it is started by NMT, at the beginning and after each of its boot-ups.
    pub start: bool,
    /// Its heartbeat, missed this long or never seen this long, is a fault; `None`: not watched.
    pub heartbeat: Option<Duration>,
    /// Objects written before each start, in this order.
    pub setup: Vec<Setup>,
    /// What its emergency codes mean, beside those that every device has.
    pub emergencies: Vec<Emergency>,
    /// The frames that are written, as they are before an output has put its value in. Two outputs may share one; it is
    /// sent once each of them has a value.
    pub written: Vec<Frame>,
}

/// An object that is written before the node is started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Which.
    pub object: Object,
    /// What is written; it fits the type.
    pub value: i64,
    /// What that is, for people; may be empty.
    pub what: String,
}

/// Who sends SYNC on a line: we do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// With this identifier.
    pub id: CanId,
    /// This often.
    pub every: Duration,
}

impl Profile {
    /// The CANopen objects of a device that are in use, each once: as checks, signals and outputs name them, in this order.
    pub fn objects(&self, device: DeviceId) -> Vec<Object> {
        let object =
            |address: &Address| if let Address::Object(object) = address { Some(*object) } else { None };
        let checks = self.device(device).verify.iter().filter_map(|expected| object(&expected.address));
        let signals = self.signals.iter().filter(|signal| signal.device == device);
        let outputs = self.outputs.iter().filter(|output| output.device == device);
        let outputs = outputs.flat_map(|output| match output.verify {
            Verify::ReadBackAt(again) => [object(&output.address), Some(again)],
            _ => [object(&output.address), None],
        });
        let mut objects = Vec::new();
        for object in
            checks.chain(signals.filter_map(|signal| object(&signal.address))).chain(outputs.flatten())
        {
            if !objects.contains(&object) {
                objects.push(object);
            }
        }
        objects
    }
}

impl CanDevice {
    /// The frame that is written with this identifier, without the values of its outputs.
    pub fn written(&self, id: CanId) -> Option<&Frame> {
        self.written.iter().find(|frame| frame.id() == id)
    }

    /// What an emergency code of this device means.
    pub fn emergency(&self, code: u16) -> String {
        let own = self.emergencies.iter().filter(|known| known.names(code));
        let own = own.max_by_key(|known| known.mask.count_ones());
        own.map_or_else(|| Emergency::generic(code).to_owned(), |known| known.words.clone())
    }
}

impl Setup {
    /// The bytes that are written.
    pub fn bytes(&self) -> Vec<u8> {
        self.value.to_le_bytes()[..self.object.size().min(8)].to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::DataType;

    #[test]
    fn a_setup_writes_the_bytes_of_its_type() {
        let object = Object::new(0x6150, 1, DataType::unsigned(8));
        assert_eq!(Setup { object, value: -1, what: String::new() }.bytes(), [0xff]);
    }
}
