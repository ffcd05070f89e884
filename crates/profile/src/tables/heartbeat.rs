//! `[heartbeat]`: the register that counts while the gateway lives.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use super::bus::LineKind;
use super::register::{Notation, holding};
use crate::document::Section;
use crate::duration::{Timespan, shown};
use crate::{DeviceId, Profile};
use isotherm_core::codec::Register;

/// A register that counts while the gateway lives.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Heartbeat")]
pub(crate) struct RawHeartbeat {
    /// The device it is written to.
    #[schemars(required)]
    pub(super) device: Option<String>,
    /// A holding register, 16 bits.
    #[schemars(required)]
    register: Option<String>,
    /// How often it counts.
    #[schemars(required)]
    pub(super) every: Option<Timespan>,
}

/// The register that counts while the gateway lives.
#[derive(Clone, Debug, PartialEq)]
pub struct Heartbeat {
    /// Where.
    pub device: DeviceId,
    /// A holding register.
    pub address: Register,
    /// How often it counts.
    pub every: Duration,
}

impl Heartbeat {
    /// Where it counts, and how often.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let device = profile.device(self.device);
        let function = device.functions.write_code(1);
        let (device, register, every) = (&device.name, Notation::from(self.address), shown(self.every));
        let mut section = Section::default();
        section.line(format!(
            "  heartbeat: {register} of {device}, u16, counts every {every}; function {function:02}, 1 register"
        ));
        section.entry("device", device);
        section.json("register", register);
        section.entry("every", every);
        section.entry("function", function);
        section
    }
}

impl RawHeartbeat {
    pub(super) fn resolve(&self, at: &At<'_>) -> Option<Heartbeat> {
        let every = at.key("every").period(self.every);
        let index = at.key("device").named(&at.check.devices, self.device.as_ref());
        let address = holding(&at.key("register"), self.register.as_ref());
        let kind = at.check.line_kind(self.device.as_ref());
        if kind.is_some_and(|kind| kind != LineKind::Modbus) {
            let help = match kind {
                Some(LineKind::Can) => {
                    "name a Modbus device; a CANopen node has a heartbeat consumer of its own, object 1016"
                }
                _ => "name a Modbus device; an OPC UA server notices by itself that a client is gone",
            };
            at.key("device").wrong("the heartbeat is a register, and this device has none", help);
            return None;
        }
        if let Some(device) = index.and_then(|index| at.check.devices.get(index)) {
            device.must_write(&at.key("register"), 1);
        }
        Some(Heartbeat { device: DeviceId(index?), address: address?, every: every? })
    }
}
