//! Serial lines: their settings, and whether what is polled fits into their time.

use std::collections::BTreeSet;

use super::{Check, Signals};
use crate::place::child;
use crate::raw::{ParityWord, RawBus};
use crate::{Bus, Device, Parity, Serial, Signal, Transport};
use isotherm_core::codec::Table;

/// Frame bytes of a read request, and of its answer beside the data: unit, function, byte count, checksum.
const READ: usize = 8;
const AROUND_DATA: usize = 5;
/// Beyond this share of its time a line has no room for writes, thinking devices and repetitions.
const FULL: f64 = 0.8;

impl Check<'_> {
    pub(super) fn serial(&mut self, path: &str, raw: &RawBus) -> Option<Serial> {
        let parity = match raw.parity {
            None | Some(ParityWord::None) => Parity::None,
            Some(ParityWord::Even) => Parity::Even,
            Some(ParityWord::Odd) => Parity::Odd,
        };
        let Some(baud) = raw.baud else {
            let help = "write what the devices are set to: 9600 and 19200 are usual";
            self.missing(path, "baud", "`baud` is missing: how fast is the line?", help);
            return None;
        };
        Some(Serial { baud, parity, stop_bits: raw.stop_bits.unwrap_or(1) })
    }

    pub(super) fn port(&mut self, path: &str, raw: &RawBus) -> Option<String> {
        let Some(port) = &raw.port else {
            let help = "write the port's path; `ls /dev/serial/by-id` shows those that keep their name when replugged";
            self.missing(path, "port", "`port` is missing: where is the line?", help);
            return None;
        };
        if !port.starts_with('/') {
            let help = format!("write the whole path, as \"/dev/{port}\" or one of /dev/serial/by-id");
            self.wrong(&child(path, "port"), format!("`{port}` is no path of a port"), help);
            return None;
        }
        let is_numbered = ["/dev/ttyUSB", "/dev/ttyACM"].iter().any(|kind| port.starts_with(kind));
        if is_numbered {
            let message = format!("`{port}` may be another adapter after a replug or a restart");
            let help = "use its name below /dev/serial/by-id".to_owned();
            self.warnings.push(self.places.at_value(&child(path, "port"), message, Some(help)));
        }
        Some(port.clone())
    }

    /// Two buses on one RTU line would speak at once, and take each other's answers.
    pub(super) fn one_owner_each(&mut self, buses: &[Option<Bus>]) {
        let lines: Vec<&Bus> = buses.iter().flatten().filter(|bus| bus.transport != Transport::Tcp).collect();
        for (place, bus) in lines.iter().enumerate() {
            if let Some(first) = lines[..place].iter().find(|first| first.address == bus.address) {
                let key = match bus.transport {
                    Transport::Serial(_) => "port",
                    Transport::Can => "interface",
                    Transport::Tcp | Transport::RtuOverTcp => "address",
                };
                let message = format!("the bus `{}` has this {key} already", first.name);
                let help = "put all devices of one line on one bus; each has its own `every`";
                self.wrong(&child(&child("bus", &bus.name), key), message, help);
            }
        }
    }

    /// What is polled needs time on the line: more than there is can be told before the first poll.
    pub(super) fn time_on_lines(
        &mut self,
        buses: &[Option<Bus>],
        devices: &[Option<Device>],
        signals: &Signals,
    ) {
        for (place, bus) in buses.iter().enumerate() {
            let Some(bus) = bus else { continue };
            let Transport::Serial(serial) = bus.transport else { continue };
            let load = |(index, device): (usize, &Option<Device>)| {
                let device = device.as_ref().filter(|device| device.bus.0 == place)?;
                let of_device =
                    signals.iter().flatten().filter(|signal| signal.device.0 == index).collect::<Vec<_>>();
                Some(least_time(serial, device, &of_device) / device.every.as_secs_f64())
            };
            let load: f64 = devices.iter().enumerate().filter_map(load).sum();
            if load <= FULL {
                continue;
            }
            let message = format!(
                "polling needs at least {:.0} % of the line's time at {serial}, without the devices' own",
                100.0 * load
            );
            let help =
                "poll less often (`every`), raise `baud` here and at the devices, or use a second line";
            let path = child(&child("bus", &bus.name), "baud");
            if load > 1.0 {
                self.wrong(&path, message, help);
            } else {
                self.warnings.push(self.places.at_value(&path, message, Some(help.to_owned())));
            }
        }
    }
}

/// Seconds that one poll of a device takes at the very least: every register once, in the fewest requests.
fn least_time(serial: Serial, device: &Device, signals: &[&Signal]) -> f64 {
    let mut seconds = 0.0;
    for table in [Table::Coil, Table::Discrete, Table::Input, Table::Holding] {
        let of_table = signals.iter().filter_map(|signal| {
            let first = signal.address.register().filter(|first| first.table == table)?;
            Some((u32::from(first.offset), u32::from(signal.encoding.data_type.registers())))
        });
        let distinct: BTreeSet<u32> = of_table.clone().flat_map(|(from, count)| from..from + count).collect();
        let (per_request, bytes) = if table.is_bits() {
            (2000, distinct.len().div_ceil(8))
        } else {
            (usize::from(device.quirks.max_registers_per_request).max(1), 2 * distinct.len())
        };
        let requests = if device.quirks.one_request_per_field {
            of_table.count()
        } else {
            distinct.len().div_ceil(per_request)
        };
        if let Ok(count) = u32::try_from(requests) {
            let around = serial.exchange(READ, AROUND_DATA) + device.quirks.pause_between_requests;
            seconds += (around * count + serial.bytes(bytes)).as_secs_f64();
        }
    }
    seconds
}
