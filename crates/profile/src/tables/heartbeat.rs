//! `[heartbeat]`: register or node with a counter that shows that the gateway runs.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::device::Device;
use super::register::{Notation, TypeWord};
use crate::DeviceId;
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use isotherm_core::codec::{Address, DataType, Node};

mod resolve;

/// Smallest value that the heartbeat's counter must be able to reach.
pub(crate) const FEW: u16 = 100;

/// Register or node with a counter that shows the control that the gateway runs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Heartbeat", extend("x-layers" = "arrives"))]
pub(crate) struct RawHeartbeat {
    /// Device to which the heartbeat is written.
    #[schemars(required)]
    pub(super) device: Option<String>,
    /// Holding register of 16 bits in which the heartbeat counts.
    pub(crate) register: Option<String>,
    /// Node of an OPC UA server, for example "ns=2;s=…".
    pub(crate) node: Option<String>,
    /// Type of the node, an integer. Required for a node.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// Period of the heartbeat.
    #[schemars(required, extend("x-layers" = "free"))]
    pub(super) every: Option<Timespan>,
}

/// Heartbeat of the profile, after its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Heartbeat {
    /// Device to which the heartbeat is written.
    pub device: DeviceId,
    /// Holding register or OPC UA node that contains the counter.
    pub address: Address,
    /// Period at which the gateway increases the counter and writes it.
    pub every: Duration,
}

impl Heartbeat {
    /// Returns the data type of the heartbeat's counter.
    pub fn data_type(&self) -> DataType {
        self.address.node().map_or(DataType::U16, Node::taken_as)
    }

    /// Returns the largest value of the counter: the maximum of its data type, but at most 65535.
    pub fn highest(&self) -> u16 {
        let highest = self.data_type().integer_range().map_or(0, |(_, highest)| highest);
        u16::try_from(highest).unwrap_or(u16::MAX)
    }

    /// Returns the preview of the heartbeat: register or node, and period.
    pub(crate) fn preview(&self, device: &Device) -> Section {
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
