//! A machine profile: one TOML file, resolved into final types before anything is opened.
//!
//! [`load`] reads the layers (profile, `.local.toml` beside it, environment, `--set`), reports every error at
//! once with its place, and gives a [`Profile`] in which each name has become an index and each text a type.
//!
//! # Layout
//! - `load`, `merge`, `walk`, `span`, `overridden`, `guarded`: the layers, each against the schema, where every key was written,
//!   what those above the profile change, and what they may not change.
//! - `files`, `sources`: the files that a profile names, and everything that was read of one, kept so that it can be loaded again.
//! - [`host_and_port`]: addresses. [`regular`]: files that a person names. `unseen`: texts of others, as people may see them.
//! - `template`, `dbc`: what device templates and DBC files bring.
//! - `tables`: a file for each table of the profile: as written, checked, resolved, and what `isotherm check` says of it.
//! - `written`: the places that a gateway writes to.
//! - [`plan`], [`preview`]: which requests read a device; the tables' previews and the load of each line in one document.

use std::path::PathBuf;
use std::time::Duration;

use isotherm_core::codec::{Address, Object};
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;

mod dbc;
mod document;
mod duration;
mod error;
mod files;
mod guarded;
mod host_port;
mod load;
mod merge;
mod overridden;
pub mod plan;
pub mod preview;
pub mod regular;
mod size;
mod sources;
mod span;
pub mod stop;
mod tables;
pub mod template;
mod unseen;
mod walk;
mod wording;
mod written;

pub use error::{Errors, ProfileError, allowed, nearest};
pub use host_port::{NoPlace, host_and_port};
pub use load::{
    Loaded, environment, load, load_and_keep, load_before_certificates, load_from, parse, parse_with,
};
pub use overridden::Overridden;
pub use sources::{SOURCES_MARK, Sources};
pub use tables::axis::model::network;
pub use tables::axis::model::seals::{sha256, sha256_of};
pub use tables::axis::probe::ProbeInput;
pub use tables::axis::{Axis, Purpose};
pub use tables::bus::opcua::{NamedFile, OpcUa, Security, User, server_url};
pub use tables::bus::serial::{Parity, Serial};
pub use tables::bus::tls::{PemFile, TLS_PORT, Tls};
pub use tables::bus::{Bus, Sync, Transport};
pub use tables::device::Device;
pub use tables::device::emergency::Emergency;
pub use tables::device::functions::{Functions, WriteFunction};
pub use tables::device::node::{CanDevice, Setup};
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
pub use tables::opcua::{ReadBy, SourceTime};
pub use tables::output::Output;
pub use tables::output::applied::Applied;
pub use tables::output::display::{Beside, Display, Shown, Stale};
pub use tables::output::share::Share;
pub use tables::output::stated::Stated;
pub use tables::output::verify::Verify;
pub use tables::output::writes::Writes;
pub use tables::quirks::{Gateway, Quirks};
pub use tables::register::Flag;
pub use tables::schema::schema;
pub use tables::set::{OutputSet, OwnWord, Stretch};
pub use tables::signal::Signal;
pub use tables::signal::counter::Capture;
pub use tables::signal::unit::Unit;
pub use tables::web::{Commands, Language, PLAIN, Web, WebTls};
pub use template::Template;
pub use unseen::{lines, one_line};
pub use wording::{counted, duration_text};

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

/// One set: its place in the profile's list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SetId(pub usize);

/// A whole machine, checked. Lists are in the order of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// `machine.name`, `[a-z0-9-]`.
    pub name: String,
    /// One line for people.
    pub description: String,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// The file it came from.
    pub path: PathBuf,
    /// Time since machine start, and references.
    pub machine: MachineSettings,
    /// When an axis may begin to write.
    pub arm: Arm,
    /// How long a request to arm waits that cannot be served yet.
    pub arm_timeout: Duration,
    /// What a stop does to the registers.
    pub on_stop: OnStop,
    /// The lines.
    pub buses: Vec<Bus>,
    /// What hangs on them.
    pub devices: Vec<Device>,
    /// What is read. `SignalId` counts here.
    pub signals: Vec<Signal>,
    /// The names of those that nothing uses: they are recorded.
    pub only_recorded: Vec<String>,
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
    /// What is published to a broker.
    pub mqtt: Option<Mqtt>,
    /// Where what happens is posted.
    pub notify: Vec<Notify>,
    /// Where state and logs are kept.
    pub history: History,
    /// What layers above the file have set.
    pub overridden: Vec<Overridden>,
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

    /// Returns whether a device of a Modbus TCP line is behind a gateway to a serial line.
    pub fn is_behind_gateway(&self, id: DeviceId) -> bool {
        let device = self.device(id);
        let units = self.devices_on(device.bus).map(|(_, device)| device.unit);
        device.quirks.gateway.is_present(self.bus(device.bus).transport, units)
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

    /// Returns whether an axis takes a register that is no output's any more back to its base.
    pub fn is_release(&self, id: AxisId) -> bool {
        self.axis(id).purpose == Purpose::Release
    }

    /// Number of the axes that compensate, which come first.
    pub fn compensated(&self) -> usize {
        self.axes.iter().take_while(|axis| axis.purpose == Purpose::Compensation).count()
    }

    /// The output.
    pub fn output(&self, id: OutputId) -> &Output {
        &self.outputs[id.0]
    }

    /// The set.
    pub fn set(&self, id: SetId) -> &OutputSet {
        &self.sets[id.0]
    }

    /// The requests of one poll of a device.
    pub fn requests(&self, device: DeviceId) -> Vec<plan::ReadRequest> {
        plan::plan(self.device(device), self.signals_of(device))
    }

    /// Those of them that read registers or nodes of a server: without the objects of a CANopen node.
    pub fn register_requests(&self, device: DeviceId) -> Vec<plan::ReadRequest> {
        let is_object = |request: &plan::ReadRequest| matches!(request.asks, plan::ReadTarget::Object(_));
        self.requests(device).into_iter().filter(|request| !is_object(request)).collect()
    }

    /// The CANopen objects of a device that are in use, each once: as checks, signals and outputs name them, in this order.
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
