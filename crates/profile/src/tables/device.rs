//! `[device.*]`: one device on a bus line: a Modbus unit, a CAN device, an OPC UA server, a device that sends text, or
//! sensors of this computer.

use std::collections::BTreeMap;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::KeyContext;
use super::label::labelled;
use crate::BusId;
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::kinds::can::node::{CanDevice, RawEmergency, RawSetup};
use crate::kinds::modbus::functions::{Function, Functions};
use crate::kinds::modbus::quirks::{Quirks, RawQuirks};
use crate::kinds::opcua::nodes::{ReadBy, SourceTime};
use crate::schema_of::schema_of;
use crate::template::Template;
use isotherm_core::codec::Table;
use verify::{Expected, RawVerify};

mod resolve;
pub(crate) mod verify;

/// Device on a line: a Modbus unit, a CAN device, an OPC UA server, a device that sends text, or sensors of this
/// computer.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Device", extend("x-layers" = "arrives"))]
pub(crate) struct RawDevice {
    /// Display name of the device in any writing system, for example Chinese. It is shown next to the name.
    #[schemars(extend("x-layers" = "free"))]
    label: Option<String>,
    /// Name of the bus to which the device is connected.
    #[schemars(required)]
    pub(crate) bus: Option<String>,
    /// Modbus unit identifier. Required on a Modbus line.
    pub(crate) unit: Option<u8>,
    /// Poll period of the device's signals. Default "1s".
    #[schemars(extend("x-layers" = "free"))]
    pub(crate) every: Option<Timespan>,
    /// Device template, which sets registers, types and sentinels (raw values that mean "no measurement") of its
    /// channels.
    template: Option<String>,
    /// Variant of the template, for example "T" for a thermocouple type.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    variant: Option<String>,
    /// SHA-256 of the template, as `check` prints it. A different template, for example after an upgrade, is rejected.
    /// Default: any template is accepted.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    sha256: Option<String>,
    /// Number added to every register of the template, for a device whose first register can be configured.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    base: Option<u16>,
    /// Expected values for checks of the template on this device, by the name of the check. "unchecked" omits a check.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    expect: Option<BTreeMap<String, ExpectValue>>,
    /// Function codes that the gateway may send to the device. Default: all.
    functions: Option<Vec<Function>>,
    /// Quirks: special requirements of the device. They take precedence over the quirks of the bus.
    #[schemars(extend("x-layers" = "free"))]
    quirks: Option<RawQuirks>,
    /// CAN: DBC file next to the profile that describes the frames of the device.
    pub(crate) dbc: Option<String>,
    /// CAN, with a DBC file: J1939 source address of the device. The messages of the device are J1939 parameter groups.
    /// Messages of other senders are ignored.
    pub(crate) source_address: Option<u8>,
    /// CANopen node number.
    #[schemars(range(min = 1, max = 127))]
    pub(crate) node: Option<u8>,
    /// OPC UA: meaning of the server's timestamps. "sampled": time of measurement, from which the age of the reading is
    /// calculated. "changed": time of the last change, which does not affect the age. Default "sampled".
    #[schemars(extend("x-layers" = "free"))]
    pub(crate) source_time: Option<SourceTime>,
    /// OPC UA: way of reading signals. "poll": the gateway requests them. "subscription": the server samples them once
    /// in `every` and sends changes. Default "poll".
    #[schemars(extend("x-layers" = "free"))]
    read: Option<ReadBy>,
    /// CANopen: whether the gateway starts the node by NMT, at the beginning and after each boot-up. Default true.
    pub(crate) start: Option<bool>,
    /// CANopen: timeout of the node's heartbeat. A heartbeat missing for this time, also at the start, is a fault.
    /// Default: not monitored.
    #[schemars(extend("x-layers" = "free"))]
    pub(crate) heartbeat: Option<Timespan>,
    /// CANopen: objects that the gateway writes in this order before each start of the node.
    pub(crate) setup: Option<Vec<RawSetup>>,
    /// CANopen: meanings of the device's emergency codes, in addition to the codes of CiA 301.
    #[schemars(extend("x-layers" = "free"))]
    pub(crate) emergency: Option<Vec<RawEmergency>>,
    /// Registers (CANopen: objects) that are read before arming and in operation. A mismatch prevents arming, and makes
    /// the readings of the device bad.
    pub(crate) verify: Option<Vec<RawVerify>>,
}

/// Expected value for a check of the template.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
#[allow(dead_code, reason = "templates are resolved before the profile is checked")]
enum ExpectValue {
    Number(i64),
    Word(ExpectWord),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ExpectWord {
    Unchecked,
}

schema_of!(ExpectValue as "Expect": { "anyOf": [{ "type": "integer" }, { "type": "string", "enum": ["unchecked"] }] });

/// Parts of a device that depend on the kind of its line.
#[derive(Default)]
pub(crate) struct DeviceParts {
    /// Modbus unit or CANopen node number. `None` if it has an error.
    pub(crate) unit: Option<u8>,
    pub(crate) can: Option<CanDevice>,
    pub(crate) source_time: Option<SourceTime>,
    pub(crate) is_pc: bool,
}

/// Resolved device on a bus.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// Name of the device: `plc` for the table `[device.plc]`.
    pub name: String,
    /// Display name. Empty if the profile has none.
    pub label: String,
    /// Bus to which the device is connected.
    pub bus: BusId,
    /// Modbus unit identifier, or CANopen node number. 0 for a device that only sends frames, a server, or sensors of
    /// this computer.
    pub unit: u8,
    /// Period at which the device's signals are polled.
    pub every: Duration,
    /// Modbus function codes that the gateway may send to the device.
    pub functions: Functions,
    /// Quirks: special requirements of the device. A quirk that the device does not set has the value of its bus.
    pub quirks: Quirks,
    /// Registers, objects or nodes that are compared with expected values before arming and in operation.
    pub verify: Vec<Expected>,
    /// Template of the device. `None` if the device has none.
    pub template: Option<Box<Template>>,
    /// Settings of a device on a CAN line. `None` on every other line.
    pub can: Option<CanDevice>,
    /// Meaning of an OPC UA server's timestamps. `None` on every other line.
    pub source_time: Option<SourceTime>,
    /// Way of reading the signals of an OPC UA server. Other devices are polled.
    pub read: ReadBy,
    /// Whether the device consists of sensors of this computer.
    pub is_pc: bool,
}

impl Device {
    /// Formats the unit or node number for use after the device's name: ` (unit 3)`, ` (node 5)`, or nothing.
    pub fn at(&self) -> String {
        match &self.can {
            None if self.source_time.is_some() || self.is_pc => String::new(),
            None => format!(" (unit {})", self.unit),
            Some(can) => can.node.map_or(String::new(), |node| format!(" (node {node})")),
        }
    }

    /// Returns whether the gateway checks or sets up the device before arming: it has `verify`, or a CANopen `setup`.
    pub fn is_checked(&self) -> bool {
        !self.verify.is_empty() || self.can.as_ref().is_some_and(|can| !can.setup.is_empty())
    }

    /// Returns the preview of the device: its description, its read requests, its checks, and its template.
    /// `bounds` states how far Cz of each axis may change before a changed setting of the device is detected.
    pub(crate) fn preview(
        &self,
        (bus, described): (&str, &str),
        can: Option<Section>,
        (summary, requests): (String, Vec<Section>),
        (checks, bounds): (Vec<Section>, Vec<String>),
    ) -> Section {
        let (name, unit, every) = (&self.name, self.unit, shown(self.every));
        let mut section = Section::default();
        section.line(format!("  {}: {described}", labelled(name, &self.label)));
        can.iter().for_each(|can| section.lines_of(can));
        let stamped = self.source_time.map(|source_time| match source_time {
            SourceTime::Sampled => "the age of a reading is counted from the server's time stamp",
            SourceTime::Changed => {
                "the server's time stamps give the time of the last change: they do not affect the age of a \
                 reading"
            }
        });
        section.lines("    ", stamped);
        section.entry("source_time", stamped);
        let sent = (self.read == ReadBy::Subscription)
            .then_some("the server sends changed values (a subscription); the gateway does not poll");
        section.lines("    ", sent);
        entries!(section, read = sent, name, label = &self.label, bus, unit);
        entries!(section, every, summary);
        section.parts("requests", requests.into_iter());
        section.parts("checks", checks.into_iter());
        section.lines("    ", &bounds);
        section.entry("settings_bounds", bounds);
        section.part("template", self.template.as_deref().map(Template::preview));
        section.json("can", can);
        section
    }

    /// Describes the template channel that the signal or output `user` uses: `channel 0 of icp-das-m7019r; the profile
    /// itself sets scale`. `None` if it uses no channel.
    pub(crate) fn channel(&self, user: &str) -> Option<String> {
        let template = self.template.as_ref()?;
        let used = template.uses.iter().find(|used| used.name == user)?;
        let own = match used.overridden.as_slice() {
            [] => String::new(),
            keys => format!("; the profile itself sets {}", keys.join(", ")),
        };
        Some(format!("channel {} of {}{own}", used.channel, template.name))
    }

    /// Returns the largest number of registers that the device accepts in one read as well as in one write.
    pub fn longest_request(&self) -> u16 {
        // Function 16 writes 123 registers, function 06 one.
        let most = if self.functions.write_multiple { 123 } else { 1 };
        self.quirks.max_registers_per_request.min(most)
    }

    /// Reports an error if the device does not allow writing this number of registers.
    pub(crate) fn must_write(&self, at: &KeyContext<'_>, registers: u16) {
        if self.functions.writes(registers).is_none() {
            let functions =
                if registers == 1 { "\"write-single\" or \"write-multiple\"" } else { "\"write-multiple\"" };
            self.lacks(at, &format!("writing {registers} register(s) needs {functions}"), functions);
        }
    }

    /// Reports an error if the device does not allow reading this table.
    pub(crate) fn must_read(&self, at: &KeyContext<'_>, table: Table) {
        if !self.functions.reads(table) {
            let function = match table {
                Table::Coil => "read-coils",
                Table::Discrete => "read-discrete",
                Table::Holding => "read-holding",
                Table::Input => "read-input",
            };
            self.lacks(at, &format!("reading this address needs {function}"), &format!("\"{function}\""));
        }
    }

    /// Reports that a function is missing in `functions` of this device. `needs` is the beginning of the message.
    pub(crate) fn lacks(&self, at: &KeyContext<'_>, needs: &str, functions: &str) {
        let help = format!("add {functions} to `functions` of the device, if the device supports it");
        at.invalid(format!("{needs}, which is not among the `functions` of device `{}`", self.name), help);
    }
}
