//! Lines and devices.

use std::time::Duration;

use super::{Check, Zero, bus_of, get, host_of, shown};
use crate::place::child;
use crate::raw::{BusType, FunctionWord, RawBus, RawDevice, RawQuirks};
use crate::{Bus, BusId, Device, Functions, Quirks, TLS_PORT, Transport};

const TIMEOUT: Duration = Duration::from_millis(500);
const SHORTEST_TIMEOUT: Duration = Duration::from_millis(100);
const EVERY: Duration = Duration::from_secs(1);
const LONGEST_LATE: Duration = Duration::from_mins(10);

impl Check<'_> {
    pub(super) fn buses(&mut self) -> Vec<Option<Bus>> {
        let raw = self.raw;
        let each = self.buses.each();
        each.into_iter().map(|(_, name, path)| self.bus(&path, &name, raw.bus.get(&name)?)).collect()
    }

    fn bus(&mut self, path: &str, name: &str, raw: &RawBus) -> Option<Bus> {
        let quirks = self.quirks(&child(path, "quirks"), raw.quirks.as_ref(), Quirks::default());
        let given = self.span(&child(path, "timeout"), raw.timeout.as_ref(), Zero::Refused);
        let timeout = given.unwrap_or_else(|| self.default_timeout(name));
        let kind = raw.kind?;
        self.foreign_keys(path, kind, raw);
        let (transport, address) = match kind {
            BusType::ModbusTcp => (Transport::Tcp, self.host_and_port(path, raw)),
            BusType::ModbusRtuOverTcp => (Transport::RtuOverTcp, self.host_and_port(path, raw)),
            BusType::ModbusRtu => {
                let (serial, port) = (self.serial(path, raw), self.port(path, raw));
                (Transport::Serial(serial?), port)
            }
            BusType::Can => (Transport::Can, self.interface(path, raw)),
        };
        let late = self.late(&child(path, "late"), raw, timeout, transport.late(timeout));
        let tls = match (&raw.tls, kind) {
            (Some(tls), BusType::ModbusTcp) => {
                // Its files are looked at even where the address is wrong.
                let host = address.as_deref().and_then(host_of).unwrap_or("localhost");
                Some(self.tls(&child(path, "tls"), tls, host))
            }
            _ => None,
        };
        let tls = match tls {
            Some(tls) => Some(tls?),
            None => None,
        };
        let sync = if kind == BusType::Can { self.sync(path, raw) } else { None };
        Some(Bus { name: name.to_owned(), transport, address: address?, tls, timeout, late, quirks, sync })
    }

    fn late(&mut self, path: &str, raw: &RawBus, timeout: Duration, default: Duration) -> Duration {
        let Some(late) = self.span(path, raw.late.as_ref(), Zero::Refused) else { return default };
        let left_out = format!("or leave it out: {}", shown(default));
        if late < timeout {
            let (late, timeout) = (shown(late), shown(timeout));
            let message =
                format!("{late} is shorter than the {timeout} that an answer is waited for (`timeout`)");
            self.wrong(path, message, format!("write {timeout} or more, {left_out}"));
        } else if late > LONGEST_LATE {
            let (late, longest) = (shown(late), shown(LONGEST_LATE));
            let message = format!(
                "{late} is longer than {longest}, and for that long a lost answer may keep an axis where it is"
            );
            self.wrong(path, message, format!("write {longest} or less, {left_out}"));
        }
        late
    }

    fn host_and_port(&mut self, path: &str, raw: &RawBus) -> Option<String> {
        let Some(address) = &raw.address else {
            let help = "write host and port, as \"192.168.0.10:502\"; 502 is Modbus TCP's usual port";
            self.missing(path, "address", "`address` is missing: where is the line?", help);
            return None;
        };
        if raw.tls.is_some() && !address.is_empty() && !address.contains(':') {
            return Some(format!("{address}:{TLS_PORT}"));
        }
        if host_of(address).is_none() {
            let help = format!("write host and port, as \"{address}:502\"; 502 is Modbus TCP's usual port");
            self.wrong(&child(path, "address"), format!("`{address}` is no host and port"), help);
            return None;
        }
        Some(address.clone())
    }

    fn foreign_keys(&mut self, path: &str, kind: BusType, raw: &RawBus) {
        let serial = kind == BusType::ModbusRtu;
        let can = kind == BusType::Can;
        let keys = [
            ("address", raw.address.is_some(), !serial && !can, "a TCP line"),
            ("port", raw.port.is_some(), serial, "a modbus-rtu line"),
            ("baud", raw.baud.is_some(), serial, "a modbus-rtu line"),
            ("parity", raw.parity.is_some(), serial, "a modbus-rtu line"),
            ("stop_bits", raw.stop_bits.is_some(), serial, "a modbus-rtu line"),
            ("tls", raw.tls.is_some(), kind == BusType::ModbusTcp, "a modbus-tcp line"),
            ("interface", raw.interface.is_some(), can, "a can line"),
            ("sync", raw.sync.is_some(), can, "a can line"),
            ("quirks", raw.quirks.is_some(), !can, "a Modbus line"),
        ];
        for (key, there, belongs, owner) in keys {
            if there && !belongs {
                self.wrong_key(
                    &child(path, key),
                    format!("`{key}` belongs to {owner}"),
                    "remove it, or change `type`",
                );
            }
        }
    }

    /// Where nothing is written: half a fast poll period, but never so short that a sound device is missed.
    fn default_timeout(&self, bus: &str) -> Duration {
        let devices = self.raw.device.values().filter(|device| device.bus.as_deref() == Some(bus));
        let periods = devices.filter_map(|device| humantime::parse_duration(&device.every.as_ref()?.0).ok());
        periods.map(|period| (period / 2).max(SHORTEST_TIMEOUT)).fold(TIMEOUT, Duration::min)
    }

    pub(super) fn devices(&mut self, buses: &[Option<Bus>]) -> Vec<Option<Device>> {
        let raw = self.raw;
        let each = self.devices.each();
        each.into_iter()
            .map(|(_, name, path)| self.device(&path, &name, raw.device.get(&name)?, buses))
            .collect()
    }

    fn device(&mut self, path: &str, name: &str, raw: &RawDevice, buses: &[Option<Bus>]) -> Option<Device> {
        self.of_template(path, raw);
        let every = self.span(&child(path, "every"), raw.every.as_ref(), Zero::Refused).unwrap_or(EVERY);
        let functions = functions(raw.functions.as_deref());
        if raw.functions.as_ref().is_some_and(Vec::is_empty) {
            let help = "name what it may be sent, as [\"read-holding\", \"write-multiple\"], or leave the key out: all";
            self.wrong(&child(path, "functions"), "a device that may be sent nothing is of no use", help);
        }
        let bus = raw.bus.as_ref().and_then(|bus| self.bus_index(&child(path, "bus"), bus));
        let over = bus.and_then(|bus| get(buses, bus)).map_or_else(Quirks::default, |bus| bus.quirks);
        let quirks = self.quirks(&child(path, "quirks"), raw.quirks.as_ref(), over);
        let on_can = self.is_on_can(name);
        let can = self.can_device(path, name, raw);
        if raw.unit.is_none() && on_can != Some(true) {
            let help = "write the unit identifier of the device, 0 to 255; one that is alone at its address often has 1 or 255";
            self.missing(path, "unit", "`unit` is missing", help);
        }
        let over_rtu = bus
            .and_then(|bus| get(buses, bus))
            .is_some_and(|bus| matches!(bus.transport, Transport::Serial(_) | Transport::RtuOverTcp));
        if let Some(unit) = raw.unit.filter(|unit| over_rtu && !(1..=247).contains(unit)) {
            let message = if unit == 0 {
                "unit 0 speaks to all devices of an RTU line at once, and none of them answers".to_owned()
            } else {
                format!("an RTU line has no unit {unit}: 248 to 255 are reserved")
            };
            self.wrong(&child(path, "unit"), message, "write the address set at the device, 1 to 247");
        }
        let verify = match on_can {
            Some(true) => self.expected_objects(&child(path, "verify"), raw),
            _ => self.verify(&child(path, "verify"), raw, functions),
        };
        if let Some(can) = &can {
            self.heartbeat_produced(path, can);
        }
        if let Some(dbc) = raw.dbc.as_ref().filter(|_| can.is_some()) {
            self.dbc(&child(path, "dbc"), dbc);
        }
        let unit = if on_can == Some(true) { Some(raw.node.unwrap_or(0)) } else { raw.unit };
        let template = self.templates.get(name).cloned();
        let device = Device {
            name: name.to_owned(),
            bus: BusId(bus?),
            unit: unit?,
            every,
            functions,
            quirks,
            verify,
            template,
            can,
        };
        if let Some(bus) = bus_of(&device, buses)
            && bus.timeout >= every
        {
            let (timeout, every) = (shown(bus.timeout), shown(every));
            let message = format!(
                "the bus `{}` waits {timeout} for an answer, as long as the poll period {every}",
                bus.name
            );
            let help = "make `timeout` of the bus shorter than `every` of each of its devices";
            let written = self.raw.bus.get(&bus.name).is_some_and(|raw| raw.timeout.is_some());
            if bus.timeout > TIMEOUT {
                self.wrong(&child(path, "every"), message, help);
            } else if written {
                // An ordinary timeout over a fast scale: a lost answer costs some polls, which are skipped.
                let warning = self.places.at_value(&child(path, "every"), message, Some(help.to_owned()));
                self.warnings.push(warning);
            }
        }
        Some(device)
    }

    fn of_template(&mut self, path: &str, raw: &RawDevice) {
        let of_template = [
            ("variant", raw.variant.is_some()),
            ("base", raw.base.is_some()),
            ("expect", raw.expect.is_some()),
        ];
        for (key, _) in of_template.iter().filter(|(_, there)| *there && raw.template.is_none()) {
            let help = "write template = \"…\" as well, or remove it";
            self.wrong_key(&child(path, key), format!("`{key}` belongs to a device template"), help);
        }
    }

    fn quirks(&mut self, path: &str, raw: Option<&RawQuirks>, over: Quirks) -> Quirks {
        let Some(raw) = raw else { return over };
        let mut span = |key: &str, value| self.span(&child(path, key), value, Zero::Allowed);
        let after_connect = span("pause_after_connect", raw.pause_after_connect.as_ref());
        let between = span("pause_between_requests", raw.pause_between_requests.as_ref());
        Quirks {
            pause_after_connect: after_connect.unwrap_or(over.pause_after_connect),
            pause_between_requests: between.unwrap_or(over.pause_between_requests),
            one_request_per_field: raw.one_request_per_field.unwrap_or(over.one_request_per_field),
            max_registers_per_request: raw
                .max_registers_per_request
                .unwrap_or(over.max_registers_per_request),
            max_gap: raw.max_gap.unwrap_or(over.max_gap),
            close_after_each: raw.close_after_each.unwrap_or(over.close_after_each),
        }
    }
}

fn functions(words: Option<&[FunctionWord]>) -> Functions {
    let Some(words) = words else { return Functions::ALL };
    let has = |word| words.contains(&word);
    Functions {
        read_coils: has(FunctionWord::ReadCoils),
        read_discrete: has(FunctionWord::ReadDiscrete),
        read_holding: has(FunctionWord::ReadHolding),
        read_input: has(FunctionWord::ReadInput),
        write_coil: has(FunctionWord::WriteCoil),
        write_single: has(FunctionWord::WriteSingle),
        write_coils: has(FunctionWord::WriteCoils),
        write_multiple: has(FunctionWord::WriteMultiple),
    }
}
