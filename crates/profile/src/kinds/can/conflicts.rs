//! Checks each CAN line for conflicts: node numbers used twice, reserved identifiers, frames and objects with two
//! writers.

use std::collections::HashMap;

use crate::DeviceId;
use crate::tables::Check;
use crate::tables::signal::Signal;
use isotherm_core::codec::{Address, CanId, Entry, Object};

/// CANopen node on a line: its node number, and the name and index of its device.
#[derive(Clone, Debug)]
struct Node {
    number: u8,
    device: String,
    index: usize,
}

/// Checks all CAN lines, and reports each conflict as an error.
pub(super) fn check(check: &Check<'_>) {
    let devices = check.devices.by_owner(|device| Some(device.bus.0));
    let bus_of = |signal: &Signal| Some(check.devices.get(signal.device.0)?.bus.0);
    let in_frames = |signal: &Signal| matches!(signal.address, Address::Frame(_));
    let signals = check.signals.by_owner(|signal| bus_of(signal).filter(|_| in_frames(signal)));
    for bus in 0..check.buses.resolved.len() {
        let nodes = nodes(check, devices.of(bus));
        let signals: Vec<&Signal> = signals.of(bus).filter_map(|signal| check.signals.get(signal)).collect();
        sync_identifier(check, bus, &nodes);
        read_identifiers(check, (bus, &nodes), &signals);
        written_identifiers(check, (bus, &nodes), &signals);
    }
    objects_written(check);
}

/// Returns the CANopen nodes among the devices of a line, and reports node numbers that are used twice.
fn nodes(check: &Check<'_>, devices: impl Iterator<Item = usize>) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::new();
    for index in devices {
        let Some(device) = check.devices.get(index) else { continue };
        let Some(number) = device.can.as_ref().and_then(|can| can.node) else { continue };
        if let Some(first) = nodes.iter().find(|known| known.number == number) {
            let key = |device: &str| check.at("device").key(device).key("node");
            let there = key(&first.device).line();
            let message = format!(
                "device `{}` already has the node number {number} on this line ({there})",
                first.device
            );
            key(&device.name).invalid(message, "each node of a line has its own number, set at the device");
        }
        nodes.push(Node { number, device: device.name.clone(), index });
    }
    nodes
}

fn sync(check: &Check<'_>, bus: usize) -> Option<CanId> {
    check.buses.get(bus)?.sync.map(|sync| sync.id)
}

fn sync_identifier(check: &Check<'_>, bus: usize, nodes: &[Node]) {
    let Some((bus, id)) = check.buses.get(bus).zip(sync(check, bus)) else { return };
    if let Some((what, _)) = taken(id, None, nodes, true).or_else(|| sent_by_a_node(id, nodes)) {
        let help = "remove `cob_id`: SYNC has the identifier 0x80, unless the nodes are configured for \
                    another identifier";
        check.at("bus").key(&bus.name).key("sync").key("cob_id").invalid(format!("{id} is {what}"), help);
    }
}

fn read_identifiers(check: &Check<'_>, (bus, nodes): (usize, &[Node]), signals: &[&Signal]) {
    for signal in signals {
        let Address::Frame(field) = &signal.address else { continue };
        let device = check.devices.get(signal.device.0).filter(|_| field.frames.is_exact());
        let Some(device) = device else { continue };
        let at = check.at("signal").key(&signal.name);
        let (at, is_pdo) = match (at.has("pdo"), at.has("frame")) {
            (true, _) => (at.key("pdo").key("cob_id"), true),
            (_, true) => (at.key("frame").key("id"), false),
            _ => (at.key("dbc"), false),
        };
        let id = field.frames.id;
        let blame = taken(id, sync(check, bus), nodes, is_pdo)
            .or_else(|| sent_by_another(id, nodes, signal.device.0, &device.name));
        if let Some((what, help)) = blame {
            at.invalid(format!("{id} is {what}"), help);
        }
    }
}

fn written_identifiers(check: &Check<'_>, (bus, nodes): (usize, &[Node]), signals: &[&Signal]) {
    let here = |device: usize| check.devices.get(device).is_some_and(|device| device.bus.0 == bus);
    let written = check.written_frames.borrow();
    let written: Vec<_> = written.iter().filter(|one| here(one.device)).collect();
    for (place, one) in written.iter().enumerate() {
        let (id, is_pdo) = (one.id(), one.is_process_data());
        let at = one.at(check).key(if is_pdo { "cob_id" } else { "id" });
        let blame = taken(id, sync(check, bus), nodes, is_pdo)
            .or_else(|| sent_by_a_node(id, nodes))
            .or_else(|| received_by_another(id, nodes, one.device));
        if let Some((what, help)) = blame {
            at.invalid(format!("{id} is {what}"), help);
        }
        let other = written[..place].iter().find(|other| other.id() == id && other.device != one.device);
        if let Some(other) = other {
            let there = other.at(check).line();
            let message =
                format!("output `{}` of another device at {there} writes {id} already", other.output);
            let help = "a frame must be written by one device: write the same `device` at both outputs, or \
                        correct the identifier";
            at.invalid(message, help);
        }
        for signal in signals {
            if matches!(&signal.address, Address::Frame(field) if field.frames.takes(id)) {
                let message =
                    format!("signal `{}` is read from {id}, which this output would send", signal.name);
                at.invalid(
                    message,
                    "a frame has only one sender: correct the identifier of this output or of the signal",
                );
            }
        }
    }
}

/// Reports CANopen objects with two writers. Also reports an output that would write a position plus Cz into the object
/// from which the position is read.
fn objects_written(check: &Check<'_>) {
    let mut known: HashMap<(DeviceId, Entry), &str> = HashMap::new();
    let sdo = |output: &str| check.at("output").key(output).key("sdo");
    for output in check.outputs.valid() {
        let Address::Object(Object { entry, .. }) = output.address else { continue };
        let at = sdo(&output.name);
        let first = *known.entry((output.device, entry)).or_insert(&output.name);
        if first != output.name {
            let message = format!("output `{first}` at {} writes the same object", sdo(first).line());
            at.invalid(message, "an object must have one writer: give each output its own object");
        }
        let can = check.devices.get(output.device.0).and_then(|device| device.can.as_ref());
        if can.is_some_and(|can| can.setup.iter().any(|setup| setup.object.entry == entry)) {
            let message = "`setup` of the device writes this object before each start of the node";
            at.invalid(
                message,
                "remove the object from `setup`: the value would jump at each restart of the node",
            );
        }
        let Some(position) = output.writes.position() else { continue };
        let signal = check.signals.get(position.0).filter(|signal| signal.device == output.device);
        let is_same = |address: &Address| matches!(address, Address::Object(read) if read.entry == entry);
        if let Some(signal) = signal.filter(|signal| is_same(&signal.address)) {
            let message = format!(
                "the corrected position would overwrite signal `{}`, from which it is computed",
                signal.name
            );
            at.invalid(message, "read the object of the encoder, and write to another object");
        }
    }
}

/// Description of the conflicting use of a CAN identifier, and a hint for the error.
type Blame = (String, &'static str);

/// Returns the reserved use of an identifier that carries no values in CANopen, for example SYNC or a heartbeat. `None`
/// if the identifier may carry values.
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
            Some(("the identifier that starts and stops CANopen nodes".to_owned(), CORRECT))
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
        (is_pdo && is_restricted)
            .then(|| ("reserved by CiA 301, and not for process data".to_owned(), CORRECT))
    })
}

/// Returns the default use of an identifier: the number of the process data object, its node, and whether the node
/// sends the object. `None` if no node uses the identifier by default.
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
    // Two devices with one number have been reported.
    let is_own = nodes.iter().any(|other| (other.number, other.index) == (node.number, device));
    (!is_own).then_some((message, "write the name of that device in `device`, or correct the identifier"))
}

fn sent_by_a_node(id: CanId, nodes: &[Node]) -> Option<Blame> {
    let (number, node, is_sent) = usual(id, nodes)?;
    let message =
        format!("TPDO{number} of node {}, `{}`, which the node itself sends", node.number, node.device);
    is_sent.then_some((
        message,
        "a node receives process data at the identifiers 0x200, 0x300, 0x400 and 0x500 plus its node number",
    ))
}

fn received_by_another(id: CanId, nodes: &[Node], device: usize) -> Option<Blame> {
    let (number, node, is_sent) = usual(id, nodes)?;
    let message = format!("RPDO{number} of node {}, `{}`", node.number, node.device);
    (!is_sent && node.index != device)
        .then_some((message, "write the name of that device in `device`, or correct the identifier"))
}
