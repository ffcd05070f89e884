//! `restart` of an output: a boot counter, by which a restart of the CNC is detected. The boot counter is a register or
//! node that changes at every start of the CNC. The gateway reads it as a signal of the device.

use std::collections::HashMap;
use std::time::Duration;

use super::device::Device;
use super::register::{plain, register};
use super::signal::Signal;
use super::signal::limits::DefaultLimits;
use super::signal::unit::Unit;
use super::{Check, KeyContext};
use crate::DeviceId;
use crate::kinds::opcua::nodes::{Place, read};
use isotherm_core::codec::{Address, DataType, Node};
use isotherm_core::reading::SignalId;

/// Boot counter of a device, with the signal by which the gateway reads it.
struct BootCounter {
    address: Address,
    signal: SignalId,
    /// Position in the profile where the first output names the boot counter, for example `profiles/x.toml:41`.
    line: String,
}

/// Adds one signal for each device whose outputs name a boot counter.
pub(super) fn boot_counters(check: &mut Check<'_>) {
    let mut known: HashMap<DeviceId, BootCounter> = HashMap::new();
    for place in 0..check.outputs.names.len() {
        let Some((device, address, line)) = boot_counter(check, place, &known) else { continue };
        let signal = match known.get(&device) {
            Some(same) => same.signal,
            None => {
                let signal = SignalId(check.signals.resolved.len());
                let Some(of) = check.devices.get(device.0) else { continue };
                let timeout = check.bus_of(of).map_or(Duration::ZERO, |bus| bus.timeout);
                let counter = counter(of, device, address.clone(), timeout);
                check.signals.resolved.push(Some(counter));
                known.insert(device, BootCounter { address, signal, line });
                signal
            }
        };
        if let Some(Some(output)) = check.outputs.resolved.get_mut(place) {
            output.boot_counter = Some(signal);
        }
    }
}

/// Returns the boot counter of an output: its device, its address, and its position in the profile. `None` if
/// the output has no boot counter, or if its boot counter is invalid. `known` contains the boot counters of
/// earlier outputs: a device has only one.
fn boot_counter(
    check: &Check<'_>,
    place: usize,
    known: &HashMap<DeviceId, BootCounter>,
) -> Option<(DeviceId, Address, String)> {
    let name = &check.outputs.names[place];
    let counts = check.raw.output.get(name)?.restart.as_ref()?.boot_counter.as_ref()?;
    let at = check.at("output").key(name).key("restart").key("boot_counter");
    let output = check.outputs.get(place)?;
    let address = counts_there(&at, counts, output.address.node().is_some())?;
    if output.writes.position().is_some() {
        let help = "remove `restart`: after a restart, a corrected position needs no new start of Cz";
        at.wrong_key("a corrected position is written each time the position is read", help);
        return None;
    }
    let device = check.devices.get(output.device.0)?;
    if let Some(register) = address.register() {
        device.must_read(&at, register.table);
    }
    let other = known.get(&output.device).filter(|known| known.address != address);
    if let Some(BootCounter { address, line, .. }) = other {
        let address = address.register().map_or_else(|| address.to_string(), |register| register.to_string());
        let message = format!("device `{}` already has its boot counter at {address} ({line})", device.name);
        let help = "a device restarts as a whole: write the same boot counter at all its outputs";
        return at.reject(message, help);
    }
    Some((output.device, address, at.line()))
}

/// Resolves the register or node of a boot counter. `is_in_nodes` is true if the device is an OPC UA server.
/// `None` if the register or node cannot be a boot counter, which is reported.
fn counts_there(at: &KeyContext<'_>, place: &Place, is_in_nodes: bool) -> Option<Address> {
    let text = match (place, is_in_nodes) {
        (Place::Register(text), false) => text,
        (Place::Node(raw), true) => return read(at, raw.node.as_ref(), raw.kind, None).map(Address::Node),
        _ => return place.is_foreign(at, is_in_nodes),
    };
    let address = register(at, Some(text))?;
    if address.table.is_bits() {
        let help = "write a holding or input register, as \"holding:98\"; for a single bit, use machine.on";
        return at.reject(format!("{address} is one bit, which cannot count"), help);
    }
    Some(address.into())
}

/// Creates the signal for a boot counter. The name of the signal contains a dot, and therefore differs from
/// all names in a profile.
fn counter(device: &Device, id: DeviceId, address: Address, timeout: Duration) -> Signal {
    let data_type = address.node().map_or(DataType::U16, Node::taken_as);
    Signal {
        label: String::new(),
        name: format!("{}.boot_counter", device.name),
        device: id,
        address,
        encoding: plain(data_type),
        scale_from: None,
        unit: Unit("count"),
        range: None,
        max_rate: None,
        defaults: DefaultLimits::default(),
        is_difference: false,
        max_age: (device.every * 5).max(timeout * 3),
        fault_when: None,
        merge: true,
        counter: None,
        capture: None,
    }
}
