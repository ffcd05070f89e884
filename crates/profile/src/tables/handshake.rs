//! `handshake` of an output or a set: a strobe and its acknowledgement.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use super::register::{Flag, Notation};
use crate::document::Section;
use crate::duration::{Timespan, shown};
use isotherm_core::codec::Table;

/// A strobe and its acknowledgement.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Handshake")]
pub(super) struct RawHandshake {
    /// Ours, "take it": a coil ("coil:20"), a holding register (1 and 0), or one bit of one ("holding:101.3").
    #[schemars(required)]
    strobe: Option<String>,
    /// The control's, "taken": a coil, a discrete input ("discrete:20"), a register (0 or not), or one bit of one
    /// ("input:16.0").
    #[schemars(required)]
    acknowledge: Option<String>,
    /// Longest wait for the acknowledge to come, and again for it to drop.
    #[schemars(required)]
    timeout: Option<Timespan>,
}

/// A strobe and its acknowledgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handshake {
    /// Ours: "take it".
    pub strobe: Flag,
    /// The control's: "taken".
    pub acknowledge: Flag,
    /// Longest wait for the acknowledge to rise, and again for it to drop.
    pub timeout: Duration,
}

impl Handshake {
    /// Its two exchanges; `function` writes one register of its device.
    pub(super) fn preview(&self, function: u8) -> Section {
        let function = if self.strobe.address.table.is_bits() { 5 } else { function };
        let (strobe, acknowledge) = (Notation::from(self.strobe), Notation::from(self.acknowledge));
        let timeout = shown(self.timeout);
        let mut section = Section::default();
        section.line(format!(
            "    then strobe {strobe} up (function {function:02}), acknowledge {acknowledge} up within {timeout}, strobe \
             down, acknowledge down within {timeout}"
        ));
        section.json("strobe", strobe);
        section.entry("function", function);
        section.json("acknowledge", acknowledge);
        section.entry("timeout", timeout);
        section
    }
}

impl RawHandshake {
    pub(super) fn resolve(&self, at: &At<'_>, device: Option<usize>) -> Option<Handshake> {
        let timeout = at.key("timeout").duration(self.timeout);
        let (at_strobe, at_acknowledge) = (at.key("strobe"), at.key("acknowledge"));
        let strobe = flag(&at_strobe, self.strobe.as_ref());
        let acknowledge = flag(&at_acknowledge, self.acknowledge.as_ref());
        if let Some(strobe) = strobe.filter(|strobe| !strobe.address.table.is_writable()) {
            let help = "write a coil or a holding register, as \"coil:20\" or \"holding:101\"";
            at_strobe.wrong(format!("{} cannot be written", strobe.address), help);
            return None;
        }
        let (strobe, acknowledge) = (strobe?, acknowledge?);
        if strobe.address == acknowledge.address {
            let message =
                format!("{} is the strobe itself: it would acknowledge at once", acknowledge.address);
            at_acknowledge.wrong(message, "name what the control raises when it has taken the value");
            return None;
        }
        if let Some(device) = device.and_then(|device| at.check.devices.get(device)) {
            if strobe.address.table == Table::Coil && !device.functions.write_coil {
                let message =
                    format!("writing this needs write-coil, which `{}` may not be sent", device.name);
                let help = "add \"write-coil\" to `functions` of the device, or take a holding register";
                at_strobe.wrong(message, help);
            }
            if strobe.address.table == Table::Holding {
                device.must_write(&at_strobe, 1);
            }
            device.must_read(&at_acknowledge, acknowledge.address.table);
        }
        Some(Handshake { strobe, acknowledge, timeout: timeout? })
    }
}

fn flag(at: &At<'_>, text: Option<&String>) -> Option<Flag> {
    let report = |message: String| {
        let help = "allowed: \"coil:20\", \"discrete:20\", \"input:16\", \"input:16.0\", \"holding:101\"";
        at.wrong(message, help);
    };
    text?.parse().map_err(report).ok()
}
