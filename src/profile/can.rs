//! What hangs on a CAN line: nodes, objects, and values inside frames.

use std::fmt;
use std::time::Duration;

use super::{DeviceId, Profile};
use crate::codec::{Address, BitField, CanId, CanMatch, DataType, Encoded, Frame, Table};
use crate::reading::Reason;

mod emergency;

pub use emergency::Emergency;

/// What a device on a CAN line has beside what every device has.
#[derive(Clone, Debug, PartialEq)]
pub struct CanDevice {
    /// CANopen node number, 1 to 127; `None`: a device that only sends frames.
    pub node: Option<u8>,
    /// Whether it is started by NMT, at the beginning and after each of its boot-ups.
    pub start: bool,
    /// Its heartbeat, missed this long or never seen this long, is a fault; `None`: not watched.
    pub heartbeat: Option<Duration>,
    /// Objects written before each start, in this order.
    pub setup: Vec<Setup>,
    /// What its emergency codes mean, beside those that every device has.
    pub emergencies: Vec<Emergency>,
    /// Its objects in use: those of the addresses in [`Table::Object`](crate::codec::Table::Object).
    pub objects: Vec<Object>,
    /// Its values inside frames: those of the addresses in [`Table::Process`](crate::codec::Table::Process).
    pub fields: Vec<Field>,
    /// The frames that are written, as they are before an output has put its value in. Two outputs may share one; it is
    /// sent once each of them has a value.
    pub written: Vec<Frame>,
}

/// One CANopen object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Object {
    /// Its index in the object dictionary.
    pub index: u16,
    /// Its subindex.
    pub sub: u8,
    /// How its value lies there; always whole bytes.
    pub data_type: DataType,
}

/// A value inside frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// The frames it is in.
    pub frames: CanMatch,
    /// They are CAN FD frames; a classic one that is long enough does as well.
    pub is_fd: bool,
    /// Where in there.
    pub bits: BitField,
    /// Only in frames for which all of these hold.
    pub multiplex: Vec<Selector>,
}

/// A value that says what else is in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selector {
    /// Where it is.
    pub bits: BitField,
    /// The smallest and the largest of the values at which the frame holds the field.
    pub values: Vec<(u64, u64)>,
}

/// An object that is written before the node is started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Which.
    pub object: Object,
    /// What is written; it fits the type.
    pub value: i64,
    /// What that is, for people; may be empty.
    pub what: String,
}

/// Who sends SYNC on a line: we do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sync {
    /// With this identifier.
    pub id: CanId,
    /// This often.
    pub every: Duration,
}

impl Profile {
    /// Where a value of a device is, for people: `holding:104 (40105)`, `object 6150:01`, `0x20c, 32 bits from 0 up
    /// (Intel), signed`.
    pub fn place(&self, device: DeviceId, address: Address) -> String {
        let can = self.device(device).can.as_ref();
        let known = match address.table {
            Table::Object => {
                can.and_then(|can| can.object(address.offset)).map(|object| format!("object {object}"))
            }
            Table::Process => can.and_then(|can| can.field(address.offset)).map(ToString::to_string),
            _ => Some(format!("{address} ({})", address.modicon())),
        };
        known.unwrap_or_else(|| address.to_string())
    }
}

impl CanDevice {
    /// The object at a place of the list.
    pub fn object(&self, place: u16) -> Option<&Object> {
        self.objects.get(usize::from(place))
    }

    /// The field at a place of the list.
    pub fn field(&self, place: u16) -> Option<&Field> {
        self.fields.get(usize::from(place))
    }

    /// The frame that is written with this identifier, without the values of its outputs.
    pub fn written(&self, id: CanId) -> Option<&Frame> {
        self.written.iter().find(|frame| frame.id() == id)
    }

    /// What an emergency code of this device means.
    pub fn emergency(&self, code: u16) -> String {
        let own = self.emergencies.iter().filter(|known| known.names(code));
        let own = own.max_by_key(|known| known.mask.count_ones());
        own.map_or_else(|| Emergency::generic(code).to_owned(), |known| known.words.clone())
    }
}

impl Object {
    /// How many bytes it has.
    pub const fn size(&self) -> usize {
        self.data_type.width().div_ceil(8) as usize
    }

    /// Its value as registers, the most significant first; `None` where it is not its size.
    pub fn words(&self, bytes: &[u8]) -> Option<Encoded> {
        if bytes.len() != self.size() || bytes.len() > 8 {
            return None;
        }
        let mut eight = [0; 8];
        eight[..bytes.len()].copy_from_slice(bytes);
        Some(self.data_type.words(u64::from_le_bytes(eight)))
    }

    /// The bytes of such registers, as they go over the line.
    pub fn bytes(&self, words: &[u16]) -> Vec<u8> {
        Encoded::of(words).bits().to_le_bytes()[..self.size().min(8)].to_vec()
    }
}

impl Setup {
    /// The bytes that are written.
    pub fn bytes(&self) -> Vec<u8> {
        self.value.to_le_bytes()[..self.object.size().min(8)].to_vec()
    }
}

impl Field {
    /// Its value in a frame as registers, the most significant first; `None` where the frame holds another value there.
    pub fn read(&self, frame: &[u8]) -> Option<Result<Encoded, Reason>> {
        for selector in &self.multiplex {
            match selector.bits.bits(frame) {
                Ok(value) if selector.selects(value) => {}
                Ok(_) => return None,
                Err(short) => return Some(Err(short)),
            }
        }
        Some(self.bits.words(frame))
    }
}

impl Selector {
    fn selects(&self, value: u64) -> bool {
        self.values.iter().any(|(from, to)| (*from..=*to).contains(&value))
    }
}

/// `7130:01`.
impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}:{:02X}", self.index, self.sub)
    }
}

/// `0x185, 16 bits from 0 up (Intel), signed`.
impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.frames, self.bits)?;
        self.multiplex.iter().try_for_each(|selector| write!(f, ", {selector}"))
    }
}

/// `where bits 0..3 are 2 or 5 to 7`.
impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |(from, to): &(u64, u64)| match from == to {
            true => from.to_string(),
            false => format!("{from} to {to}"),
        };
        let values: Vec<String> = self.values.iter().map(value).collect();
        write!(f, "where {} is {}", self.bits, values.join(" or "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{BitKind, ByteOrder};

    fn bits(start: u16, length: u16) -> BitField {
        BitField::new(start, length, ByteOrder::Intel, BitKind::Unsigned).unwrap()
    }

    #[test]
    fn an_object_s_bytes_are_its_registers_turned_round() {
        let position = Object { index: 0x6004, sub: 0, data_type: DataType::I32 };
        assert_eq!(position.words(&[0x78, 0x56, 0x34, 0x12]).unwrap().words(), [0x1234, 0x5678]);
        assert_eq!(position.bytes(&[0x1234, 0x5678]), [0x78, 0x56, 0x34, 0x12]);
        assert_eq!(position.words(&[0x78, 0x56]), None);
        let status = Object { index: 0x6150, sub: 1, data_type: DataType::unsigned(8) };
        assert_eq!((status.size(), status.words(&[3]).unwrap().words()), (1, [3].as_slice()));
        assert_eq!((position.to_string(), status.to_string()), ("6004:00".to_owned(), "6150:01".to_owned()));
        assert_eq!(Setup { object: status, value: -1, what: String::new() }.bytes(), [0xff]);
    }

    #[test]
    fn a_multiplexed_value_is_only_in_the_frames_that_say_so() {
        let frames = CanMatch::exactly(CanId::standard(0x100).unwrap());
        let selector = Selector { bits: bits(0, 4), values: vec![(2, 2), (5, 7)] };
        let field = Field { frames, is_fd: false, bits: bits(8, 16), multiplex: vec![selector] };
        assert_eq!(field.read(&[0xf1, 0x34, 0x12]), None);
        for chosen in [0xf2, 0x05, 0x07] {
            assert_eq!(field.read(&[chosen, 0x34, 0x12]).unwrap().unwrap().words(), [0x1234]);
        }
        assert_eq!(field.read(&[2, 0x34]), Some(Err(Reason::ShortFrame)));
        assert_eq!(field.read(&[]), Some(Err(Reason::ShortFrame)));
    }
}
