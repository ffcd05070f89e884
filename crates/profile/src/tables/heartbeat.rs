//! `[heartbeat]`: register or node with a counter that shows that the gateway runs.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::bus::LineKind;
use super::opcua::{holds, written};
use super::register::{Notation, TypeWord, holding};
use super::{KeyContext, sysfs};
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::{DeviceId, Profile};
use isotherm_core::codec::{Address, DataType, Node};

/// Smallest value that the heartbeat's counter must be able to reach.
const FEW: u16 = 100;

/// Register or node with a counter that shows the control that the gateway runs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Heartbeat", extend("x-layers" = "arrives"))]
pub(crate) struct RawHeartbeat {
    /// Device to which the heartbeat is written.
    #[schemars(required)]
    pub(super) device: Option<String>,
    /// Holding register of 16 bits in which the heartbeat counts.
    register: Option<String>,
    /// Node of an OPC UA server, for example "ns=2;s=…".
    node: Option<String>,
    /// Type of the node, an integer. Required for a node.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Period of the heartbeat.
    #[schemars(required, extend("x-layers" = "free"))]
    pub(super) every: Option<Timespan>,
}

/// Heartbeat of the profile, after its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Heartbeat {
    /// Device to which the heartbeat is written.
    pub device: DeviceId,
    /// Holding register or node.
    pub address: Address,
    /// Period of the heartbeat.
    pub every: Duration,
}

impl Heartbeat {
    /// Type of the counter.
    pub fn data_type(&self) -> DataType {
        self.address.node().map_or(DataType::U16, Node::taken_as)
    }

    /// Returns the largest value of the counter: that of its type, at most 65535.
    pub fn highest(&self) -> u16 {
        let highest = self.data_type().integer_range().map_or(0, |(_, highest)| highest);
        u16::try_from(highest).unwrap_or(u16::MAX)
    }

    /// Preview of the heartbeat: register or node, and period.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let device = profile.device(self.device);
        let function = self.address.register().map_or(0, |_| device.functions.write_code(1));
        let by = if function == 0 { String::new() } else { format!("; function {function:02}, 1 register") };
        let data_type = self.data_type();
        let register = Notation::of(&self.address, data_type);
        let (device, every, name) = (&device.name, shown(self.every), data_type.name());
        let mut section = Section::default();
        section.line(format!("  heartbeat: {register} of {device}, {name}, counts every {every}{by}"));
        section.entry("device", device);
        section.json("register", register);
        entries!(section, every, function);
        section
    }
}

impl RawHeartbeat {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<Heartbeat> {
        let every = at.key("every").period(self.every);
        let index = at.key("device").named(&at.check.devices, self.device.as_ref());
        let address = match at.check.line_kind(self.device.as_ref()) {
            Some(LineKind::OpcUa) => {
                let help = "remove this key, and write node = \"ns=2;s=…\"";
                at.not_applicable(&["register"], "a Modbus device", help);
                let node = written(at, self.node.as_ref(), self.kind)?;
                holds(at, &node, FEW)?;
                Some(Address::Node(node))
            }
            Some(LineKind::Can) => {
                let help =
                    "name a Modbus device; a CANopen node has a heartbeat consumer of its own, object 1016";
                let message = "the heartbeat is written to a register, and this device has no registers";
                return at.key("device").reject(message, help);
            }
            Some(LineKind::Sysfs) => {
                let help = "name the device of the control that watches the gateway";
                return at.key("device").reject(sysfs::ONLY_READ, help);
            }
            _ => {
                let help = "remove this key, and write register = \"holding:100\"";
                at.not_applicable(&["node", "type"], "an OPC UA server", help);
                let place = at.key("register");
                let help = "write a holding register, as \"holding:100\"";
                place.missing("`register` is missing: in which register does the heartbeat count?", help);
                holding(&place, self.register.as_ref()).map(Address::from)
            }
        };
        let is_register = address.as_ref().is_some_and(|address| address.register().is_some());
        let device = index.and_then(|index| at.check.devices.get(index));
        if let Some(device) = device.filter(|_| is_register) {
            device.must_write(&at.key("register"), 1);
        }
        Some(Heartbeat { device: DeviceId(index?), address: address?, every: every? })
    }
}
