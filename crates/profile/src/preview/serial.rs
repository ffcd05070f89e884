//! Preview of a serial port, with the share of its time for polls.

use super::load::ms;
use super::traffic::read_frames;
use crate::document::{Section, entries};
use crate::{BusId, Profile, Serial};

/// Preview of the settings of a serial port, and of the time that polls take without the answer times of the devices.
pub(super) fn preview(profile: &Profile, id: BusId, serial: Serial) -> Section {
    let (settings, character, silence) = (serial.to_string(), ms(serial.character()), ms(serial.silence()));
    let mut section = Section::default();
    section.line(format!(
        "  {settings}: {character:.2} ms a character, {silence:.2} ms silence before a request"
    ));
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
