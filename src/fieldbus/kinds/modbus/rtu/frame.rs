//! RTU frames: requests as bytes, and the search for the answer in received bytes. The functions have no state and no
//! input or output.
//!
//! Frames are separated by their length and checksum, not by gaps in time, because adapters on USB and on the network
//! divide and join frames.

use crate::fieldbus::kinds::modbus::pdu;
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::kinds::modbus::request::ModbusRequest;
use isotherm_core::codec::{Table, checksum};

/// Length in bytes of the longest frame: unit (1), message (253), checksum (2).
pub(super) const LONGEST: usize = 256;
/// Number of bytes around the content of a frame (protocol data unit): unit (1) and checksum (2).
const AROUND: usize = 3;
/// Length in bytes of the frame of a read request.
const QUESTION: usize = 8;
/// Bit of the function code that marks an exception.
const EXCEPTION: u8 = 0x80;

/// Result of the search for a frame in the bytes received so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// Whole frame of the addressed unit: the range of its protocol data unit, and the index of the byte after the
    /// frame.
    Own { pdu: std::ops::Range<usize>, end: usize },
    /// Whole frame of another unit; `end` is the index of the byte after this frame.
    Foreign { end: usize },
    /// The bytes contain no whole frame yet.
    Incomplete,
}

/// Returns the frame of a request as bytes: unit, protocol data unit, checksum.
pub(super) fn request(unit: u8, request: ModbusRequest<'_>) -> Vec<u8> {
    let mut bytes = vec![unit];
    pdu::question(request, &mut bytes);
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// Returns the lengths in bytes of the frames of a request and of its answer.
pub(super) fn lengths(request: ModbusRequest<'_>) -> (usize, usize) {
    match request {
        ModbusRequest::Read { from, count } if from.table.is_bits() => {
            (8, 5 + usize::from(count.div_ceil(8)))
        }
        ModbusRequest::Read { count, .. } => (8, 5 + 2 * usize::from(count)),
        ModbusRequest::WriteCoil { .. } | ModbusRequest::WriteSingle { .. } => (8, 8),
        ModbusRequest::WriteMultiple { values, .. } => (9 + 2 * values.len(), 8),
    }
}

/// Returns whether the answer to this request could begin with the same bytes as the request. An echo could
/// then be mistaken for the answer. In the answer to a read, the data length has the position that the high
/// byte of the address has in the request.
pub(super) fn is_like_its_answer(request: ModbusRequest<'_>) -> bool {
    match request {
        ModbusRequest::Read { from, count } => {
            let is_bits = matches!(from.table, Table::Coil | Table::Discrete);
            is_bits && from.offset >> 8 == count.div_ceil(8)
        }
        ModbusRequest::WriteCoil { .. } | ModbusRequest::WriteSingle { .. } => true,
        ModbusRequest::WriteMultiple { .. } => false,
    }
}

/// Searches for the answer to a request like [`find`], but not inside an incomplete answer. Bytes inside an
/// incomplete answer may look like a frame.
pub(super) fn find_answer(bytes: &[u8], unit: u8, request: ModbusRequest<'_>) -> Reply {
    find_before(bytes, unit, incomplete_answer(bytes, unit, request).unwrap_or(bytes.len()))
}

/// Searches for a frame of `unit`; if no such frame exists, for a frame of another unit. Bytes before the frame are
/// noise.
pub(super) fn find(bytes: &[u8], unit: u8) -> Reply {
    find_before(bytes, unit, bytes.len())
}

/// Returns the index at which an incomplete answer to this request begins; `None` if the bytes contain no such answer.
fn incomplete_answer(bytes: &[u8], unit: u8, request: ModbusRequest<'_>) -> Option<usize> {
    let (_, length) = lengths(request);
    let mut begin = vec![unit];
    if request.is_read() {
        begin.extend([request.function(), u8::try_from(length.checked_sub(2 + AROUND)?).ok()?]);
    } else {
        pdu::question(request, &mut begin);
        // Function and address.
        begin.truncate(4);
    }
    (bytes.len().saturating_sub(length - 1)..bytes.len()).find(|start| bytes[*start..].starts_with(&begin))
}

/// Searches for a frame of `unit` that begins before the index `before`. If no such frame exists, returns the first
/// frame of another unit.
fn find_before(bytes: &[u8], unit: u8, before: usize) -> Reply {
    let frames = (0..before).filter_map(|start| whole(&bytes[start..]).map(|end| (start, start + end)));
    let mut foreign = Reply::Incomplete;
    for (start, end) in frames {
        if bytes[start] == unit {
            return Reply::Own { pdu: start + 1..end - 2, end };
        }
        if foreign == Reply::Incomplete {
            foreign = Reply::Foreign { end };
        }
    }
    foreign
}

/// Returns all complete answers in the bytes, in their order. Each entry has the unit, the range of the protocol data
/// unit, and the index of the byte after the frame.
pub(super) fn all(bytes: &[u8]) -> impl Iterator<Item = (u8, std::ops::Range<usize>, usize)> {
    let mut start = 0;
    std::iter::from_fn(move || {
        while start < bytes.len() {
            let here = start;
            match whole(&bytes[here..]) {
                Some(length) => {
                    start += length;
                    return Some((bytes[here], here + 1..start - 2, start));
                }
                None => start += 1,
            }
        }
        None
    })
}

/// Complete frame in received bytes: an answer, or a read request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    pub(super) unit: u8,
    pub(super) pdu: std::ops::Range<usize>,
    /// Whether the frame is a read request of a master. Otherwise it is an answer.
    pub(super) is_question: bool,
}

/// Returns all whole answers and all whole read requests in order.
pub(super) fn frames(bytes: &[u8]) -> Vec<Frame> {
    let (mut frames, mut start) = (Vec::new(), 0);
    while start < bytes.len() {
        let left = &bytes[start..];
        let answer = whole(left).map(|length| (length, false));
        let Some((length, is_question)) =
            answer.or_else(|| whole_question(left).map(|length| (length, true)))
        else {
            start += 1;
            continue;
        };
        frames.push(Frame { unit: bytes[start], pdu: start + 1..start + length - 2, is_question });
        start += length;
    }
    frames
}

/// Returns whether the content of an answer is an exception. Noise and parts of other frames sometimes look like such a
/// frame, which has only five bytes.
pub(super) fn is_exception(pdu: &[u8]) -> bool {
    pdu.first().is_some_and(|function| function & EXCEPTION != 0)
}

/// Returns the length of the read request at the start of the bytes; `None` if the request is incomplete, or its
/// checksum is wrong.
fn whole_question(bytes: &[u8]) -> Option<usize> {
    let (body, sum) = bytes.get(..QUESTION)?.split_at(QUESTION - 2);
    ReplySignature::of_question(&body[1..])?;
    (checksum(body).to_le_bytes() == *sum).then_some(QUESTION)
}

/// Returns the length of the answer at the start of the bytes; `None` if the answer is incomplete, or its checksum is
/// wrong.
fn whole(bytes: &[u8]) -> Option<usize> {
    let data = match *bytes.get(1)? {
        function if function & EXCEPTION != 0 => 2,
        1..=4 => 2 + usize::from(*bytes.get(2)?),
        5 | 6 | 15 | 16 => 5,
        _ => return None,
    };
    let end = data + AROUND;
    let (body, sum) = bytes.get(..end)?.split_at(end - 2);
    (checksum(body).to_le_bytes() == *sum).then_some(end)
}

#[cfg(test)]
mod tests;
