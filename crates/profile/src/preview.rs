//! Preview of a valid profile, which `isotherm check` prints as sentences and numbers: the values that the
//! gateway reads and writes, and how the compensation value (Cz) of each axis changes.
//!
//! The operator reads the preview before the gateway is connected to a machine. For programs, the same content is
//! available as one JSON document.

use std::fmt;

use serde::Serialize;

use crate::document::{Section, entries};
use crate::duration::shown;
use crate::kinds;
use crate::plan::summary;
use crate::tables::axis::model::uniform_temperature::UniformTemperature;
use crate::tables::label::labelled;
use crate::{BusId, Device, DeviceId, Profile};

pub mod checks;
mod load;
mod stop;
mod traffic;

pub use load::{Load, Verdict, warnings};

/// Preview of the whole machine. `Display` is the text; serialisation is the JSON document.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Preview(Section);

impl Preview {
    /// Creates the preview of a profile.
    pub fn of(profile: &Profile) -> Preview {
        let devices = profile.devices.iter().enumerate();
        let readers = checks::readers(profile);
        let preview = |(place, device): (usize, &Device)| {
            let id = DeviceId(place);
            let requests = profile.register_requests(id);
            let polled = requests.iter().map(|request| request.preview(profile)).collect();
            let (every, summary) = (shown(device.every), summary(&requests));
            let bus = profile.bus(device.bus);
            let (kind, _) = kinds::of(bus.transport);
            let described = (kind.device_preview)(device, &every, &summary);
            let checks = checks::preview(profile, (id, device), &readers);
            let can = device.can.as_ref().map(|can| can.preview(profile, id));
            device.preview((&bus.name, &described), can, (summary, polled), checks)
        };
        let devices: Vec<Section> = devices.map(preview).collect();
        let mut section = Section::default();
        let (name, description) = (&profile.name, &profile.description);
        let title = labelled(name, &profile.label);
        section.line(if description.is_empty() { title } else { format!("{title}: {description}") });
        entries!(section, machine = name, label = &profile.label, description);
        if !profile.overridden.is_empty() {
            section.line("");
            section.line("settings that override the profile");
            section.lines("  ", &profile.overridden);
            section.line("");
        }
        section.entry("overridden", &profile.overridden);
        let lines = profile.buses.iter().enumerate().zip(Load::of_lines(profile));
        let buses = lines.map(|((place, bus), load)| {
            let id = BusId(place);
            let load = load.map(|load| load.preview());
            let (kind, line) = kinds::of(bus.transport);
            let bus = bus.preview((line.title, kind.line_preview), (kind.preview)(profile, id), load);
            section.lines_of(&bus);
            profile.devices_on(id).for_each(|(device, _)| section.lines_of(&devices[device.0]));
            bus
        });
        let buses: Vec<Section> = buses.collect();
        section.json("buses", buses);
        section.json("devices", devices);
        let unidentified = checks::unidentified(profile);
        if !unidentified.is_empty() {
            let names = unidentified.join(", ");
            section.line(format!(
                "without checks: {names}. If another device replaces one of them, this is not detected. Give \
                 each device a `verify` of its serial number, type code or data format (CANopen: object \
                 1018:04)"
            ));
        }
        section.entry("without_checks", unidentified);
        section.line("");
        section.line("signals");
        let signals = profile.signals.iter().map(|signal| (signal, profile.device(signal.device)));
        let signals = signals.map(|(signal, device)| signal.preview(device, profile.bus(device.bus)));
        section.parts("signals", signals);
        if !profile.only_recorded.is_empty() {
            let names = profile.only_recorded.join(", ");
            section.line(format!(
                "  only recorded (no model, condition, output or machine state uses them): {names}"
            ));
        }
        section.entry("only_recorded", &profile.only_recorded);
        let mut all_over = UniformTemperature::shown(&profile.signals);
        section.parts("axes", profile.axes.iter().map(|axis| axis.preview(&profile.signals, &mut all_over)));
        section.line("");
        section.line("writes");
        section.parts("writes", profile.outputs.iter().map(|output| output.preview(profile)));
        let captures = profile.signals.iter().filter_map(|signal| {
            let device = &profile.device(signal.device).name;
            let (capture, name) = (signal.shown_capture()?, &signal.name);
            Some(format!("{capture} of {device}: written before each read of {name}, also in a dry run"))
        });
        let captures: Vec<String> = captures.collect();
        section.lines("  ", &captures);
        section.parts("sets", profile.sets.iter().map(|set| set.preview(profile)));
        let heartbeat = profile.heartbeat.as_ref();
        section.part("heartbeat", heartbeat.map(|beat| beat.preview(profile.device(beat.device))));
        if profile.outputs.is_empty() && captures.is_empty() && profile.heartbeat.is_none() {
            section.line("  nothing");
        }
        if profile.mqtt.is_some() {
            section.line("");
            section.line("publishes");
        }
        section.part("mqtt", profile.mqtt.as_ref().map(|mqtt| mqtt.preview(profile)));
        if profile.opcua_server.is_some() {
            section.line("");
            section.line("serves");
        }
        section.part("opcua_server", profile.opcua_server.as_ref().map(|server| server.preview()));
        if !profile.notify.is_empty() {
            section.line("");
            section.line("posts");
        }
        section.parts("notify", profile.notify.iter().map(|notify| notify.preview()));
        section.line("");
        section.part("stop", Some(stop::preview(profile)));
        Preview(section)
    }
}

impl fmt::Display for Preview {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
