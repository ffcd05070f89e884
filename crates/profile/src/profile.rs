//! Resolved profile of a machine.

use std::path::PathBuf;
use std::time::Duration;

use crate::ids::{AxisId, BusId, DeviceId, OutputId, SetId};
use crate::members::{Lists, ProfileMembers};
use crate::{
    Arm, Axis, Bus, Device, Heartbeat, History, Mqtt, Notify, OnStop, OpcUaServer, Output, OutputSet,
    Overridden, Purpose, Signal, Verify, Web,
};
use isotherm_core::codec::{Address, Object};
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;

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
    /// Signals that start the time since machine start and capture references, and the averaging time of
    /// references.
    pub machine: MachineSettings,
    /// Whether axes are armed automatically, or only by the operator.
    pub arm: Arm,
    /// Timeout of a request to arm that cannot be executed yet.
    pub arm_timeout: Duration,
    /// Action on the output registers when the gateway stops.
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
    /// Output sets: outputs that are written together.
    pub sets: Vec<OutputSet>,
    /// Heartbeat, which shows the CNC that the gateway runs.
    pub heartbeat: Option<Heartbeat>,
    /// Web page, API and metrics.
    pub web: Option<Web>,
    /// Publication to an MQTT broker.
    pub mqtt: Option<Mqtt>,
    /// OPC UA server for clients of the plant.
    pub opcua_server: Option<OpcUaServer>,
    /// Servers that receive messages about events.
    pub notify: Vec<Notify>,
    /// Directory of state and logs.
    pub history: History,
    /// Keys whose values come from the local file (`.local.toml`), the environment or `--set`.
    pub overridden: Vec<Overridden>,
    /// Devices of each bus and signals of each device.
    pub members: ProfileMembers,
}

impl Profile {
    /// Returns the shortest `max_age` (age at which a reading becomes stale) of all signals; `Duration::MAX` without
    /// signals.
    pub fn shortest_age(&self) -> Duration {
        self.signals.iter().map(|signal| signal.max_age).min().unwrap_or(Duration::MAX)
    }

    /// Returns the shortest `max_age` of the signals of a device; `Duration::MAX` if the device has no signals.
    pub fn shortest_age_of(&self, device: DeviceId) -> Duration {
        self.signals_of(device).map(|(_, signal)| signal.max_age).min().unwrap_or(Duration::MAX)
    }

    /// Returns the signal with this index, which must be an index of this profile.
    pub fn signal(&self, id: SignalId) -> &Signal {
        &self.signals[id.0]
    }

    /// Returns the device with this index, which must be an index of this profile.
    pub fn device(&self, id: DeviceId) -> &Device {
        &self.devices[id.0]
    }

    /// Returns the bus with this index, which must be an index of this profile.
    pub fn bus(&self, id: BusId) -> &Bus {
        &self.buses[id.0]
    }

    /// Iterates over the devices on a bus, each with its index.
    pub fn devices_on(&self, bus: BusId) -> impl Iterator<Item = (DeviceId, &Device)> + Clone {
        self.lists().devices.of(bus.0).map(move |place| (DeviceId(place), &self.devices[place]))
    }

    /// Returns whether a device of a Modbus TCP line is behind a Modbus gateway to a serial line.
    pub fn is_behind_gateway(&self, id: DeviceId) -> bool {
        let device = self.device(id);
        let units = self.devices_on(device.bus).map(|(_, device)| device.unit);
        device.quirks.gateway.is_present(self.bus(device.bus).transport, units)
    }

    /// Iterates over the signals that are read from a device, each with its index.
    pub fn signals_of(&self, device: DeviceId) -> impl Iterator<Item = (SignalId, &Signal)> + Clone {
        self.lists().signals.of(device.0).map(move |place| (SignalId(place), &self.signals[place]))
    }

    fn lists(&self) -> &Lists {
        self.members.lists(|| {
            let devices = self.devices.iter().enumerate().map(|(place, device)| (device.bus.0, place));
            let signals = self.signals.iter().enumerate().map(|(place, signal)| (signal.device.0, place));
            Lists { devices: devices.collect(), signals: signals.collect() }
        })
    }

    /// Returns the axis with this index, which must be an index of this profile.
    pub fn axis(&self, id: AxisId) -> &Axis {
        &self.axes[id.0]
    }

    /// Returns whether an axis only removes Cz from a register that no output uses any longer. Such an axis does not
    /// compensate.
    pub fn is_release(&self, id: AxisId) -> bool {
        self.axis(id).purpose == Purpose::Release
    }

    /// Returns the number of axes that compensate. These axes come first in the list.
    pub fn compensated(&self) -> usize {
        self.axes.iter().take_while(|axis| axis.purpose == Purpose::Compensation).count()
    }

    /// Returns the output with this index, which must be an index of this profile.
    pub fn output(&self, id: OutputId) -> &Output {
        &self.outputs[id.0]
    }

    /// Returns the output set with this index, which must be an index of this profile.
    pub fn set(&self, id: SetId) -> &OutputSet {
        &self.sets[id.0]
    }

    /// Returns the CANopen objects of a device: first those of checks, then those of signals, then those of
    /// outputs. Each object occurs once.
    pub fn objects(&self, device: DeviceId) -> Vec<Object> {
        let object =
            |address: &Address| if let Address::Object(object) = address { Some(*object) } else { None };
        let checks = self.device(device).verify.iter().filter_map(|expected| object(&expected.address));
        let signals = self.signals_of(device).map(|(_, signal)| signal);
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
