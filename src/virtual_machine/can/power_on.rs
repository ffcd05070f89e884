//! Initial state of a virtual CAN device at power-on.
//!
//! Objects in the setup list of the profile do not have the values of that list yet. Timers among them are zero, so
//! that a node without setup sends nothing, like a real node. Objects that the profile only verifies have the expected
//! values.

use std::time::Duration;

use super::dictionary::Dictionary;
use super::frames;
use super::node::{CYCLE, ERROR_REGISTER, HEARTBEAT_TIME, Node, Pdo, communication};
use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, CanId, Entry};
use isotherm_profile::{CanDevice, DeviceId, Profile};

/// Transmission type of a PDO that is sent by a timer, or on a change that the manufacturer defines. CiA 301 has two
/// types with this meaning; this is the first.
const BY_CLOCK: u8 = 254;

/// Returns the node of a device with its objects; `None` for a device that is not on a CAN line. The node and
/// `bank` get the same values of the objects that the profile uses. An initial value of the node is copied to
/// `bank`. Any other value is copied from `bank`.
pub(crate) fn node(profile: &Profile, id: DeviceId, bank: &mut Bank) -> Option<Node> {
    let device = profile.device(id);
    let can = device.can.as_ref()?;
    let sent = frames::sent(profile, id);
    let Some(number) = can.node else {
        let pdos = sent.iter().map(|group| Pdo::new(group.id, None, group.every));
        return Some(Node::new(None, true, Dictionary::default(), pdos.collect()));
    };
    let sync = profile.bus(device.bus).sync.map_or(0x80, |sync| sync.id.raw());
    let heartbeat = can.heartbeat.map_or(0, |patience| milliseconds(patience / 3));
    let mut objects = Dictionary::default();
    objects.put(Entry::new(0x1000, 0), &[0; 4], false);
    objects.put(ERROR_REGISTER, &[0], false);
    objects.put(Entry::new(0x1005, 0), &sync.to_le_bytes(), true);
    objects.put(Entry::new(0x1008, 0), device.name.as_bytes(), false);
    objects.put(HEARTBEAT_TIME, &heartbeat.to_le_bytes(), true);
    objects.put(Entry::new(0x1018, 0), &[4], false);
    (1..=4).for_each(|sub| objects.put(Entry::new(0x1018, sub), &[0; 4], false));
    let mut pdos = Vec::new();
    for group in &sent {
        let pdo = number_of(group.id, number, can);
        pdos.push(Pdo::new(group.id, pdo, group.every));
        let Some(pdo) = pdo else { continue };
        let [identifier, kind, timer] = communication(pdo);
        objects.put(Entry::new(identifier.index, 0), &[5], false);
        objects.put(identifier, &usual(pdo, number).raw().to_le_bytes(), true);
        objects.put(kind, &[BY_CLOCK], true);
        objects.put(timer, &milliseconds(group.every).to_le_bytes(), true);
    }
    let in_use = profile.objects(id);
    let first_timer = communication(0)[2];
    if in_use.iter().chain(can.setup.iter().map(|setup| &setup.object)).any(|object| object.entry == CYCLE) {
        let first = objects.get(first_timer).unwrap_or(&[0, 0]).to_vec();
        objects.put(CYCLE, &first, true);
    }
    for object in can.setup.iter().map(|setup| setup.object) {
        let entry = object.entry;
        match objects.get(entry).map(<[u8]>::len) {
            Some(length) if entry == HEARTBEAT_TIME || entry == CYCLE || is_timer(entry) => {
                objects.put(entry, &vec![0; length], true);
                if entry == CYCLE || entry == first_timer {
                    objects.set(first_timer, &[0, 0]);
                    objects.set(CYCLE, &[0, 0]);
                }
            }
            Some(_) => objects.unlock(entry),
            None => objects.put(entry, &vec![0; object.size()], true),
        }
    }
    let is_set_up = |entry: Entry| can.setup.iter().any(|setup| setup.object.entry == entry);
    // The object is only verified before arming, so that it has the expected value.
    let is_verified = |entry: Entry| {
        !is_set_up(entry) && device.verify.iter().any(|expected| named(&expected.address) == Some(entry))
    };
    // An output writes this value by SDO, or it comes in a frame and can be read here.
    let is_written = |entry: Entry| {
        let mut outputs = profile.outputs.iter().filter(|output| output.device == id);
        outputs.any(|output| [&output.address, &output.reads_at()].map(named).contains(&Some(entry)))
    };
    for object in &in_use {
        let (entry, cell) = (object.entry, &Address::Object(*object));
        bank.reserve(cell, object.data_type.registers());
        match objects.get(entry).and_then(|bytes| object.registers(bytes)) {
            Some(words) if !is_verified(entry) && !is_written(entry) => bank.set(cell, words.registers()),
            current => {
                let bytes = object.bytes(bank.read(cell, object.data_type.registers()).unwrap_or_default());
                objects.put(entry, &bytes, is_written(entry) || (current.is_some() && is_set_up(entry)));
            }
        }
    }
    Some(Node::new(Some(number), !can.start, objects, pdos))
}

fn is_timer(entry: Entry) -> bool {
    (0x1800..0x1a00).contains(&entry.index) && entry.sub == 5
}

/// Returns the index and sub-index of an address that is an object; `None` for other addresses.
pub(crate) const fn named(address: &Address) -> Option<Entry> {
    if let Address::Object(object) = address { Some(object.entry) } else { None }
}

/// Returns the number of the PDO with this identifier: from the setup list, or from the predefined connection set of
/// CiA 301. Returns `None` if no PDO has this identifier.
fn number_of(id: CanId, node: u8, can: &CanDevice) -> Option<u16> {
    let is_set_up = |pdo: &u16| {
        let mut of_pdo = can.setup.iter().filter(|setup| setup.object.entry == communication(*pdo)[0]);
        of_pdo.next().is_some_and(|setup| setup.value & 0x1fff_ffff == i64::from(id.raw()))
    };
    (0..512).find(is_set_up).or_else(|| (0..4).find(|pdo| usual(*pdo, node) == id))
}

/// Returns the default identifier of a PDO. PDOs after the first four have no default identifier, and get 0.
fn usual(pdo: u16, node: u8) -> CanId {
    CanId::of_11_bits(if pdo < 4 { 0x180 + 0x100 * pdo + u16::from(node) } else { 0 })
}

fn milliseconds(span: Duration) -> u16 {
    u16::try_from(span.as_millis()).unwrap_or(u16::MAX)
}
