//! `[bus.*]`: one bus line through which the gateway reaches devices. Examples are a serial port, a TCP connection, a
//! CAN interface, an OPC UA server, and the sensors of this computer.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::kinds::modbus::quirks::{Quirks, RawQuirks};
use crate::kinds::modbus::serial::Parity;
use crate::kinds::opcua::connection::{OpcUa, RawUser, Security};
use isotherm_core::codec::CanId;
use tls::{RawTls, Tls};
use transport::{BusType, Transport};

pub(super) mod periods;
pub(super) mod resolve;
pub(crate) mod tls;
pub(crate) mod transport;

/// Message if `pipeline = 2` is combined with quirks that do not allow two requests at the same time.
pub(crate) const APART: &str =
    "two requests at a time are not possible with `pause_between_requests` or `close_after_each`";
/// Bus: one physical line to which devices are connected.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Bus")]
pub(crate) struct RawBus {
    /// Type of the bus line: its protocol and transport.
    #[serde(rename = "type")]
    #[schemars(required)]
    pub(crate) kind: Option<BusType>,
    /// Address of the line. TCP lines: host and port, for example "192.168.0.10:502". With `tls` the default port is
    /// 802. OPC UA lines: URL of the server, for example "opc.tcp://192.168.214.241:4840". Sysfs lines: directory of
    /// the kernel's sensors, default "/sys". Lines of the types serial-ascii and modbus-ascii have host
    /// and port of a serial server, or `port`.
    pub(crate) address: Option<String>,
    /// Timeout of an answer. Default "500ms", or half the shortest period of reads and writes on the line if that is
    /// less. Default on a sysfs line "2s", on a serial-ascii line "1s".
    pub(crate) timeout: Option<Timespan>,
    /// Time during which a write without an answer may still arrive at the device, from `timeout` to "10min". Default
    /// "30s"; on a serial port twice `timeout`, because no network delays the write.
    pub(crate) late: Option<Timespan>,
    /// Certificate files of a modbus-tcp line with Modbus/TCP Security.
    pub(crate) tls: Option<RawTls>,
    /// Largest number of requests that wait for an answer at the same time on a modbus-tcp line, 1 or 2. Default 1.
    /// With 2, a corrected position (position plus Cz) is written together with the request for the next position.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) pipeline: Option<u8>,
    /// Quirks: special requirements of all devices on the line.
    pub(crate) quirks: Option<RawQuirks>,
    /// Serial port of a modbus-rtu, modbus-ascii or serial-ascii line, for example "/dev/serial/by-id/usb-…".
    pub(crate) port: Option<String>,
    /// Baud rate of a serial port, in bits per second. Required with `port`.
    #[schemars(range(min = 300, max = 4_000_000))]
    pub(crate) baud: Option<u32>,
    /// Parity of a serial port. Default "none"; on a modbus-ascii line "even".
    pub(crate) parity: Option<Parity>,
    /// Stop bits of a serial port, 1 or 2. Default 1.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) stop_bits: Option<u8>,
    /// Data bits of the serial port of a serial-ascii or modbus-ascii line, 7 or 8. Default 8; on a modbus-ascii line
    /// 7. A modbus-rtu line always has 8.
    #[schemars(range(min = 7, max = 8))]
    pub(crate) data_bits: Option<u8>,
    /// Network interface of a CAN line, for example "can0".
    pub(crate) interface: Option<String>,
    /// SYNC message that the gateway sends on a CAN line. Default: none.
    #[schemars(extend("x-layers" = "arrives"))]
    pub(crate) sync: Option<RawSync>,
    /// Protection of the messages on an opcua line. The strongest security policy that both ends support is used.
    /// Required on such a line.
    pub(crate) security: Option<Security>,
    /// User of the gateway on an opcua line: { name = "isotherm", password_file = "opcua.password" }, or { cert =
    /// "user.der", key = "user.pem" }. Default: anonymous.
    pub(crate) user: Option<RawUser>,
    /// Certificate of the gateway for a secured opcua line, in DER or PEM form.
    pub(crate) cert: Option<String>,
    /// Private key of `cert`, in PEM form.
    pub(crate) key: Option<String>,
    /// Directory with the certificates of the servers that a secured opcua line trusts.
    pub(crate) trusted: Option<String>,
}

/// SYNC message for all nodes of a line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sync")]
pub(crate) struct RawSync {
    /// CAN identifier of SYNC. Default 0x80.
    #[schemars(range(min = 1, max = 2047))]
    pub(crate) cob_id: Option<u32>,
    /// Period of SYNC.
    #[schemars(required)]
    pub(crate) every: Option<Timespan>,
}

/// Type of a bus line: its name in the profile, its keys, and whether buses may share the physical line.
pub(crate) struct LineType {
    /// Value of the key `type` for this type of line.
    pub(crate) word: BusType,
    /// Name of this type of line in the preview.
    pub(crate) title: &'static str,
    /// Keys of the table `OWNERS` (in `bus/resolve.rs`) that lines of this type may have.
    pub(crate) keys: &'static [&'static str],
    /// Key whose value identifies the physical line, for example `port`. Two buses must not have the same value,
    /// because they would receive each other's answers. `None` if several buses can use the same physical line.
    pub(crate) exclusive: Option<&'static str>,
    /// Assumed time from a request until the device begins its answer, including the network.
    pub(crate) answer: Duration,
}

impl LineType {
    /// Assumed answer time of a device if the line has no slow part, such as a serial server.
    pub(crate) const ANSWER: Duration = Duration::from_millis(10);
}

/// Settings that only some types of lines have.
#[derive(Default)]
pub(crate) struct LineSettings {
    pub(crate) tls: Option<Tls>,
    pub(crate) opcua: Option<OpcUa>,
    pub(crate) sync: Option<Sync>,
}

/// Bus of the profile (one physical line), after all its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Bus {
    /// Name of the bus: `cell` for the table `[bus.cell]`.
    pub name: String,
    /// Transport of the line.
    pub transport: Transport,
    /// Host and port, serial port, CAN interface, URL of the server, or directory of the kernel's sensors, as written.
    pub address: String,
    /// TLS settings (Modbus/TCP Security). `None` if the line is not encrypted.
    pub tls: Option<Box<Tls>>,
    /// Settings of an OPC UA connection. `None` on every other line.
    pub opcua: Option<Box<OpcUa>>,
    /// Timeout for an answer and for connecting.
    pub timeout: Duration,
    /// Time during which a write without an answer may still arrive at the device. Never less than `timeout`.
    pub late: Duration,
    /// Largest number of requests that wait for an answer at the same time, 1 or 2.
    pub pipeline: u8,
    /// Quirks: special requirements of the devices on the line.
    pub quirks: Quirks,
    /// SYNC message that the gateway sends on a CAN line. `None` if it sends none.
    pub sync: Option<Sync>,
}

/// CANopen SYNC message that the gateway sends periodically on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// CAN identifier of the SYNC message.
    pub id: CanId,
    /// Period at which SYNC is sent.
    pub every: Duration,
}

impl Bus {
    /// Returns the preview of the line: its kind and address, its serial port or CAN interface, the devices
    /// behind a Modbus gateway, and its load.
    pub(crate) fn preview(
        &self,
        (title, reads_only): (&str, Option<&str>),
        mut sections: Vec<(&'static str, Section)>,
        load: Option<Section>,
    ) -> Section {
        let kind = if self.tls.is_some() { "Modbus TCP inside TLS (Modbus/TCP Security)" } else { title };
        let (name, address, timeout, late) =
            (&self.name, &self.address, shown(self.timeout), shown(self.late));
        let late_writes = || format!("a write without an answer may still arrive up to {late} later");
        let mut section = Section::default();
        section.line("");
        section.line(format!("bus {name}: {kind} at {address}, timeout {timeout}"));
        section.line(format!("  {}", reads_only.map_or_else(late_writes, str::to_owned)));
        entries!(section, name, kind, address);
        section.part("tls", self.tls.as_deref().map(Tls::preview));
        section.part("opcua", self.opcua.as_deref().map(OpcUa::preview));
        entries!(section, timeout, late);
        if self.pipeline > 1 {
            section.line("  two requests at a time, when a corrected position is written");
            section.entry("pipeline", self.pipeline);
        }
        for key in ["serial", "can", "gateway"] {
            let own = sections.iter().position(|(known, _)| *known == key);
            section.part(key, own.map(|place| sections.remove(place).1));
        }
        for (key, own) in sections {
            section.part(key, Some(own));
        }
        section.part("load", load);
        section
    }
}
