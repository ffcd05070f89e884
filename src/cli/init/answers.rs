//! Answers to the questions, and their checks.

use isotherm_profile::allowed;
use isotherm_profile::template::{Outline, on_modbus, on_text};

/// Values from which the first profile is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Answers {
    pub(super) machine: String,
    pub(super) line: Line,
    pub(super) module: Module,
    pub(super) variant: Option<String>,
    pub(super) unit: u8,
    pub(super) signals: Vec<String>,
    pub(super) axis: String,
    pub(super) limit: f64,
    pub(super) target: Target,
    /// Line of the control, if it is not the line of the module.
    pub(super) control: Option<Line>,
    pub(super) control_unit: u8,
}

/// Line to which the module or the control is connected: Modbus, or text from the module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Line {
    Tcp(String),
    Serial(String),
}

impl Line {
    pub(super) fn parse(text: &str) -> Result<Line, String> {
        if text.starts_with('/') {
            return Ok(Line::Serial(text.to_owned()));
        }
        let example = "write 192.168.0.10:502, or /dev/ttyUSB0";
        if text.contains("//") {
            return Err("write an address without a prefix such as tcp://. Examples: 192.168.0.10:502, or \
                        /dev/ttyUSB0"
                .to_owned());
        }
        if text.starts_with("can") || text.starts_with("vcan") {
            return Err(format!(
                "{text} is a CAN interface: for CAN, copy the shipped profile xc100-lathe-can.toml; as an \
                 answer, {example}"
            ));
        }
        let (host, port) = text.rsplit_once(':').unwrap_or((text, "502"));
        let is_host = |byte: u8| byte.is_ascii_alphanumeric() || b".-:[]".contains(&byte);
        match port.parse::<u16>() {
            Ok(port) if port > 0 && !host.is_empty() && host.bytes().all(is_host) => {
                Ok(Line::Tcp(format!("{host}:{port}")))
            }
            _ => Err(format!("`{text}` is no address; {example}")),
        }
    }
}

/// Returns the shipped templates of modules that measure temperatures.
pub(super) fn modules() -> impl Iterator<Item = Outline> {
    on_modbus().chain(on_text()).filter(|outline| !outline.temperatures.is_empty())
}

/// Module that measures the temperatures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Module {
    Template(Outline),
    SpelledOut,
}

impl Module {
    pub(super) fn parse(text: &str) -> Result<Module, String> {
        if text == "none" {
            return Ok(Module::SpelledOut);
        }
        let found = modules().find(|outline| outline.name == text);
        let known = || modules().map(|outline| outline.name);
        found.map(Module::Template).ok_or_else(|| allowed(text, known().chain(["none"])))
    }

    /// Returns whether the module sends lines of text, so that the control needs a line of its own.
    pub(super) fn sends_text(&self) -> bool {
        self.outline().is_some_and(|outline| outline.sends_text)
    }

    pub(super) fn outline(&self) -> Option<&Outline> {
        if let Module::Template(outline) = self { Some(outline) } else { None }
    }

    /// Returns how many temperatures the module can measure.
    pub(super) fn channels(&self) -> usize {
        self.outline().map_or(32, |outline| outline.temperatures.len())
    }
}

/// Register or template by which Cz is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// Device template, and the name of the output in it to which Cz is written.
    Template(Outline, String),
    Register(u16),
}

impl Target {
    pub(super) fn parse(text: &str, axis: &str) -> Result<Target, String> {
        if let Some(register) = text.strip_prefix("holding:") {
            let register = register
                .parse()
                .map_err(|_| "write a register such as holding:104, from 0 to 65534".to_owned());
            return register.map(Target::Register);
        }
        let mut taking = on_modbus().filter(|outline| !outline.targets.is_empty());
        let known = || on_modbus().filter(|outline| !outline.targets.is_empty()).map(|outline| outline.name);
        let outline = taking.find(|outline| outline.name == text);
        let outline = outline
            .ok_or_else(|| format!("{}; or write a register such as holding:104", allowed(text, known())))?;
        let target =
            outline.targets.iter().find(|target| *target == axis).or_else(|| outline.targets.first());
        let target = target.cloned().unwrap_or_default();
        Ok(Target::Template(outline, target))
    }
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

pub(super) fn unit(text: &str) -> Result<u8, String> {
    let unit = text.parse().ok().filter(|unit| (1..=247).contains(unit));
    unit.ok_or_else(|| "write a unit from 1 to 247".to_owned())
}

pub(super) fn limit(text: &str) -> Result<f64, String> {
    let limit = text.replace(',', ".").parse().ok().filter(|limit| (1.0..=500.0).contains(limit));
    limit.ok_or_else(|| "write micrometres from 1 to 500, such as 40".to_owned())
}
