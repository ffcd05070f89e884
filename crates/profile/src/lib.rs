//! A machine profile: one TOML file, resolved into final types before anything is opened.
//!
//! [`load`] reads the layers (profile, `.local.toml` beside it, environment, `--set`), reports every error at
//! once with its place, and gives a [`Profile`] in which each name has become an index and each text a type.

use std::path::PathBuf;
use std::time::Duration;

use isotherm_core::codec::{Address, Counter, Encoding, Register};
use isotherm_core::compensation::model::Condition;
use isotherm_core::compensation::settings::{AxisSettings, MachineSettings};
use isotherm_core::reading::SignalId;

mod can;
mod check;
mod data;
mod dbc;
mod display;
mod error;
mod files;
mod functions;
mod load;
mod merge;
mod output;
mod place;
pub mod plan;
pub mod preview;
mod raw;
mod serial;
mod set;
pub mod template;
mod tls;
mod verify;
mod walk;
mod writes;

pub use can::{CanDevice, Emergency, Setup, Sync};
pub use data::network;
pub use display::{Beside, Display, Shown, Stale};
pub use error::{Errors, ProfileError};
pub use functions::{Functions, WriteFunction};
pub use load::{Loaded, environment, load, parse, parse_with};
pub use output::{Applied, Output, Share, Verify};
pub use raw::schema;
pub use serial::{Parity, Serial, Transport};
pub use set::{Control, Flag, Handshake, OutputSet, SetId, Stretch};
pub use template::Template;
pub use tls::{TLS_PORT, Tls};
pub use verify::Expected;
pub use writes::Writes;

/// One physical line: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BusId(pub usize);

/// One device: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DeviceId(pub usize);

/// One axis: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AxisId(pub usize);

/// One output: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct OutputId(pub usize);

/// A whole machine, checked. Lists are in the order of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// `machine.name`, `[a-z0-9-]`.
    pub name: String,
    /// One line for people.
    pub description: String,
    /// The file it came from.
    pub path: PathBuf,
    /// Machine-on time and references.
    pub machine: MachineSettings,
    /// When an axis may begin to write.
    pub arm: Arm,
    /// The lines.
    pub buses: Vec<Bus>,
    /// What hangs on them.
    pub devices: Vec<Device>,
    /// What is read. `SignalId` counts here.
    pub signals: Vec<Signal>,
    /// What is computed. Same order as [`Profile::outputs`]' `axis`.
    pub axes: Vec<Axis>,
    /// What is written.
    pub outputs: Vec<Output>,
    /// Which of them are written as one.
    pub sets: Vec<OutputSet>,
    /// The register that lets the CNC see the gateway die.
    pub heartbeat: Option<Heartbeat>,
    /// Page, API, metrics.
    pub web: Option<Web>,
    /// Where state and logs are kept.
    pub history: History,
}

/// When an axis may begin to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arm {
    /// Once its devices are verified and its readings good.
    Auto,
    /// When a person says so.
    Manual,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Bus {
    /// Its name in the profile.
    pub name: String,
    /// What it is made of.
    pub transport: Transport,
    /// Host and port, the serial port's path, or the CAN interface, as written.
    pub address: String,
    /// Modbus/TCP Security; `None`: in the clear.
    pub tls: Option<Tls>,
    /// Longest wait for one answer, and for a connection.
    pub timeout: Duration,
    /// How long a write that was not answered may still arrive. Never less than `timeout`.
    pub late: Duration,
    /// What its devices need to be treated like.
    pub quirks: Quirks,
    /// The SYNC that is sent on a CAN line.
    pub sync: Option<Sync>,
}

/// Ways in which a device is peculiar, by the names users know from Telegraf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quirks {
    /// Silence after connecting.
    pub pause_after_connect: Duration,
    /// Silence between two requests.
    pub pause_between_requests: Duration,
    /// Reads are not merged at all.
    pub one_request_per_field: bool,
    /// Largest number of registers in one read, 1 to 125.
    pub max_registers_per_request: u16,
    /// Unused registers that a merged read may bridge.
    pub max_gap: u16,
    /// The connection is closed after each answer.
    pub close_after_each: bool,
}

/// One unit on a bus.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// Its name in the profile.
    pub name: String,
    /// Its line.
    pub bus: BusId,
    /// Modbus unit identifier; a CANopen node's number, and 0 for a device that only sends frames.
    pub unit: u8,
    /// Poll period of its signals.
    pub every: Duration,
    /// The function codes it may be sent.
    pub functions: Functions,
    /// The bus's quirks with the device's own over them.
    pub quirks: Quirks,
    /// What is read before anything that depends on it is armed.
    pub verify: Vec<Expected>,
    /// What it has from its template.
    pub template: Option<Template>,
    /// What it has on a CAN line.
    pub can: Option<CanDevice>,
}

impl Device {
    /// Where it is on its bus, behind its name: ` (unit 3)`, ` (node 5)`, nothing for one that only sends CAN frames.
    pub fn at(&self) -> String {
        match &self.can {
            None => format!(" (unit {})", self.unit),
            Some(can) => can.node.map_or(String::new(), |node| format!(" (node {node})")),
        }
    }
}

impl Default for Quirks {
    fn default() -> Quirks {
        Quirks {
            pause_after_connect: Duration::ZERO,
            pause_between_requests: Duration::ZERO,
            one_request_per_field: false,
            max_registers_per_request: 125,
            max_gap: 8,
            close_after_each: false,
        }
    }
}

/// One value that is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Its name in the profile.
    pub name: String,
    /// Where it is read.
    pub device: DeviceId,
    /// Its first register or its bit, its object, its place in frames.
    pub address: Address,
    /// How registers become the value.
    pub encoding: Encoding,
    /// Its engineering unit.
    pub unit: Unit,
    /// Smallest and largest believable value.
    pub range: Option<(f64, f64)>,
    /// Fastest believable change per second.
    pub max_rate: Option<f64>,
    /// Older is stale.
    pub max_age: Duration,
    /// A condition on other signals that condemns this one.
    pub fault_when: Option<Condition>,
    /// May share a read request with its neighbours.
    pub merge: bool,
    /// It counts: it rolls over, and may be set anew.
    pub counter: Option<Counter>,
    /// Written before each read, so that there is something to read.
    pub capture: Option<Capture>,
}

/// The command by which a counter copies its count into the registers that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capture {
    /// A coil or a holding register of the same device.
    pub address: Register,
    /// What is written there; a coil takes zero and not zero.
    pub value: u16,
}

/// Engineering units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit(pub &'static str);

impl Unit {
    /// The units a profile may name; "1" is a number without one.
    pub const WORDS: [&'static str; 23] = [
        "degC", "K", "mm", "um", "rpm", "bool", "percent", "mm/min", "m/s", "l/min", "bar", "V", "mV", "A",
        "mA", "W", "kW", "N", "Nm", "Hz", "s", "count", "1",
    ];

    /// The unit with this name.
    pub fn named(name: &str) -> Option<Unit> {
        Unit::WORDS.into_iter().find(|known| *known == name).map(Unit)
    }
}

impl std::fmt::Display for Unit {
    /// As people write it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.0 {
            "degC" => "°C",
            "um" => "µm",
            "percent" => "%",
            "1" => "",
            name => name,
        })
    }
}

/// One axis with its place in the profile's words.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What the pure step needs.
    pub settings: AxisSettings,
    /// A lathe's X: the offset acts on the diameter, Cz is doubled when written.
    pub diameter: bool,
    /// Where its measured error is read; `None`: errors come by command only, if it takes any.
    pub probe_input: Option<ProbeInput>,
}

/// Where a probing cycle leaves its result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbeInput {
    /// The measured error.
    pub signal: SignalId,
    /// Tells when there is a new one; without it each change of the error does.
    pub trigger: Option<SignalId>,
    /// One unit of the signal in µm of Cz: half of it where the axis acts on a diameter.
    pub micron: f64,
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

/// Page, API, metrics.
#[derive(Clone, Debug, PartialEq)]
pub struct Web {
    /// Host and port; port 0 takes any free one.
    pub listen: String,
    /// A file with the token that is asked for; required beyond loopback.
    pub token_file: Option<PathBuf>,
}

/// State and logs.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// `None`: the platform's state directory.
    pub directory: Option<PathBuf>,
    /// How long logs are kept.
    pub keep: Duration,
}

impl Profile {
    /// The shortest time for which a reading may be used.
    pub fn shortest_age(&self) -> Duration {
        self.signals.iter().map(|signal| signal.max_age).min().unwrap_or(Duration::MAX)
    }

    /// The signal.
    pub fn signal(&self, id: SignalId) -> &Signal {
        &self.signals[id.0]
    }

    /// The device.
    pub fn device(&self, id: DeviceId) -> &Device {
        &self.devices[id.0]
    }

    /// The bus.
    pub fn bus(&self, id: BusId) -> &Bus {
        &self.buses[id.0]
    }

    /// The devices of a bus.
    pub fn devices_on(&self, bus: BusId) -> impl Iterator<Item = (DeviceId, &Device)> + Clone {
        let devices = self.devices.iter().enumerate().map(|(place, device)| (DeviceId(place), device));
        devices.filter(move |(_, device)| device.bus == bus)
    }

    /// The signals that are read from a device.
    pub fn signals_of(&self, device: DeviceId) -> impl Iterator<Item = (SignalId, &Signal)> + Clone {
        let signals = self.signals.iter().enumerate().map(|(place, signal)| (SignalId(place), signal));
        signals.filter(move |(_, signal)| signal.device == device)
    }

    /// The axis.
    pub fn axis(&self, id: AxisId) -> &Axis {
        &self.axes[id.0]
    }

    /// The output.
    pub fn output(&self, id: OutputId) -> &Output {
        &self.outputs[id.0]
    }
}
