//! `[signal.*]`: one value that is read.

use std::time::Duration;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::bus::LineKind;
use super::can::{self, RawFrame, RawPdo, Sender};
use super::label::{self, labelled};
use super::register::{self, Flag, Notation, TypeWord, WordOrderWord, plain};
use super::{KeyContext, dbc, expression, opcua, sysfs};
use crate::dbc::Described;
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::schema_of::schema_of;
use crate::{DeviceId, Profile, ReadBy};
use bad::{BadValue, sentinels, sentinels_fit};
use counter::{Capture, RawCounter};
use isotherm_core::codec::{Address, Counter, DataType, Encoding, PcSensor};
use isotherm_core::compensation::model::Condition;
use isotherm_core::reading::Reason;
use unit::Unit;

mod bad;
pub(crate) mod counter;
pub(crate) mod unit;

/// Value that is read from a device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Signal", extend("x-layers" = "arrives"))]
pub(crate) struct RawSignal {
    /// Display name of the signal in any script, shown next to its name.
    #[schemars(extend("x-layers" = "free"))]
    label: Option<String>,
    /// Device from which the signal is read.
    #[schemars(required)]
    pub(super) device: Option<String>,
    /// Channel of the device's template, by number or name.
    #[allow(dead_code, reason = "resolved before the profile is checked")]
    channel: Option<ChannelValue>,
    /// Register as table and zero-based address ("input:0", "holding:84", "coil:1", "discrete:3"), or as one-based
    /// Modicon number ("30001"). "input:50.3" is bit 3 of a register.
    register: Option<String>,
    /// OPC UA: node, for example "ns=2;s=/Nck/State" or "ns=3;i=1005".
    node: Option<String>,
    /// Sensor of this computer: "w1:28-0316a2794f01", "hwmon:NAME/LABEL" or "iio:NAME/LABEL". If several chips have the
    /// same name: "hwmon:NAME@DEVICE/LABEL".
    sensor: Option<String>,
    /// Type of the value. Required for input and holding registers. For a node, its own type; by default any number is
    /// accepted.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Order of the registers. Required for 32 bits and more, because devices differ.
    word_order: Option<WordOrderWord>,
    /// Whether the two bytes of each register are exchanged. Default false.
    byte_swap: Option<bool>,
    /// Engineering units per count, not zero. Default 1.
    scale: Option<f64>,
    /// Engineering value of raw zero. Default 0.
    offset: Option<f64>,
    /// Raw values that mean "no measurement", compared before scaling: [-32768]. They may have a meaning: [{ raw =
    /// -512, means = "open circuit" }].
    bad: Option<Vec<BadValue>>,
    /// Engineering unit. Default: "bool" for a coil or a discrete input, otherwise "1".
    #[serde(default)]
    #[schemars(schema_with = "units")]
    unit: Option<String>,
    /// Smallest and largest plausible value, in the unit of the signal. Values outside of this range are bad.
    #[schemars(extend("x-layers" = "free"))]
    range: Option<[f64; 2]>,
    /// Largest plausible rate of change, units per second. A reading that changes faster is bad.
    #[schemars(extend("x-layers" = "free"))]
    max_rate: Option<f64>,
    /// Largest age of a reading. An older one is stale. Default: five polls, and at least three timeouts.
    #[schemars(extend("x-layers" = "free"))]
    max_age: Option<Timespan>,
    /// Condition on other signals under which this signal is bad, for example "bed_open == 1".
    #[schemars(extend("x-layers" = "free"))]
    fault_when: Option<String>,
    /// Whether a read request may include adjacent registers of other signals. Default true.
    #[schemars(extend("x-layers" = "free"))]
    merge: Option<bool>,
    /// Settings of a counting signal: rollover and new reference.
    counter: Option<RawCounter>,
    /// CAN: message and signal in the device's DBC file: "Message.Signal".
    dbc: Option<String>,
    /// CANopen process data, for example { cob_id = 0x185, start = 0, length = 16, signed = true }.
    pdo: Option<RawPdo>,
    /// CANopen object, polled with the period `every` of the device, for example "7130:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    sdo: Option<String>,
    /// CAN frame without a DBC file, for example { id = 0x100, start = 0, length = 16, order = "little", signed = true
    /// }.
    frame: Option<RawFrame>,
}

/// Channel of a template.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
#[allow(dead_code, reason = "resolved before the profile is checked")]
pub(super) enum ChannelValue {
    Number(u16),
    Name(String),
}

schema_of!(ChannelValue as "Channel": { "anyOf": [{ "type": "integer", "minimum": 0, "maximum": 65535 }, { "type": "string" }] });

fn units(_: &mut SchemaGenerator) -> Schema {
    schemars::json_schema!({ "type": "string", "enum": Unit::WORDS })
}

/// Signal of the profile, after all its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// Name in the profile.
    pub name: String,
    /// Display name. Empty if the profile has none.
    pub label: String,
    /// Device from which the signal is read.
    pub device: DeviceId,
    /// First register, bit, object, node, sensor, or place in frames.
    pub address: Address,
    /// Encoding of the value.
    pub encoding: Encoding,
    /// Engineering unit of the value.
    pub unit: Unit,
    /// Smallest and largest plausible value.
    pub range: Option<(f64, f64)>,
    /// Largest plausible change per second.
    pub max_rate: Option<f64>,
    /// Largest age of a reading. An older one is stale.
    pub max_age: Duration,
    /// Condition on other signals under which this signal is bad.
    pub fault_when: Option<Condition>,
    /// Whether a read request may include adjacent registers of other signals.
    pub merge: bool,
    /// Settings of a counting signal: rollover and new reference.
    pub counter: Option<Counter>,
    /// Command that is written before each read, to capture the count.
    pub capture: Option<Capture>,
}

impl Signal {
    /// Preview of the signal: address, encoding, and conditions under which it is bad.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let (encoding, unit) = (&self.encoding, self.unit);
        let (name, device) = (&self.name, profile.device(self.device));
        let register = Notation::of(&self.address, encoding.data_type);
        let (data_type, scale) = (encoding.data_type.name(), encoding.scale.get());
        let channel = device.channel(name);
        let device = &device.name;
        let shown = labelled(name, &self.label);
        let sensor = self.address.sensor();
        let mut line = match (register.is_in_frames(), sensor, self.address.node()) {
            (true, ..) => format!("  {shown}: {register}, from {device}"),
            (false, Some(_), _) => format!("  {shown}: {register} of {device}"),
            (false, None, Some(node)) if node.data_type.is_none() => {
                format!("  {shown}: {register} of {device}, the node's own type")
            }
            (false, None, _) => format!("  {shown}: {register} of {device}, {data_type}"),
        };
        let word_order = register::shown_order(&self.address, encoding);
        line.extend(word_order.iter().map(|order| format!(" {order}")));
        if sensor.is_some() && (scale - 1.0).abs() > 0.0 {
            line += &format!(", times {scale}");
        } else if sensor.is_none() && data_type != "bool" {
            let unit = unit.to_string();
            let space = if unit.is_empty() { "" } else { " " };
            let each = opcua::one_of(&self.address);
            line += &format!(", {scale}{space}{unit} per {each}");
        }
        if encoding.offset.abs() > 0.0 {
            line += &format!(", plus {}", encoding.offset);
        }
        let doubts = self.doubts();
        line += &format!("; rejected {}", doubts.join(", "));
        line.extend(channel.iter().map(|channel| format!("; {channel}")));
        let mut section = Section::default();
        section.line(line);
        let read_in = sensor.map(|sensor| {
            let sought = sensor.sought_in(&profile.bus(profile.device(self.device).bus).address);
            format!("read in {sought}")
        });
        section.lines("    ", &read_in);
        entries!(section, read_in, name, label = &self.label, device);
        section.json("register", register);
        entries!(section, data_type, word_order, scale, offset = encoding.offset, unit = unit.0, doubts);
        entries!(section, capture = self.shown_capture(), channel);
        section
    }

    /// Describes the command before each read: `holding:132 (40133) = 1`. `None` if there is no command.
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
        doubts.extend(self.counter.as_ref().map(|counter| {
            let speed = counter.max_speed;
            format!("after a step faster than {speed} {unit} per second until the next reading confirms it")
        }));
        doubts.push(format!("older than {}", shown(self.max_age)));
        doubts.extend(self.fault_when.as_ref().map(|condition| format!("when {}", condition.text)));
        doubts
    }
}

/// Address and encoding of a signal.
struct Located {
    address: Address,
    encoding: Encoding,
    /// Unit if the profile names none.
    unit: Option<Unit>,
}

impl RawSignal {
    pub(super) fn resolve(&self, at: &KeyContext<'_>, name: &str) -> Option<Signal> {
        let check = at.check;
        let index = at.key("device").named(&check.devices, self.device.as_ref());
        let device = index.and_then(|index| check.devices.get(index));
        let places = ["register", "dbc", "sdo", "pdo", "frame", "node", "sensor"];
        if places.into_iter().filter(|key| at.has(key)).count() > 1 {
            let help = "keep one of register, channel, dbc, pdo, sdo, frame, node, sensor";
            at.wrong_key("the signal is read from more than one place", help);
        }
        let kind = check.line_kind(self.device.as_ref());
        self.foreign_keys(at, kind);
        let max_age = self.max_age(at, index);
        let range = self.range.map(|[low, high]| {
            if low >= high {
                let message = format!("the range {low} to {high} is empty");
                at.key("range").invalid(message, "write the smaller value first, as [-10.0, 80.0]");
            }
            (low, high)
        });
        let max_rate = at.key("max_rate").positive(self.max_rate);
        let fault_when = expression::condition(&at.key("fault_when"), self.fault_when.as_ref(), Some(name));
        let (on_can, on_opcua) = (kind == Some(LineKind::Can), kind == Some(LineKind::OpcUa));
        let on_sysfs = kind == Some(LineKind::Sysfs);
        let on_can_somewhere = self.comes_by_itself() || self.sdo.is_some();
        // A channel without an address has been reported.
        let is_somewhere = self.register.is_some()
            || on_sysfs
            || on_can && on_can_somewhere
            || on_opcua && self.node.is_some();
        let is_elsewhere = on_can_somewhere || self.node.is_some() || self.sensor.is_some();
        if !is_somewhere && (at.key("channel").is_written() || (!on_can && !on_opcua && is_elsewhere)) {
            return None;
        }
        let Located { address, encoding, unit } = match kind {
            Some(LineKind::Can) => self.on_can(at)?,
            Some(LineKind::OpcUa) => self.in_a_node(at)?,
            Some(LineKind::Sysfs) => self.of_this_computer(at)?,
            Some(LineKind::Modbus) | None => self.in_registers(at, index)?,
        };
        let unit = match self.unit.as_deref() {
            Some(unit) => Unit::named(unit),
            None => unit.or(Some(Unit("1"))),
        };
        sentinels_fit(&at.key("bad"), &encoding);
        let every = device.map_or(Duration::ZERO, |device| device.every);
        // A value that arrives without a request must arrive twice before it is stale.
        let apart =
            max_age.filter(|_| on_can && self.comes_by_itself()).map_or(every, |age| every.min(age / 2));
        let (place, has_max_rate) = (at.key("counter"), self.max_rate.is_some());
        let counter = self.counter.as_ref();
        let counter = counter.map(|raw| raw.resolve(&place, &encoding, index, apart, has_max_rate));
        let (counter, capture) = counter.unwrap_or_default();
        Some(Signal {
            name: name.to_owned(),
            label: label::resolve(&at.key("label"), self.label.as_ref()),
            device: DeviceId(index?),
            address,
            encoding,
            unit: unit?,
            range,
            max_rate,
            max_age: max_age?,
            fault_when,
            merge: on_can || on_opcua || on_sysfs || self.merge.unwrap_or(true),
            counter,
            capture: capture.filter(|_| !on_can && !on_opcua && !on_sysfs),
        })
    }

    /// Reports keys that belong to another kind of line.
    fn foreign_keys(&self, at: &KeyContext<'_>, kind: Option<LineKind>) {
        let (Some(kind), Some(device)) = (kind, &self.device) else { return };
        if kind == LineKind::Sysfs {
            let help = format!(
                "`{device}` is for sensors of this computer: write sensor = \"w1:28-…\" or \
                 \"hwmon:NAME/LABEL\""
            );
            let owner = "a device on another kind of line";
            at.not_applicable(&["register", "node", "dbc", "pdo", "sdo", "frame", "channel"], owner, &help);
            let help = "remove this key: the kernel gives a temperature, and reports itself if there is none";
            let of_registers = ["type", "word_order", "byte_swap", "merge", "bad", "counter"];
            return at.not_applicable(&of_registers, owner, help);
        }
        let help = "remove this key, or put the device on a sysfs line";
        at.not_applicable(&["sensor"], "a sensor of this computer", help);
        if kind == LineKind::OpcUa {
            let help = format!("`{device}` is an OPC UA server: write node = \"ns=2;s=…\"");
            at.not_applicable(&["register", "word_order", "byte_swap", "merge"], "a Modbus device", &help);
            at.not_applicable(&["dbc", "pdo", "sdo", "frame"], "a device on a CAN line", &help);
            let help = "remove this key: a node needs no command before a read";
            at.key("counter").not_applicable(&["capture"], "a Modbus device", help);
            return;
        }
        at.not_applicable(&["node"], "an OPC UA server", "remove `node`, or put the device on an opcua line");
        if kind == LineKind::Modbus {
            let help = format!("`{device}` is on a Modbus line: write register = \"input:0\"");
            at.not_applicable(&["dbc", "pdo", "sdo", "frame"], "a device on a CAN line", &help);
            let help = "use \"u16\" or \"i16\", or one bit, as \"input:50.3\"";
            register::not_smaller_than_a_register(&at.key("type"), self.kind, help);
            return;
        }
        let help = format!(
            "`{device}` is on a CAN line: remove this key, and write dbc, pdo, sdo or frame for the place of \
             the value"
        );
        at.not_applicable(&["register", "word_order", "byte_swap", "merge"], "a Modbus device", &help);
        let help = "remove this key: a CAN device sends its count by itself";
        at.key("counter").not_applicable(&["capture"], "a Modbus device", help);
    }

    fn in_a_node(&self, at: &KeyContext<'_>) -> Option<Located> {
        let node = opcua::read(at, self.node.as_ref(), self.kind);
        let scale = register::scale(&at.key("scale"), self.scale.unwrap_or(1.0));
        let bad = sentinels(self.bad.as_ref(), &at.key("bad"));
        let (node, scale) = (node?, scale?);
        let data_type = node.taken_as();
        let offset = self.offset.unwrap_or(0.0);
        let encoding = Encoding { scale, offset, bad, ..plain(data_type) };
        let unit = (data_type == DataType::Bool).then_some(Unit("bool"));
        Some(Located { address: Address::Node(node), encoding, unit })
    }

    fn of_this_computer(&self, at: &KeyContext<'_>) -> Option<Located> {
        let sensor = sysfs::sensor(at, self.sensor.as_ref());
        sysfs::unit(&at.key("unit"), self.unit.as_deref());
        let scale = register::scale(&at.key("scale"), self.scale.unwrap_or(1.0))?;
        let encoding = Encoding { scale, offset: self.offset.unwrap_or(0.0), ..plain(DataType::F64) };
        Some(Located { address: Address::Sensor(sensor?), encoding, unit: Some(Unit("degC")) })
    }

    fn in_registers(&self, at: &KeyContext<'_>, device: Option<usize>) -> Option<Located> {
        let place = at.key("register");
        let help = "write a zero-based protocol address (\"input:0\") or a Modicon number (\"30001\")";
        place.missing("`register` is missing: where is the signal read?", help);
        let cell = self.register.as_ref().and_then(|text| register::cell(&place, text));
        // An error of the register must not hide other errors.
        let data_type = match cell {
            Some(cell) => self.type_in(&at.key("type"), cell),
            None => self.kind.map(|TypeWord(kind)| kind),
        };
        let word_order = register::word_order(&at.key("word_order"), data_type, self.word_order);
        let scale = register::scale(&at.key("scale"), self.scale.unwrap_or(1.0));
        let (Flag { address, .. }, data_type) = (cell?, data_type?);
        register::fits(&place, address, data_type);
        if let Some(device) = device.and_then(|device| at.check.devices.get(device)) {
            device.must_read(&place, address.table);
            // A value in two answers could consist of parts of different values.
            let most = device.quirks.max_registers_per_request;
            if data_type.registers() > most {
                let (name, registers) = (data_type.name(), data_type.registers());
                let message = format!("{name} needs {registers} registers, but one request reads {most}");
                let help = "raise `max_registers_per_request` in the quirks, or use a smaller type";
                at.key("type").invalid(message, help);
            }
        }
        let is_bit = matches!(data_type, DataType::Bool | DataType::Bit(_));
        let encoding = Encoding {
            word_order: word_order?,
            byte_swap: self.byte_swap.unwrap_or(false),
            scale: scale?,
            offset: self.offset.unwrap_or(0.0),
            bad: sentinels(self.bad.as_ref(), &at.key("bad")),
            ..plain(data_type)
        };
        Some(Located { address: address.into(), encoding, unit: is_bit.then_some(Unit("bool")) })
    }

    /// Resolves the type of a register or a bit.
    fn type_in(&self, at: &KeyContext<'_>, cell: Flag) -> Option<DataType> {
        let kind = self.kind.map(|TypeWord(kind)| kind);
        let is_bits = cell.address.table.is_bits();
        if is_bits || cell.bit.is_some() {
            if let Some(wrong) = kind.filter(|kind| *kind != DataType::Bool) {
                let message = format!("{} is not possible for one bit", wrong.name());
                if is_bits {
                    return at.reject(message, "a coil and a discrete input are \"bool\": leave `type` out");
                }
                at.invalid(message, "one bit is \"bool\": leave `type` out");
            }
            return Some(cell.bit.map_or(DataType::Bool, DataType::Bit));
        }
        let help = "allowed: bool, u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
        at.missing("`type` is missing: which type does the value have in its registers?", help);
        kind
    }

    fn on_can(&self, at: &KeyContext<'_>) -> Option<Located> {
        let device = self.device.as_deref()?;
        let own = (self.scale.unwrap_or(1.0), self.offset.unwrap_or(0.0));
        let (address, (scale, offset), unit) = if let Some(name) = &self.dbc {
            self.no_type(at, "remove this key: the DBC file defines the bits and their type");
            let found = dbc::described(&at.key("dbc"), name, device)?;
            let scale = self.scale_over(at, &found)?;
            self.agrees_with_unit(at, found.unit);
            (Address::Frame(found.field), scale, found.unit)
        } else if let Some(pdo) = &self.pdo {
            self.no_type(at, OF_BITS);
            let field = pdo.resolve(&at.key("pdo"), device, Sender::Device)?;
            no_fill(&at.key("pdo").key("fill"), pdo.fill.is_some());
            (Address::Frame(field), own, None)
        } else if let Some(sdo) = &self.sdo {
            let types = "allowed: bool, u8, i8, u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
            (can::object(at, sdo, self.kind, device, types)?, own, None)
        } else if let Some(frame) = &self.frame {
            self.no_type(at, OF_BITS);
            no_fill(&at.key("frame").key("fill"), frame.fill.is_some());
            (Address::Frame(frame.resolve(&at.key("frame"))?), own, None)
        } else {
            let is_wrong = ["dbc", "pdo", "sdo", "frame"].into_iter().any(|key| at.key(key).is_written());
            if self.register.is_none() && !is_wrong {
                let help = "write dbc = \"Message.Signal\", pdo = { … }, sdo = \"7130:01\" or frame = { … }";
                at.wrong_key("the place from which the signal is read is missing", help);
            }
            return None;
        };
        let data_type = register::type_at(&address);
        let unit = unit.or((data_type == DataType::Bool && self.dbc.is_none()).then_some(Unit("bool")));
        let bad = sentinels(self.bad.as_ref(), &at.key("bad"));
        let scale = register::scale(&at.key("scale"), scale)?;
        Some(Located { address, encoding: Encoding { scale, offset, bad, ..plain(data_type) }, unit })
    }

    fn no_type(&self, at: &KeyContext<'_>, help: &str) {
        if self.kind.is_some() {
            at.key("type").wrong_key("on a CAN line, `type` is allowed only with `sdo`", help);
        }
    }

    /// Resolves scale and offset of a signal in a DBC file. The profile must replace both, because only one of them
    /// would give wrong values.
    fn scale_over(&self, at: &KeyContext<'_>, found: &Described) -> Option<(f64, f64)> {
        let (missing, there, is_plain) = match (self.scale, self.offset) {
            (None, None) => return Some((found.scale, found.offset)),
            (Some(scale), Some(offset)) => return Some((scale, offset)),
            (None, Some(_)) => ("scale", "offset", (found.scale - 1.0).abs() == 0.0),
            (Some(_), None) => ("offset", "scale", found.offset.abs() == 0.0),
        };
        if is_plain {
            return Some((self.scale.unwrap_or(1.0), self.offset.unwrap_or(0.0)));
        }
        let message = format!(
            "the DBC file has scale {} and offset {}; `scale` and `offset` can only be replaced together",
            found.scale, found.offset
        );
        at.key(there).reject(message, format!("write `{missing}` as well, or remove both"))
    }

    fn agrees_with_unit(&self, at: &KeyContext<'_>, of_file: Option<Unit>) {
        let own = self.unit.as_deref().and_then(Unit::named);
        let Some((own, of_file)) = own.zip(of_file).filter(|(own, of_file)| own != of_file) else { return };
        if self.scale.is_none() {
            let help = format!(
                "write unit = \"{}\", or the `scale` and `offset` that convert the raw count to \"{}\"",
                of_file.0, own.0
            );
            at.key("unit").invalid(format!("the DBC file has this signal in \"{}\"", of_file.0), help);
        }
    }

    /// Returns whether the value arrives without a request, so that no poll period limits its age.
    fn comes_by_itself(&self) -> bool {
        self.dbc.is_some() || self.pdo.is_some() || self.frame.is_some()
    }

    fn max_age(&self, at: &KeyContext<'_>, device: Option<usize>) -> Option<Duration> {
        let at = at.key("max_age");
        let given = at.duration(self.max_age);
        let device = at.check.devices.get(device?)?;
        let every = device.every;
        let Some(age) = given else {
            let timeout = at.check.bus_of(device).map_or(Duration::ZERO, |bus| bus.timeout);
            return Some((5 * every).max(3 * timeout));
        };
        if self.comes_by_itself() {
            return Some(age);
        }
        let figures =
            format!("`max_age` is {}, `{}` is read every {}", shown(age), device.name, shown(every));
        if device.read == ReadBy::Subscription && age < SENT_WITHIN * every {
            let help = format!(
                "write max_age = \"{}\", or write read = \"poll\" at the device",
                shown((SENT_WITHIN + 1) * every)
            );
            let message = format!("{figures}: a value from a subscription may be {SENT_WITHIN} periods old");
            return at.reject(message, help);
        }
        let help = format!("allow at least two polls: write max_age = \"{}\"", shown(2 * every));
        if age <= every {
            at.invalid(format!("{figures}: the signal would always become stale"), help);
        } else if age < 2 * every {
            at.warn(format!("{figures}: one late answer makes the signal stale"), help);
        }
        Some(age)
    }
}

/// Largest age of a value from a subscription, in poll periods. A value needs up to one period each to be sampled,
/// sent, requested and used.
const SENT_WITHIN: u32 = 4;

/// Hint for `type` of a value in frames.
const OF_BITS: &str = "remove this key: `length`, `signed` and `float` define the type";

fn no_fill(at: &KeyContext<'_>, is_there: bool) {
    if is_there {
        let help = "remove this key: `fill` is only for an output";
        at.wrong_key("a frame that is read is filled by its sender", help);
    }
}
