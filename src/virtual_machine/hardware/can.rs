//! Frames that the virtual devices of a CAN line send, and their reaction to received frames.

use std::time::Duration;

use rand::RngExt;

use super::{Hardware, Unit};
use crate::fieldbus::kinds::can::canopen::abort::AbortCode;
use crate::virtual_machine::can::dictionary::{NONE, Server, refusal};
use crate::virtual_machine::can::frames::{self, Delivery, Image, ReceivedValue};
use crate::virtual_machine::can::node::{Node, NodeAction, is_own};
use crate::virtual_machine::can::power_on;
use crate::virtual_machine::fault::{BusError, CanFault, FaultFrame, Kind, ReplyFault};
use crate::virtual_machine::journal::SeenRequest;
use crate::virtual_machine::random::stream;
use isotherm_core::codec::{Address, CanMatch, Encoded, Entry, Frame, Object};
use isotherm_core::quantity::Moment;
use isotherm_profile::{DeviceId, Profile};

/// CAN part of a unit: its node, its frames and its objects.
#[derive(Debug)]
pub(crate) struct CanUnit {
    pub(super) node: Node,
    /// Frames of each PDO (frame with measured values) of the node. A multiplexed PDO has several frames.
    sent: Vec<Vec<Image>>,
    taken: Vec<ReceivedValue>,
    /// Objects that the profile reads or writes.
    objects: Vec<Object>,
}

/// Frame that the virtual machine sends on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sent {
    /// Frame to send, after an optional delay in wall-clock time.
    Frame(Frame, Option<Duration>),
    /// A bus error that a controller reports.
    Error(BusError),
}

impl CanUnit {
    /// Returns the CAN part of a unit, with its power off; `None` for a unit on another line.
    pub(super) fn of(profile: &Profile, unit: &mut Unit) -> Option<CanUnit> {
        let node = power_on::node(profile, unit.device, &mut unit.bank)?;
        let sent = frames::sent(profile, unit.device).into_iter().map(|group| group.images).collect();
        let (taken, objects) = (frames::taken(profile, unit.device), profile.objects(unit.device));
        Some(CanUnit { node, sent, taken, objects })
    }

    /// Returns those objects of the profile that `which` selects, each with its current value.
    fn standing(&self, which: impl Fn(Entry) -> bool) -> Vec<(Address, Encoded)> {
        let objects = self.objects.iter().filter(|object| which(object.entry));
        let current = |object: &Object| object.registers(self.node.objects.get(object.entry)?);
        objects.filter_map(|object| Some((Address::Object(*object), current(object)?))).collect()
    }
}

impl Hardware {
    /// Advances the devices of a line to `now`. Returns the frames that they send, in order.
    pub(crate) fn can_tick(&mut self, places: &[usize], now: Moment) -> Vec<Sent> {
        self.advance_to(now);
        let mut sent = Vec::new();
        for &place in places {
            let device = self.units[place].device;
            let Some(can) = &mut self.units[place].can else { continue };
            can.node.tick(now);
            for utterance in self.faults.utter(device, now) {
                match utterance {
                    FaultFrame::Emergency(code) => can.node.complain(code),
                    FaultFrame::Error(error) => sent.push(Sent::Error(error)),
                    FaultFrame::Babble(id) => {
                        let bytes = stream(now.as_nanos(), "babble").random();
                        sent.push(Sent::Frame(Frame::short::<8>(id, bytes), None));
                    }
                }
            }
            self.act(place, now, &mut sent);
        }
        sent
    }

    /// Returns the latest time for the next call of [`Hardware::can_tick`]; `None` if no call is needed.
    pub(crate) fn can_due(&self, places: &[usize]) -> Option<Moment> {
        let due = places.iter().map(|place| &self.units[*place]).flat_map(|unit| {
            let node = unit.can.as_ref().and_then(|can| can.node.due());
            node.into_iter().chain(self.faults.due(unit.device))
        });
        due.min()
    }

    /// Returns the index of the unit of each of these devices in the list of units.
    pub(crate) fn places(&self, devices: impl Iterator<Item = DeviceId>) -> Vec<usize> {
        devices.map(|device| self.unit_of[device.0]).collect()
    }

    /// Returns the identifiers of the frames that the devices of a line receive.
    pub(crate) fn can_wanted(&self, places: &[usize]) -> Vec<CanMatch> {
        let units = places.iter().filter_map(|place| self.units[*place].can.as_ref());
        let wanted = units.flat_map(|can| {
            let taken = can.taken.iter().map(|value| value.field().frames.id);
            can.node.receives().into_iter().chain(taken)
        });
        let mut wanted: Vec<_> = wanted.map(CanMatch::exactly).collect();
        wanted.sort_unstable();
        wanted.dedup();
        wanted
    }

    /// Delivers a frame to the devices of a line. Returns the frames that they send in response.
    pub(crate) fn can_take(&mut self, places: &[usize], frame: &Frame, now: Moment) -> Vec<Sent> {
        self.advance_to(now);
        let mut sent = Vec::new();
        for &place in places {
            if self.faults.silences(self.units[place].device, now) {
                continue;
            }
            self.receive(place, frame, now, &mut sent);
            self.take_process_data(place, frame, now);
            self.act(place, now, &mut sent);
        }
        sent
    }

    /// Processes a frame of a CANopen service. Adds the answer to `sent`.
    fn receive(&mut self, place: usize, frame: &Frame, now: Moment, sent: &mut Vec<Sent>) {
        let device = self.units[place].device;
        let is_request = |can: &CanUnit| can.node.is_asked_by(frame);
        if !self.units[place].can.as_ref().is_some_and(is_request) {
            if let Some(can) = &mut self.units[place].can {
                can.node.take(frame, now);
            }
            return;
        }
        self.units[place].requests += 1;
        self.measure(place, now, None);
        self.show_objects(place);
        self.faults.count_signals(device, now);
        let is_write = Server::is_write(frame.data());
        let fault = self.faults.sdo(device, is_write, now);
        let Some(can) = &mut self.units[place].can else { return };
        let before = can.node.objects.clone();
        let served = match fault {
            Some(Kind::Can(CanFault::Refusal(code))) => {
                let at = Server::names(frame.data()).unwrap_or(NONE);
                let answer = can.node.answer(refusal(at, AbortCode(code)));
                sent.extend(answer.map(|answer| Sent::Frame(answer, None)));
                return;
            }
            _ => can.node.take(frame, now),
        };
        let Some(served) = served else { return };
        let is_ignored = fault == Some(Kind::Reply(ReplyFault::IgnoredWrite));
        if let Some(at) = served.written.filter(|_| is_ignored) {
            can.node.undo(at, before, now);
        }
        if let Some(mut answer) = served.answer {
            if fault == Some(Kind::Can(CanFault::WrongIndex)) {
                answer[1] ^= 1;
            }
            let delay = match fault {
                Some(Kind::Reply(ReplyFault::Late(delay))) => Some(delay),
                _ => None,
            };
            sent.extend(can.node.answer(answer).map(|answer| Sent::Frame(answer, delay)));
        }
        if let Some(at) = served.written.filter(|_| !is_ignored) {
            self.take_object(place, at, now);
        }
    }

    /// Copies the stored values to the node's objects. Objects that the node itself determines are copied in the other
    /// direction.
    fn show_objects(&mut self, place: usize) {
        self.keep_objects(place, is_own);
        let unit = &mut self.units[place];
        let Some(can) = &mut unit.can else { return };
        for object in can.objects.iter().filter(|object| !is_own(object.entry)) {
            let words = unit.bank.read(&Address::Object(*object), object.data_type.registers());
            if let Some(words) = words {
                can.node.objects.set(object.entry, &object.bytes(words));
            }
        }
    }

    /// Updates the stored value of an object that a client has written, and the stored values that depend on this
    /// object.
    fn take_object(&mut self, place: usize, at: Entry, now: Moment) {
        let Some(can) = &self.units[place].can else { return };
        for (cell, words) in can.standing(|object| object == at) {
            let Some(can) = &self.units[place].can else { return };
            let shown: Vec<_> = can.taken.iter().filter_map(|value| value.shown_at(&cell)).collect();
            let cells: Vec<_> = std::iter::once(cell).chain(shown).collect();
            self.put(place, &cells, words.registers(), now);
        }
    }

    /// Updates the stored values of the device from the node's objects that `which` selects.
    fn keep_objects(&mut self, place: usize, which: impl Fn(Entry) -> bool) {
        let unit = &mut self.units[place];
        let Some(can) = &unit.can else { return };
        for (cell, words) in can.standing(which) {
            unit.bank.set(&cell, words.registers());
        }
    }

    /// Stores the values that outputs write to a unit in this frame. If the frame is too short, the node reports an
    /// error.
    fn take_process_data(&mut self, place: usize, frame: &Frame, now: Moment) {
        let device = self.units[place].device;
        let Some(can) = &self.units[place].can else { return };
        if can.taken.is_empty() || !can.node.takes_process_data() {
            return;
        }
        let delivery = frames::delivered(&can.taken, frame);
        if delivery == Delivery::Foreign {
            return;
        }
        self.units[place].requests += 1;
        if self.faults.sdo(device, true, now) == Some(Kind::Reply(ReplyFault::IgnoredWrite)) {
            return;
        }
        match delivery {
            Delivery::Taken(values) => {
                for (cells, words) in values {
                    self.put(place, &cells, words.registers(), now);
                }
            }
            _ => {
                if let Some(can) = &mut self.units[place].can {
                    can.node.complain(0x8210);
                }
            }
        }
    }

    /// Stores a written value at these addresses, and records the write in the request journal.
    fn put(&mut self, place: usize, cells: &[Address], words: &[u16], at: Moment) {
        let device = self.units[place].device;
        let count = u16::try_from(words.len()).unwrap_or(u16::MAX);
        for address in cells {
            let before = self.units[place].bank.read(address, count).unwrap_or_default().to_vec();
            self.units[place].bank.set(address, words);
            self.note_corrections(place, address, count);
            if let Some(journal) = &mut self.journal {
                let (address, after, wanted) = (address.clone(), words.to_vec(), words.to_vec());
                journal.push(SeenRequest { at, device, function: 0, address, count, before, after, wanted });
            }
        }
    }

    /// Executes the collected actions of a node. Adds the resulting frames to `sent`.
    fn act(&mut self, place: usize, now: Moment, sent: &mut Vec<Sent>) {
        let device = self.units[place].device;
        loop {
            let Some(can) = &mut self.units[place].can else { return };
            let acts = std::mem::take(&mut can.node.acts);
            if acts.is_empty() {
                return;
            }
            for act in acts {
                match act {
                    NodeAction::Reset => self.restart(place, now),
                    NodeAction::Restored => self.keep_objects(place, is_own),
                    NodeAction::Send(frame) => {
                        if !self.faults.silences(device, now) {
                            sent.push(Sent::Frame(frame, None));
                        }
                    }
                    NodeAction::Measured(pdo) => self.send_measured(place, pdo, now, sent),
                }
            }
        }
    }

    fn send_measured(&mut self, place: usize, pdo: usize, now: Moment, sent: &mut Vec<Sent>) {
        let device = self.units[place].device;
        self.measure(place, now, None);
        self.faults.count_signals(device, now);
        let unit = &self.units[place];
        let images = unit.can.as_ref().and_then(|can| can.sent.get(pdo)).map_or(&[][..], Vec::as_slice);
        for image in images {
            let Some(mut frame) = image.frame(&unit.bank) else { continue };
            if self.faults.silences(device, now) {
                continue;
            }
            match self.faults.spoils(device, now) {
                Some(Kind::Reply(ReplyFault::Garbage)) => {
                    let mut random = stream(now.as_nanos(), "garbage");
                    frame.data_mut().iter_mut().for_each(|byte| *byte = random.random());
                }
                Some(_) => {
                    let Some(short) = frames::beginning(&frame, image.length().saturating_sub(1)) else {
                        continue;
                    };
                    frame = short;
                }
                None => {}
            }
            sent.push(Sent::Frame(frame, None));
        }
    }
}
