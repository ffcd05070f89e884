//! Line and unit to which a verb connects: named by a profile, or given as an address.

use std::path::PathBuf;
use std::time::Duration;

use super::loading::load_with;
use super::values::{self, key_and_value};
use crate::discovery::Register;
use crate::discovery::bus::{LineAddress, ScanKind};
use isotherm_profile::{Bus, BusId, Profile, Quirks};

/// Timeout of a request if no option and no profile sets it.
const TIMEOUT: Duration = Duration::from_millis(500);

/// Line to which a verb connects, with or without a profile.
#[derive(clap::Args, Debug)]
pub(super) struct Target {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    pub(super) profile: Option<PathBuf>,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value, requires = "profile")]
    pub(super) set: Vec<(String, String)>,
    /// The line; with a profile, the name of one of its buses. Without a profile: tcp://192.168.0.10:502,
    /// rtu:///dev/ttyUSB0?baud=9600&parity=none, rtu+tcp://192.168.0.11:4001, modbus-ascii:///dev/ttyUSB0,
    /// opc.tcp://192.168.0.12:4840, ascii:///dev/ttyUSB0 for lines of text, or /sys for the sensors of this computer.
    /// Without a type, a host is Modbus TCP (with the port 4840: OPC UA), and /dev/ttyUSB0 is a serial port
    #[arg(long, value_name = "BUS")]
    pub(super) bus: Option<String>,
    /// Timeout of a request [default: that of the profile, or 500ms]
    #[arg(long, value_name = "SPAN", value_parser = timeout)]
    pub(super) timeout: Option<Duration>,
}

/// Bus line that the options name.
pub(super) struct Line {
    pub(super) address: LineAddress,
    pub(super) bus: Bus,
    pub(super) quirks: Quirks,
    /// Profile that contains the line, and the bus in this profile; `None` if the line is given as an address.
    pub(super) known: Option<(Profile, BusId)>,
}

impl Target {
    /// Loads the profile; `None` if the arguments name no profile.
    pub(super) fn load(&self, json: bool) -> anyhow::Result<Option<Profile>> {
        self.profile.as_ref().map(|path| load_with(path, &self.set, json)).transpose()
    }

    /// Returns whether the line is given as the address of an OPC UA server.
    pub(super) fn is_at_a_server(&self) -> bool {
        let address = || self.bus.as_ref()?.parse::<LineAddress>().ok();
        self.profile.is_none() && address().is_some_and(|address| address.kind().has_namespaces)
    }

    /// Returns the line that the options name. A line without registers is an error.
    pub(super) fn find(&self, json: bool) -> anyhow::Result<Line> {
        let line = self.any(json)?;
        line.has_registers()?;
        Ok(line)
    }

    /// Returns the line that the options name, whether it has registers or not.
    pub(super) fn any(&self, json: bool) -> anyhow::Result<Line> {
        let Some(profile) = self.load(json)? else {
            let address: LineAddress =
                self.bus.as_deref().unwrap_or_default().parse().map_err(anyhow::Error::msg)?;
            let bus = address.bus(self.timeout.unwrap_or(TIMEOUT));
            return Ok(Line { address, bus, quirks: Quirks::default(), known: None });
        };
        let names: Vec<&str> = profile.buses.iter().map(|bus| bus.name.as_str()).collect();
        let bus = match &self.bus {
            Some(name) => names.iter().position(|known| known == name),
            None => (names.len() == 1).then_some(0),
        };
        let bus = bus.map(BusId).ok_or_else(|| {
            let why = self.bus.as_ref().map(|name| format!("the profile has no bus `{name}`"));
            let why = why.unwrap_or("--bus is missing".to_owned());
            anyhow::anyhow!("{why}; it has: {}", names.join(", "))
        })?;
        Ok(Target::of_any(profile, bus, self.timeout))
    }

    /// Returns the line of a bus in a profile. A line without registers is an error.
    pub(super) fn of(profile: Profile, id: BusId, timeout: Option<Duration>) -> anyhow::Result<Line> {
        let line = Target::of_any(profile, id, timeout);
        line.has_registers()?;
        Ok(line)
    }

    fn of_any(profile: Profile, id: BusId, timeout: Option<Duration>) -> Line {
        let mut bus = profile.bus(id).clone();
        bus.timeout = timeout.unwrap_or(bus.timeout);
        Line { address: LineAddress::of(&bus), bus, quirks: Quirks::default(), known: Some((profile, id)) }
    }
}

impl Line {
    /// Returns an error if devices on the line have no registers. These are CAN lines, OPC UA servers, and the sensors
    /// of this computer.
    pub(super) fn has_registers(&self) -> anyhow::Result<()> {
        let ScanKind::Other { is, instead, .. } = self.address.kind().scan else { return Ok(()) };
        let name = self.known.as_ref().map_or(self.address.to_string(), |_| format!("bus {}", self.bus.name));
        anyhow::bail!("{name} is {is}, without registers; {instead}")
    }
}

fn timeout(text: &str) -> Result<Duration, String> {
    let hint = "write a time above zero and of at most 60s, such as 300ms";
    values::span(text, Duration::from_secs(60), hint)
}

/// Parses unit numbers `3` or `1..247`, both ends included.
pub(super) fn units(text: &str) -> Result<(u8, u8), String> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    match (from.trim().parse(), to.trim().parse()) {
        (Ok(from), Ok(to)) if from <= to => Ok((from, to)),
        _ => Err(format!("`{text}` is not a range of units; write 1..247 or 3, from 0 to 255")),
    }
}

/// Parses a range of registers `holding:0..99` or `40001..40100`, both ends included. Returns the first register and
/// the number of registers.
pub(super) fn range(text: &str) -> Result<(Register, u16), String> {
    const FORM: &str = "write holding:0..99";
    let (from, to) =
        text.split_once("..").ok_or_else(|| format!("`{text}` is not a range of registers; {FORM}"))?;
    let first: Register = from.trim().parse()?;
    let to = to.trim();
    let last = match to.parse() {
        Ok(last) if from.contains(':') => last,
        _ => {
            let last = to.parse::<Register>();
            last.map_err(|_| format!("`{to}` is not the end of a range of registers; {FORM}"))?.offset
        }
    };
    let count = last.checked_sub(first.offset).and_then(|more| more.checked_add(1));
    let count = count.filter(|count| *count <= MOST);
    count
        .map(|count| (first, count))
        .ok_or_else(|| format!("`{text}` is not a range of 1 to {MOST} registers; {FORM}"))
}

/// Maximum number of registers of one scan, which takes some minutes at 9600 baud.
const MOST: u16 = 10_000;
