//! Values that a virtual device sends in one answer, and their addresses in registers.

use std::time::Duration;

use isotherm_core::codec::{Address, Register, Table, TextPattern};
use isotherm_profile::plan::ReadTarget;
use isotherm_profile::{BusId, DeviceId, Profile};

/// Number of registers that store one value, a 64-bit float.
pub(super) const WIDTH: u16 = 4;

/// Values that a device sends in answer to one request, or without a request.
#[derive(Clone, Debug)]
pub(in crate::virtual_machine) struct TextGroup {
    pub(super) bus: BusId,
    pub(super) device: DeviceId,
    pub(super) unit: u8,
    /// Request that the device answers; empty if the device sends without a request.
    pub(super) request: String,
    pub(super) patterns: Vec<TextPattern>,
    /// First register of the first value. The registers of the other values follow.
    pub(super) first: u16,
    pub(super) every: Duration,
}

/// Assigns registers to each value that a device sends as text. Returns the profile with the addresses of these
/// registers, and the groups of values.
pub(in crate::virtual_machine) fn in_registers(profile: &Profile) -> (Profile, Vec<TextGroup>) {
    let (mut changed, mut groups, mut next) = (profile.clone(), Vec::new(), 0_u16);
    for (index, device) in profile.devices.iter().enumerate() {
        for request in profile.requests(DeviceId(index)) {
            let ReadTarget::Texts(texts) = &request.asks else { continue };
            let first = next;
            for field in &request.fields {
                let register = Register { table: Table::Input, offset: next };
                changed.signals[field.signal.0].address = Address::Modbus(register);
                next = next.saturating_add(WIDTH);
            }
            groups.push(TextGroup {
                bus: device.bus,
                device: DeviceId(index),
                unit: device.unit,
                request: texts.first().map(|text| text.request.clone()).unwrap_or_default(),
                patterns: texts.iter().map(|text| text.pattern.clone()).collect(),
                first,
                every: device.every,
            });
        }
    }
    (changed, groups)
}

impl TextGroup {
    /// Returns whether the device is a DCON module (input module with an ASCII protocol). Its requests begin with `#`.
    pub(super) fn is_dcon(&self) -> bool {
        self.request.starts_with('#')
    }

    /// Returns whether the answers have a checksum.
    pub(super) fn has_sum(&self) -> bool {
        self.patterns.iter().any(TextPattern::has_sum)
    }
}
