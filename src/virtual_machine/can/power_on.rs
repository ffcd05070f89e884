//! A device on a CAN line as it is when the power comes on.
//!
//! What the profile sets up is not set up yet: timers that it writes stand at zero, so a node whose setup list was not
//! written stays silent, as on the shop floor. What it only verifies stands as it must.

use std::time::Duration;

use super::dictionary::{At, Dictionary};
use super::frames;
use super::node::{CYCLE, ERROR_REGISTER, HEARTBEAT_TIME, Node, Pdo, communication};
use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, CanId, Object};
use isotherm_profile::{CanDevice, DeviceId, Expected, Output, Profile};

/// Sent by the clock or on a change of the maker's own choosing; the first of the two types that mean it.
const BY_CLOCK: u8 = 254;

/// The node that a device is, in front of what its bank holds; objects that stand at something of their own are put
/// into the bank.
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
    objects.put((0x1000, 0), &[0; 4], false);
    objects.put(ERROR_REGISTER, &[0], false);
    objects.put((0x1005, 0), &sync.to_le_bytes(), true);
    objects.put((0x1008, 0), device.name.as_bytes(), false);
    objects.put(HEARTBEAT_TIME, &heartbeat.to_le_bytes(), true);
    objects.put((0x1018, 0), &[4], false);
    (1..=4).for_each(|sub| objects.put((0x1018, sub), &[0; 4], false));
    let mut pdos = Vec::new();
    for group in &sent {
        let pdo = number_of(group.id, number, can);
        pdos.push(Pdo::new(group.id, pdo, group.every));
        let Some(pdo) = pdo else { continue };
        let [identifier, kind, timer] = communication(pdo);
        objects.put((identifier.0, 0), &[5], false);
        objects.put(identifier, &usual(pdo, number).raw().to_le_bytes(), true);
        objects.put(kind, &[BY_CLOCK], true);
        objects.put(timer, &milliseconds(group.every).to_le_bytes(), true);
    }
    let knows_cycle = |object: &Object| at(object) == CYCLE;
    let in_use = profile.objects(id);
    if in_use.iter().chain(can.setup.iter().map(|setup| &setup.object)).any(knows_cycle) {
        let first = objects.get(communication(0)[2]).unwrap_or(&[0, 0]).to_vec();
        objects.put(CYCLE, &first, true);
    }
    for setup in &can.setup {
        let place = at(&setup.object);
        let first_timer = communication(0)[2];
        match objects.get(place).map(<[u8]>::len) {
            Some(length) if place == HEARTBEAT_TIME || place == CYCLE || is_timer(place) => {
                objects.put(place, &vec![0; length], true);
                if place == CYCLE || place == first_timer {
                    objects.set(first_timer, &[0, 0]);
                    objects.set(CYCLE, &[0, 0]);
                }
            }
            Some(_) => objects.unlock(place),
            None => objects.put(place, &vec![0; setup.object.size()], true),
        }
    }
    let kept = |object: &Object| is_verified(profile, id, can, object) || is_written(profile, id, object);
    for object in &in_use {
        let cell = &Address::Object(*object);
        bank.reserve(cell, object.data_type.registers());
        match objects.get(at(object)).and_then(|bytes| object.words(bytes)) {
            Some(words) if !kept(object) => {
                let fits = bank.write(cell, words.words());
                debug_assert!(fits.is_some(), "room was made for it");
            }
            stands => {
                let bytes = object.bytes(bank.read(cell, object.data_type.registers()).unwrap_or_default());
                let is_writable = is_written(profile, id, object)
                    || (stands.is_some() && can.setup.iter().any(|setup| at(&setup.object) == at(object)));
                objects.put(at(object), &bytes, is_writable);
            }
        }
    }
    Some(Node::new(Some(number), !can.start, objects, pdos))
}

/// Index and sub-index.
pub(crate) const fn at(object: &Object) -> At {
    (object.entry.index, object.entry.sub)
}

fn is_timer((index, sub): At) -> bool {
    (0x1800..0x1a00).contains(&index) && sub == 5
}

/// It is only looked at before arming, so it stands as it must.
fn is_verified(profile: &Profile, id: DeviceId, can: &CanDevice, object: &Object) -> bool {
    let is_set_up = can.setup.iter().any(|setup| at(&setup.object) == at(object));
    let is_looked_at = |expected: &Expected| named(&expected.address) == Some(at(object));
    !is_set_up && profile.device(id).verify.iter().any(is_looked_at)
}

/// An output's value is written there, or stands there once it came in a frame.
fn is_written(profile: &Profile, id: DeviceId, object: &Object) -> bool {
    let is_its = |output: &Output| {
        named(&output.address) == Some(at(object)) || named(&output.reads_at()) == Some(at(object))
    };
    profile.outputs.iter().filter(|output| output.device == id).any(is_its)
}

/// The object at an address.
pub(crate) const fn named(address: &Address) -> Option<At> {
    if let Address::Object(object) = address { Some(at(object)) } else { None }
}

/// Which of a node's PDOs comes with this identifier: by the usual set, or because the setup list gives it that one.
fn number_of(id: CanId, node: u8, can: &CanDevice) -> Option<u16> {
    let is_set_up = |pdo: &u16| {
        let is_its = |setup: &&isotherm_profile::Setup| at(&setup.object) == communication(*pdo)[0];
        can.setup.iter().find(is_its).is_some_and(|setup| setup.value & 0x1fff_ffff == i64::from(id.raw()))
    };
    (0..512).find(is_set_up).or_else(|| (0..4).find(|pdo| usual(*pdo, node) == id))
}

/// The identifier that a PDO has unless somebody changes it; none of the first four has one of no use to anybody.
fn usual(pdo: u16, node: u8) -> CanId {
    CanId::of_11_bits(if pdo < 4 { 0x180 + 0x100 * pdo + u16::from(node) } else { 0 })
}

fn milliseconds(span: Duration) -> u16 {
    u16::try_from(span.as_millis()).unwrap_or(u16::MAX)
}
