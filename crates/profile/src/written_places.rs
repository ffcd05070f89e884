//! Lists the registers, nodes, objects and frames that a gateway writes, as texts, so that two profiles can be
//! compared.

use std::collections::BTreeSet;

use crate::kinds::KINDS;
use crate::{DeviceId, Profile};
use isotherm_core::codec::{Address, Register, Table};

impl Profile {
    /// Returns, for each bus, every register, node, object and frame that a gateway with this profile writes: `unit 1
    /// holding:104`, `node ns=2;i=5`, `node 5 object 6110:01`, `frame 0x20c`. Each register of a value is a separate
    /// entry.
    pub fn written_places(&self) -> Vec<BTreeSet<String>> {
        let mut written = Written { profile: self, places: vec![BTreeSet::new(); self.buses.len()] };
        for output in &self.outputs {
            written.value(output.device, &output.address, output.encoding.data_type.registers());
            output.display.registers().for_each(|register| written.register(output.device, register));
        }
        for set in &self.sets {
            // Includes registers between the words of a set that it writes as zeros.
            for stretch in set.stretches(set.members(self), self.device(set.device).longest_request()) {
                let from = Register { table: Table::Holding, offset: stretch.from };
                written.value(set.device, &Address::Modbus(from), stretch.count);
            }
            for (_, node) in set.own_nodes() {
                written.value(set.device, &Address::Node(node.clone()), 1);
            }
            if let Some(handshake) = &set.handshake {
                written.value(set.device, &handshake.strobe.address(), 1);
            }
        }
        if let Some(heartbeat) = &self.heartbeat {
            written.value(heartbeat.device, &heartbeat.address, heartbeat.data_type().registers());
        }
        for signal in &self.signals {
            let capture = signal.capture.map(|capture| capture.address);
            capture.into_iter().for_each(|register| written.register(signal.device, register));
        }
        for (place, device) in self.devices.iter().enumerate() {
            for setup in device.can.iter().flat_map(|can| &can.setup) {
                written.value(DeviceId(place), &Address::Object(setup.object), 1);
            }
        }
        written.places
    }
}

struct Written<'p> {
    profile: &'p Profile,
    /// Registers, nodes, objects and frames that were found so far, as texts, for each bus by its index.
    places: Vec<BTreeSet<String>>,
}

impl Written<'_> {
    fn register(&mut self, device: DeviceId, at: Register) {
        self.value(device, &Address::Modbus(at), 1);
    }

    /// Adds the registers, node, object or frame of a value. `count` is the number of registers.
    fn value(&mut self, device: DeviceId, address: &Address, count: u16) {
        let device = self.profile.device(device);
        let places = KINDS.iter().flat_map(|kind| (kind.written)(device.unit, address, count));
        self.places[device.bus.0].extend(places);
    }
}
