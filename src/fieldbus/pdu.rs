//! Questions and answers as bytes, without what a transport puts around them. Beside the virtual machine only this knows
//! the Modbus library, for its decoder.
//!
//! The library's clients cannot serve: over TCP it numbers every connection's transactions from zero and clears away,
//! without a word, what was sent before it asked; over RTU it keeps no silence, waits for ever on a wrong checksum and
//! takes the first frame of the right unit and function for the answer. Neither has a timeout, compares the length of a
//! read, or (in release builds) the echo of a write. So the frames are ours ([`super::modbus`], [`super::rtu`]), and an
//! answer is compared here with its question in every part that the protocol repeats.

use std::io;

use tokio_modbus::Response;
use tokio_modbus::bytes::Bytes;

use super::error::{Fault, PeerFault};
use super::request::{Answer, Request};

/// The longest, by the protocol.
pub(super) const LONGEST: usize = 253;
/// The flag of an exception in the function code.
const EXCEPTION: u8 = 0x80;

/// The bytes of a request; none of one that is not Modbus.
pub(super) fn question(request: Request<'_>, bytes: &mut Vec<u8>) {
    bytes.extend(head(request).into_iter().flatten());
    if let Request::WriteMultiple { values, .. } = request {
        bytes.push(u8::try_from(2 * values.len()).unwrap_or(u8::MAX));
        bytes.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    }
}

/// What each question begins with, and what the answer to a write repeats: function, address, and value or count.
fn head(request: Request<'_>) -> Option<[u8; 5]> {
    let (at, second) = match request {
        Request::Read { from, count } => (from.offset, count),
        Request::WriteCoil { at, value } => (at, if value { 0xff00 } else { 0 }),
        Request::WriteSingle { at, value } => (at, value),
        Request::WriteMultiple { at, values } => (at, u16::try_from(values.len()).unwrap_or(u16::MAX)),
        // Refused before.
        Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => return None,
    };
    let ([at_high, at_low], [high, low]) = (at.to_be_bytes(), second.to_be_bytes());
    Some([request.function(), at_high, at_low, high, low])
}

/// What these bytes answer to that question.
///
/// # Errors
/// They refuse it, or they are not its answer. An exception has exactly two bytes.
pub(super) fn answer(request: Request<'_>, bytes: &[u8]) -> Result<Answer, Fault> {
    let function = bytes.first().copied().unwrap_or_default();
    if function & !EXCEPTION != request.function() {
        return Err(Fault::Peer(PeerFault::Function));
    }
    if function & EXCEPTION != 0 {
        return Err(match bytes {
            [_, code] => Fault::Exception(*code),
            _ => Fault::Peer(PeerFault::Malformed),
        });
    }
    // The library leaves out what is behind an answer's last byte, and guesses what is missing.
    let length = match request {
        Request::Read { .. } => 2 + usize::from(bytes.get(1).copied().unwrap_or_default()),
        _ => 5,
    };
    if bytes.len() != length {
        return Err(Fault::Peer(PeerFault::Length));
    }
    if !request.is_read() {
        let is_repeated = head(request).is_some_and(|head| head == bytes);
        return if is_repeated { Ok(Answer::Done) } else { Err(Fault::Peer(PeerFault::Echo)) };
    }
    let malformed = |_: io::Error| Fault::Peer(PeerFault::Malformed);
    compare(request, Response::try_from(Bytes::copy_from_slice(bytes)).map_err(malformed)?)
}

fn compare(request: Request<'_>, response: Response) -> Result<Answer, Fault> {
    match (request, response) {
        (
            Request::Read { count, .. },
            Response::ReadInputRegisters(registers) | Response::ReadHoldingRegisters(registers),
        ) => {
            if registers.len() == usize::from(count) {
                Ok(Answer::Registers(registers))
            } else {
                Err(Fault::Peer(PeerFault::Length))
            }
        }
        (
            Request::Read { count, .. },
            Response::ReadCoils(mut bits) | Response::ReadDiscreteInputs(mut bits),
        ) => {
            // Bits travel in whole bytes.
            if bits.len() != usize::from(count).next_multiple_of(8) {
                return Err(Fault::Peer(PeerFault::Length));
            }
            bits.truncate(usize::from(count));
            Ok(Answer::Bits(bits))
        }
        _ => Err(Fault::Peer(PeerFault::Function)),
    }
}
