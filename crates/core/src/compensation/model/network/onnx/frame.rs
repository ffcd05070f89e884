//! Check that an ONNX file is complete: the length of each nested message agrees with the message that
//! contains it.
//!
//! The ONNX runtime accepts a truncated file as complete. It also allocates as many bytes as a damaged length demands.
//! Therefore each length is checked before the runtime reads the file.

/// Kinds of messages in an ONNX file, after `onnx.proto`. [`Message::Flat`] is any message that contains no other
/// messages.
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
    /// Returns the kind of message that this field contains; `None` if the field contains text or numbers.
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

/// Maximum nesting of messages. A graph contains other graphs only for branches and loops, which are not
/// supported.
const DEEPEST: u32 = 16;

/// Returns whether the file is complete: the fields of each message fill it to its last byte. A graph and a version of
/// the operators must exist.
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

/// Iterator over the fields of a message, with their numbers. A damaged field yields `None`, and ends the iteration.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

/// Content of a field of a message: a number of variable length, bytes, or a number of fixed length.
#[derive(Clone, Copy)]
pub(super) enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    /// Number of four or eight bytes. Its value is not needed.
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

/// Returns the fields of a message, each with its number, its content, and all its bytes. Ends at a damaged field.
pub(super) fn raw_fields(message: &[u8]) -> impl Iterator<Item = (u64, Field<'_>, &[u8])> {
    let mut fields = Fields(message);
    std::iter::from_fn(move || {
        let before = fields.0;
        let (number, value) = fields.next()??;
        Some((number, value, &before[..before.len() - fields.0.len()]))
    })
}

/// Returns the contents of all fields of a message that have this number and contain bytes.
pub(super) fn parts(message: &[u8], wanted: u64) -> impl Iterator<Item = &[u8]> {
    Fields(message).flatten().filter_map(move |(field, value)| match value {
        Field::Bytes(inner) if field == wanted => Some(inner),
        _ => None,
    })
}

/// Returns the last content of this field as text; an empty text if the field is missing or is not UTF-8.
pub(super) fn last_text(message: &[u8], wanted: u64) -> &str {
    parts(message, wanted).last().map(text).unwrap_or_default()
}

/// Returns the bytes as text; an empty text if the bytes are not UTF-8.
pub(super) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap_or_default()
}

/// Reads a length at the beginning of the bytes. Returns the content of this length, and the bytes after the
/// content; `None` if there are too few bytes.
fn inside(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = varint(bytes)?;
    rest.split_at_checked(usize::try_from(length).ok()?)
}

/// Decodes a variable-length number of Protocol Buffers at the beginning of the bytes. Returns the number and the bytes
/// after it; `None` if the number is incomplete.
pub(super) fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let end = bytes.iter().take(10).position(|byte| byte & 0x80 == 0)?;
    let number = bytes[..=end].iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f));
    Some((number, &bytes[end + 1..]))
}
