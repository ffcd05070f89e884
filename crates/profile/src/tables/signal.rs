//! `[signal.*]`: one value that the gateway reads from a device, for example a temperature.

use std::time::Duration;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::bus::Bus;
use super::device::Device;
use super::label::labelled;
use super::register::{self, Notation, TypeWord, WordOrderWord};
use crate::DeviceId;
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::kinds::can::fields::{RawFrame, RawPdo};
use crate::kinds::opcua::nodes::ElementValue;
use crate::schema_of::schema_of;
use bad::BadValue;
use counter::{Capture, RawCounter};
use isotherm_core::codec::{Address, Counter, Encoding, PcSensor, ScaleFrom};
use isotherm_core::compensation::model::Condition;
use isotherm_core::reading::Reason;
use limits::{DefaultLimits, DefaultRange, RangeValue, RateValue};
use scale::ShownScale;
use unit::Unit;

pub(crate) mod bad;
pub(crate) mod counter;
pub(crate) mod limits;
mod resolve;
mod scale;
pub(crate) mod unit;

/// Value that is read from a device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Signal", extend("x-layers" = "arrives"))]
pub(crate) struct RawSignal {
    /// Display name of the signal in any writing system, for example Chinese. It is shown next to the name.
    #[schemars(extend("x-layers" = "free"))]
    label: Option<String>,
    /// Device from which the signal is read.
    #[schemars(required)]
    pub(crate) device: Option<String>,
    /// Channel of the device's template, by number or name.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    channel: Option<ChannelValue>,
    /// Register as table and zero-based address ("input:0", "holding:84", "coil:1", "discrete:3"), or as one-based
    /// Modicon number ("30001"). "input:50.3" is bit 3 of a register, and "input:50.4-7" the number in bits 4 to 7.
    pub(crate) register: Option<String>,
    /// OPC UA: node, for example "ns=2;s=/Nck/State" or "ns=3;i=1005".
    pub(crate) node: Option<String>,
    /// OPC UA: element of the node's array. The first one is 0. A list has one index for each dimension: [1, 2].
    pub(crate) element: Option<ElementValue>,
    /// Sensor of this computer: "w1:28-0316a2794f01", "hwmon:NAME/LABEL" or "iio:NAME/LABEL". If several chips have the
    /// same name: "hwmon:NAME@DEVICE/LABEL".
    pub(crate) sensor: Option<String>,
    /// Serial-ascii: pattern of the line of text with the value, for example "{number} mm" or ">{skip 2}{number}{any}".
    /// `{number.3}` requires three decimals, `{number 8}` eight characters, `{number,}` has a decimal comma, and `{sum}`
    /// is the checksum of DCON.
    #[schemars(extend("x-control" = true))]
    pub(crate) text: Option<String>,
    /// Serial-ascii: text that the gateway sends before each read, for example "#{unit}\r" or "\u0002". `{unit}` is the
    /// `unit` of the device in two hexadecimal digits, `{sum}` the checksum of DCON. Default: nothing is sent, because
    /// the device sends its text without a request.
    #[schemars(extend("x-control" = true))]
    pub(crate) request: Option<String>,
    /// Type of the value. Required for input and holding registers. For bits of a register, "i16" is a signed number;
    /// "u32" and "i32" are bits of two registers. For a node, its own type; by default any number is accepted.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// Order of the registers. Required for 32 bits and more, because devices differ.
    pub(crate) word_order: Option<WordOrderWord>,
    /// Whether the two bytes of each register are exchanged. Default false.
    pub(crate) byte_swap: Option<bool>,
    /// Engineering units per count, not zero. Default 1.
    pub(crate) scale: Option<f64>,
    /// Modbus: register that contains the power of ten of the scale, with its sign, for example "holding:12". -1 means
    /// that the value is a tenth of `scale` times the count. SunSpec calls it scale factor.
    pub(crate) scale_from: Option<String>,
    /// Modbus: register that contains the number of decimals of the value, for example "holding:12". 1 means that the
    /// value is a tenth of `scale` times the count.
    pub(crate) decimals_from: Option<String>,
    /// Engineering value of the raw count 0. Default 0.
    pub(crate) offset: Option<f64>,
    /// Raw values that mean "no measurement", compared before scaling: [-32768]. They may have a meaning: [{ raw =
    /// -512, means = "open circuit" }].
    pub(crate) bad: Option<Vec<BadValue>>,
    /// Engineering unit. Default: "bool" for a coil or a discrete input, the unit of the DBC file, otherwise "1".
    #[serde(default)]
    #[schemars(schema_with = "units")]
    pub(crate) unit: Option<String>,
    /// Smallest and largest plausible value, in the unit of the signal. Values outside of this range are bad. "none": no
    /// limit. Default of a temperature that a model uses: -40 to 200 °C. Default of any other temperature: not below
    /// absolute zero.
    #[schemars(extend("x-layers" = "free"))]
    range: Option<RangeValue>,
    /// Largest plausible rate of change, units per second. A reading that changes faster is bad. "none": no limit.
    /// Default of a temperature that a model uses: 5 °C per second.
    #[schemars(extend("x-layers" = "free"))]
    max_rate: Option<RateValue>,
    /// Whether the value is a difference of two temperatures. Then `range` and `max_rate` have no default. Default
    /// false.
    #[schemars(extend("x-layers" = "free"))]
    difference: Option<bool>,
    /// Largest age of a reading. An older reading is stale. Default: five polls, and at least three timeouts.
    #[schemars(extend("x-layers" = "free"))]
    max_age: Option<Timespan>,
    /// Condition on other signals under which this signal is bad, for example "bed_open == 1".
    #[schemars(extend("x-layers" = "free"))]
    fault_when: Option<String>,
    /// Whether a read request may include adjacent registers of other signals. Default true.
    #[schemars(extend("x-layers" = "free"))]
    merge: Option<bool>,
    /// Settings of a counting signal, for example a linear scale: its largest speed, and the command that
    /// captures the count.
    counter: Option<RawCounter>,
    /// CAN: message and signal in the device's DBC file: "Message.Signal". Long names are allowed.
    pub(crate) dbc: Option<String>,
    /// CANopen process data, for example { cob_id = 0x185, start = 0, length = 16, signed = true }.
    pub(crate) pdo: Option<RawPdo>,
    /// CANopen object, polled with the period `every` of the device, for example "7130:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// CAN frame without a DBC file, for example { id = 0x100, start = 0, length = 16, order = "little", signed = true
    /// }.
    pub(crate) frame: Option<RawFrame>,
}

/// Channel of a device template, by number or name.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
#[allow(dead_code, reason = "templates are resolved before the profile is checked")]
pub(super) enum ChannelValue {
    Number(u16),
    Name(String),
}

schema_of!(ChannelValue as "Channel": { "anyOf": [{ "type": "integer", "minimum": 0, "maximum": 65535 }, { "type": "string" }] });

fn units(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "string", "enum": Unit::WORDS })
}

/// Signal of the profile, after all its keys were checked. Rarely used settings are boxed, because a
/// profile may have thousands of signals.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Name of the signal: `bed` for the table `[signal.bed]`.
    pub name: String,
    /// Display name. Empty if the profile has none.
    pub label: String,
    /// Device from which the signal is read.
    pub device: DeviceId,
    /// Address of the signal: its first register or bit, its object, node or sensor, or its bits in frames.
    pub address: Address,
    /// Encoding of the value: its type, scale, offset, and raw values for "no measurement".
    pub encoding: Encoding,
    /// Register with the power of ten of the scale, which the encoding does not contain. `None` if the scale is fixed.
    pub scale_from: Option<Box<ScaleFrom>>,
    /// Engineering unit of the value after scale and offset have been applied.
    pub unit: Unit,
    /// Smallest and largest plausible value that the profile or its template states, in the unit of the signal. `None`
    /// if neither states a range.
    pub range: Option<(f64, f64)>,
    /// Largest plausible change per second that the profile states, in the unit of the signal. `None` if it states no
    /// limit.
    pub max_rate: Option<f64>,
    /// Default limits of a temperature. They apply if the profile and its template state no limits.
    pub defaults: DefaultLimits,
    /// Whether the value is a difference of two temperatures.
    pub is_difference: bool,
    /// Largest age of a reading. An older reading is stale, and is not used.
    pub max_age: Duration,
    /// Condition on other signals under which this signal is bad, so that its readings are not used.
    pub fault_when: Option<Box<Condition>>,
    /// Whether a read request may include adjacent registers of other signals.
    pub merge: bool,
    /// Settings of a counting signal, for example a linear scale, such as its largest speed. `None` for any
    /// other signal.
    pub counter: Option<Counter>,
    /// Command that is written before each read, so that the device copies its count into the registers. `None` if no
    /// command is needed.
    pub capture: Option<Capture>,
}

impl Signal {
    /// Returns whether a value is within the plausible range: the range of the profile or template, or the default
    /// range.
    pub fn is_plausible(&self, value: f64) -> bool {
        let (low, high) = self.plausible_range();
        (low..=high).contains(&value)
    }

    /// Returns the smallest and the largest plausible value: the limits of the profile or template, or the default
    /// limits. Infinity stands for no limit.
    pub fn plausible_range(&self) -> (f64, f64) {
        let default = || self.defaults.range.map(DefaultRange::bounds);
        self.range.or_else(default).unwrap_or((f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Returns the largest plausible change per second: the limit of the profile, or the default limit. `None` if there
    /// is no limit.
    pub fn rate_limit(&self) -> Option<f64> {
        self.max_rate.or(self.defaults.max_rate)
    }

    /// Preview of the signal: address, encoding, and the conditions under which a reading is rejected.
    pub(crate) fn preview(&self, device: &Device, bus: &Bus) -> Section {
        let (encoding, unit) = (&self.encoding, self.unit);
        let name = &self.name;
        let register = Notation::of(&self.address, encoding.data_type);
        let (data_type, scale) = (encoding.data_type.name(), encoding.scale.get());
        let channel = device.channel(name);
        let device = &device.name;
        let shown = labelled(name, &self.label);
        let sensor = self.address.sensor();
        // A sensor and a text have a number with its unit, and no counts.
        let is_number = sensor.is_some() || self.address.text().is_some();
        let mut line = match (self.address.is_in_frames(), is_number, self.address.node()) {
            (true, ..) => format!("  {shown}: {register}, from {device}"),
            (false, true, _) => format!("  {shown}: {register} of {device}"),
            (false, false, Some(node)) if node.data_type.is_none() => {
                format!("  {shown}: {register} of {device}, the node's own type")
            }
            (false, false, _) => format!("  {shown}: {register} of {device}, {data_type}"),
        };
        let element = self.address.node().and_then(|node| node.element.as_ref()).map(ToString::to_string);
        line.extend(element.iter().map(|element| format!(", {element}")));
        let word_order = register::shown_order(&self.address, encoding);
        line.extend(word_order.iter().map(|order| format!(" {order}")));
        if is_number && (scale - 1.0).abs() > 0.0 {
            line += &format!(", times {scale}");
        } else if !is_number && data_type != "bool" {
            let unit = unit.to_string();
            let space = if unit.is_empty() { "" } else { " " };
            let each = register::one_of(&self.address);
            line += &format!(", {scale}{space}{unit} per {each}");
        }
        let scale_from = self.scale_from.as_deref().map(ShownScale::from);
        line.extend(scale_from.iter().map(|from| format!(", {from}")));
        if encoding.offset.abs() > 0.0 {
            line += &format!(", plus {}", encoding.offset);
        }
        let doubts = self.doubts();
        line += &format!("; rejected {}", doubts.join(", "));
        line.extend(channel.iter().map(|channel| format!("; {channel}")));
        let mut section = Section::default();
        section.line(line);
        let read_in = sensor.map(|sensor| {
            let sought = sensor.sought_in(&bus.address);
            format!("read in {sought}")
        });
        section.lines("    ", &read_in);
        entries!(section, read_in, name, label = &self.label, device);
        section.json("register", register);
        entries!(section, element, data_type, word_order, scale);
        section.json("scale_from", scale_from);
        entries!(section, offset = encoding.offset, unit = unit.0, doubts);
        entries!(section, capture = self.shown_capture(), channel);
        section
    }

    /// Formats the command that is written before each read: `holding:132 (40133) = 1`. `None` if the signal has none.
    pub(crate) fn shown_capture(&self) -> Option<String> {
        self.capture.map(|capture| format!("{} = {}", Notation::from(capture.address), capture.value))
    }

    fn doubts(&self) -> Vec<String> {
        let unit = self.unit;
        let mut doubts = Vec::new();
        if let Some(PcSensor::OneWire(_)) = self.address.sensor() {
            doubts.push("with a wrong checksum, or with all bits zero".to_owned());
        }
        if self.address.sensor().is_some_and(PcSensor::is_ds18b20) {
            doubts.push("at exactly 85 °C (power-on)".to_owned());
        }
        if self.address.text().is_some() {
            doubts.push("with any other text".to_owned());
        }
        let bad = self.encoding.bad.iter().map(|bad| match bad.means {
            Reason::Sentinel => bad.raw.to_string(),
            means => format!("{} ({means})", bad.raw),
        });
        let bad: Vec<String> = bad.collect();
        if !bad.is_empty() {
            doubts.push(format!("at raw {}", bad.join(" or ")));
        }
        doubts.extend(self.range.map(|(low, high)| format!("outside {low} to {high} {unit}")));
        doubts.extend(self.max_rate.map(|rate| format!("faster than {rate} {unit} per second")));
        doubts.extend(self.defaults.conditions(unit).into_iter().map(|limit| format!("{limit} (default)")));
        doubts.extend(self.counter.as_ref().map(|counter| {
            let speed = counter.max_speed;
            format!("after a step faster than {speed} {unit} per second until the next reading confirms it")
        }));
        if self.scale_from.is_some() {
            doubts.push("after a change of the scale until a reading is plausible again".to_owned());
        }
        doubts.push(format!("older than {}", shown(self.max_age)));
        doubts.extend(self.fault_when.as_ref().map(|condition| format!("when {}", condition.text)));
        doubts
    }
}

/// Keys that state where a signal is read. A signal has at most one of them.
pub(crate) const PLACES: [&str; 8] = ["register", "dbc", "sdo", "pdo", "frame", "node", "sensor", "text"];

/// Resolved address and encoding of a signal, with its default unit and the register of its scale.
pub(crate) struct Located {
    pub(crate) address: Address,
    pub(crate) encoding: Encoding,
    /// Unit that the signal has if the profile states no unit.
    pub(crate) unit: Option<Unit>,
    /// Register of the scale. `None` if the scale is fixed.
    pub(crate) scale_from: Option<ScaleFrom>,
}

impl Located {
    /// Creates the address and encoding of a value with a fixed scale.
    pub(crate) fn of(address: Address, encoding: Encoding, unit: Option<Unit>) -> Located {
        Located { address, encoding, unit, scale_from: None }
    }
}
