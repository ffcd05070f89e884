//! `handshake` of an output or an output set: after a write, the gateway sets a strobe signal, and the control
//! acknowledges it.

use std::fmt;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::KeyContext;
use super::device::Device;
use super::register::{Flag, Notation};
use crate::document::Section;
use crate::duration::{Timespan, shown};
use crate::kinds::opcua::nodes::{Place, read};
use isotherm_core::codec::{Address, Node, Table};

/// Handshake with a strobe signal and its acknowledgement.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Handshake")]
pub(super) struct RawHandshake {
    /// Strobe signal, written by the gateway. A coil ("coil:20"), a holding register (1 and 0), or one bit of a
    /// register ("holding:101.3"). On an OPC UA server a node (1 and 0): { node = "ns=2;s=…", type = "bool" }.
    #[schemars(required)]
    strobe: Option<Place>,
    /// Acknowledgement, read from the control. A coil, a discrete input ("discrete:20"), a register (0 or not), or one
    /// bit of a register ("input:16.0"). On an OPC UA server a node (0 or not): { node = "ns=2;s=…" }.
    #[schemars(required)]
    acknowledge: Option<Place>,
    /// Timeout for the acknowledge bit to rise after the strobe signal, and again for the bit to drop.
    #[schemars(required)]
    timeout: Option<Timespan>,
}

/// Bit of a handshake: the strobe or the acknowledge bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Bit {
    /// Bit of a Modbus device.
    Flag(Flag),
    /// Node of an OPC UA server. The bit is set if the value of the node is not 0.
    Node(Node),
}

/// Handshake of an output or an output set, after its keys were checked. Strobe and acknowledge bit are on the same
/// device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Handshake {
    /// Strobe signal, written by the gateway.
    pub strobe: Bit,
    /// Acknowledgement, which the gateway reads from the control.
    pub acknowledge: Bit,
    /// Timeout for the acknowledge bit to rise after the strobe signal, and again for the bit to drop.
    pub timeout: Duration,
}

impl Handshake {
    /// Returns the preview of the handshake. `function` is the Modbus function that writes one register.
    pub(super) fn preview(&self, function: u8) -> Section {
        let function = match &self.strobe {
            Bit::Flag(flag) if flag.address.table.is_bits() => 5,
            Bit::Flag(_) => function,
            Bit::Node(_) => 0,
        };
        let (strobe, acknowledge) = (self.strobe.notation(), self.acknowledge.notation());
        let timeout = shown(self.timeout);
        let by = if function == 0 { String::new() } else { format!(" (function {function:02})") };
        let mut section = Section::default();
        section.line(format!(
            "    then: strobe {strobe} on{by}, acknowledge {acknowledge} on within {timeout}, strobe off, \
             acknowledge off within {timeout}"
        ));
        section.json("strobe", strobe);
        section.entry("function", function);
        section.json("acknowledge", acknowledge);
        section.entry("timeout", timeout);
        section
    }
}

impl RawHandshake {
    pub(super) fn resolve(
        &self,
        at: &KeyContext<'_>,
        device: Option<&Device>,
        is_in_nodes: bool,
    ) -> Option<Handshake> {
        let timeout = at.key("timeout").duration(self.timeout);
        let (at_strobe, at_acknowledge) = (at.key("strobe"), at.key("acknowledge"));
        if is_in_nodes {
            let strobe = self.strobe.as_ref()?.word(&at_strobe, true, 1);
            let acknowledge = match self.acknowledge.as_ref()? {
                Place::Node(raw) => read(&at_acknowledge, raw.node.as_ref(), raw.kind, None),
                Place::Register(_) => self.acknowledge.as_ref()?.is_foreign(&at_acknowledge, true),
            };
            let (Some(Address::Node(strobe)), Some(acknowledge)) = (strobe, acknowledge) else { return None };
            if strobe.id == acknowledge.id {
                return itself(&at_acknowledge, &strobe);
            }
            let (strobe, acknowledge) = (Bit::Node(strobe), Bit::Node(acknowledge));
            return Some(Handshake { strobe, acknowledge, timeout: timeout? });
        }
        let strobe = flag(&at_strobe, self.strobe.as_ref());
        let acknowledge = flag(&at_acknowledge, self.acknowledge.as_ref());
        if let Some(strobe) = strobe.filter(|strobe| !strobe.address.table.is_writable()) {
            let help = "write a coil or a holding register, as \"coil:20\" or \"holding:101\"";
            return at_strobe.reject(format!("{} cannot be written", strobe.address), help);
        }
        let (strobe, acknowledge) = (strobe?, acknowledge?);
        if strobe.address == acknowledge.address {
            return itself(&at_acknowledge, &acknowledge.address);
        }
        if let Some(device) = device {
            if strobe.address.table == Table::Coil && !device.functions.write_coil {
                let message = format!(
                    "writing a coil needs write-coil, which is not among the `functions` of `{}`",
                    device.name
                );
                let help = "add \"write-coil\" to `functions` of the device, or use a holding register";
                at_strobe.invalid(message, help);
            }
            if strobe.address.table == Table::Holding {
                device.must_write(&at_strobe, 1);
            }
            device.must_read(&at_acknowledge, acknowledge.address.table);
        }
        let (strobe, acknowledge) = (Bit::Flag(strobe), Bit::Flag(acknowledge));
        Some(Handshake { strobe, acknowledge, timeout: timeout? })
    }
}

impl Bit {
    /// Returns the address of the register or node that contains the bit.
    pub fn address(&self) -> Address {
        match self {
            Bit::Flag(flag) => flag.address.into(),
            Bit::Node(node) => Address::Node(node.clone()),
        }
    }

    /// Returns the bit if it is on a Modbus device. `None` for an OPC UA node.
    pub const fn flag(&self) -> Option<Flag> {
        if let Bit::Flag(flag) = self { Some(*flag) } else { None }
    }

    fn notation(&self) -> Notation {
        match self {
            Bit::Flag(flag) => Notation::from(*flag),
            Bit::Node(node) => Notation::of(&self.address(), node.taken_as()),
        }
    }
}

/// Formats the bit: `holding:101.3`, `node ns=2;s=…`.
impl fmt::Display for Bit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bit::Flag(flag) => flag.fmt(f),
            Bit::Node(_) => self.address().fmt(f),
        }
    }
}

fn itself<T>(at: &KeyContext<'_>, strobe: &impl fmt::Display) -> Option<T> {
    let message = format!("{strobe} is the strobe signal itself, and would acknowledge at once");
    at.reject(message, "write the bit that the control sets when it has accepted the value")
}

fn flag(at: &KeyContext<'_>, place: Option<&Place>) -> Option<Flag> {
    let text = match place? {
        Place::Register(text) => text,
        node @ Place::Node(_) => return node.is_foreign(at, false),
    };
    let report = |message: String| {
        let help = "allowed: \"coil:20\", \"discrete:20\", \"input:16\", \"input:16.0\", \"holding:101\"";
        at.invalid(message, help);
    };
    text.parse().map_err(report).ok()
}
