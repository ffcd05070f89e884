//! `[bus.*]`: one physical line.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::{Check, KeyContext};
use crate::document::{Section, entries};
use crate::duration::{Timespan, shown};
use crate::kinds::modbus::quirks::{Quirks, RawQuirks};
use crate::kinds::modbus::serial::Parity;
use crate::kinds::opcua::connection::{OpcUa, RawUser, Security};
use isotherm_core::codec::CanId;
use periods::{Due, TIMEOUT};
use tls::{RawTls, Tls};
use transport::{BusType, LATE, Transport};

pub(super) mod periods;
pub(crate) mod tls;
pub(crate) mod transport;

const LONGEST_LATE: Duration = Duration::from_mins(10);
/// Reason why `pipeline = 2` is not possible with some quirks.
pub(crate) const APART: &str =
    "two requests at a time are not possible with `pause_between_requests` or `close_after_each`";
/// Keys that only some types of lines have, each group with its owner in messages.
const OWNERS: [(&[&str], &str); 7] = [
    (&["address"], "a TCP line"),
    (&["late"], "a line with writes"),
    (&["port", "baud", "parity", "stop_bits"], "a modbus-rtu line"),
    (&["tls", "pipeline"], "a modbus-tcp line"),
    (&["interface", "sync"], "a can line"),
    (&["security", "user", "cert", "key", "trusted"], "an opcua line"),
    (&["quirks"], "a Modbus line"),
];

/// One physical line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Bus")]
pub(crate) struct RawBus {
    /// Type of the line.
    #[serde(rename = "type")]
    #[schemars(required)]
    pub(crate) kind: Option<BusType>,
    /// Address of the line. TCP lines: host and port, for example "192.168.0.10:502". With `tls` the default port is
    /// 802. OPC UA lines: URL of the server, for example "opc.tcp://192.168.214.241:4840". Sysfs lines: directory of
    /// the kernel's sensors, default "/sys".
    pub(crate) address: Option<String>,
    /// Timeout of an answer. Default "500ms", or half the shortest period of reads and writes on the line if that is
    /// less; "2s" on a sysfs line.
    pub(crate) timeout: Option<Timespan>,
    /// Time during which a write without an answer may still arrive, from `timeout` to "10min". Default "30s"; on a
    /// modbus-rtu line twice `timeout`, because no network delays the write.
    pub(crate) late: Option<Timespan>,
    /// Certificate files of a modbus-tcp line with Modbus/TCP Security.
    pub(crate) tls: Option<RawTls>,
    /// Largest number of requests that wait for an answer at the same time on a modbus-tcp line, 1 or 2. Default 1.
    /// With 2, a corrected position (position plus Cz) is written together with the request for the next position.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) pipeline: Option<u8>,
    /// Quirks: special requirements of all devices on the line.
    pub(crate) quirks: Option<RawQuirks>,
    /// Serial port of a modbus-rtu line, for example "/dev/serial/by-id/usb-…".
    pub(crate) port: Option<String>,
    /// Baud rate of a modbus-rtu line, in bits per second. Required on such a line.
    #[schemars(range(min = 300, max = 4_000_000))]
    pub(crate) baud: Option<u32>,
    /// Parity of a modbus-rtu line. Default "none".
    pub(crate) parity: Option<Parity>,
    /// Stop bits of a modbus-rtu line, 1 or 2. Default 1.
    #[schemars(range(min = 1, max = 2))]
    pub(crate) stop_bits: Option<u8>,
    /// Network interface of a CAN line, for example "can0".
    pub(crate) interface: Option<String>,
    /// SYNC that the gateway sends on a CAN line. Default: none.
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

/// Type of a line: its keys, and how programs share it.
pub(crate) struct LineType {
    /// Word in the key `type`.
    pub(crate) word: BusType,
    /// Name of the line in the preview.
    pub(crate) title: &'static str,
    /// Keys of `OWNERS` that lines of this type have.
    pub(crate) keys: &'static [&'static str],
    /// Key of a line that only one bus may have, because two would receive each other's answers. `None` for a line that
    /// several clients can use.
    pub(crate) exclusive: Option<&'static str>,
    /// Assumed time until a current device begins its answer, including its network.
    pub(crate) answer: Duration,
}

impl LineType {
    /// Answer time of a device without a slow part of the line.
    pub(crate) const ANSWER: Duration = Duration::from_millis(10);
}

/// Settings that only some types of lines have.
#[derive(Default)]
pub(crate) struct LineSettings {
    pub(crate) tls: Option<Tls>,
    pub(crate) opcua: Option<OpcUa>,
    pub(crate) sync: Option<Sync>,
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

/// SYNC that the gateway sends on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// CAN identifier of the SYNC message.
    pub id: CanId,
    /// Period at which SYNC is sent.
    pub every: Duration,
}

impl Bus {
    /// Preview of the line: its kind, its serial port or CAN interface, a Modbus gateway on it, and its load.
    pub(crate) fn preview(
        &self,
        (title, reads_only): (&str, Option<&str>),
        mut sections: Vec<(&'static str, Section)>,
        load: Option<Section>,
    ) -> Section {
        let kind = if self.tls.is_some() { "Modbus TCP inside TLS (Modbus/TCP Security)" } else { title };
        let (name, address, timeout, late) =
            (&self.name, &self.address, shown(self.timeout), shown(self.late));
        let late_writes = || format!("a write that is not answered may still arrive for {late}");
        let mut section = Section::default();
        section.line("");
        section.line(format!("bus {name}: {kind} at {address}, timeout {timeout}"));
        section.line(format!("  {}", reads_only.map_or_else(late_writes, str::to_owned)));
        entries!(section, name, kind, address);
        section.part("tls", self.tls.as_ref().map(Tls::preview));
        section.part("opcua", self.opcua.as_ref().map(OpcUa::preview));
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

impl RawBus {
    pub(super) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Bus> {
        let quirks =
            self.quirks.as_ref().map_or_else(Quirks::default, |quirks| quirks.over(Quirks::default()));
        let timeout = at.key("timeout").duration(self.timeout);
        let kind = check.kind_of_line(self);
        let usual = kind.filter(|_| self.kind.is_some()).and_then(|kind| kind.timeout);
        let timeout = timeout.or(usual).unwrap_or_else(|| check.periods.timeout(name));
        let Some((of, kind)) = self.kind.zip(kind) else {
            // The type has an error. The other keys are checked nevertheless.
            check.kinds.iter().for_each(|other| (other.line_without_type)(self, at, kind.is_some()));
            self.late(&at.key("late"), timeout, LATE.max(timeout));
            return None;
        };
        foreign_keys(at, kind.line_type(of).map_or(&[], |known| known.keys));
        let (transport, address) = (kind.line)(self, at, of)?;
        let late = self.late(&at.key("late"), timeout, transport.late(timeout));
        let LineSettings { tls, opcua, sync } = (kind.settings)(self, at, of, address.as_deref())?;
        let pipeline = self.pipeline(&at.key("pipeline"), quirks);
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
}

/// Reports keys that belong to another type of line. `own` are those of its type.
fn foreign_keys(at: &KeyContext<'_>, own: &[&str]) {
    for (keys, owner) in OWNERS {
        let foreign: Vec<&str> = keys.iter().copied().filter(|key| !own.contains(key)).collect();
        at.not_applicable(&foreign, owner, "remove this key, or change `type`");
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
    let exclusive = |bus: &Bus| {
        let of = bus.transport.bus_type();
        check.kinds.iter().find_map(|kind| kind.line_type(of)?.exclusive)
    };
    let lines: Vec<(&Bus, &str)> =
        check.buses.valid().filter_map(|bus| exclusive(bus).map(|key| (bus, key))).collect();
    for (place, (bus, key)) in lines.iter().enumerate() {
        if let Some((first, _)) = lines[..place].iter().find(|(first, _)| first.address == bus.address) {
            let message = format!("the bus `{}` has this {key} already", first.name);
            let help = "put all devices of one line on one bus; each has its own `every`";
            check.at("bus").key(&bus.name).key(key).invalid(message, help);
        }
    }
}
