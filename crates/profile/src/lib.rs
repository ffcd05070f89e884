//! Machine profile: one TOML file, resolved into its final types before the gateway opens a connection.
//!
//! [`load`] reads the layers: the profile, the `.local.toml` next to it, the environment, and `--set`. It reports all
//! errors at once, each with its place. The result is a [`Profile`], in which references to a name are indices, and
//! words are Rust types.
//!
//! # Layout
//! - `load`, `merge`, `schema_check`, `source_map`: reading the layers, merging them, checking them against the schema,
//!   and the place of each key.
//! - `overridden_keys`, `protected_keys`: keys that the layers change, and keys that they must not change.
//! - `files`, `sources`: files that a profile names, and the record of everything that was read.
//! - [`host_and_port`]: addresses. [`safe_file`]: files named by a user. `control_chars`: safe display of foreign
//!   texts.
//! - `template`, `dbc`: device templates, and DBC files, which describe CAN frames.
//! - `tables`: one file for each table of the profile: its keys, checks, resolved form, and preview.
//! - `written_places`: the registers, nodes, objects and frames that the gateway writes.
//! - [`plan`], [`preview`]: read requests of a device; the document of `isotherm check`.

use std::path::PathBuf;
use std::time::Duration;

use isotherm_core::codec::{Address, Object};
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;

mod control_chars;
mod dbc;
mod document;
mod duration;
mod error;
mod files;
mod host_port;
mod key_context;
mod kinds;
mod load;
mod merge;
mod overridden_keys;
pub mod plan;
pub mod preview;
mod protected_keys;
pub mod safe_file;
mod schema_check;
mod schema_of;
mod size;
mod source_map;
mod sources;
pub mod stop;
mod tables;
pub mod template;
mod wording;
mod written_places;

pub use control_chars::{lines, one_line};
pub use error::{Errors, ProfileError, allowed, nearest};
pub use host_port::{NoPlace, host_and_port};
pub use kinds::can::emergency::Emergency;
pub use kinds::can::node::{CanDevice, Setup};
pub use kinds::modbus::functions::{Functions, WriteFunction};
pub use kinds::modbus::quirks::{Gateway, Quirks};
pub use kinds::modbus::serial::{Parity, Serial};
pub use kinds::opcua::connection::{OpcUa, Security, User, server_url};
pub use kinds::opcua::nodes::{ReadBy, SourceTime};
pub use load::{
    Loaded, environment, load, load_and_keep, load_before_certificates, load_from, parse, parse_with,
};
pub use overridden_keys::Overridden;
pub use sources::{SOURCES_MARK, Sources};
pub use tables::axis::model::network;
pub use tables::axis::model::seals::{sha256, sha256_of};
pub use tables::axis::probe::ProbeInput;
pub use tables::axis::{Axis, Purpose};
pub use tables::bus::tls::{NamedFile, TLS_PORT, Tls};
pub use tables::bus::transport::Transport;
pub use tables::bus::{Bus, Sync};
pub use tables::device::Device;
pub use tables::device::verify::Expected;
pub use tables::handshake::{Bit, Handshake};
pub use tables::heartbeat::Heartbeat;
pub use tables::history::History;
pub use tables::label::labelled;
pub use tables::machine::{Arm, OnStop};
pub use tables::mqtt::broker::BrokerUrl;
pub use tables::mqtt::{Mqtt, MqttFormat, MqttUser};
pub use tables::notify::url::Url;
pub use tables::notify::{ALARM, ALARM_OVER, AXIS_OFF, CLOCK, Notify, TRIGGERS, UNVERIFIED};
pub use tables::output::Output;
pub use tables::output::applied::Applied;
pub use tables::output::display::{Display, ExtraWord, Shown, Stale};
pub use tables::output::share::Share;
pub use tables::output::stated::Stated;
pub use tables::output::verify::Verify;
pub use tables::output::writes::Writes;
pub use tables::register::Flag;
pub use tables::schema::schema;
pub use tables::set::{OutputSet, OwnWord, Stretch};
pub use tables::signal::Signal;
pub use tables::signal::counter::Capture;
pub use tables::signal::unit::Unit;
pub use tables::web::{Commands, Language, PLAIN, Web, WebTls};
pub use template::Template;
pub use wording::{counted, duration_text};

/// Index of a bus (one physical line) in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BusId(pub usize);

/// Index of a device in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DeviceId(pub usize);

/// Index of an axis in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AxisId(pub usize);

/// Index of an output in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct OutputId(pub usize);

/// Index of an output set (outputs that are written together) in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SetId(pub usize);

/// Checked profile of a machine. Lists are in the order of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Name of the machine (key `machine.name`): small letters, digits and hyphens.
    pub name: String,
    /// Description in one line.
    pub description: String,
    /// Display name of the machine. Empty if the profile has none.
    pub label: String,
    /// Path of the profile.
    pub path: PathBuf,
    /// Settings of the signals that start the machine time and capture references.
    pub machine: MachineSettings,
    /// Condition for arming the axes.
    pub arm: Arm,
    /// Timeout of a request to arm that cannot be executed yet.
    pub arm_timeout: Duration,
    /// Action on the written registers when the gateway stops.
    pub on_stop: OnStop,
    /// Buses, which are the physical lines.
    pub buses: Vec<Bus>,
    /// Devices on the buses.
    pub devices: Vec<Device>,
    /// Signals, indexed by `SignalId`.
    pub signals: Vec<Signal>,
    /// Names of the signals that no model, condition, output or machine state uses. The gateway only records them.
    pub only_recorded: Vec<String>,
    /// Axes, indexed by [`AxisId`].
    pub axes: Vec<Axis>,
    /// Outputs: values that the gateway writes to devices.
    pub outputs: Vec<Output>,
    /// Sets of outputs that are written together.
    pub sets: Vec<OutputSet>,
    /// Heartbeat, which shows the CNC that the gateway runs.
    pub heartbeat: Option<Heartbeat>,
    /// Web page, API and metrics.
    pub web: Option<Web>,
    /// Publication to an MQTT broker.
    pub mqtt: Option<Mqtt>,
    /// Servers that receive messages about events.
    pub notify: Vec<Notify>,
    /// Directory of state and logs.
    pub history: History,
    /// Keys that the local file (`.local.toml`), the environment or `--set` sets above the profile.
    pub overridden: Vec<Overridden>,
}

impl Profile {
    /// Shortest `max_age` (age at which a reading becomes stale) of all signals.
    pub fn shortest_age(&self) -> Duration {
        self.signals.iter().map(|signal| signal.max_age).min().unwrap_or(Duration::MAX)
    }

    /// Signal with this index.
    pub fn signal(&self, id: SignalId) -> &Signal {
        &self.signals[id.0]
    }

    /// Device with this index.
    pub fn device(&self, id: DeviceId) -> &Device {
        &self.devices[id.0]
    }

    /// Bus with this index.
    pub fn bus(&self, id: BusId) -> &Bus {
        &self.buses[id.0]
    }

    /// Devices on a bus.
    pub fn devices_on(&self, bus: BusId) -> impl Iterator<Item = (DeviceId, &Device)> + Clone {
        let devices = self.devices.iter().enumerate().map(|(place, device)| (DeviceId(place), device));
        devices.filter(move |(_, device)| device.bus == bus)
    }

    /// Returns whether a device of a Modbus TCP line is behind a Modbus gateway to a serial line.
    pub fn is_behind_gateway(&self, id: DeviceId) -> bool {
        let device = self.device(id);
        let units = self.devices_on(device.bus).map(|(_, device)| device.unit);
        device.quirks.gateway.is_present(self.bus(device.bus).transport, units)
    }

    /// Signals that are read from a device.
    pub fn signals_of(&self, device: DeviceId) -> impl Iterator<Item = (SignalId, &Signal)> + Clone {
        let signals = self.signals.iter().enumerate().map(|(place, signal)| (SignalId(place), signal));
        signals.filter(move |(_, signal)| signal.device == device)
    }

    /// Axis with this index.
    pub fn axis(&self, id: AxisId) -> &Axis {
        &self.axes[id.0]
    }

    /// Returns whether an axis does not compensate, but only returns a register that outputs no longer use to its value
    /// without Cz.
    pub fn is_release(&self, id: AxisId) -> bool {
        self.axis(id).purpose == Purpose::Release
    }

    /// Number of the axes that compensate. These axes come first in the list.
    pub fn compensated(&self) -> usize {
        self.axes.iter().take_while(|axis| axis.purpose == Purpose::Compensation).count()
    }

    /// Output with this index.
    pub fn output(&self, id: OutputId) -> &Output {
        &self.outputs[id.0]
    }

    /// Set with this index.
    pub fn set(&self, id: SetId) -> &OutputSet {
        &self.sets[id.0]
    }

    /// Read requests of one poll of a device.
    pub fn requests(&self, device: DeviceId) -> Vec<plan::ReadRequest> {
        plan::plan(self.device(device), self.signals_of(device))
    }

    /// Read requests of one poll of a device, without those for CANopen objects.
    pub fn register_requests(&self, device: DeviceId) -> Vec<plan::ReadRequest> {
        let is_object = |request: &plan::ReadRequest| matches!(request.asks, plan::ReadTarget::Object(_));
        self.requests(device).into_iter().filter(|request| !is_object(request)).collect()
    }

    /// CANopen objects of a device that checks, signals and outputs use. Each occurs once, in this order.
    pub fn objects(&self, device: DeviceId) -> Vec<Object> {
        let object =
            |address: &Address| if let Address::Object(object) = address { Some(*object) } else { None };
        let checks = self.device(device).verify.iter().filter_map(|expected| object(&expected.address));
        let signals = self.signals.iter().filter(|signal| signal.device == device);
        let outputs = self.outputs.iter().filter(|output| output.device == device);
        let outputs = outputs.flat_map(|output| match output.verify {
            Verify::ReadBackAt(again) => [object(&output.address), Some(again)],
            _ => [object(&output.address), None],
        });
        let mut objects = Vec::new();
        for object in
            checks.chain(signals.filter_map(|signal| object(&signal.address))).chain(outputs.flatten())
        {
            if !objects.contains(&object) {
                objects.push(object);
            }
        }
        objects
    }
}
