//! Text of the profile that `isotherm init` writes.

use std::fmt::{Display, Write};

use super::answers::{Answers, Line, MachineOn, Module, Target, TemperatureNode};
use super::serial_settings::{Frames, SerialSettings};
use super::value_form::ValueForm;
use crate::discovery::Register;
use isotherm_core::codec::Element;
use isotherm_profile::{Bits, Cell};

/// Keys that follow the address in the table of an OPC UA bus. Their comments show how to secure the connection.
const OF_SERVER: &str = r#"security = "none"                    # only if this machine alone uses the network
# Use "sign-and-encrypt" if the server supports it: `isotherm scan --bus ADDRESS` shows that, and prints such lines.
# security = "sign-and-encrypt"
# cert     = "own.der"               # `isotherm opcua certificate` with this profile makes cert and key
# key      = "own.pem"
# trusted  = "trusted"               # `isotherm opcua trust` stores the certificate of the server here
# user     = { name = "isotherm", password_file = "opcua.password" }   # if the server requires a user
timeout  = "500ms"                   # shorter than every `every` below
"#;

/// Returns the text of a profile with comments, which `check` accepts.
pub(super) fn profile(answers: &Answers) -> String {
    let mut text = String::new();
    // Writing to a string never fails.
    let _ = write_profile(&mut text, answers);
    text
}

fn write_profile(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let Answers { machine, axis, limit, .. } = answers;
    writeln!(
        text,
        "# Written by `isotherm init`. `isotherm check` explains it; `isotherm schema` is the JSON Schema for an editor.\n\n\
         [machine]\nname   = \"{machine}\""
    )?;
    match answers.machine_on {
        MachineOn::Unknown => writeln!(
            text,
            "# on   = \"machine_on\"               # a signal that is 1 while the machine is on: \"start\" references need it"
        )?,
        _ => writeln!(text, "on     = \"machine_on\"               # its rising edge is the machine start")?,
    }
    writeln!(
        text,
        "settle = \"3min\"                     # \"start\" references are the mean over this long\n\
         arm    = \"manual\"                   # nothing is written before `isotherm arm`; \"auto\" arms by itself\n"
    )?;
    line(text, "cell", &answers.line, answers.module.sends_text())?;
    if let Some(control) = &answers.control {
        line(text, "control", control, false)?;
    }
    module(text, answers)?;
    control(text, answers)?;
    machine_on(text, &answers.machine_on)?;
    let first = answers.signals.first().map(String::as_str).unwrap_or_default();
    writeln!(
        text,
        "[axis.{axis}]\nlimit    = {limit:?}                     # µm: |Cz| is never larger\n\
         step     = 1.0                      # µm: largest change of one update\n\
         rate     = 0.5                      # µm per second\ndeadband = 0.1                      # µm: smaller changes are not made\n\
         every    = \"10s\"                    # interval between updates"
    )?;
    if answers.diameter {
        writeln!(
            text,
            "diameter = true                     # the position is a diameter: twice Cz is written"
        )?;
    }
    writeln!(
        text,
        "on_fault = {{ action = \"ramp\", after = \"60s\" }}\n\n\
         # The coefficients come from the machine: record a few days with `isotherm record`, and measure the error at the same time.\n\
         # `isotherm identify --into-profile` then adds the model here. Cz = -e; without a model nothing is compensated.\n\
         # [[axis.{axis}.model]]\n# name  = \"{first}\"\n# kind  = \"linear\"\n\
         # terms = [ {{ signal = \"{first}\", gain = -4.0, reference = \"start\" }} ]   # µm per °C\n"
    )?;
    output(text, answers)?;
    writeln!(
        text,
        "[web]\nlisten = \"127.0.0.1:8080\"            # the web page; commands need token_file \
         (isotherm token), other addresses also tls"
    )
}

/// Writes the table of a bus line. `sends_text`: the module on this line sends lines of text.
fn line(text: &mut String, name: &str, line: &Line, sends_text: bool) -> std::fmt::Result {
    let kind = match line {
        _ if sends_text => "serial-ascii",
        line if line.is_ascii() => "modbus-ascii",
        Line::Serial(..) => "modbus-rtu",
        Line::OpcUa(_) => "opcua",
        Line::Tcp(_) | Line::AsciiOverTcp(_) => "modbus-tcp",
    };
    writeln!(text, "[bus.{name}]\ntype    = \"{kind}\"")?;
    match line {
        Line::Tcp(address) | Line::AsciiOverTcp(address) => writeln!(text, "address = \"{address}\"")?,
        Line::Serial(port, SerialSettings { baud, parity, frames }) => {
            let parity = parity.word();
            writeln!(
                text,
                "port    = \"{port}\"             # a name below /dev/serial/by-id stays the same\n\
                 baud    = {baud}                      # the setting of the devices\nparity  = \"{parity}\"\nstop_bits = 1"
            )?;
            match frames {
                Frames::Ascii { data_bits } => writeln!(text, "data_bits = {data_bits}")?,
                Frames::Rtu if sends_text => writeln!(text, "data_bits = 8")?,
                Frames::Rtu => {}
            }
        }
        Line::OpcUa(url) => return writeln!(text, "address = {}\n{OF_SERVER}", quoted(url)),
    }
    writeln!(text, "timeout = \"300ms\"                   # shorter than every `every` below\n")
}

fn module(text: &mut String, answers: &Answers) -> std::fmt::Result {
    writeln!(
        text,
        "[device.module]                      # the temperature module\nbus   = \"cell\"\n\
         every = \"1s\"                        # how often it is read"
    )?;
    unit(text, answers.unit)?;
    if let Some(template) = answers.module.template() {
        writeln!(text, "template = \"{}\"   # {}", template.outline.name, template.outline.title)?;
        if let Some(variant) = &template.variant {
            writeln!(text, "variant = \"{variant}\"")?;
        }
        if let Some(base) = template.base {
            writeln!(
                text,
                "base  = {base}                           # first register; it depends on the node's modules"
            )?;
        }
    }
    for (place, signal) in answers.signals.iter().enumerate() {
        writeln!(text, "\n[signal.{signal}]\ndevice   = \"module\"")?;
        match &answers.module {
            Module::Template(template) => {
                let channel =
                    template.outline.temperatures.get(place).map(String::as_str).unwrap_or_default();
                writeln!(text, "channel  = {channel}")?;
                for (key, value) in &template.keys {
                    writeln!(text, "{key:<8} = {value}   # compare with a thermometer")?;
                }
            }
            Module::Nodes(nodes, scale) => {
                if let Some(found) = nodes.get(place) {
                    node(text, found)?;
                }
                writeln!(text, "scale    = {scale:?}                      # °C per count")?;
            }
            Module::SpelledOut(first, form) => {
                let width = usize::from(form.data_type.registers());
                let offset = usize::from(first.address.offset) + place * width;
                let offset = u16::try_from(offset).unwrap_or(u16::MAX);
                let cell = Cell { address: Register { offset, ..first.address }, bits: first.bits };
                writeln!(
                    text,
                    "register = \"{cell}\"                # zero-based; \"{}\" means the same\ntype     = \"{}\"",
                    cell.modicon(),
                    form.data_type.name()
                )?;
                if let Some(order) = form.word_order {
                    writeln!(text, "word_order = \"{order}\"")?;
                }
                match form.scale_from {
                    None => {
                        writeln!(text, "scale    = {:?}                      # °C per count", form.scale)?
                    }
                    Some(from) => writeln!(
                        text,
                        "scale_from = \"{from}\"             # the power of ten of the scale: -1 means a tenth\n\
                         max_rate = 5.0                      # °C per second: plausible after a change of the scale"
                    )?,
                }
                if form.data_type == crate::discovery::DataType::I16 && first.bits == Bits::All {
                    writeln!(text, "bad      = [-32768, 32767]           # values that mean a broken wire")?;
                }
            }
        }
        writeln!(
            text,
            "unit     = \"degC\"\nrange    = [-10.0, 80.0]             # readings outside are rejected\nmax_age  = \"5s\""
        )?;
    }
    writeln!(text)
}

fn node(text: &mut String, TemperatureNode { node, element }: &TemperatureNode) -> std::fmt::Result {
    writeln!(text, "node     = {}", quoted(node))?;
    match element.as_ref().map(Element::indices) {
        None => Ok(()),
        Some([index]) => {
            writeln!(text, "element  = {index}                        # index in the array, from 0")
        }
        Some(indices) => {
            writeln!(text, "element  = {indices:?}                   # indices in the array, from 0")
        }
    }
}

/// Writes the key `unit` of a device. `None`: the device is an OPC UA server, which has no unit number.
fn unit(text: &mut String, unit: Option<u8>) -> std::fmt::Result {
    match unit {
        Some(unit) => writeln!(text, "unit  = {unit}"),
        None => writeln!(
            text,
            "# source_time = \"changed\"            # if the server updates time stamps only when values change"
        ),
    }
}

fn control(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let bus = if answers.control.is_some() { "control" } else { "cell" };
    writeln!(text, "[device.cnc]                         # the control\nbus   = \"{bus}\"\nevery = \"1s\"")?;
    unit(text, answers.control_unit)?;
    if let Target::Template(template) = &answers.target {
        writeln!(text, "template = \"{}\"", template.outline.name)?;
        if let Some(base) = template.base {
            writeln!(text, "base  = {base}                           # first register of the block")?;
        }
    }
    writeln!(text)
}

fn machine_on(text: &mut String, signal: &MachineOn) -> std::fmt::Result {
    let place = match signal {
        MachineOn::Unknown => return Ok(()),
        MachineOn::Channel(channel) => format!("channel  = \"{channel}\""),
        MachineOn::Bit(bit) => format!("register = \"{bit}\""),
        MachineOn::Node(node) => format!("node     = {}\ntype     = \"bool\"", quoted(node)),
    };
    writeln!(
        text,
        "[signal.machine_on]                  # 1 while the machine is on\ndevice   = \"cnc\"\n{place}\nunit     = \"bool\"\nmax_age  = \"5s\"\n"
    )
}

fn output(text: &mut String, answers: &Answers) -> std::fmt::Result {
    let axis = &answers.axis;
    writeln!(
        text,
        "[output.cnc_{axis}]                       # writes Cz to the control\naxis     = \"{axis}\"\ndevice   = \"cnc\""
    )?;
    match &answers.target {
        Target::Template(template) => {
            writeln!(text, "channel  = \"{}\"", template.target)?;
            for (key, value) in &template.keys {
                writeln!(text, "{key:<8} = {value}")?;
            }
        }
        Target::Register(register, form) => {
            writeln!(
                text,
                "writes   = \"offset\"\nregister = \"holding:{register}\"              # {} in one-based notation\ntype     = \"{}\"",
                Register { table: crate::discovery::Table::Holding, offset: *register }.modicon(),
                form.data_type.name()
            )?;
            if let Some(order) = form.word_order {
                writeln!(text, "word_order = \"{order}\"")?;
            }
            offset_scale(text, form)?;
        }
        Target::Node(node, form) => {
            writeln!(
                text,
                "writes   = \"offset\"\nnode     = {}\ntype     = \"{}\"                    # the node's own type",
                quoted(node),
                form.data_type.name()
            )?;
            offset_scale(text, form)?;
        }
    }
    writeln!(text, "verify   = \"read-back\"\n")?;
    match &answers.target {
        Target::Template(template) if template.outline.has_heartbeat => writeln!(
            text,
            "[heartbeat]                          # without it, the control detects a failed gateway\ndevice = \"cnc\"\nevery  = \"500ms\"\n"
        ),
        _ => Ok(()),
    }
}

fn offset_scale(text: &mut String, form: &ValueForm) -> std::fmt::Result {
    writeln!(
        text,
        "scale    = {:?}                      # µm per count; negative if the control subtracts it",
        form.scale
    )
}

/// Returns a text as a TOML string, with escapes if needed: names of nodes may contain quotes.
fn quoted(text: &impl Display) -> toml::Value {
    toml::Value::String(text.to_string())
}
