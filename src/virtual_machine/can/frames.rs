//! Frames that a virtual device sends and receives: conversion between its stored values and the bits of a frame.

use std::time::Duration;

use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, BitField, CanId, CanMatch, Encoded, Field, Frame, Selector};
use isotherm_profile::{DeviceId, Profile, Verify};

/// Layout of a frame that a device sends. A multiplexed frame has one layout for each value of its selector.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    id: CanId,
    length: usize,
    /// Bits of each selector (multiplexer field), and the value of the selector in this frame.
    selected: Vec<(BitField, u64)>,
    parts: Vec<(Address, BitField)>,
}

/// Value of an output that a virtual device receives in CAN frames.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReceivedValue {
    field: Field,
    /// Addresses at which the device stores the value: the address of the output, and the object at which a
    /// client can read the value back.
    cells: Vec<Address>,
}

/// Values of a received frame that one device uses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Delivery {
    /// The device does not use any value of this frame.
    Foreign,
    /// The new values, each with the addresses at which the device stores it.
    Taken(Vec<(Vec<Address>, Encoded)>),
    /// The frame has too few bytes. The device uses none of its values.
    Short,
}

/// Frames with the same identifier that a device sends together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Group {
    pub(crate) id: CanId,
    /// Period of sending: the period of the device, or a shorter one if a value would become too old.
    pub(crate) every: Duration,
    pub(crate) images: Vec<Image>,
}

/// Returns the frames that a device sends, grouped by identifier.
pub(crate) fn sent(profile: &Profile, id: DeviceId) -> Vec<Group> {
    let device = profile.device(id);
    let mut sent: Vec<Group> = Vec::new();
    let signals = profile.signals.iter().filter(|signal| signal.device == id);
    // Values without a selection are part of the frames of each selection, so that selections come first.
    let mut fields: Vec<_> = signals.filter_map(|signal| Some((signal, field(&signal.address)?))).collect();
    fields.sort_by_key(|(_, field)| field.multiplex.is_empty());
    for (signal, field) in fields {
        let id = sender(field.frames);
        let place = sent.iter().position(|group| group.id == id).unwrap_or(sent.len());
        if place == sent.len() {
            sent.push(Group { id, every: device.every, images: Vec::new() });
        }
        let Group { every, images, .. } = &mut sent[place];
        *every = (*every).min(signal.max_age / 4).max(Duration::from_millis(1));
        let select = |selector: &Selector| {
            let (value, _) = selector.values.first()?;
            Some((selector.bits, *value))
        };
        let selected: Vec<_> = field.multiplex.iter().filter_map(select).collect();
        if !images.iter().any(|image| selected.is_empty() || image.selected == selected) {
            images.push(Image { id, length: 0, selected: selected.clone(), parts: Vec::new() });
        }
        for image in images.iter_mut().filter(|image| selected.is_empty() || image.selected == selected) {
            image.parts.push((signal.address.clone(), field.bits));
            let needed = image.selected.iter().map(|(bits, _)| bits.bytes()).chain([field.bits.bytes()]);
            image.length = image.length.max(needed.max().unwrap_or(0));
        }
    }
    sent
}

/// Returns the values that outputs write to this device in CAN frames.
pub(crate) fn taken(profile: &Profile, id: DeviceId) -> Vec<ReceivedValue> {
    let outputs = profile.outputs.iter().filter(|output| output.device == id);
    let taken = outputs.filter_map(|output| {
        let mut cells = vec![output.address.clone()];
        if let Verify::ReadBackAt(again) = output.verify {
            cells.push(Address::Object(again));
        }
        Some(ReceivedValue { field: field(&output.address)?.clone(), cells })
    });
    taken.collect()
}

const fn field(at: &Address) -> Option<&Field> {
    if let Address::Frame(field) = at { Some(field) } else { None }
}

/// Returns an identifier with which the device sends, chosen among those that the profile accepts. A J1939 frame gets
/// the usual priority, 6.
fn sender(frames: CanMatch) -> CanId {
    let priority = 0x1800_0000 & !frames.mask;
    let any = frames.id.is_extended().then(|| CanId::extended(frames.id.raw() | priority)).flatten();
    any.unwrap_or(frames.id)
}

impl Image {
    /// Returns the frame with the current values in `bank`; `None` if a value does not exist or does not fit.
    pub(crate) fn frame(&self, bank: &Bank) -> Option<Frame> {
        let mut bytes = [0; BitField::LONGEST_FRAME];
        let bytes = &mut bytes[..Frame::fd_length(self.length)?];
        for (address, bits) in &self.parts {
            let words = bank.read(address, bits.data_type().registers())?;
            bits.insert(bytes, Encoded::of(words).bits()).ok()?;
        }
        for (bits, value) in &self.selected {
            bits.insert(bytes, *value).ok()?;
        }
        if self.length > 8 { Frame::fd(self.id, bytes) } else { Frame::classic(self.id, bytes) }
    }

    /// Returns the number of bytes of the frame with all its values.
    pub(crate) const fn length(&self) -> usize {
        self.length
    }
}

impl ReceivedValue {
    /// Returns the identifiers of the frames that contain the value, and the position of the value in these frames.
    pub(crate) const fn field(&self) -> &Field {
        &self.field
    }

    /// Returns the address of the received value that a client reads back from this object. Returns `None` if a client
    /// cannot read the value back from this object.
    pub(crate) fn shown_at(&self, object: &Address) -> Option<Address> {
        self.cells.first().filter(|_| self.cells.get(1) == Some(object)).cloned()
    }
}

/// Extracts from a received frame the values that a device uses.
pub(crate) fn delivered(taken: &[ReceivedValue], frame: &Frame) -> Delivery {
    let awaited = taken.iter().filter(|value| value.field.frames.takes(frame.id()));
    let read: Option<Vec<_>> = awaited
        .filter_map(|value| Some((value, value.field.read(frame.data())?)))
        .map(|(value, words)| Some((value.cells.clone(), words.ok()?)))
        .collect();
    match read {
        None => Delivery::Short,
        Some(read) if read.is_empty() => Delivery::Foreign,
        Some(read) => Delivery::Taken(read),
    }
}

/// Returns the frame cut to its first `bytes` bytes. CAN FD does not permit every length; the returned frame is then
/// shorter.
pub(crate) fn beginning(frame: &Frame, bytes: usize) -> Option<Frame> {
    let length = bytes.min(frame.data().len());
    if !frame.is_fd() {
        return Frame::classic(frame.id(), &frame.data()[..length]);
    }
    (0..=length).rev().find_map(|length| Frame::fd(frame.id(), &frame.data()[..length]))
}
