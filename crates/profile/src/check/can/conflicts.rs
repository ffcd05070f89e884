//! What cannot be on one CAN line together: node numbers, identifiers, writers.

use crate::check::{Check, Signals, get};
use crate::place::child;
use crate::raw::RawSignal;
use crate::{Bus, Device, DeviceId, Output, Writes};
use isotherm_core::codec::{Address, CanId, Entry, Field, Object};

/// A CANopen node of a line.
#[derive(Clone, Debug)]
struct Node {
    number: u8,
    device: String,
    index: usize,
}

impl Check<'_> {
    /// Everything that two things on one line would do to each other.
    pub(in crate::check) fn can_conflicts(
        &mut self,
        buses: &[Option<Bus>],
        devices: &[Option<Device>],
        signals: &Signals,
        outputs: &[Option<Output>],
    ) {
        for bus in 0..buses.len() {
            let nodes = self.nodes(bus, devices);
            self.sync_identifier(bus, buses, &nodes);
            self.read_identifiers(bus, buses, devices, signals, &nodes);
            self.written_identifiers(bus, buses, devices, signals, &nodes);
        }
        self.objects_written(devices, signals, outputs);
    }

    /// The nodes of a line; one number names one node.
    fn nodes(&mut self, bus: usize, devices: &[Option<Device>]) -> Vec<Node> {
        let mut nodes: Vec<Node> = Vec::new();
        for (index, device) in devices.iter().enumerate() {
            let Some(device) = device.as_ref().filter(|device| device.bus.0 == bus) else { continue };
            let Some(number) = device.can.as_ref().and_then(|can| can.node) else { continue };
            if let Some(first) = nodes.iter().find(|known| known.number == number).cloned() {
                let there = self.places.line_of(&child(&child("device", &first.device), "node"));
                let message = format!("`{}` is node {number} of this line already ({there})", first.device);
                let help = "each node of a line has its own number, set at the device";
                self.wrong(&child(&child("device", &device.name), "node"), message, help);
            }
            nodes.push(Node { number, device: device.name.clone(), index });
        }
        nodes
    }

    fn sync_identifier(&mut self, bus: usize, buses: &[Option<Bus>], nodes: &[Node]) {
        let Some((bus, sync)) = get(buses, bus).and_then(|bus| Some((bus, bus.sync?))) else { return };
        let what = taken(sync.id, None, nodes, true).or_else(|| sent_by_a_node(sync.id, nodes));
        if let Some((what, _)) = what {
            let path = child(&child(&child("bus", &bus.name), "sync"), "cob_id");
            self.wrong(
                &path,
                format!("{} is {what}", sync.id),
                "remove it: SYNC is 0x80 unless the nodes are set otherwise",
            );
        }
    }

    fn read_identifiers(
        &mut self,
        bus: usize,
        buses: &[Option<Bus>],
        devices: &[Option<Device>],
        signals: &Signals,
        nodes: &[Node],
    ) {
        let sync = get(buses, bus).and_then(|bus| bus.sync).map(|sync| sync.id);
        for signal in signals.iter().flatten() {
            let Address::Frame(Field { frames, .. }) = signal.address else { continue };
            let Some(device) = get(devices, signal.device.0).filter(|device| device.bus.0 == bus) else {
                continue;
            };
            if !frames.is_exact() {
                continue;
            }
            let Some(raw) = self.raw.signal.get(&signal.name) else { continue };
            let path = identifier_key(&child("signal", &signal.name), raw);
            let is_pdo = raw.pdo.is_some();
            let what = taken(frames.id, sync, nodes, is_pdo);
            let what = what.or_else(|| sent_by_another(frames.id, nodes, signal.device.0, &device.name));
            if let Some((what, help)) = what {
                self.wrong(&path, format!("{} is {what}", frames.id), help);
            }
        }
    }

    fn written_identifiers(
        &mut self,
        bus: usize,
        buses: &[Option<Bus>],
        devices: &[Option<Device>],
        signals: &Signals,
        nodes: &[Node],
    ) {
        let sync = get(buses, bus).and_then(|bus| bus.sync).map(|sync| sync.id);
        let here = |device: usize| get(devices, device).is_some_and(|device| device.bus.0 == bus);
        let written: Vec<_> = self.written.iter().filter(|one| here(one.device)).cloned().collect();
        for (place, one) in written.iter().enumerate() {
            let path =
                if one.path.ends_with("pdo") { child(&one.path, "cob_id") } else { child(&one.path, "id") };
            let (id, is_pdo) = (one.id, one.path.ends_with("pdo"));
            let what = taken(id, sync, nodes, is_pdo).or_else(|| sent_by_a_node(id, nodes));
            let what = what.or_else(|| received_by_another(id, nodes, one.device));
            if let Some((what, help)) = what {
                self.wrong(&path, format!("{id} is {what}"), help);
            }
            let other = written[..place].iter().find(|other| other.id == id && other.device != one.device);
            if let Some(other) = other {
                let there = self.places.line_of(&other.path);
                let message =
                    format!("output `{}` of another device at {there} writes {id} already", other.output);
                self.wrong(
                    &path,
                    message,
                    "one frame belongs to one device: put both outputs there, or correct the identifier",
                );
            }
            for signal in signals.iter().flatten() {
                let is_read = matches!(&signal.address, Address::Frame(field) if field.frames.takes(id));
                if here(signal.device.0) && is_read {
                    let message =
                        format!("signal `{}` is read from {id}, which this output would send", signal.name);
                    self.wrong(
                        &path,
                        message,
                        "a frame has one sender: read another identifier, or write another",
                    );
                }
            }
        }
    }

    /// One object has one writer, and a corrected position is not the object it is computed from.
    fn objects_written(&mut self, devices: &[Option<Device>], signals: &Signals, outputs: &[Option<Output>]) {
        let mut known: Vec<((DeviceId, Entry), String)> = Vec::new();
        for output in outputs.iter().flatten() {
            let Address::Object(Object { entry, .. }) = output.address else { continue };
            let own = (output.device, entry);
            let path = child(&child("output", &output.name), "sdo");
            if let Some((_, first)) = known.iter().find(|(other, _)| *other == own) {
                let there = self.places.line_of(&child(&child("output", first), "sdo"));
                let message = format!("output `{first}` at {there} writes the same object");
                self.wrong(&path, message, "one object has one writer: give each its own");
            }
            known.push((own, output.name.clone()));
            let setup = get(devices, output.device.0).and_then(|device| device.can.as_ref());
            let is_set = |can: &crate::CanDevice| can.setup.iter().any(|setup| setup.object.entry == entry);
            if setup.is_some_and(is_set) {
                let message = "`setup` of its device writes this object before each start";
                self.wrong(&path, message, "remove it from `setup`: a node that restarts would make a step");
            }
            let Writes::Corrected { position } = output.writes else { continue };
            let Some(signal) = get(signals, position.0) else { continue };
            if signal.device == output.device
                && matches!(signal.address, Address::Object(read) if read.entry == entry)
            {
                let message = format!(
                    "the corrected position would overwrite signal `{}`, from which it is computed",
                    signal.name
                );
                self.wrong(&path, message, "read the encoder's own object; write another");
            }
        }
    }
}

fn identifier_key(path: &str, raw: &RawSignal) -> String {
    match (&raw.pdo, &raw.frame) {
        (Some(_), _) => child(&child(path, "pdo"), "cob_id"),
        (_, Some(_)) => child(&child(path, "frame"), "id"),
        _ => child(path, "dbc"),
    }
}

type Blame = (String, &'static str);

/// What an identifier is for on a line with these nodes, where it is for no value.
fn taken(id: CanId, sync: Option<CanId>, nodes: &[Node], is_pdo: bool) -> Option<Blame> {
    const CORRECT: &str = "correct the identifier; process data is at 0x180 to 0x57F";
    if id.is_extended() {
        return None;
    }
    if Some(id) == sync {
        return Some(("the SYNC of this line".to_owned(), "correct the identifier, or `cob_id` of `sync`"));
    }
    let raw = id.raw();
    let number = u8::try_from(raw & 0x7f).unwrap_or(0);
    let owner = nodes.iter().find(|node| node.number == number).map(|node| &node.device);
    let of_node = |what: &str| owner.map(|device| (format!("{what} of node {number}, `{device}`"), CORRECT));
    match raw {
        0 if is_pdo || !nodes.is_empty() => {
            Some(("the identifier by which CANopen nodes are started and stopped".to_owned(), CORRECT))
        }
        0x081..=0x0ff => of_node("the emergency message"),
        0x581..=0x5ff => of_node("the SDO answer"),
        0x601..=0x67f => of_node("the SDO request"),
        0x701..=0x77f => of_node("the heartbeat"),
        _ => None,
    }
    .or_else(|| {
        let is_restricted = matches!(
            raw,
            0x001..=0x07f | 0x101..=0x180 | 0x581..=0x5ff | 0x601..=0x67f | 0x6e0..=0x6ff | 0x701..=0x7ff
        );
        (is_pdo && is_restricted).then(|| ("reserved by CiA 301, and no process data".to_owned(), CORRECT))
    })
}

/// By the usual identifiers: the number of the process data object, the node, and whether the node sends it.
fn usual(id: CanId, nodes: &[Node]) -> Option<(u32, &Node, bool)> {
    let raw = id.raw();
    if id.is_extended() || !(0x181..=0x57f).contains(&raw) {
        return None;
    }
    let (function, number) = ((raw - 0x180) >> 7, raw & 0x7f);
    let node = nodes.iter().find(|node| u32::from(node.number) == number)?;
    Some((function / 2 + 1, node, function % 2 == 0))
}

fn sent_by_another(id: CanId, nodes: &[Node], device: usize, name: &str) -> Option<Blame> {
    let (number, node, is_sent) = usual(id, nodes)?;
    if !is_sent {
        return None;
    }
    let message = format!("TPDO{number} of node {}, `{}`, and not of `{name}`", node.number, node.device);
    let is_own = is_node(nodes, node.number, device);
    (!is_own).then_some((message, "name that device here, or correct the identifier"))
}

/// A number that two devices have been given has been told.
fn is_node(nodes: &[Node], number: u8, device: usize) -> bool {
    nodes.iter().any(|node| (node.number, node.index) == (number, device))
}

fn sent_by_a_node(id: CanId, nodes: &[Node]) -> Option<Blame> {
    let (number, node, is_sent) = usual(id, nodes)?;
    let message = format!("TPDO{number} of node {}, `{}`, which sends it itself", node.number, node.device);
    is_sent.then_some((message, "what a node receives is at 0x200, 0x300, 0x400 or 0x500 + its number"))
}

fn received_by_another(id: CanId, nodes: &[Node], device: usize) -> Option<Blame> {
    let (number, node, is_sent) = usual(id, nodes)?;
    let message = format!("RPDO{number} of node {}, `{}`", node.number, node.device);
    (!is_sent && node.index != device)
        .then_some((message, "name that device here, or correct the identifier"))
}
