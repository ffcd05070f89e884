//! What lands together: its requests, its sequence and check word, its handshake.

use std::fmt;

use serde::Serialize;

use super::Register;
use crate::{Flag, OutputSet, Profile, WriteFunction};
use isotherm_core::codec::{self, Table};

/// One set, or one output with a handshake of its own.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetExplained {
    /// `set plc`, `output cnc_z`.
    pub what: String,
    /// Where it goes.
    pub device: String,
    /// What belongs to it.
    pub outputs: Vec<String>,
    /// The requests that write it, in their order: `holding:103..110 (40104..40111), 8 registers, function 16`.
    pub requests: Vec<String>,
    /// Counts up with every whole set.
    pub sequence: Option<Register>,
    /// All other words summed to 16 bits, inverted.
    pub complement: Option<Register>,
    /// Counts up with every write.
    pub heartbeat: Option<Register>,
    /// What the gateway does, in bits.
    pub control: Option<Register>,
    /// A number that control and profile agree on.
    pub version: Option<(Register, u16)>,
    /// Registers between its words are written as 0.
    pub zeros: bool,
    /// Strobe and acknowledge.
    pub handshake: Option<HandshakeExplained>,
}

/// A strobe and its acknowledgement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HandshakeExplained {
    /// Ours: "take it".
    pub strobe: Register,
    /// Function code that writes it.
    pub function: u8,
    /// The control's: "taken".
    pub acknowledge: Register,
    /// Longest wait for it to come, and again to drop.
    pub timeout: String,
}

pub(super) fn explained(profile: &Profile, set: &OutputSet) -> SetExplained {
    let device = profile.device(set.device);
    let function = |registers| device.functions.writes(registers).map_or(0, WriteFunction::code);
    let stretches = set.stretches(set.members(profile), device.longest_request());
    let requests = stretches.iter().map(|stretch| {
        let at = |offset| codec::Register { table: Table::Holding, offset };
        let (first, last) = (at(stretch.from), at(stretch.from + (stretch.count - 1)));
        let code = function(stretch.count);
        if stretch.count == 1 {
            return format!("{first} ({}), 1 register, function {code:02}", first.modicon());
        }
        let modicon = format!("{}..{}", first.modicon(), last.modicon());
        format!("{first}..{} ({modicon}), {} registers, function {code:02}", last.offset, stretch.count)
    });
    let handshake = set.handshake.map(|handshake| HandshakeExplained {
        strobe: register(handshake.strobe),
        function: if handshake.strobe.address.table.is_bits() { 5 } else { function(1) },
        acknowledge: register(handshake.acknowledge),
        timeout: humantime::format_duration(handshake.timeout).to_string(),
    });
    SetExplained {
        what: set.label(),
        device: device.name.clone(),
        outputs: set.members(profile).map(|output| output.name.clone()).collect(),
        requests: requests.collect(),
        sequence: set.sequence.map(Register::of),
        complement: set.complement.map(Register::of),
        heartbeat: set.heartbeat.map(Register::of),
        control: set.control.map(Register::of),
        version: set.version.map(|(at, number)| (Register::of(at), number)),
        zeros: set.zeros,
        handshake,
    }
}

fn register(flag: Flag) -> Register {
    Register { protocol: flag.to_string(), modicon: flag.modicon() }
}

impl fmt::Display for SetExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SetExplained { what, device, outputs, requests, .. } = self;
        if outputs.len() > 1 || self.sequence.is_some() || self.complement.is_some() {
            writeln!(f, "  {what}: {} land together in {device}", outputs.join(", "))?;
        } else {
            writeln!(f, "  {what}: taken by {device} with a handshake")?;
        }
        match requests.as_slice() {
            [one] => writeln!(f, "    one request: {one}")?,
            several => {
                writeln!(f, "    {} requests, in this order:", several.len())?;
                several.iter().try_for_each(|request| writeln!(f, "      {request}"))?;
            }
        }
        if self.zeros {
            writeln!(f, "    registers in it that are nobody's are written as 0")?;
        }
        if let Some(heartbeat) = &self.heartbeat {
            writeln!(f, "    heartbeat {heartbeat}: counts up with every write, 0 to 32767")?;
        }
        if let Some(control) = &self.control {
            writeln!(f, "    control {control}: bit 0 armed, 1 hold, 2 fault, 3 lesser model")?;
        }
        if let Some((at, number)) = &self.version {
            writeln!(f, "    version {at}: always {number}")?;
        }
        if let Some(sequence) = &self.sequence {
            writeln!(
                f,
                "    sequence {sequence}: counts up with every whole set, 1 to 65535; take the set when it changes"
            )?;
        }
        if let Some(complement) = &self.complement {
            writeln!(f, "    complement {complement}: all its other words summed to 16 bits, inverted")?;
        }
        if let Some(HandshakeExplained { strobe, function, acknowledge, timeout }) = &self.handshake {
            writeln!(
                f,
                "    then strobe {strobe} up (function {function:02}), acknowledge {acknowledge} up within {timeout}, strobe \
                 down, acknowledge down within {timeout}"
            )?;
        }
        Ok(())
    }
}
