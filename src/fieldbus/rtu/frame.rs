//! RTU frames: requests as bytes, and the answer among the bytes that came. Pure.
//!
//! Frames are told apart by length and checksum, not by gaps: adapters on USB and on the network tear frames apart and
//! put them together as they like.

use crate::fieldbus::owed::Mark;
use crate::fieldbus::pdu;
use crate::fieldbus::request::Request;
use isotherm_core::codec::{Table, checksum};

/// The longest frame: unit, 253 bytes, checksum.
pub(super) const LONGEST: usize = 256;
/// Unit and checksum.
const AROUND: usize = 3;
/// The frame of a read request.
const QUESTION: usize = 8;
/// The flag of an exception in the function code.
const EXCEPTION: u8 = 0x80;

/// What the bytes received so far come to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// A whole frame of the unit that was asked: its protocol data unit, and the byte behind it.
    Own { pdu: std::ops::Range<usize>, end: usize },
    /// A whole frame of another unit, up to this byte.
    Foreign { end: usize },
    /// Nothing yet.
    Incomplete,
}

/// The frame of a request.
pub(super) fn request(unit: u8, request: Request<'_>) -> Vec<u8> {
    let mut bytes = vec![unit];
    pdu::question(request, &mut bytes);
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// How many bytes the frame of a request has, and that of its answer.
pub(super) fn lengths(request: Request<'_>) -> (usize, usize) {
    match request {
        Request::Read { from, count } if from.table.is_bits() => (8, 5 + usize::from(count.div_ceil(8))),
        Request::Read { count, .. } => (8, 5 + 2 * usize::from(count)),
        Request::WriteCoil { .. } | Request::WriteSingle { .. } => (8, 8),
        Request::WriteMultiple { values, .. } => (9 + 2 * values.len(), 8),
        Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => (0, 0),
    }
}

/// Whether an answer to this request could begin like the request itself, byte for byte.
pub(super) fn is_like_its_answer(request: Request<'_>) -> bool {
    match request {
        Request::Read { from, .. } => matches!(from.table, Table::Coil | Table::Discrete),
        Request::WriteCoil { .. } | Request::WriteSingle { .. } => true,
        Request::WriteMultiple { .. } | Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => false,
    }
}

/// Looks for the answer to a request as [`find`] does, but not inside of an answer that has not arrived to its end. Some of its
/// bytes may look like a frame.
pub(super) fn find_answer(bytes: &[u8], unit: u8, request: Request<'_>) -> Reply {
    find_before(bytes, unit, incomplete_answer(bytes, unit, request).unwrap_or(bytes.len()))
}

/// Looks for a frame of `unit`, else for one of another unit. Bytes before it are noise.
pub(super) fn find(bytes: &[u8], unit: u8) -> Reply {
    find_before(bytes, unit, bytes.len())
}

/// Returns where an answer to this request begins whose end is missing.
fn incomplete_answer(bytes: &[u8], unit: u8, request: Request<'_>) -> Option<usize> {
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

/// Looks for a frame that begins before this byte.
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

/// Every whole frame, one after another: its unit, its protocol data unit, and the byte behind it.
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

/// A whole frame in what was received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    pub(super) unit: u8,
    pub(super) pdu: std::ops::Range<usize>,
    /// The frame is a read request: another master sends it.
    pub(super) is_question: bool,
}

/// Every whole answer and every whole read request, one after another.
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

/// Whether the content of an answer is an exception. Its frame has five bytes: noise and parts of other frames look like one at times.
pub(super) fn is_exception(pdu: &[u8]) -> bool {
    pdu.first().is_some_and(|function| function & EXCEPTION != 0)
}

/// The length of the read request that begins here, if it is there to its end and its checksum is right.
fn whole_question(bytes: &[u8]) -> Option<usize> {
    let (body, sum) = bytes.get(..QUESTION)?.split_at(QUESTION - 2);
    Mark::of_question(&body[1..])?;
    (checksum(body).to_le_bytes() == *sum).then_some(QUESTION)
}

/// The length of the answer that begins here, if it is there to its end and its checksum is right.
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
