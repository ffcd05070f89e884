//! Whether an ONNX file is all there and its parts fit into each other.
//!
//! The runtime takes what a file cut short still says for the whole of it, and sets memory aside for as many bytes as
//! a damaged length claims. So each length is looked at first.

/// The messages of an ONNX file that have parts, after `onnx.proto`. [`Message::Flat`] has none that are messages.
#[derive(Clone, Copy)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    ValueInfo,
    Type,
    TensorType,
    Sequence,
    Shape,
    Flat,
}

impl Message {
    /// What a field holds; `None` where it is text or numbers.
    fn part(self, field: u64) -> Option<Message> {
        Some(match (self, field) {
            (Message::Model, 7) | (Message::Attribute, 6 | 11) => Message::Graph,
            (Message::Graph, 1) => Message::Node,
            (Message::Graph, 5) | (Message::Attribute, 5 | 10) => Message::Tensor,
            (Message::Graph, 11..=13) => Message::ValueInfo,
            (Message::Node, 5) => Message::Attribute,
            (Message::ValueInfo, 2) | (Message::Sequence, 1) => Message::Type,
            (Message::Type, 1) => Message::TensorType,
            (Message::Type, 4) => Message::Sequence,
            (Message::TensorType, 2) => Message::Shape,
            (Message::Model, 8 | 14) | (Message::Tensor, 13) | (Message::Shape, 1) => Message::Flat,
            _ => return None,
        })
    }
}

/// Graphs lie in graphs only where there are branches and loops, which no network here has.
const DEEPEST: u32 = 16;

/// Whether the fields of each message fill it to its last byte, and there are a graph and the operators' version.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    let mut needed = vec![7, 8];
    fills(bytes, Message::Model, DEEPEST, &mut |field| needed.retain(|needed| *needed != field))
        && needed.is_empty()
}

fn fills(bytes: &[u8], message: Message, depth: u32, seen: &mut dyn FnMut(u64)) -> bool {
    Fields(bytes).all(|found| {
        let Some((field, value)) = found else { return false };
        seen(field);
        match (value, message.part(field)) {
            (Field::Bytes(inner), Some(part)) => depth > 0 && fills(inner, part, depth - 1, &mut |_| {}),
            _ => true,
        }
    })
}

/// The fields of a message, each with its number; `None` and no more where they are damaged.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

/// What a field holds.
#[derive(Clone, Copy)]
pub(super) enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    /// Four bytes, or eight.
    Fixed,
}

impl<'a> Iterator for Fields<'a> {
    type Item = Option<(u64, Field<'a>)>;

    fn next(&mut self) -> Option<Self::Item> {
        let bytes = std::mem::take(&mut self.0);
        if bytes.is_empty() {
            return None;
        }
        let Some((tag, rest)) = varint(bytes) else { return Some(None) };
        let found = match tag & 7 {
            0 => varint(rest).map(|(number, rest)| (Field::Number(number), rest)),
            1 => rest.get(8..).map(|rest| (Field::Fixed, rest)),
            2 => inside(rest).map(|(inner, rest)| (Field::Bytes(inner), rest)),
            5 => rest.get(4..).map(|rest| (Field::Fixed, rest)),
            _ => None,
        };
        Some(found.map(|(value, rest)| {
            self.0 = rest;
            (tag >> 3, value)
        }))
    }
}

/// What a length announces, and what follows it.
fn inside(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = varint(bytes)?;
    rest.split_at_checked(usize::try_from(length).ok()?)
}

/// A number of seven bits a byte, the last without the highest bit; and what follows it.
pub(super) fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let end = bytes.iter().take(10).position(|byte| byte & 0x80 == 0)?;
    let number = bytes[..=end].iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f));
    Some((number, &bytes[end + 1..]))
}
