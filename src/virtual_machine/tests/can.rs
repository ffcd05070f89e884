//! Tests of the devices on a CAN line, without a socket. Frames are in candump format, times in milliseconds.

use super::*;
use crate::virtual_machine::fault::BusError;
use crate::virtual_machine::hardware::Hardware;
use crate::virtual_machine::hardware::can::Sent;
use isotherm_core::codec::{Address, CanId, Frame};
use isotherm_core::quantity::Moment;

mod faults;
mod frames;
mod led;
mod machine;
mod node;

use machine::can_machine;

/// Devices of the machine on their line.
struct Rig {
    hardware: Hardware,
    places: Vec<usize>,
}

fn at(milliseconds: u64) -> Moment {
    Moment::from_nanos(1_000_000_000_000).after(Duration::from_millis(milliseconds))
}

/// Parses a frame such as `705#7F`: a hexadecimal identifier, `#`, and bytes.
fn frame(text: &str) -> Frame {
    let (id, data) = text.split_once('#').unwrap();
    let raw = u32::from_str_radix(id, 16).unwrap();
    let id = if id.len() > 3 { CanId::extended(raw) } else { CanId::standard(raw) };
    let byte = |place: usize| u8::from_str_radix(&data[place..place + 2], 16).unwrap();
    let data: Vec<u8> = (0..data.len()).step_by(2).map(byte).collect();
    Frame::classic(id.unwrap(), &data).unwrap()
}

impl Rig {
    fn new(faults: &str) -> Rig {
        let profile = can_machine();
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let faults = Faults::new(faults, at(0));
        let mut hardware = Hardware::new(&profile, None, 1, faults, at(0), Vec::new());
        hardware.journal = Some(Vec::new());
        Rig { hardware, places: (0..profile.devices.len()).collect() }
    }

    /// All frames sent until this time, with their times.
    fn until(&mut self, milliseconds: u64) -> Vec<(u64, Sent)> {
        let mut sent = Vec::new();
        loop {
            let due = self.hardware.can_due(&self.places).filter(|due| *due <= at(milliseconds));
            let Some(due) = due else { break };
            let now = u64::try_from(due.since(at(0)).as_millis()).unwrap();
            let said = self.hardware.can_tick(&self.places, due);
            sent.extend(said.into_iter().map(|sent| (now, sent)));
        }
        let last = self.hardware.can_tick(&self.places, at(milliseconds));
        sent.extend(last.into_iter().map(|sent| (milliseconds, sent)));
        sent
    }

    /// Frames with these identifiers sent until this time.
    fn heard(&mut self, milliseconds: u64, wanted: &[&str]) -> Vec<String> {
        let is_wanted = |text: &String| wanted.iter().any(|id| text.split('#').next() == Some(id));
        let sent = self.until(milliseconds);
        let texts = sent.into_iter().filter_map(|(at, sent)| Some((at, text(&sent)?)));
        texts.filter(|(_, text)| is_wanted(text)).map(|(at, text)| format!("{at} {text}")).collect()
    }

    /// Frames sent at once in answer to this frame.
    fn give(&mut self, milliseconds: u64, text: &str) -> Vec<String> {
        let frame = frame(text);
        let sent = self.hardware.can_take(&self.places, &frame, at(milliseconds));
        sent.iter().filter_map(self::text).collect()
    }

    fn start_all(&mut self) {
        self.until(0);
        self.give(0, "000#0100");
    }

    fn cell(&self, device: usize, address: &Address, count: u16) -> Vec<u16> {
        self.hardware.cell(DeviceId(device), address, count).unwrap().to_vec()
    }
}

fn text(sent: &Sent) -> Option<String> {
    match sent {
        Sent::Frame(frame, _) => Some(frame.to_string()),
        Sent::Error(_) => None,
    }
}
