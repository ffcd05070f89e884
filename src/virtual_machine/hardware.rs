//! Simulated hardware: plant, registers and faults, which are updated at each access.
//!
//! The registers are filled from the plant at the time of each request. Clients therefore cannot detect at which times
//! the plant itself advances.

use isotherm_core::codec::{Address, Counter, Encoding, Scale};
use isotherm_core::quantity::Moment;
use isotherm_profile::{AxisId, Capture, DeviceId, Output, OutputId, Profile, SetId, Signal, Writes};

use super::control::{AcceptedSet, Control};
use super::fault::{Faults, Kind, Reads, ReplyFault};
use super::journal::SeenRequest;
use super::modbus::{self, Request};
use super::plant::Plant;
use super::probing::Cycle;
use super::truth::{AxisTruth, Observer, TruthRow};
use super::wander::wander;

pub(super) mod can;
#[cfg(feature = "opcua")]
pub(super) mod nodes;
mod scales;
mod units;

use units::{Unit, overlap, units, well};

/// State of a virtual machine except its sockets: plant, units, controls and faults.
#[derive(Debug)]
pub(super) struct Hardware {
    profile: Profile,
    plant: Option<Plant>,
    seed: u64,
    begin: Moment,
    /// Hardware units. Devices with the same unit number on one line share a unit.
    units: Vec<Unit>,
    /// For each device: position of its unit in `units`.
    unit_of: Vec<usize>,
    /// For each signal: its value without a fault, if the signal indicates a fault of another signal. `None` for all
    /// other signals.
    well: Vec<Option<f64>>,
    /// For each output that writes a position plus Cz: written position minus measured position, µm. Zero for all other
    /// outputs.
    corrections: Vec<f64>,
    /// For each axis: offset that an external control applies, µm; `None` if there is no external control.
    elsewhere: Vec<Option<f64>>,
    /// Axes whose true error the plant simulates, with their names.
    axes: Vec<(AxisId, String)>,
    /// Virtual control of each output set.
    controls: Vec<Control>,
    /// Values that the controls have accepted. They are recorded only if the request journal is recorded.
    pub(super) taken: Vec<AcceptedSet>,
    cycles: Vec<Cycle>,
    pub(super) faults: Faults,
    pub(super) observer: Observer,
    /// All requests in order; `None` if requests are not recorded.
    pub(super) journal: Option<Vec<SeenRequest>>,
}

/// Correct answer of a unit, and the fault of the answer that is actually sent.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reply {
    /// Correct answer as a protocol data unit (Modbus answer without its frame); `None` if the unit ignores the
    /// request.
    pub(super) pdu: Option<Vec<u8>>,
    pub(super) fault: Option<ReplyFault>,
}

impl Hardware {
    pub(super) fn new(
        profile: &Profile,
        plant: Option<Plant>,
        seed: u64,
        mut faults: Faults,
        begin: Moment,
        cycles: Vec<Cycle>,
    ) -> Hardware {
        let (mut units, unit_of) = units(profile);
        units.iter_mut().filter_map(|unit| unit.can.as_mut()).for_each(|can| can.node.boot(begin));
        faults.rename(|device| units[unit_of[device.0]].device);
        let known = |axis: &str| plant.as_ref().is_some_and(|plant| plant.true_error_um(axis).is_some());
        let names = profile.axes.iter().map(|axis| axis.settings.name.clone()).enumerate();
        let axes: Vec<_> =
            names.map(|(place, name)| (AxisId(place), name)).filter(|(_, name)| known(name)).collect();
        let observer = Observer::new(axes.iter().map(|(_, name)| name), begin);
        let controls = profile.sets.iter().enumerate().map(|(place, set)| {
            let unit = unit_of[set.device.0];
            Control::new(profile, SetId(place), set, unit, &units[unit].bank)
        });
        Hardware {
            controls: controls.collect(),
            taken: Vec::new(),
            well: well(profile),
            corrections: vec![0.0; profile.outputs.len()],
            profile: profile.clone(),
            plant,
            seed,
            begin,
            units,
            unit_of,
            elsewhere: vec![None; profile.axes.len()],
            axes,
            cycles,
            faults,
            observer,
            journal: None,
        }
    }

    /// Advances the plant to `now`, and begins the faults that are due.
    pub(super) fn advance_to(&mut self, now: Moment) {
        if let Some(plant) = &mut self.plant {
            plant.advance_to(now);
        }
        let (units, unit_of) = (&self.units, &self.unit_of);
        let incidents = self.faults.advance(now, |device| units[unit_of[device.0]].requests);
        for (device, kind) in incidents {
            self.happen(self.unit_of[device.0], kind, now);
        }
        for control in &mut self.controls {
            let unit = &mut self.units[control.place];
            let taken = control.advance(&mut unit.bank, self.faults.acknowledges(unit.device, now), now);
            self.taken.extend(taken.filter(|_| self.journal.is_some()));
        }
        self.probe(now);
    }

    /// Runs the probing cycles that are due. An axis is skipped if its true error is not known.
    fn probe(&mut self, now: Moment) {
        for place in 0..self.cycles.len() {
            let axis = AxisId(self.cycles[place].axis);
            let name = &self.profile.axis(axis).settings.name;
            let error = self.plant.as_ref().and_then(|plant| plant.true_error_um(name));
            if let Some(error) = error.filter(|_| self.cycles[place].is_due(now)) {
                let left = error + self.applied_um(axis);
                self.cycles[place].measure(left, now);
            }
        }
    }

    /// Samples the true error and the applied Cz of each axis for the summary.
    pub(super) fn observe(&mut self, now: Moment) {
        let Some(plant) = &self.plant else { return };
        let axes = self.axes.iter().map(|(axis, name)| AxisTruth {
            error_um: plant.true_error_um(name).unwrap_or_default(),
            cz_um: self.applied_um(*axis),
        });
        let row = TruthRow { at: now, axes: axes.collect() };
        self.observer.sample(row);
    }

    /// Sets the offset in µm that an external control applies to an axis, instead of the virtual control.
    pub(super) fn applies_elsewhere(&mut self, axis: AxisId, cz_um: f64) {
        self.elsewhere[axis.0] = Some(cz_um);
    }

    /// Returns the Cz that acts in the machine, µm. This is the value that the control has accepted for the Cz output
    /// of the axis. Without such an output, it is the Cz in the written position of the axis. A diameter value is
    /// halved. An offset of an external control replaces both of these values.
    pub(super) fn applied_um(&self, axis: AxisId) -> f64 {
        if let Some(cz_um) = self.elsewhere[axis.0] {
            return cz_um;
        }
        let outputs = || self.profile.outputs.iter().enumerate().filter(|(_, output)| output.axis == axis);
        let current = |(place, output): (usize, &Output)| {
            let mut controls = self.controls.iter();
            match controls.find_map(|control| control.taken(OutputId(place))) {
                Some(words) => output.encoding.decode(words).ok(),
                None => self.decoded(output.device, &output.address, &output.encoding),
            }
        };
        let written = outputs()
            .find(|(_, output)| output.writes.is_cz())
            .map(|output| current(output).unwrap_or_default())
            .or_else(|| outputs().next().map(|(place, _)| self.corrections[place]))
            .unwrap_or_default();
        if self.profile.axis(axis).diameter { 0.5 * written } else { written }
    }

    /// Executes one Modbus request to a device, after an update of its measurements. Returns the answer and its fault.
    pub(super) fn serve(&mut self, device: DeviceId, pdu: &[u8], now: Moment) -> Reply {
        let place = self.unit_of[device.0];
        let device = self.units[place].device;
        self.units[place].requests += 1;
        self.advance_to(now);
        self.measure(place, now, None);
        let request = match Request::decode(pdu) {
            Ok(request) if self.profile.device(device).functions.allow(request.function) => request,
            Ok(request) => {
                let current = self.cells_of(place, &request);
                self.note(device, request, current.clone(), current, now);
                return Reply::honest(modbus::exception(pdu, modbus::ILLEGAL_FUNCTION));
            }
            Err(code) => return Reply::honest(modbus::exception(pdu, code)),
        };
        self.faults.count_signals(device, now);
        let fault = self.faults.reply(device, request.is_write(), now);
        let before = self.cells_of(place, &request);
        let reply = self.carry_out(place, &request, pdu, fault);
        if let [value] = request.values[..] {
            self.measure(place, now, Some(Capture { address: request.address, value }));
        }
        if request.is_write() {
            self.check_controls(place, now);
        }
        let after = self.cells_of(place, &request);
        self.note(device, request, before, after, now);
        reply
    }

    fn check_controls(&mut self, place: usize, now: Moment) {
        for control in self.controls.iter_mut().filter(|control| control.place == place) {
            let taken = control.check(&self.units[place].bank, now);
            self.taken.extend(taken.filter(|_| self.journal.is_some()));
        }
    }

    fn note(&mut self, device: DeviceId, request: Request, before: Vec<u16>, after: Vec<u16>, at: Moment) {
        let Some(journal) = &mut self.journal else { return };
        let Request { function, address, count, values: wanted } = request;
        journal.push(SeenRequest {
            at,
            device,
            function,
            address: address.into(),
            count,
            before,
            after,
            wanted,
        });
    }

    /// Returns the content of the cells (registers or bits) that a request addresses. Returns an empty list if they do
    /// not exist, or if the machine records no request journal.
    fn cells_of(&self, place: usize, request: &Request) -> Vec<u16> {
        let bank = self.journal.as_ref().map(|_| &self.units[place].bank);
        bank.and_then(|bank| bank.registers(request.address, request.count)).unwrap_or_default().to_vec()
    }

    fn carry_out(&mut self, place: usize, request: &Request, pdu: &[u8], fault: Option<ReplyFault>) -> Reply {
        let unit = &mut self.units[place];
        let answer = match fault {
            Some(ReplyFault::Silent | ReplyFault::HalfOpen) => return Reply { pdu: None, fault },
            Some(ReplyFault::Exception(code)) => Err(code),
            Some(ReplyFault::IgnoredWrite) => request.answer(pdu, &mut unit.bank.clone()),
            _ => request.answer(pdu, &mut unit.bank),
        };
        if answer.is_ok() && request.is_write() && fault != Some(ReplyFault::IgnoredWrite) {
            self.note_corrections(place, &request.address.into(), request.count);
        }
        Reply { pdu: Some(answer.unwrap_or_else(|code| modbus::exception(pdu, code))), fault }
    }

    /// Writes current measurements to the registers of a unit. If `command` is `None`, the function writes
    /// the continuous measurements. Otherwise, it writes the measurements that this command captures.
    fn measure(&mut self, place: usize, now: Moment, command: Option<Capture>) {
        let seconds = now.since(self.begin).as_secs_f64();
        let unit = &mut self.units[place];
        let broken: Vec<_> = self.faults.signals(unit.device, now).collect();
        for id in &unit.measures {
            let signal = &self.profile.signals[id.0];
            if signal.capture != command {
                continue;
            }
            let known = self.plant.as_ref().and_then(|plant| plant.sensor(&signal.name));
            let probed = self.cycles.iter().find_map(|cycle| cycle.shows(*id, signal, now));
            let value =
                probed.or(known).or(self.well[id.0]).unwrap_or_else(|| wander(signal, self.seed, seconds));
            let reads = broken.iter().find(|(broken, _)| broken == id).map(|(_, reads)| *reads);
            let encoding = scales::encoding(signal, &unit.bank);
            let cells = cells(signal, &encoding, reads.unwrap_or(Reads::Value(value)));
            unit.bank.put(&signal.address, &encoding, &cells);
        }
        self.apply(place);
    }

    /// Copies each written value to the register in which the control reports its applied value, because the virtual
    /// control applies values at once.
    fn apply(&mut self, place: usize) {
        for output in &self.profile.outputs {
            let Some(applied) = output.applied.as_ref().filter(|_| self.unit_of[output.device.0] == place)
            else {
                continue;
            };
            if let Some(value) = self.decoded(output.device, &output.address, &output.encoding) {
                let words = applied.encoding.encode(value);
                self.units[place].bank.set(&applied.address.into(), words.registers());
            }
        }
    }

    /// Updates the correction of each output that was written, if it writes a position plus Cz. The correction is the
    /// written position minus the position that the scale showed last.
    fn note_corrections(&mut self, place: usize, address: &Address, count: u16) {
        for (index, output) in self.profile.outputs.iter().enumerate() {
            let Writes::Corrected { position } = output.writes else { continue };
            let width = output.encoding.data_type.registers();
            let touched =
                self.unit_of[output.device.0] == place && overlap((&output.address, width), (address, count));
            let scale = self.profile.signal(position);
            if !touched {
                continue;
            }
            let of_scale = scales::encoding(scale, &self.units[self.unit_of[scale.device.0]].bank);
            if let (Some(corrected), Some(shown)) = (
                self.decoded(output.device, &output.address, &output.encoding),
                self.decoded(scale.device, &scale.address, &of_scale),
            ) {
                self.corrections[index] = 1000.0 * (corrected - shown);
            }
        }
    }

    /// Executes a fault that happens to a unit only once: a write by another client, or a restart.
    fn happen(&mut self, place: usize, kind: Kind, now: Moment) {
        match kind {
            Kind::Register { address: register, words } => {
                let count = u16::try_from(words.len()).unwrap_or(u16::MAX);
                let address = &Address::Modbus(register);
                self.units[place].bank.set(address, &words);
                self.note_corrections(place, address, count);
                self.check_controls(place, now);
            }
            Kind::Restart => self.restart(place, now),
            _ => {}
        }
    }

    /// Restarts a unit. The unit loses all values that were written to it.
    fn restart(&mut self, place: usize, now: Moment) {
        let unit = &mut self.units[place];
        unit.restart();
        if let Some(can) = &mut unit.can {
            can.node.boot(now);
        }
        for control in self.controls.iter_mut().filter(|control| control.place == place) {
            let taken = control.restart(&unit.bank, now);
            self.taken.extend(self.journal.is_some().then_some(taken));
        }
        for (output, correction) in self.profile.outputs.iter().zip(&mut self.corrections) {
            if self.unit_of[output.device.0] == place {
                *correction = 0.0;
            }
        }
    }

    /// Returns the content of `count` cells (registers or bits) of a device; `None` if one of the cells does not exist.
    #[cfg(test)]
    pub(super) fn cell(&self, device: DeviceId, address: &Address, count: u16) -> Option<&[u16]> {
        self.units[self.unit_of[device.0]].bank.read(address, count)
    }

    fn decoded(&self, device: DeviceId, address: &Address, encoding: &Encoding) -> Option<f64> {
        let bank = &self.units[self.unit_of[device.0]].bank;
        let words = bank.read(address, encoding.data_type.registers())?;
        if address.is_bit() {
            return words.first().and_then(|bit| encoding.decode_bit(*bit != 0).ok());
        }
        encoding.decode(words).ok()
    }
}

impl Reply {
    fn honest(pdu: Vec<u8>) -> Reply {
        Reply { pdu: Some(pdu), fault: None }
    }
}

/// Returns the register values with which a signal with this encoding shows this value.
fn cells(signal: &Signal, encoding: &Encoding, reads: Reads) -> Vec<u16> {
    let encoded = match reads {
        Reads::Value(value) if signal.counter.is_some() => Counter::registers(encoding, value),
        Reads::Value(value) => encoding.encode(value),
        Reads::Raw(raw) => {
            let plain = Encoding { scale: Scale::ONE, offset: 0.0, bias: 0, ..encoding.clone() };
            plain.encode(exact(raw))
        }
        Reads::Nan => return not_a_number(encoding),
    };
    let mut words = encoded.registers().to_vec();
    if signal.address.is_bit() {
        words.iter_mut().for_each(|word| *word = (*word).min(1));
    }
    words
}

/// Returns the register values of a quiet NaN, in either word order: all exponent bits and one mantissa bit are set.
fn not_a_number(encoding: &Encoding) -> Vec<u16> {
    let width = usize::from(encoding.data_type.registers());
    let highest = if encoding.byte_swap { 0x7fff_u16.swap_bytes() } else { 0x7fff };
    let mut words = vec![0xffff; width];
    let at = match encoding.word_order {
        isotherm_core::codec::WordOrder::MswFirst => 0,
        isotherm_core::codec::WordOrder::LswFirst => width.saturating_sub(1),
    };
    if let Some(word) = words.get_mut(at) {
        *word = highest;
    }
    words
}

/// Converts a raw value to `f64`. Raw values in scripts are far below 2^53, so the result is exact.
#[allow(clippy::cast_precision_loss)]
fn exact(raw: i64) -> f64 {
    raw as f64
}
