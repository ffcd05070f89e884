//! Settings of a device on a CAN line: its node number, the objects that are written before the node starts, and the
//! frames that are sent to the device.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::emergency::Emergency;
use super::fields;
use crate::duration::shown;
use crate::tables::KeyContext;
use crate::tables::register::TypeWord;
use isotherm_core::codec::{CanId, Frame, Object};

/// Object that is written before the node starts.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Setup")]
pub(crate) struct RawSetup {
    /// Index and sub-index in hexadecimal, for example "1800:05".
    #[schemars(required, regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    sdo: Option<String>,
    /// Type of the object.
    #[serde(rename = "type")]
    #[schemars(required)]
    kind: Option<TypeWord>,
    /// Value that is written.
    #[schemars(required)]
    value: Option<i64>,
    /// Meaning of the value, for messages, for example "TPDO1 every 100 ms".
    what: Option<String>,
}

/// Meaning of an emergency code of the device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Emergency")]
pub(crate) struct RawEmergency {
    /// Emergency code.
    #[schemars(required, range(min = 0, max = 65535))]
    pub(super) code: Option<u16>,
    /// Bits of the code that are compared: 0xFF00 for a class of codes. Default 0xFFFF.
    #[schemars(range(min = 0, max = 65535))]
    pub(super) mask: Option<u16>,
    /// Meaning of the code.
    #[schemars(required)]
    pub(super) means: Option<String>,
}

/// Settings that only a device on a CAN line has. Such a device is a CANopen node if it has a node number.
#[derive(Clone, Debug, PartialEq)]
pub struct CanDevice {
    /// CANopen node number, 1 to 127. `None` if the device only sends frames.
    pub node: Option<u8>,
    /// Whether the gateway starts the node by NMT (CANopen network management): when the gateway starts, and after each
    /// boot-up of the node.
    pub start: bool,
    /// Timeout of the node's heartbeat. The timeout also applies if no heartbeat was ever received. `None` if the
    /// heartbeat is not monitored.
    pub heartbeat: Option<Duration>,
    /// Objects that are written before each start of the node, in this order.
    pub setup: Vec<Setup>,
    /// Meanings of the device's own emergency codes. They take precedence over those of CiA 301.
    pub emergencies: Vec<Emergency>,
    /// Frames that the gateway sends, with their bytes before the values of outputs are inserted. Several outputs may
    /// write into one frame. The gateway sends this frame when each of these outputs has a value.
    pub written: Vec<Frame>,
}

/// Object that is written before the node starts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Entry of the object dictionary that is written.
    pub object: Object,
    /// Value to write, within the range of the object's type.
    pub value: i64,
    /// Meaning of the value, for messages. May be empty.
    pub what: String,
}

impl CanDevice {
    /// Returns the frame that the gateway sends with this identifier. The values of its outputs have not been inserted
    /// yet.
    pub fn written(&self, id: CanId) -> Option<&Frame> {
        self.written.iter().find(|frame| frame.id() == id)
    }

    /// Returns the meaning of an emergency code of this device.
    pub fn emergency(&self, code: u16) -> String {
        let own = self.emergencies.iter().filter(|known| known.names(code));
        let own = own.max_by_key(|known| known.mask.count_ones());
        own.map_or_else(|| Emergency::generic(code).to_owned(), |known| known.meaning.clone())
    }
}

impl Setup {
    /// Returns the bytes of the value as they are written into the object, least significant byte first.
    pub fn bytes(&self) -> Vec<u8> {
        self.value.to_le_bytes()[..self.object.size().min(8)].to_vec()
    }
}

impl RawSetup {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<Setup> {
        let entry = fields::entry(&at.key("sdo"), self.sdo.as_ref()?);
        let data_type = fields::object_type(&at.key("type"), self.kind?);
        let (entry, data_type, value) = (entry?, data_type?, self.value?);
        let Some((low, high)) = data_type.integer_range() else {
            let help = "use an integer type: u8, u16, i16, u32, i32, …";
            return at.key("type").reject("`setup` cannot write an object with a floating-point type", help);
        };
        if !(low..=high).contains(&i128::from(value)) {
            let message = format!("{} cannot contain {value}", data_type.name());
            at.key("value").invalid(message, format!("allowed: {low} to {high}"));
        }
        Some(Setup {
            object: Object { entry, data_type },
            value,
            what: self.what.clone().unwrap_or_default(),
        })
    }
}

/// Reports an error if `setup` makes the node send its heartbeat too rarely for the timeout `heartbeat`. Does nothing
/// if the timeout or the heartbeat period is unknown.
pub(super) fn heartbeat_produced(at: &KeyContext<'_>, can: &CanDevice) {
    let produced = can.setup.iter().find(|setup| setup.object.entry.index == 0x1017);
    let Some((heartbeat, produced)) = can.heartbeat.zip(produced) else { return };
    let every = Duration::from_millis(u64::try_from(produced.value).unwrap_or(0));
    if every.is_zero() || every * 2 > heartbeat {
        let pace = if every.is_zero() { "none".to_owned() } else { format!("one every {}", shown(every)) };
        let heartbeat = shown(heartbeat);
        let message =
            format!("`heartbeat` is {heartbeat}, but with 1017:00 in `setup` the node sends {pace}");
        let help = "let the node send at least two heartbeats in this time, so that one lost heartbeat is not a fault";
        at.key("heartbeat").invalid(message, help);
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
