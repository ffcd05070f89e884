//! Hardware units of a virtual machine, with their registers at power-on and their measured signals.

use crate::virtual_machine::can::{node, power_on};
use crate::virtual_machine::control::Control;
use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, DataType, Encoding, Register};
use isotherm_core::quantity::Counts;
use isotherm_core::reading::SignalId;
use isotherm_profile::{DeviceId, Expected, Output, Profile, Verify};

use super::can::CanUnit;
use super::scales;

/// Hardware unit: registers and state of one physical device.
#[derive(Debug)]
pub(super) struct Unit {
    /// First device of the profile with this unit.
    pub(super) device: DeviceId,
    pub(super) bank: Bank,
    pub(super) at_power_on: Bank,
    pub(super) requests: u64,
    /// Addresses and encodings of the registers in which the unit shows its number of starts, `boots`.
    pub(super) counters: Vec<(Address, Encoding)>,
    pub(super) boots: u16,
    /// CAN part of the unit; `None` for a unit on another line.
    pub(super) can: Option<CanUnit>,
    /// Signals that the unit measures. Signals in registers of an output or of the heartbeat are left out, because a
    /// client writes these registers.
    pub(super) measures: Vec<SignalId>,
}

impl Unit {
    /// Discards everything that was written to the unit, and counts the restart.
    pub(super) fn restart(&mut self) {
        self.bank = self.at_power_on.clone();
        self.boots = self.boots.wrapping_add(1);
        for (counter, encoding) in &self.counters {
            self.bank.set(counter, encoding.encode(f64::from(self.boots)).registers());
        }
    }
}

/// Returns the units, and for each device the position of its unit. Devices with the same unit number on one line share
/// a unit; on a CAN line each device has its own unit.
pub(super) fn units(profile: &Profile) -> (Vec<Unit>, Vec<usize>) {
    let mut units: Vec<Unit> = Vec::new();
    let mut unit_of = Vec::new();
    for (index, device) in profile.devices.iter().enumerate() {
        let line = &profile.bus(device.bus).address;
        let same = |unit: &Unit| {
            let other = profile.device(unit.device);
            let is_addressed = device.can.is_none() && other.can.is_none();
            is_addressed && other.unit == device.unit && profile.bus(other.bus).address == *line
        };
        let place = units.iter().position(same).unwrap_or(units.len());
        if place == units.len() {
            units.push(Unit {
                device: DeviceId(index),
                bank: Bank::default(),
                at_power_on: Bank::default(),
                requests: 0,
                counters: Vec::new(),
                boots: 0,
                can: None,
                measures: Vec::new(),
            });
        }
        unit_of.push(place);
    }
    let mut owned: Vec<(usize, Address, u16)> = Vec::new();
    for Output { device, address, encoding, verify, applied, .. } in &profile.outputs {
        let place = unit_of[device.0];
        let width = encoding.data_type.registers();
        let bank = &mut units[place].bank;
        bank.set(address, encoding.encode(0.0).registers());
        owned.push((place, address.clone(), width));
        if let Some(applied) = applied {
            bank.reserve(&applied.address.into(), applied.encoding.data_type.registers());
        }
        if let Verify::ReadBackAt(again) = verify {
            let again = Address::Object(*again);
            bank.reserve(&again, width);
            owned.push((place, again, width));
        }
    }
    let heartbeat = profile.heartbeat.iter();
    let heartbeat = heartbeat.filter_map(|beat| Some((beat.device, beat.address.register()?)));
    let of_sets = profile.sets.iter().flat_map(|set| Control::own(set).map(|at| (set.device, at)));
    let displays = profile
        .outputs
        .iter()
        .flat_map(|output| output.display.registers().map(|register| (output.device, register)));
    let commands = profile.signals.iter().filter_map(|signal| Some((signal.device, signal.capture?.address)));
    let single = heartbeat.chain(of_sets).chain(displays).chain(commands);
    owned.extend(single.map(|(device, register)| (unit_of[device.0], register.into(), 1)));
    let heartbeat = profile.heartbeat.iter();
    let heartbeat = heartbeat.filter_map(|beat| Some((beat.device, beat.address.node()?.clone())));
    let of_sets =
        profile.sets.iter().flat_map(|set| Control::own_nodes(set).map(move |node| (set.device, node)));
    owned.extend(heartbeat.chain(of_sets).map(|(device, node)| {
        let width = node.taken_as().registers();
        (unit_of[device.0], Address::Node(node), width)
    }));
    for (device, place) in profile.devices.iter().zip(&unit_of) {
        for Expected { address, encoding, equals, .. } in &device.verify {
            units[*place].bank.put(address, encoding, encoding.encode_counts(Counts(*equals)).registers());
        }
    }
    for signal in &profile.signals {
        let Some(from) = &signal.scale_from else { continue };
        let (place, address) = (unit_of[signal.device.0], Address::Modbus(from.address));
        let number = f64::from(from.number(scales::at_power_on(profile, signal)));
        units[place].bank.put(&address, &from.encoding, from.encoding.encode(number).registers());
        if !matches!(from.encoding.data_type, DataType::Part(_)) {
            owned.push((place, address, from.encoding.data_type.registers()));
        }
    }
    for output in &profile.outputs {
        let Some(counter) = output.boot_counter.map(|id| profile.signal(id)) else { continue };
        let (place, width) = (unit_of[output.device.0], counter.encoding.data_type.registers());
        units[place].counters.push((counter.address.clone(), counter.encoding.clone()));
        owned.push((place, counter.address.clone(), width));
    }
    for (place, address, count) in &owned {
        units[*place].bank.reserve(address, *count);
    }
    for (index, signal) in profile.signals.iter().enumerate() {
        let (place, width) = (unit_of[signal.device.0], signal.encoding.data_type.registers());
        units[place].bank.reserve(&signal.address, width);
        let is_owned = |(other, address, count): &(usize, Address, u16)| {
            *other == place && overlap((address, *count), (&signal.address, width))
        };
        let is_the_node_s = power_on::named(&signal.address).is_some_and(node::is_own);
        if !is_the_node_s && !owned.iter().any(is_owned) {
            units[place].measures.push(SignalId(index));
        }
    }
    for unit in &mut units {
        unit.can = CanUnit::of(profile, unit);
        unit.at_power_on = unit.bank.clone();
        unit.restart();
    }
    (units, unit_of)
}

/// Returns for each signal its value without a fault, if the signal indicates a fault of another signal. `None` for all
/// other signals.
pub(super) fn well(profile: &Profile) -> Vec<Option<f64>> {
    let mut well = vec![None; profile.signals.len()];
    for condition in profile.signals.iter().filter_map(|signal| signal.fault_when.as_ref()) {
        let healthy = [0.0, 1.0].into_iter().find(|value| condition.holds(&|_| Some(*value)) == Some(false));
        for id in condition.signals() {
            well[id.0] = well[id.0].or(healthy);
        }
    }
    well
}

pub(super) fn overlap((first, count): (&Address, u16), (other, other_count): (&Address, u16)) -> bool {
    let (Address::Modbus(first), Address::Modbus(other)) = (first, other) else { return first == other };
    let end = |register: &Register, count: u16| u32::from(register.offset) + u32::from(count);
    first.table == other.table
        && u32::from(first.offset) < end(other, other_count)
        && u32::from(other.offset) < end(first, count)
}
