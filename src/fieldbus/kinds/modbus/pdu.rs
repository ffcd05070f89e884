//! Encoding of Modbus requests and decoding of answers (the protocol data unit, without the frame of a transport). Only
//! this module uses the Modbus library, for its decoder.
//!
//! The clients of the library are not suitable. Over TCP they number the transactions of every connection from zero,
//! and discard earlier input without a warning. Over RTU they do not keep the line silent before a request, and wait
//! for ever after a wrong checksum. They accept the first frame with the correct unit and function as the
//! answer. No client has a timeout, or checks the length of a read, or (in release builds) the echo of a
//! write. The gateway therefore has its own frames ([`super::tcp`], [`super::rtu`]). This module compares an
//! answer with its request in every field that the protocol repeats.

use std::io;

use tokio_modbus::Response;
use tokio_modbus::bytes::Bytes;

use super::request::ModbusRequest;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::request::Answer;

/// Length in bytes of the longest Modbus message (protocol data unit).
pub(super) const LONGEST: usize = 253;
/// Bit of the function code that marks an exception.
pub(super) const EXCEPTION: u8 = 0x80;

/// Appends the encoded request to `bytes`: function code, address, and value or count; for function 16 also the values.
pub(super) fn question(request: ModbusRequest<'_>, bytes: &mut Vec<u8>) {
    bytes.extend(head(request));
    if let ModbusRequest::WriteMultiple { values, .. } = request {
        bytes.push(u8::try_from(2 * values.len()).unwrap_or(u8::MAX));
        bytes.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    }
}

/// Returns the first five bytes of a request: function, address, and value or count. The answer to a write repeats
/// these bytes.
fn head(request: ModbusRequest<'_>) -> [u8; 5] {
    let (at, second) = match request {
        ModbusRequest::Read { from, count } => (from.offset, count),
        ModbusRequest::WriteCoil { at, value } => (at, if value { 0xff00 } else { 0 }),
        ModbusRequest::WriteSingle { at, value } => (at, value),
        ModbusRequest::WriteMultiple { at, values } => (at, u16::try_from(values.len()).unwrap_or(u16::MAX)),
    };
    let ([at_high, at_low], [high, low]) = (at.to_be_bytes(), second.to_be_bytes());
    [request.function(), at_high, at_low, high, low]
}

/// Decodes an answer, and compares it with its request.
///
/// # Errors
/// The device refuses the request, or the bytes are not an answer to the request. An exception has exactly two bytes.
/// An exception of three or four bytes is a separate fault, because such an answer does not prove that a write was not
/// executed.
pub(super) fn answer(request: ModbusRequest<'_>, bytes: &[u8]) -> Result<Answer, Fault> {
    let function = bytes.first().copied().unwrap_or_default();
    if function & !EXCEPTION != request.function() {
        return Err(Fault::Peer(PeerFault::Function));
    }
    if function & EXCEPTION != 0 {
        return Err(match bytes {
            [_, code] => Fault::Exception(*code),
            [_, code, _] | [_, code, _, _] => Fault::Peer(PeerFault::LongException(*code)),
            _ => Fault::Peer(PeerFault::Malformed),
        });
    }
    // The library ignores bytes after the end of an answer, and fills in missing ones.
    let length = match request {
        ModbusRequest::Read { .. } => 2 + usize::from(bytes.get(1).copied().unwrap_or_default()),
        _ => 5,
    };
    if bytes.len() != length {
        let is_echo = request.is_read() && head(request) == *bytes;
        return Err(Fault::Peer(if is_echo { PeerFault::Echoed } else { PeerFault::Length }));
    }
    if !request.is_read() {
        return if head(request) == *bytes { Ok(Answer::Done) } else { Err(Fault::Peer(PeerFault::Echo)) };
    }
    let malformed = |_: io::Error| Fault::Peer(PeerFault::Malformed);
    compare(request, Response::try_from(Bytes::copy_from_slice(bytes)).map_err(malformed)?)
}

fn compare(request: ModbusRequest<'_>, response: Response) -> Result<Answer, Fault> {
    match (request, response) {
        (
            ModbusRequest::Read { count, .. },
            Response::ReadInputRegisters(registers) | Response::ReadHoldingRegisters(registers),
        ) => {
            if registers.len() == usize::from(count) {
                Ok(Answer::Registers(registers))
            } else {
                Err(Fault::Peer(PeerFault::Length))
            }
        }
        (
            ModbusRequest::Read { count, .. },
            Response::ReadCoils(mut bits) | Response::ReadDiscreteInputs(mut bits),
        ) => {
            // Bits are sent in whole bytes.
            if bits.len() != usize::from(count).next_multiple_of(8) {
                return Err(Fault::Peer(PeerFault::Length));
            }
            bits.truncate(usize::from(count));
            Ok(Answer::Bits(bits))
        }
        _ => Err(Fault::Peer(PeerFault::Function)),
    }
}
