//! Exchanges (request and answer) on each bus line, and how often each exchange takes place: polls, heartbeat, outputs,
//! output sets. The calculation has no side effects.

use std::time::Duration;

use crate::kinds::modbus::frames::{
    cells_read, holding, read_frames, register_for, registers_read, write_frames,
};
use crate::plan::{ReadRequest, ReadTarget};
use crate::{Bit, Capture, DeviceId, Output, OutputSet, Profile, Share, Stretch, Writes};
use isotherm_core::codec::Address;
use isotherm_core::reading::SignalId;

/// Number of reads of the acknowledge bit in one handshake: one before the strobe signal, two when the bit rises, two
/// when it falls. The second read of each pair follows one cycle of the control (CNC) later.
const ASKS: u8 = 5;

/// Exchange (request and answer) with one device, repeated at a constant rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exchange {
    pub(super) device: DeviceId,
    pub(super) per_second: f64,
    /// Length of the request on a serial line in bytes, with unit and checksum.
    pub(super) question: usize,
    pub(super) answer: usize,
    /// Whether the exchange belongs to an output or the heartbeat. `false` if it reads a signal.
    pub(super) writes: bool,
}

/// Returns all exchanges on each line, in the order of the buses. Cz of every axis is assumed to change at
/// each update.
pub(super) fn traffic(profile: &Profile) -> Vec<Vec<Exchange>> {
    let mut traffic = Traffic { profile, asked: vec![Vec::new(); profile.buses.len()] };
    traffic.polls();
    traffic.heartbeat();
    for output in profile.outputs.iter().filter(|output| output.set.is_none()) {
        traffic.output(output);
    }
    profile.sets.iter().for_each(|set| traffic.set(set));
    traffic.asked
}

struct Traffic<'a> {
    profile: &'a Profile,
    /// Exchanges that have been collected so far, for each line by the index of its bus.
    asked: Vec<Vec<Exchange>>,
}

impl Traffic<'_> {
    fn ask(&mut self, device: DeviceId, per_second: f64, writes: bool, (question, answer): (usize, usize)) {
        if per_second > 0.0 {
            let bus = self.profile.device(device).bus;
            self.asked[bus.0].push(Exchange { device, per_second, question, answer, writes });
        }
    }

    fn polls(&mut self) {
        let profile = self.profile;
        for (place, device) in profile.devices.iter().enumerate() {
            let (id, per_second) = (DeviceId(place), per(device.every));
            let mut captures: Vec<Capture> = Vec::new();
            for capture in profile.signals_of(id).filter_map(|(_, signal)| signal.capture) {
                if !captures.contains(&capture) {
                    captures.push(capture);
                }
            }
            for capture in captures {
                self.ask(id, per_second, false, write_frames(device, capture.address, 1));
            }
            for request in profile.requests(id) {
                for _ in 0..transfers_of(&request) {
                    self.ask(id, per_second, false, read_frames(&request));
                }
            }
        }
    }

    fn heartbeat(&mut self) {
        if let Some(heartbeat) = &self.profile.heartbeat {
            let at = register_for(&heartbeat.address);
            let frames = write_frames(self.profile.device(heartbeat.device), at, 1);
            self.ask(heartbeat.device, per(heartbeat.every), true, frames);
        }
    }

    fn output(&mut self, output: &Output) {
        let every = self.profile.axis(output.axis).settings.every;
        self.applied(output, per(every));
        let again = refreshes(every, output.refresh);
        match (output.writes, output.share) {
            (Writes::Corrected { position }, _) => {
                let often = self.position(position);
                self.write(output, often);
                self.read_back(output, often, 1.0);
            }
            // Between the reads the promise is written to disk, so that an operator's write in between is detected.
            (_, Share::Ledger) => {
                self.write(output, per(every));
                self.read_back(output, per(every), 3.0);
            }
            // Constant, which is written only if the register holds another value.
            (Writes::Reference, Share::Whole) => {
                let often = output.refresh.map_or(0.0, per);
                self.write(output, often);
                self.read_back(output, often, 2.0);
            }
            (Writes::Offset | Writes::Intercept | Writes::Slope, Share::Whole) => {
                let often = per(every) + again;
                self.write(output, often);
                self.read_back(output, often, 2.0);
            }
        }
    }

    /// Returns how often per second a position is read. The gateway adds Cz to each reading and writes the sum.
    fn position(&self, position: SignalId) -> f64 {
        let signal = self.profile.signal(position);
        let device = self.profile.device(signal.device);
        let sync = self.profile.bus(device.bus).sync.filter(|_| !is_asked_for(&signal.address));
        per(sync.map_or(device.every, |sync| sync.every))
    }

    /// Adds the writes of an output's value. For a digit display, the writes include the additional registers.
    fn write(&mut self, output: &Output, per_second: f64) {
        if !is_asked_for(&output.address) {
            return;
        }
        let device = self.profile.device(output.device);
        let registers = output.encoding.data_type.registers();
        if output.display.beside.is_empty() {
            let at = register_for(&output.address);
            for _ in 0..transfers(&output.address, registers) {
                self.ask(output.device, per_second, true, write_frames(device, at, registers));
            }
            return;
        }
        let value = output.cells(&[0; 4][..usize::from(registers).min(4)]).map(|(register, _)| register);
        let beside = output.display.beside.iter().map(|beside| beside.register);
        let cells = value.chain(beside).map(|register| (register, 1)).collect();
        for stretch in Stretch::joined(cells, device.longest_request()) {
            self.ask(
                output.device,
                per_second,
                true,
                write_frames(device, holding(stretch.from), stretch.count),
            );
        }
    }

    /// Adds the reads of the value that the control reports as applied: one after each change, and one when the control
    /// has applied it.
    fn applied(&mut self, output: &Output, per_second: f64) {
        if let Some(applied) = &output.applied {
            let registers = applied.encoding.data_type.registers();
            self.ask(output.device, 2.0 * per_second, true, registers_read(registers));
        }
    }

    /// Adds `times` reads for each write, if the gateway verifies the output by reading the value back.
    fn read_back(&mut self, output: &Output, per_second: f64, times: f64) {
        let from = output.reads_at();
        if !output.verify.reads() || !is_asked_for(&from) {
            return;
        }
        let registers = output.encoding.data_type.registers();
        for _ in 0..transfers(&from, registers) {
            self.ask(output.device, times * per_second, true, registers_read(registers));
        }
    }

    /// Adds the exchanges of an output set: all registers are read, written and read again, with the handshake in
    /// between.
    fn set(&mut self, set: &OutputSet) {
        let device = self.profile.device(set.device);
        let moving = set.members(self.profile).filter(|output| output.writes != Writes::Reference);
        let mut periods: Vec<Duration> =
            moving.map(|output| self.profile.axis(output.axis).settings.every).collect();
        periods.sort_unstable();
        let refresh = set.members(self.profile).filter_map(|output| output.refresh).min();
        let often = match periods.first() {
            Some(shortest) => together(&periods) + refreshes(*shortest, refresh),
            None => refresh.map_or(0.0, per),
        };
        for stretch in set.stretches(set.members(self.profile), device.longest_request()) {
            let at = holding(stretch.from);
            self.ask(set.device, 2.0 * often, true, registers_read(stretch.count));
            self.ask(set.device, often, true, write_frames(device, at, stretch.count));
        }
        if set.is_in_nodes(self.profile) {
            self.ask(set.device, 2.0 * often, true, registers_read(1));
            self.ask(set.device, often, true, write_frames(device, holding(0), 1));
        }
        if let Some(handshake) = &set.handshake {
            let register = |bit: &Bit| register_for(&bit.address());
            let asked = cells_read(register(&handshake.acknowledge).table, 1);
            self.ask(set.device, f64::from(ASKS) * often, true, asked);
            let strobe = write_frames(device, register(&handshake.strobe), 1);
            self.ask(set.device, 2.0 * often, true, strobe);
        }
    }
}

/// Returns whether the gateway requests the value at this address. Values in CAN frames arrive without a request.
fn is_asked_for(address: &Address) -> bool {
    !address.is_in_frames()
}

/// Returns the number of exchanges for one value. A CANopen object of more than four bytes is transferred in segments
/// of seven bytes.
fn transfers(address: &Address, registers: u16) -> usize {
    if matches!(address, Address::Object(_)) { segments(registers) } else { 1 }
}

/// Returns the number of exchanges for one read request.
fn transfers_of(request: &ReadRequest) -> usize {
    let registers = request.fields.iter().map(|field| field.len).sum();
    if matches!(request.asks, ReadTarget::Object(_)) { segments(registers) } else { 1 }
}

fn segments(registers: u16) -> usize {
    let bytes = 2 * usize::from(registers);
    if bytes > 4 { 1 + bytes.div_ceil(7) } else { 1 }
}

fn per(every: Duration) -> f64 {
    1.0 / every.as_secs_f64()
}

/// Returns how often per second `refresh` repeats an unchanged value. The value changes once in `every`, and each
/// change restarts the refresh period.
fn refreshes(every: Duration, refresh: Option<Duration>) -> f64 {
    refresh.map_or(0.0, |refresh| {
        let spans = (every.as_secs_f64() / refresh.as_secs_f64()).ceil();
        (spans - 1.0).max(0.0) * per(every)
    })
}

/// Returns the updates per second of axes with these update periods. Simultaneous updates of several axes count once.
/// The periods must be sorted from the shortest to the longest.
fn together(periods: &[Duration]) -> f64 {
    let own = periods.iter().enumerate().filter(|(place, period)| {
        periods[..*place].iter().all(|shorter| !period.as_nanos().is_multiple_of(shorter.as_nanos()))
    });
    own.map(|(_, period)| per(*period)).sum()
}
