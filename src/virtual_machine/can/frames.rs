//! Frames that a device sends and receives: values of its bank as bits of a frame.

use std::time::Duration;

use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, BitField, CanId, CanMatch, Encoded, Field, Frame, Selector};
use isotherm_profile::{DeviceId, Profile, Verify};

/// One kind of frame that a device sends. A multiplexed frame has one image for each selection.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    id: CanId,
    length: usize,
    /// Selector bits and their values.
    selected: Vec<(BitField, u64)>,
    parts: Vec<(Address, BitField)>,
}

/// A value that a device reads from frames.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ReceivedValue {
    field: Field,
    /// Cells for the value: its own cell, and the object at which it is read back.
    cells: Vec<Address>,
}

/// Content of a frame for one device.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Delivery {
    /// The device uses no value of this frame.
    Foreign,
    /// Values with their cells.
    Taken(Vec<(Vec<Address>, Encoded)>),
    /// The frame has too few bytes. None of its values is used.
    Short,
}

/// Frames with one identifier that a device sends together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Group {
    pub(crate) id: CanId,
    /// Period: that of the device, or shorter if a value would become too old.
    pub(crate) every: Duration,
    pub(crate) images: Vec<Image>,
}

/// Frames that a device sends.
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

/// Values that a device reads from the frames of outputs.
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

/// An identifier that a listener accepts. A J1939 group is sent with the usual priority, 6.
fn sender(frames: CanMatch) -> CanId {
    let priority = 0x1800_0000 & !frames.mask;
    let any = frames.id.is_extended().then(|| CanId::extended(frames.id.raw() | priority)).flatten();
    any.unwrap_or(frames.id)
}

impl Image {
    /// Makes the frame with the current content of the bank.
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

    /// Number of bytes that a listener needs.
    pub(crate) const fn length(&self) -> usize {
        self.length
    }
}

impl ReceivedValue {
    /// Position of the value, and its frames.
    pub(crate) const fn field(&self) -> &Field {
        &self.field
    }

    /// Returns the cell that holds the same value as this object, if the value is read back at the object; else `None`.
    pub(crate) fn shown_at(&self, object: &Address) -> Option<Address> {
        self.cells.first().filter(|_| self.cells.get(1) == Some(object)).cloned()
    }
}

/// Reads the values of a frame for a device.
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

/// Start of a frame, with this number of bytes, or fewer if its kind has no such length.
pub(crate) fn beginning(frame: &Frame, bytes: usize) -> Option<Frame> {
    let length = bytes.min(frame.data().len());
    if !frame.is_fd() {
        return Frame::classic(frame.id(), &frame.data()[..length]);
    }
    (0..=length).rev().find_map(|length| Frame::fd(frame.id(), &frame.data()[..length]))
}
