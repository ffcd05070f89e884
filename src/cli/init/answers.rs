//! Answers to the questions of `isotherm init`, and their checks.

use std::net::Ipv4Addr;

use super::opcua;
use super::serial_settings::{Frames, SerialSettings};
use super::value_form::ValueForm;
use crate::discovery::bus::LineAddress;
use crate::discovery::{Register, Table};
use isotherm_core::codec::{Element, NodeId};
use isotherm_profile::template::Outline;
use isotherm_profile::{Bits, Cell, Flag, Transport, allowed};

/// Values from which the first profile is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Answers {
    pub(super) machine: String,
    pub(super) line: Line,
    pub(super) module: Module,
    /// Modbus unit number of the module; `None` if the module is an OPC UA server.
    pub(super) unit: Option<u8>,
    pub(super) signals: Vec<String>,
    pub(super) axis: String,
    /// Whether the control shows the axis position as a diameter, for example X of a lathe.
    pub(super) diameter: bool,
    pub(super) limit: f64,
    pub(super) target: Target,
    /// Bus line of the control; `None` if module and control are on the same line.
    pub(super) control: Option<Line>,
    /// Modbus unit number of the control; `None` if the control is an OPC UA server.
    pub(super) control_unit: Option<u8>,
    pub(super) machine_on: MachineOn,
}

/// Bus line to which the module or the control is connected: Modbus, text from the module, or OPC UA.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Line {
    Tcp(String),
    /// Address of a serial server, behind which the line uses frames of Modbus ASCII.
    AsciiOverTcp(String),
    Serial(String, SerialSettings),
    /// URL of an OPC UA server.
    OpcUa(String),
}

impl Line {
    pub(super) fn parse(text: &str) -> Result<Line, String> {
        if text.starts_with('/') {
            return Ok(Line::Serial(text.to_owned(), SerialSettings::RTU));
        }
        if text.starts_with("modbus-ascii") && text.contains("://") {
            return Line::parse_modbus_ascii(text);
        }
        if let Some(url) = opcua::url(text) {
            return url.map(Line::OpcUa);
        }
        let example = "write 192.168.0.10:502, or /dev/ttyUSB0";
        if text.contains("//") {
            return Err("write an address without a prefix such as tcp://. Examples: 192.168.0.10:502, \
                        /dev/ttyUSB0, or modbus-ascii:///dev/ttyUSB0 for Modbus ASCII"
                .to_owned());
        }
        if text.starts_with("can") || text.starts_with("vcan") {
            return Err(format!(
                "{text} is a CAN interface: for CAN, copy the shipped profile xc100-lathe-can.toml; for \
                 another line, {example}"
            ));
        }
        let is_numbered = |begin: &str| {
            let rest = text.get(begin.len()..).filter(|_| text.to_ascii_lowercase().starts_with(begin));
            rest.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|byte| byte.is_ascii_digit()))
        };
        if is_numbered("com") {
            return Err(format!(
                "{text} is a serial port of Windows: here a port has a path, such as /dev/ttyUSB0 or \
                 /dev/ttyS0; `ls /dev/serial/by-id` shows the adapters"
            ));
        }
        if ["ttyusb", "ttyacm", "ttys"].into_iter().any(is_numbered) {
            return Err(format!("write the whole path of the serial port: /dev/{text}"));
        }
        let (host, port) = text.rsplit_once(':').unwrap_or((text, "502"));
        let is_of_numbers = host.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
        if is_of_numbers && host.parse::<Ipv4Addr>().is_err() {
            return Err(format!(
                "`{host}` is not an address: write four numbers from 0 to 255, such as 192.168.0.10:502"
            ));
        }
        let is_host = |byte: u8| byte.is_ascii_alphanumeric() || b".-:[]".contains(&byte);
        match port.parse::<u16>() {
            Ok(port) if port > 0 && !host.is_empty() && host.bytes().all(is_host) => {
                Ok(Line::Tcp(format!("{host}:{port}")))
            }
            _ => Err(format!("`{text}` is not an address; {example}")),
        }
    }

    /// Parses the address of a line with frames of Modbus ASCII.
    fn parse_modbus_ascii(text: &str) -> Result<Line, String> {
        if let Some((port, _)) = text.split_once('?') {
            return Err(match port.starts_with("modbus-ascii+tcp") {
                true => format!("write only {port}: the serial server has its own settings"),
                false => {
                    format!("write only {port}: further questions ask for baud rate, parity and data bits")
                }
            });
        }
        let line: LineAddress = text.parse()?;
        Ok(match line.transport {
            Transport::ModbusAsciiOverTcp => Line::AsciiOverTcp(line.address),
            _ => Line::Serial(line.address, SerialSettings::ASCII),
        })
    }

    /// Returns the address of a line on the network, the path of a serial port, or the URL of an OPC UA server.
    fn place(&self) -> &str {
        match self {
            Line::Tcp(place) | Line::AsciiOverTcp(place) | Line::Serial(place, _) | Line::OpcUa(place) => {
                place
            }
        }
    }

    /// Returns whether the line uses frames of Modbus ASCII.
    pub(super) fn is_ascii(&self) -> bool {
        match self {
            Line::Tcp(_) | Line::OpcUa(_) => false,
            Line::AsciiOverTcp(_) => true,
            Line::Serial(_, settings) => settings.frames != Frames::Rtu,
        }
    }

    /// Returns whether `other` is the same bus line: it has the same address or the same serial port.
    pub(super) fn is_same(&self, other: &Line) -> bool {
        self.place() == other.place()
    }
}

/// Module that measures the temperatures.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Module {
    Template(Box<ModuleTemplate>),
    /// Module without a template: the register of the first temperature, and type, word order and scale of all
    /// temperatures.
    SpelledOut(Cell, ValueForm),
    /// OPC UA server: the node of each temperature, and the scale of all values, °C per count.
    Nodes(Vec<TemperatureNode>, f64),
}

/// OPC UA node that contains a temperature.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct TemperatureNode {
    pub(super) node: NodeId,
    /// Element of the node's array; `None` if the node has a single value.
    pub(super) element: Option<Element>,
}

/// Template of the module, with the answers that it needs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ModuleTemplate {
    pub(super) outline: Outline,
    pub(super) variant: Option<String>,
    /// First register of the module, if its template does not fix it.
    pub(super) base: Option<u16>,
    /// Channel keys that the template does not set, each with its value in the notation of a profile.
    pub(super) keys: Vec<(String, String)>,
}

impl Module {
    pub(super) fn template(&self) -> Option<&ModuleTemplate> {
        if let Module::Template(template) = self { Some(template) } else { None }
    }

    /// Returns whether the module sends lines of text. The control then needs another bus line.
    pub(super) fn sends_text(&self) -> bool {
        self.template().is_some_and(|template| template.outline.sends_text)
    }
}

/// Finds the template of a module by its name; `None` for the answer `none`.
pub(super) fn module(text: &str, known: &[Outline]) -> Result<Option<Outline>, String> {
    if text == "none" {
        return Ok(None);
    }
    let found = known.iter().find(|outline| outline.name == text).cloned();
    let names = || known.iter().map(|outline| outline.name.as_str()).chain(["none"]);
    found.map(Some).ok_or_else(|| allowed(text, names()))
}

/// Template, register or node by which Cz is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Target {
    Template(Box<ControlTemplate>),
    Register(u16, ValueForm),
    Node(NodeId, ValueForm),
}

/// Template of the control, with the answers that it needs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ControlTemplate {
    pub(super) outline: Outline,
    /// Name of the target to which Cz is written. A target is a value of the template that can receive Cz.
    pub(super) target: String,
    /// First register of the control, if its template does not fix it.
    pub(super) base: Option<u16>,
    /// Keys of the output that differ from the template, each with its value in the notation of a profile.
    pub(super) keys: Vec<(String, String)>,
}

/// Destination of Cz before data type, word order and scale of the offset are known.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Destination {
    Template(Outline),
    Register(u16),
    Node(NodeId),
}

/// Parses the destination of Cz: a template of a control, a register (`holding:104` or `40105`), or an OPC UA node.
pub(super) fn destination(text: &str, known: &[Outline]) -> Result<Destination, String> {
    if let Some(outline) = known.iter().find(|outline| outline.name == text) {
        return Ok(Destination::Template(outline.clone()));
    }
    if opcua::is_node(text) {
        return opcua::node(text).map(Destination::Node);
    }
    if let Some(place) = opcua::place(text) {
        return Err(format!(
            "opc.tcp://{place} is the address of an OPC UA server, which a later question asks for: write the node of \
             the offset, such as ns=2;s=Offset.Z"
        ));
    }
    let looks_like_a_register = text.contains(':') || text.bytes().all(|byte| byte.is_ascii_digit());
    if looks_like_a_register {
        if text.contains('.') {
            return Err(format!(
                "{text} is a part of a register, which cannot be written: write a whole register such as holding:104"
            ));
        }
        let register: Register = text.parse()?;
        return match register {
            Register { table: Table::Holding, offset } => Ok(Destination::Register(offset)),
            _ => {
                Err(format!("{text} cannot be written: write a holding register, from holding:0 (40001) on"))
            }
        };
    }
    let names = known.iter().map(|outline| outline.name.as_str());
    Err(format!(
        "{}; or write a register such as holding:104, which is 40105, or a node such as ns=2;s=Offset.Z",
        allowed(text, names)
    ))
}

/// Parses the register of the first temperature (`input:0` or `30001`), or a part of a register (`input:0.4-15`).
pub(super) fn first_register(text: &str) -> Result<Cell, String> {
    let cell: Cell = text.parse()?;
    match cell.bits {
        Bits::All | Bits::Range(..) if !cell.address.table.is_bits() => Ok(cell),
        _ => Err(format!(
            "{text} is one bit: write an input or holding register, such as input:0, or a part of it, such as \
             input:0.4-15"
        )),
    }
}

/// Signal that is set while the machine is on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum MachineOn {
    /// No signal shows when the machine is switched on.
    Unknown,
    /// Channel of the control's template.
    Channel(String),
    /// Coil, discrete input, or bit of a register of the control.
    Bit(Flag),
    /// Boolean node of the control.
    Node(NodeId),
}

/// Parses the node that is true while the machine is on.
pub(super) fn machine_on_node(text: &str) -> Result<MachineOn, String> {
    if text == "none" { Ok(MachineOn::Unknown) } else { opcua::node(text).map(MachineOn::Node) }
}

/// Parses the signal that is set while the machine is on. `channels` are the bits of the control's template.
pub(super) fn machine_on(text: &str, channels: &[String]) -> Result<MachineOn, String> {
    if text == "none" {
        return Ok(MachineOn::Unknown);
    }
    if channels.iter().any(|channel| channel == text) {
        return Ok(MachineOn::Channel(text.to_owned()));
    }
    if !text.bytes().any(|byte| byte.is_ascii_digit()) {
        let words = channels.iter().map(String::as_str).chain(["none"]);
        return Err(format!("{}; or write a bit such as discrete:0 or holding:16.3", allowed(text, words)));
    }
    let flag: Flag = text.parse()?;
    match (flag.bit, flag.address.table.is_bits()) {
        (None, false) => Err(format!("{text} is a whole register: add the bit, such as {text}.0")),
        _ => Ok(MachineOn::Bit(flag)),
    }
}

/// Parses the first register of a block: a number, a register such as `holding:100`, or a Modicon number such as
/// `40101`. Five digits that begin with 3 or 4 are a Modicon number, as in a profile.
pub(super) fn base(text: &str) -> Result<u16, String> {
    let is_modicon = text.len() > 4 && text.starts_with(['3', '4']);
    let register = || text.parse::<Register>().ok().map(|register| register.offset);
    let base = if is_modicon || text.contains(':') { register() } else { text.parse().ok() };
    base.ok_or_else(|| "write the first register, such as 100 or holding:100, which is 40101".to_owned())
}

pub(super) fn machine(text: &str) -> Result<String, String> {
    let is_good = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    match (1..=64).contains(&text.len()) && text.bytes().all(is_good) {
        true => Ok(text.to_owned()),
        false => {
            Err("write lower-case letters, digits and hyphens, such as press-7: the name becomes part of \
                 file names"
                .to_owned())
        }
    }
}

pub(super) fn name(text: &str) -> Result<String, String> {
    let is_good = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_';
    match text.starts_with(|first: char| first.is_ascii_alphabetic()) && text.bytes().all(is_good) {
        true => Ok(text.to_owned()),
        false => Err(format!("`{text}`: write a letter, then letters, digits and underscores")),
    }
}

pub(super) fn signals(text: &str, most: usize) -> Result<Vec<String>, String> {
    let names: Vec<String> = text.split(',').map(|text| name(text.trim())).collect::<Result<_, _>>()?;
    if names.len() > most {
        return Err(format!(
            "{} names are given, but the module has {most} channels: give at most {most} names",
            names.len()
        ));
    }
    match names.iter().enumerate().find(|(place, name)| names[..*place].contains(name)) {
        Some((_, twice)) => Err(format!("{twice} is given twice: give each name once")),
        None => Ok(names),
    }
}

/// Parses a Modbus unit number. On a serial line, 0 addresses all units, and numbers above 247 are reserved. A device
/// on a network may use these numbers.
pub(super) fn unit(text: &str, line: &Line) -> Result<u8, String> {
    let allowed = match line {
        Line::Tcp(_) | Line::OpcUa(_) => 0..=255,
        Line::AsciiOverTcp(_) | Line::Serial(..) => 1..=247,
    };
    let unit = text.parse::<u8>().ok().filter(|unit| allowed.contains(unit));
    unit.ok_or_else(|| format!("write a unit from {} to {}", allowed.start(), allowed.end()))
}

pub(super) fn data_bits(text: &str) -> Result<u8, String> {
    let bits = text.parse().ok().filter(|bits| (7..=8).contains(bits));
    bits.ok_or_else(|| "write 7 or 8".to_owned())
}

pub(super) fn limit(text: &str) -> Result<f64, String> {
    let limit = text.replace(',', ".").parse().ok().filter(|limit| (1.0..=500.0).contains(limit));
    limit.ok_or_else(|| "write micrometres from 1 to 500, such as 10".to_owned())
}
