//! Classification of input that contains no answer to a request. The functions have no state and no input or output.

use crate::fieldbus::error::PeerFault;
use crate::fieldbus::kinds::modbus::pdu::EXCEPTION;
use crate::fieldbus::kinds::modbus::text;
use isotherm_core::codec::checksum;

/// Number of bytes at the beginning of an echo that may be wrong, because the adapter switches its driver on or off.
const DAMAGED: usize = 3;
/// Maximum number of surplus bytes after a Modbus exception.
const SURPLUS: usize = 2;

/// Returns the fault of input that contains no answer. Returns `None` for input that may be noise. Input counts as
/// noise if it is shorter than the answer, after removal of echoes, and contains no text and no exception.
///
/// `question` is the frame of the request, `before` is the frame of the request before it, and `answer` is the length
/// of the answer.
pub(super) fn assess(received: &[u8], question: &[u8], before: &[u8], answer: usize) -> Option<PeerFault> {
    let [unit, function, ..] = *question else { return None };
    let left = without_echoes(received, question, before);
    let long = (0..left.len()).find_map(|start| long_exception(&left[start..], unit, function));
    if let Some(code) = long {
        return Some(PeerFault::LongException(code));
    }
    let text = text::recognise(&left).map(PeerFault::Text);
    text.or((!left.is_empty() && left.len() >= answer).then_some(PeerFault::Malformed))
}

/// Removes the echo of the request, and a late echo of the request before it. The first bytes of an echo may be
/// damaged. If only the beginning of the request is left, this beginning is removed too.
fn without_echoes(received: &[u8], question: &[u8], before: &[u8]) -> Vec<u8> {
    let mut left = received.to_vec();
    for sent in [question, before] {
        let tail = &sent[sent.len().min(DAMAGED)..];
        while let Some(at) = left.windows(tail.len().max(1)).position(|part| part == tail) {
            left.drain(at.saturating_sub(DAMAGED)..at + tail.len());
        }
    }
    if question.starts_with(&left) {
        left.clear();
    }
    left
}

/// Returns the code of a Modbus exception with one or two surplus bytes; `None` if the bytes are anything else.
pub(super) fn long_exception(bytes: &[u8], unit: u8, function: u8) -> Option<u8> {
    let (body, sum) = bytes.split_at_checked(bytes.len().checked_sub(2)?)?;
    let [from, refused, code, surplus @ ..] = body else { return None };
    let is_it = *from == unit && *refused == function | EXCEPTION && (1..=SURPLUS).contains(&surplus.len());
    (is_it && checksum(body).to_le_bytes() == *sum).then_some(*code)
}

#[cfg(test)]
mod tests;
