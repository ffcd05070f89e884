//! Whole profile as written, before it is checked and resolved.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Deserialize;

use super::axis::RawAxis;
use super::bus::RawBus;
use super::device::RawDevice;
use super::heartbeat::RawHeartbeat;
use super::history::RawHistory;
use super::machine::RawMachine;
use super::mqtt::RawMqtt;
use super::notify::RawNotify;
use super::opcua_server::RawOpcUaServer;
use super::output::RawOutput;
use super::set::RawSet;
use super::signal::RawSignal;
use super::web::RawWeb;

/// One machine: its buses, devices, signals, axes and outputs.
///
/// The JSON schema is generated from the `Raw…` types. Each layer of a profile (file, local file,
/// environment, `--set`) is checked against the schema. Editors and error messages show the doc comments of
/// the fields. Every key is an `Option`, even if it is required. The schema check reports missing and wrong
/// keys and leaves them out, so that the other keys can still be checked.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(
    title = "isotherm machine profile",
    description = "One machine: its buses, devices, signals, axes and outputs."
)]
pub(crate) struct RawProfile {
    /// Settings of the whole machine.
    #[schemars(required)]
    pub(super) machine: Option<RawMachine>,
    /// Lines (buses) to which devices are connected, by name.
    #[serde(default)]
    pub(super) bus: BTreeMap<String, RawBus>,
    /// Devices on the lines, by name.
    #[serde(default)]
    pub(crate) device: BTreeMap<String, RawDevice>,
    /// Values that are read from devices, by name. A name must not be that of another column of the log, such as
    /// `z_cz_um`.
    #[serde(default)]
    pub(super) signal: BTreeMap<String, RawSignal>,
    /// Compensated axes, by name.
    #[serde(default)]
    pub(super) axis: BTreeMap<String, RawAxis>,
    /// Values that are written to devices, by name.
    #[serde(default)]
    pub(super) output: BTreeMap<String, RawOutput>,
    /// Sets of outputs that a control must receive together, by name.
    #[serde(default)]
    pub(super) set: BTreeMap<String, RawSet>,
    /// Register or node with a counter that shows the CNC that the gateway runs.
    pub(super) heartbeat: Option<RawHeartbeat>,
    /// Web page, API and metrics.
    pub(super) web: Option<RawWeb>,
    /// Publication of values and events to an MQTT broker.
    pub(super) mqtt: Option<RawMqtt>,
    /// OPC UA server, from which clients read values and events.
    pub(super) opcua_server: Option<RawOpcUaServer>,
    /// Servers that receive messages about events.
    #[serde(default)]
    pub(super) notify: Vec<RawNotify>,
    /// Storage of state and logs.
    pub(super) history: Option<RawHistory>,
}
