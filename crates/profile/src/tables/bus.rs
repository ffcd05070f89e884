//! `[bus.*]`: one physical line.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::quirks::{self, Quirks, RawQuirks};
use super::{Check, KeyContext, optional, sysfs};
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::host_port::host_and_port;
use isotherm_core::codec::CanId;
use opcua::{OpcUa, RawUser, Security};
use periods::{Due, TIMEOUT};
use serial::{Parity, Serial};
use tls::{RawTls, TLS_PORT, Tls};

pub(crate) mod opcua;
pub(super) mod periods;
pub(crate) mod serial;
pub(crate) mod tls;

/// Longest time for which a network and its devices are assumed to delay a write.
const LATE: Duration = Duration::from_secs(30);
const LATE_TIMEOUTS: u32 = 2;
const LONGEST_LATE: Duration = Duration::from_mins(10);
/// Longest name of a network interface on Linux.
const LONGEST_NAME: usize = 15;
/// Reason why `pipeline = 2` is not possible with some quirks.
pub(super) const APART: &str =
    "two requests at a time are not possible with `pause_between_requests` or `close_after_each`";
/// Default port of Modbus TCP.
const USUAL: u16 = 502;
/// Example of host and port.
const EXAMPLE: &str = "192.168.0.10:502";
/// Default identifier of SYNC.
const SYNC: u32 = 0x80;

/// One physical line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Bus")]
pub(crate) struct RawBus {
    /// Type of the line.
    #[serde(rename = "type")]
    #[schemars(required)]
    pub(super) kind: Option<BusType>,
    /// Address of the line. TCP lines: host and port, for example "192.168.0.10:502". With `tls` the default port is
    /// 802. OPC UA lines: URL of the server, for example "opc.tcp://192.168.214.241:4840". Sysfs lines: directory of
    /// the kernel's sensors, default "/sys".
    address: Option<String>,
    /// Timeout of an answer. Default "500ms", or half the shortest period of reads and writes on the line if that is
    /// less; "2s" on a sysfs line.
    pub(super) timeout: Option<Timespan>,
    /// Time during which a write without an answer may still arrive, from `timeout` to "10min". Default "30s"; on a
    /// modbus-rtu line twice `timeout`, because no network delays the write.
    late: Option<Timespan>,
    /// Certificate files of a modbus-tcp line with Modbus/TCP Security.
    tls: Option<RawTls>,
    /// Largest number of requests that wait for an answer at the same time on a modbus-tcp line, 1 or 2. Default 1.
    /// With 2, a corrected position is written together with the request for the next position.
    #[schemars(range(min = 1, max = 2))]
    pipeline: Option<u8>,
    /// Quirks: special requirements of all devices on the line.
    quirks: Option<RawQuirks>,
    /// Serial port of a modbus-rtu line, for example "/dev/serial/by-id/usb-…".
    port: Option<String>,
    /// Baud rate of a modbus-rtu line, in bits per second. Required on such a line.
    #[schemars(range(min = 300, max = 4_000_000))]
    baud: Option<u32>,
    /// Parity of a modbus-rtu line. Default "none".
    parity: Option<Parity>,
    /// Stop bits of a modbus-rtu line, 1 or 2. Default 1.
    #[schemars(range(min = 1, max = 2))]
    stop_bits: Option<u8>,
    /// Network interface of a CAN line, for example "can0".
    interface: Option<String>,
    /// SYNC that the gateway sends on a CAN line. Default: none.
    #[schemars(extend("x-layers" = "arrives"))]
    sync: Option<RawSync>,
    /// Protection of the messages on an opcua line. The strongest security policy that both ends support is used.
    /// Required on such a line.
    security: Option<Security>,
    /// User of the gateway on an opcua line: { name = "isotherm", password_file = "opcua.password" }, or { cert =
    /// "user.der", key = "user.pem" }. Default: anonymous.
    user: Option<RawUser>,
    /// Certificate of the gateway for a secured opcua line, in DER or PEM form.
    cert: Option<String>,
    /// Private key of `cert`, in PEM form.
    key: Option<String>,
    /// Directory with the certificates of the servers that a secured opcua line trusts.
    trusted: Option<String>,
}

/// SYNC message for all nodes of a line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Sync")]
struct RawSync {
    /// CAN identifier of SYNC. Default 0x80.
    #[schemars(range(min = 1, max = 2047))]
    cob_id: Option<u32>,
    /// Period of SYNC.
    #[schemars(required)]
    every: Option<Timespan>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BusType {
    ModbusTcp,
    ModbusRtu,
    ModbusRtuOverTcp,
    Can,
    #[serde(rename = "opcua")]
    OpcUa,
    Sysfs,
}

/// Protocol family of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineKind {
    /// Modbus: registers, coils and discrete inputs.
    Modbus,
    /// CAN: frames and CANopen objects.
    Can,
    /// OPC UA: nodes of a server.
    OpcUa,
    /// Sensors that the kernel of this computer reads.
    Sysfs,
}

impl BusType {
    /// Protocol family of this type of line.
    pub(super) const fn kind(self) -> LineKind {
        match self {
            BusType::Can => LineKind::Can,
            BusType::OpcUa => LineKind::OpcUa,
            BusType::Sysfs => LineKind::Sysfs,
            BusType::ModbusTcp | BusType::ModbusRtu | BusType::ModbusRtuOverTcp => LineKind::Modbus,
        }
    }
}

/// Line of the profile, after all its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Bus {
    /// Name in the profile.
    pub name: String,
    /// Transport of the line.
    pub transport: Transport,
    /// Host and port, serial port, CAN interface, URL of the server, or directory of the kernel's sensors, as written.
    pub address: String,
    /// Modbus/TCP Security. `None` without encryption.
    pub tls: Option<Tls>,
    /// Settings of an OPC UA connection. `None` on every other line.
    pub opcua: Option<OpcUa>,
    /// Timeout of an answer and of a connection.
    pub timeout: Duration,
    /// Time during which a write without an answer may still arrive. Never less than `timeout`.
    pub late: Duration,
    /// Largest number of requests that wait for an answer at the same time, 1 or 2.
    pub pipeline: u8,
    /// Quirks: special requirements of the devices on the line.
    pub quirks: Quirks,
    /// SYNC that the gateway sends on a CAN line.
    pub sync: Option<Sync>,
}

/// Transport of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Modbus TCP.
    Tcp,
    /// RTU frames over a TCP connection, as simple Modbus gateways forward them.
    RtuOverTcp,
    /// Modbus RTU on a serial port of this computer.
    Serial(Serial),
    /// A CAN interface of this computer.
    Can,
    /// An OPC UA server.
    OpcUa,
    /// Sensors of this computer, from its kernel.
    Sysfs,
}

/// SYNC that the gateway sends on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// CAN identifier of the SYNC message.
    pub id: CanId,
    /// Period at which SYNC is sent.
    pub every: Duration,
}

impl Transport {
    /// Returns whether the transport is a CAN interface.
    pub const fn is_can(self) -> bool {
        matches!(self, Transport::Can)
    }

    /// Default time during which a write without an answer may still arrive. On a local serial port only the device can
    /// delay a write.
    pub fn late(self, timeout: Duration) -> Duration {
        match self {
            Transport::Serial(_) => timeout.saturating_mul(LATE_TIMEOUTS),
            // Nothing is written to a sysfs line.
            Transport::Sysfs => timeout,
            Transport::Tcp | Transport::RtuOverTcp | Transport::Can | Transport::OpcUa => LATE.max(timeout),
        }
    }
}

impl Bus {
    /// Preview of the line: its kind, its serial port or CAN interface, a Modbus gateway on it, and its load.
    pub(crate) fn preview(
        &self,
        (serial, can): (Option<Section>, Option<Section>),
        gateway: Option<Section>,
        load: Option<Section>,
    ) -> Section {
        let kind = match self.transport {
            Transport::Tcp if self.tls.is_some() => "Modbus TCP inside TLS (Modbus/TCP Security)",
            Transport::Tcp => "Modbus TCP",
            Transport::RtuOverTcp => "RTU over TCP",
            Transport::Can => "CAN",
            Transport::OpcUa => "OPC UA",
            Transport::Sysfs => "sensors of this computer",
            Transport::Serial(_) => "Modbus RTU",
        };
        let (name, address, timeout, late) =
            (&self.name, &self.address, shown(self.timeout), shown(self.late));
        let mut section = Section::default();
        section.line("");
        section.line(format!("bus {name}: {kind} at {address}, timeout {timeout}"));
        section.line(match self.transport {
            Transport::Sysfs => {
                "  only read; all sensors of a device at the same time; a sensor that does not answer is \
                 read again when the driver has returned"
                    .to_owned()
            }
            _ => format!("  a write that is not answered may still arrive for {late}"),
        });
        entries!(section, name, kind, address);
        section.part("tls", self.tls.as_ref().map(Tls::preview));
        section.part("opcua", self.opcua.as_ref().map(OpcUa::preview));
        entries!(section, timeout, late);
        if self.pipeline > 1 {
            section.line("  two requests at a time, when a corrected position is written");
            section.entry("pipeline", self.pipeline);
        }
        section.part("serial", serial);
        section.part("can", can);
        section.part("gateway", gateway);
        section.part("load", load);
        section
    }
}

impl RawBus {
    pub(super) fn resolve(&self, at: &KeyContext<'_>, name: &str) -> Option<Bus> {
        let quirks =
            self.quirks.as_ref().map_or_else(Quirks::default, |quirks| quirks.over(Quirks::default()));
        let timeout = at.key("timeout").duration(self.timeout);
        let timeout = timeout.unwrap_or_else(|| match self.kind {
            Some(BusType::Sysfs) => sysfs::TIMEOUT,
            _ => at.check.periods.timeout(name),
        });
        let Some(kind) = self.kind else {
            // The type has an error. The other keys are checked nevertheless.
            self.address.as_ref().filter(|_| !self.is_at_a_server()).and_then(|_| self.host_and_port(at));
            self.interface.as_ref().and_then(|_| self.interface(at));
            self.late(&at.key("late"), timeout, LATE.max(timeout));
            return None;
        };
        foreign_keys(at, kind);
        let (transport, address) = match kind {
            BusType::ModbusTcp => (Transport::Tcp, self.host_and_port(at)),
            BusType::ModbusRtuOverTcp => (Transport::RtuOverTcp, self.host_and_port(at)),
            BusType::ModbusRtu => {
                let (settings, port) = (serial::settings(self, at), serial::port(self, at));
                (Transport::Serial(settings?), port)
            }
            BusType::Can => (Transport::Can, self.interface(at)),
            BusType::OpcUa => (Transport::OpcUa, opcua::address(self, at)),
            BusType::Sysfs => (Transport::Sysfs, sysfs::root(at, self.address.as_ref())),
        };
        let late = self.late(&at.key("late"), timeout, transport.late(timeout));
        let tls = optional(self.tls.as_ref().filter(|_| kind == BusType::ModbusTcp), |tls| {
            // The files are checked even if the address is wrong.
            let host = address.as_deref().and_then(|address| host_and_port(address).ok());
            let host = host.map_or("localhost", |(host, _)| host);
            tls.resolve(&at.key("tls"), host)
        })?;
        let opcua = if kind == BusType::OpcUa { Some(opcua::resolve(self, at)?) } else { None };
        let pipeline = self.pipeline(&at.key("pipeline"), quirks);
        let sync = self.sync.as_ref().filter(|_| kind == BusType::Can).and_then(|sync| {
            let every = at.key("sync").key("every").period(sync.every);
            Some(Sync { id: CanId::standard(sync.cob_id.unwrap_or(SYNC))?, every: every? })
        });
        Some(Bus {
            name: name.to_owned(),
            transport,
            address: address?,
            tls,
            opcua,
            timeout,
            late,
            pipeline,
            quirks,
            sync,
        })
    }

    /// Returns the protocol family of the line. If `type` is missing or wrong, an address with `opc.tcp://` means OPC
    /// UA.
    pub(super) fn line_kind(&self) -> Option<LineKind> {
        self.kind.map(BusType::kind).or_else(|| self.is_at_a_server().then_some(LineKind::OpcUa))
    }

    fn is_at_a_server(&self) -> bool {
        self.address.as_ref().is_some_and(|address| address.starts_with(opcua::SCHEME))
    }

    fn pipeline(&self, at: &KeyContext<'_>, quirks: Quirks) -> u8 {
        let pipeline = self.pipeline.unwrap_or(1);
        if !(1..=2).contains(&pipeline) {
            at.invalid(format!("{pipeline} is not possible"), "write 1 or 2");
        }
        if pipeline > 1 && !quirks.support_two() {
            at.invalid(APART, "remove `pipeline`, or the quirk of this bus");
        }
        pipeline
    }

    fn late(&self, at: &KeyContext<'_>, timeout: Duration, default: Duration) -> Duration {
        let Some(late) = at.duration(self.late) else { return default };
        let left_out = format!("or remove `late` (default {})", shown(default));
        if late < timeout {
            let (late, timeout) = (shown(late), shown(timeout));
            let message = format!("{late} is shorter than `timeout`, which is {timeout}");
            at.invalid(message, format!("write {timeout} or more, {left_out}"));
        } else if late > LONGEST_LATE {
            let (late, longest) = (shown(late), shown(LONGEST_LATE));
            let message =
                format!("{late} is longer than {longest}: a lost answer could stop an axis for this time");
            at.invalid(message, format!("write {longest} or less, {left_out}"));
        }
        late
    }

    fn host_and_port(&self, at: &KeyContext<'_>) -> Option<String> {
        let at = at.key("address");
        let help = "write host and port, as \"192.168.0.10:502\"; 502 is Modbus TCP's usual port";
        at.missing("`address` is missing: where is the line?", help);
        let address = self.address.as_ref()?;
        if let Some((scheme, rest)) = address.split_once("://") {
            let host = rest.split(['/', '?']).next().unwrap_or_default();
            let host = match host_and_port(host) {
                Ok((_, Some(_))) => host.to_owned(),
                Ok((host, None)) => format!("{host}:{USUAL}"),
                Err(why) => why.meant(USUAL).unwrap_or_else(|| EXAMPLE.to_owned()),
            };
            let help = format!("write host and port alone, as \"{host}\"; `type` sets the protocol");
            return at.reject(format!("`{address}` is a URL (`{scheme}`), and no host and port"), help);
        }
        let place = host_and_port(address);
        let host = place.as_ref().map_or(address.as_str(), |(host, _)| host);
        let is_numbers = host.contains('.') && host.chars().all(|c| c.is_ascii_digit() || c == '.');
        if is_numbers && host.parse::<std::net::Ipv4Addr>().is_err() {
            let help = "write four numbers of 0 to 255, as \"192.168.0.10:502\"";
            return at.reject(format!("`{host}` is no address"), help);
        }
        let example = match place {
            Ok((_, Some(_))) => return Some(address.clone()),
            Ok((host, None)) if self.tls.is_some() => return Some(format!("{host}:{TLS_PORT}")),
            Ok((host, None)) => format!("{host}:{USUAL}"),
            Err(_) => EXAMPLE.to_owned(),
        };
        let help = place.err().and_then(|why| why.help(USUAL, str::to_owned));
        let help = help.unwrap_or_else(|| {
            format!("write host and port, as \"{example}\"; {USUAL} is Modbus TCP's usual port")
        });
        at.reject(format!("`{address}` is no host and port"), help)
    }

    fn interface(&self, at: &KeyContext<'_>) -> Option<String> {
        let at = at.key("interface");
        let help = "write the network interface, as \"can0\"; `ip link` shows which there are";
        at.missing("`interface` is missing: where is the line?", help);
        let name = self.interface.as_ref()?;
        let is_plain = |c: char| c != '/' && !c.is_whitespace();
        if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(is_plain) {
            let help = "write the name of the interface, as \"can0\": up to 15 characters; `ip link` shows \
                        which there are";
            return at.reject(format!("`{name}` cannot be a network interface"), help);
        }
        Some(name.clone())
    }
}

/// Reports keys that belong to another type of line.
fn foreign_keys(at: &KeyContext<'_>, kind: BusType) {
    let modbus = [BusType::ModbusTcp, BusType::ModbusRtu, BusType::ModbusRtuOverTcp];
    let by_address = [BusType::ModbusTcp, BusType::ModbusRtuOverTcp, BusType::OpcUa, BusType::Sysfs];
    let written = [modbus.as_slice(), &[BusType::Can, BusType::OpcUa]].concat();
    let owners: [(&[&str], &str, &[BusType]); 7] = [
        (&["address"], "a TCP line", &by_address),
        (&["late"], "a line with writes", &written),
        (&["port", "baud", "parity", "stop_bits"], "a modbus-rtu line", &[BusType::ModbusRtu]),
        (&["tls", "pipeline"], "a modbus-tcp line", &[BusType::ModbusTcp]),
        (&["interface", "sync"], "a can line", &[BusType::Can]),
        (&["security", "user", "cert", "key", "trusted"], "an opcua line", &[BusType::OpcUa]),
        (&["quirks"], "a Modbus line", &modbus),
    ];
    for (keys, owner, _) in owners.into_iter().filter(|(.., kinds)| !kinds.contains(&kind)) {
        at.not_applicable(keys, owner, "remove this key, or change `type`");
    }
    if matches!(kind, BusType::ModbusRtu | BusType::ModbusRtuOverTcp) {
        at.key("quirks").not_applicable(&["gateway"], quirks::OF_TCP, quirks::WAITS);
    }
}

/// Warns if the timeout is as long as the shortest period on the line, because a lost answer then delays further
/// exchanges. The profile stays valid, because overdue exchanges are skipped.
pub(super) fn none_waits_for_a_period(check: &Check<'_>) {
    for (name, bus) in &check.raw.bus {
        let at = check.at("bus").key(name).key("timeout");
        let Some(timeout) = bus.timeout.map(|Timespan(timeout)| timeout) else { continue };
        let of_line = check.periods.of(name).iter();
        let mut due: Vec<&Due> = of_line.filter(|(_, every)| *every <= timeout).collect();
        due.sort_by_key(|(_, every)| *every);
        let Some((_, shortest)) = due.first() else { continue };
        let shortest = shown(*shortest);
        let due: Vec<String> =
            due.into_iter().map(|(what, every)| format!("{what} {}", shown(*every))).collect();
        let message = format!("`timeout` is {}, but {}", shown(timeout), due.join(", "));
        let help = format!(
            "write a `timeout` shorter than {shortest}, or remove this key (default: half the shortest \
             period, at most {}). During the wait for a lost answer, due reads and writes are skipped",
            shown(TIMEOUT)
        );
        at.warn(message, help);
    }
}

/// Reports two buses on one physical line, which would send at the same time and receive each other's answers.
pub(super) fn one_owner_each(check: &Check<'_>) {
    let is_shared = |transport| matches!(transport, Transport::Tcp | Transport::OpcUa | Transport::Sysfs);
    let lines: Vec<&Bus> = check.buses.valid().filter(|bus| !is_shared(bus.transport)).collect();
    for (place, bus) in lines.iter().enumerate() {
        if let Some(first) = lines[..place].iter().find(|first| first.address == bus.address) {
            let key = match bus.transport {
                Transport::Serial(_) => "port",
                Transport::Can => "interface",
                Transport::Tcp | Transport::RtuOverTcp | Transport::OpcUa | Transport::Sysfs => "address",
            };
            let message = format!("the bus `{}` has this {key} already", first.name);
            let help = "put all devices of one line on one bus; each has its own `every`";
            check.at("bus").key(&bus.name).key(key).invalid(message, help);
        }
    }
}
