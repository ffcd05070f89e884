//! Time that polling takes on a serial line. Checks that the polls fit into their periods, and shows the time in the
//! preview.

use std::collections::BTreeSet;

use super::frames::read_frames;
use super::serial::Serial;
use crate::document::{Section, entries};
use crate::duration::ms;
use crate::tables::Check;
use crate::tables::bus::transport::Transport;
use crate::tables::device::Device;
use crate::tables::signal::Signal;
use crate::{BusId, Profile};
use isotherm_core::codec::Table;

/// Length of an RTU read request in bytes: unit, function, first register, number of registers, checksum.
const READ: usize = 8;
/// Length of an answer without its data, in bytes: unit, function, byte count, checksum.
const AROUND_DATA: usize = 5;
/// Largest fraction of a line's time that polls may take without a warning. Above it, too little time is left for
/// writes, slow devices and retries.
const FULL: f64 = 0.8;

/// Reports an error for a serial line if its polls take longer than the poll periods. Warns if the polls take more than
/// [`FULL`] of the time.
pub(super) fn check(check: &Check<'_>) {
    let devices = check.devices.by_owner(|device| Some(device.bus.0));
    let signals = check.signals.by_owner(|signal| Some(signal.device.0));
    for (place, bus) in check.buses.resolved.iter().enumerate() {
        let Some(bus) = bus else { continue };
        let Some(serial) = bus.transport.serial() else { continue };
        let load = |id: usize| {
            let device = check.devices.get(id)?;
            let signals: Vec<&Signal> =
                signals.of(id).filter_map(|signal| check.signals.get(signal)).collect();
            Some(least_time(serial, device, &signals) / device.every.as_secs_f64())
        };
        let load: f64 = devices.of(place).filter_map(load).sum();
        let message = format!(
            "polling needs at least {:.0} % of the line's time at {}, without the answer times of the devices",
            100.0 * load,
            bus.transport.port_settings().unwrap_or_default()
        );
        let help = "poll less often (`every`), raise `baud` here and at the devices, or use a second line";
        let at = check.at("bus").key(&bus.name).key("baud");
        if load > 1.0 {
            at.invalid(message, help);
        } else if load > FULL {
            at.warn(message, help);
        }
    }
}

/// Returns the minimum duration of one poll of a device, in seconds. Every register is read once, with the fewest
/// requests.
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

/// Returns the preview of a serial port: its settings, and the time that polls take. The answer times of the
/// devices are not included.
pub(super) fn preview(profile: &Profile, id: BusId, serial: Serial) -> Section {
    let transport = profile.bus(id).transport;
    let settings = transport.port_settings();
    // An ASCII frame has two characters for each byte.
    let each = if matches!(transport, Transport::ModbusAscii { .. }) { "byte" } else { "character" };
    let (settings, character, silence) =
        (settings.unwrap_or_default(), ms(serial.character()), ms(serial.silence()));
    let mut section = Section::default();
    section
        .line(format!("  {settings}: {character:.2} ms a {each}, {silence:.2} ms silence before a request"));
    entries!(section, settings, character_ms = character, silence_ms = silence);
    let mut loads: Vec<f64> = Vec::new();
    let polls = profile.devices_on(id).filter_map(|(id, device)| {
        let requests = profile.requests(id);
        let frames = requests.iter().map(read_frames);
        let bytes: usize = frames.clone().map(|(question, answer)| question + answer).sum();
        let takes = frames.map(|(question, answer)| {
            serial.exchange(question, answer) + device.quirks.pause_between_requests
        });
        let (name, takes, every) = (&device.name, ms(takes.sum()), ms(device.every));
        if requests.is_empty() {
            return None;
        }
        loads.push(takes / every);
        let mut section = Section::default();
        section.line(format!("  {name}: {bytes} bytes take {takes:.0} ms of every {every:.0} ms"));
        entries!(section, device = name, bytes, takes_ms = takes, every_ms = every);
        Some(section)
    });
    section.parts("polls", polls);
    let load = 100.0 * loads.iter().sum::<f64>();
    section.line(format!(
        "  polls take {load:.0} % of the line's time, without writes and without the answer times of the \
         devices"
    ));
    section.entry("load_percent", load);
    section
}
