//! Sensors of this computer, which the Linux kernel reads: their names, unit and timing.

use std::time::Duration;

use crate::duration::shown;
use crate::plan::{Field, ReadRequest, ReadTarget, numbered};
use crate::tables::bus::LineType;
use crate::tables::bus::transport::{BusType, Transport};
use crate::tables::bus_kind::{BusKind, SignalKeys, SignalsOf};
use crate::tables::device::{Device, DeviceParts};
use crate::tables::register::{self, plain};
use crate::tables::signal::unit::Unit;
use crate::tables::signal::{Located, RawSignal};
use crate::tables::{Check, KeyContext};
use isotherm_core::codec::{Address, DataType, Encoding, PcSensor};

/// Default directory in which the Linux kernel shows its sensors.
const ROOT: &str = "/sys";
/// Default timeout for reading all sensors of a device. A 1-Wire sensor needs almost a second.
const TIMEOUT: Duration = Duration::from_secs(2);
/// Time for reading a 1-Wire sensor. The sensor measures for 750 ms at 12 bits (DS18B20). A request comes before the
/// measurement, and a read after it.
const ONE_WIRE: Duration = Duration::from_secs(1);
/// Keys that a signal on a sysfs bus cannot have: addresses on other kinds of buses, then keys for values in registers.
static FOREIGN: [&str; 13] = [
    "register",
    "node",
    "dbc",
    "pdo",
    "sdo",
    "frame",
    "channel",
    "type",
    "word_order",
    "byte_swap",
    "merge",
    "bad",
    "counter",
];

/// Kind of bus for sensors of this computer.
pub(super) static KIND: BusKind = BusKind {
    types: &[LineType {
        word: BusType::Sysfs,
        title: "sensors of this computer",
        keys: &["address"],
        exclusive: None,
        answer: LineType::ANSWER,
    }],
    line: |raw, at, _| Some((Transport::Sysfs, root(at, raw.address.as_ref()))),
    timeout: Some(TIMEOUT),
    only_read: Some("sensors of this computer are only read: nothing is written to a sysfs line"),
    has_load: false,
    device: |_, _, _, _| DeviceParts { unit: Some(0), is_pc: true, ..DeviceParts::default() },
    foreign_device_keys: &[
        (
            &["unit", "functions", "quirks", "template"],
            "a Modbus device",
            "remove this key: the key `sensor` of each signal selects a sensor",
        ),
        (
            &["verify"],
            "a device with settings that can change",
            "remove this key: the key `sensor` of each signal selects a sensor",
        ),
    ],
    signal_keys: SignalKeys {
        keys: &["sensor"],
        owner: "a sensor of this computer",
        help: Some("remove this key, or put the device on a sysfs line"),
    },
    signal_help,
    check_signal: |_, at, device| {
        let owner = "a device on another kind of line";
        let (places, of_registers) = FOREIGN.split_at(7);
        at.not_applicable(places, owner, &signal_help(device));
        let help = "remove this key: the kernel returns a temperature, or an error if there is none";
        at.not_applicable(of_registers, owner, help);
        &FOREIGN
    },
    signal,
    check: too_quick,
    requests,
    line_preview: Some(
        "only read; all sensors of a device at the same time; a sensor that does not answer is read again \
         when its kernel driver responds",
    ),
    can_be_identified: |_| false,
    ..BusKind::POLLED
};

fn signal_help(device: &str) -> String {
    format!("`{device}` is for sensors of this computer: write sensor = \"w1:28-…\" or \"hwmon:NAME/LABEL\"")
}

fn signal(_: &Check<'_>, raw: &RawSignal, at: &KeyContext<'_>, _: Option<&Device>) -> Option<Located> {
    let sensor = sensor(at, raw.sensor.as_ref());
    unit(&at.key("unit"), raw.unit.as_deref());
    let scale = register::scale(&at.key("scale"), raw.scale.unwrap_or(1.0))?;
    let encoding = Encoding { scale, offset: raw.offset.unwrap_or(0.0), ..plain(DataType::F64) };
    Some(Located::of(Address::Sensor(sensor?), encoding, Some(Unit("degC"))))
}

/// Plans one request for all sensors, which are read at the same time.
fn requests(_: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let sensors = signals.iter().filter_map(|(id, signal)| {
        let field = Field::value(*id, signal.encoding.data_type.registers());
        Some((field, signal.address.sensor()?.clone()))
    });
    let (fields, sensors) = numbered(sensors.collect());
    let asks = ReadTarget::Sensors(sensors);
    (!fields.is_empty()).then_some(ReadRequest { asks, fields }).into_iter().collect()
}

/// Checks the directory of a sysfs line. Returns `None` if it has an error.
fn root(at: &KeyContext<'_>, address: Option<&String>) -> Option<String> {
    let Some(address) = address else { return Some(ROOT.to_owned()) };
    if !address.starts_with('/') {
        let help = "remove this key (default \"/sys\"); in a container, write the directory where the \
                    host's /sys is mounted: \"/host/sys\"";
        return at
            .key("address")
            .reject(format!("`{address}` is not the absolute path of a directory"), help);
    }
    if let Some(inside) = ["/class", "/bus/"].iter().find_map(|inside| address.find(inside)) {
        let above = &address[..inside];
        let help = format!(
            "write the directory above: \"{above}\"; the key `sensor` of a signal selects the sensor"
        );
        let message = format!("`{address}` is a directory inside the kernel's directory");
        return at.key("address").reject(message, help);
    }
    Some(address.clone())
}

/// Parses the sensor of a signal at the key `sensor`. Returns `None` if it is missing or has an error.
fn sensor(signal: &KeyContext<'_>, text: Option<&String>) -> Option<PcSensor> {
    let at = signal.key("sensor");
    let Some(text) = text else {
        let is_elsewhere =
            ["register", "node", "dbc", "pdo", "sdo", "frame"].iter().any(|key| signal.has(key));
        if !is_elsewhere {
            let help = "write \"w1:28-0316a2794f01\", \"hwmon:NAME/LABEL\" or \"iio:NAME/LABEL\"; `isotherm \
                        scan --bus /sys` lists \
                        what this computer has";
            at.missing("`sensor` is missing: which sensor is read?", help);
        }
        return None;
    };
    let report = |why: String| {
        let (message, help) =
            why.split_once("; ").unwrap_or((&why, "write the name as `isotherm scan` shows it"));
        at.invalid(message, format!("{help}; `isotherm scan --bus /sys` lists what this computer has"));
    };
    text.parse().map_err(report).ok()
}

/// Checks that the unit of a sensor is °C, in which the gateway reads all sensors of the kernel.
fn unit(at: &KeyContext<'_>, unit: Option<&str>) {
    if let Some(unit) = unit.filter(|unit| *unit != "degC") {
        at.invalid(format!("a sensor of this computer is read in °C, not in \"{unit}\""), "leave `unit` out");
    }
}

/// Warns about 1-Wire sensors whose timeout or period is too short for a measurement.
fn too_quick(check: &Check<'_>) {
    for signal in check.signals.valid() {
        let Some(PcSensor::OneWire(id)) = signal.address.sensor() else { continue };
        let Some(device) = check.devices.get(signal.device.0) else { continue };
        let Some(bus) = check.bus_of(device).filter(|bus| bus.transport == Transport::Sysfs) else {
            continue;
        };
        let takes = format!("{id} measures for up to 750 ms (12 bits)");
        let at = check.at("bus").key(&bus.name).key("timeout");
        if bus.timeout < ONE_WIRE && at.is_written() {
            let message = format!("{takes}, but `timeout` is {}", shown(bus.timeout));
            at.warn(message, "write timeout = \"2s\", or remove this key");
        } else if device.every < ONE_WIRE {
            let message = format!("{takes}, but is read every {}", shown(device.every));
            let help = "write every = \"1s\" or longer at this device. Give faster sensors another device \
                        in the \
                        profile";
            check.at("device").key(&device.name).key("every").warn(message, help);
        } else {
            continue;
        }
        return;
    }
}
