//! Boot counters: a register of the CNC that changes at every start, read as a signal of its device.

use std::time::Duration;

use super::{Check, bus_of, get};
use crate::place::child;
use crate::{Bus, Device, DeviceId, Output, Signal, Unit, Writes};
use isotherm_core::codec::{DataType, Encoding, Register, Scale, WordOrder};
use isotherm_core::reading::SignalId;

impl Check<'_> {
    /// Adds one signal for each device whose outputs name a boot counter.
    pub(super) fn boot_counters(
        &mut self,
        outputs: &mut [Option<Output>],
        signals: &mut Vec<Option<Signal>>,
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) {
        let raw = self.raw;
        let mut known: Vec<(DeviceId, Register, SignalId, String)> = Vec::new();
        for ((_, name, path), output) in self.outputs.each().into_iter().zip(outputs) {
            let Some(restart) = raw.output.get(&name).and_then(|raw| raw.restart.as_ref()) else { continue };
            let path = child(&child(&path, "restart"), "boot_counter");
            let Some(text) = &restart.boot_counter else { continue };
            let address = self.boot_counter(&path, text);
            let (Some(address), Some(output)) = (address, output) else { continue };
            if matches!(output.writes, Writes::Corrected { .. }) {
                let help = "remove `restart`: nothing has to walk in again there";
                self.wrong_key(&path, "a corrected position is written anew with each position", help);
                continue;
            }
            let Some(device) = get(devices, output.device.0) else { continue };
            self.readable(&path, address.table, device);
            match known.iter().find(|(device, ..)| *device == output.device) {
                Some((_, same, id, _)) if *same == address => output.boot_counter = Some(*id),
                Some((_, other, _, at)) => {
                    let there = self.places.line_of(at);
                    let message =
                        format!("`{}` has its boot counter at {other} already ({there})", device.name);
                    self.wrong(
                        &path,
                        message,
                        "a device is started as a whole: give its outputs the same one",
                    );
                }
                None => {
                    let id = SignalId(signals.len());
                    signals.push(Some(counter(device, output.device, address, bus_of(device, buses))));
                    output.boot_counter = Some(id);
                    known.push((output.device, address, id, path));
                }
            }
        }
    }

    fn boot_counter(&mut self, path: &str, text: &str) -> Option<Register> {
        let address = self.address(path, text)?;
        if address.table.is_bits() {
            let help =
                "write a holding or input register, as \"holding:98\"; one bit is watched by machine.on";
            self.wrong(path, format!("{address} is one bit: it cannot count"), help);
            return None;
        }
        Some(address)
    }
}

/// The dot keeps its name apart from those that a profile can give.
fn counter(device: &Device, id: DeviceId, address: Register, bus: Option<&Bus>) -> Signal {
    let timeout = bus.map_or(Duration::ZERO, |bus| bus.timeout);
    Signal {
        name: format!("{}.boot_counter", device.name),
        device: id,
        address: address.into(),
        encoding: Encoding {
            data_type: DataType::U16,
            word_order: WordOrder::MswFirst,
            byte_swap: false,
            scale: Scale::ONE,
            offset: 0.0,
            bias: 0,
            bad: Vec::new(),
        },
        unit: Unit("count"),
        range: None,
        max_rate: None,
        max_age: (device.every * 5).max(timeout * 3),
        fault_when: None,
        merge: true,
        counter: None,
        capture: None,
    }
}
