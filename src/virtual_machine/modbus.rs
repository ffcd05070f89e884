//! Server side of Modbus: frames, requests and answers as bytes. The functions use no socket and no clock, and no input
//! causes a panic.

use std::ops::Range;

use super::registers::Bank;
use isotherm_core::codec::{Register, Table, checksum};

/// Number of bytes before the protocol data unit of Modbus TCP: transaction, protocol, length, unit.
pub(super) const HEADER: usize = 7;
/// Length in bytes of the largest protocol data unit.
pub(super) const LARGEST_PDU: usize = 253;

/// Modbus exception codes for an invalid request: function, address or value.
pub(super) const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
/// Exception code of a Modbus gateway for a unit that does not exist.
pub(super) const NO_SUCH_UNIT: u8 = 0x0b;

/// Frame format of Modbus: the bytes before and after a protocol data unit (request or answer without its frame).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Framing {
    /// Modbus TCP: a header with transaction number, length and unit number.
    Tcp,
    /// Modbus RTU: unit number before the data unit, checksum after it.
    Rtu,
}

/// Unit number and transaction number of a request. Over RTU the transaction number is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) transaction: u16,
    pub(super) unit: u8,
}

/// Error for data that is not Modbus TCP. The start of the next frame in these data cannot be found.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct NoModbus;

impl Framing {
    /// Returns a frame that contains this protocol data unit.
    pub(super) fn frame(self, transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER + pdu.len());
        if self == Framing::Tcp {
            bytes.extend(transaction.to_be_bytes());
            bytes.extend([0, 0]);
            bytes.extend(u16::try_from(pdu.len() + 1).unwrap_or(u16::MAX).to_be_bytes());
        }
        bytes.push(unit);
        bytes.extend(pdu);
        if self == Framing::Rtu {
            bytes.extend(checksum(&bytes).to_le_bytes());
        }
        bytes
    }

    /// Finds the first request in these bytes. Returns its header and the range of its protocol data unit. Returns
    /// `None` if the request is incomplete or its checksum is wrong.
    pub(super) fn request(self, bytes: &[u8]) -> Result<Option<(Header, Range<usize>)>, NoModbus> {
        match self {
            Framing::Tcp => {
                let Some(&[t1, t2, p1, p2, l1, l2, unit]) = bytes.first_chunk() else { return Ok(None) };
                let length = usize::from(u16::from_be_bytes([l1, l2]));
                if [p1, p2] != [0, 0] || !(2..=LARGEST_PDU + 1).contains(&length) {
                    return Err(NoModbus);
                }
                let pdu = HEADER..HEADER + length - 1;
                let header = Header { transaction: u16::from_be_bytes([t1, t2]), unit };
                Ok((bytes.len() >= pdu.end).then_some((header, pdu)))
            }
            Framing::Rtu => Ok(rtu_request(bytes)),
        }
    }

    /// Returns the number of bytes of a frame after its protocol data unit: the checksum of RTU.
    pub(super) fn trailer(self) -> usize {
        if self == Framing::Rtu { 2 } else { 0 }
    }
}

fn rtu_request(bytes: &[u8]) -> Option<(Header, Range<usize>)> {
    let end = match *bytes.get(1)? {
        1..=6 => 6,
        15 | 16 => 7 + usize::from(*bytes.get(6)?),
        _ => return None,
    };
    let (body, sum) = bytes.get(..end + 2)?.split_at(end);
    let is_right = checksum(body).to_le_bytes() == *sum;
    is_right.then_some((Header { transaction: 0, unit: bytes[0] }, 1..end))
}

/// Decoded request that reads or writes registers or bits, with a valid function and count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) function: u8,
    /// First register or bit; `count` is the number of registers or bits.
    pub(super) address: Register,
    pub(super) count: u16,
    /// Values to write; empty for a read.
    pub(super) values: Vec<u16>,
}

impl Request {
    /// Decodes a request from a protocol data unit.
    ///
    /// # Errors
    /// The exception code with which an invalid request is answered.
    pub(super) fn decode(pdu: &[u8]) -> Result<Request, u8> {
        let (&function, body) = pdu.split_first().ok_or(ILLEGAL_FUNCTION)?;
        let (table, most) = match function {
            1 => (Table::Coil, 2000),
            2 => (Table::Discrete, 2000),
            3 => (Table::Holding, 125),
            4 => (Table::Input, 125),
            5 => (Table::Coil, 1),
            6 => (Table::Holding, 1),
            15 => (Table::Coil, 1968),
            16 => (Table::Holding, 123),
            _ => return Err(ILLEGAL_FUNCTION),
        };
        let &[a, b, c, d, ref data @ ..] = body else { return Err(ILLEGAL_VALUE) };
        let (offset, second) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        let count = if matches!(function, 5 | 6) { 1 } else { second };
        let size = usize::from(count);
        let values = match (function, data) {
            _ if !(1..=most).contains(&count) => return Err(ILLEGAL_VALUE),
            (1..=4, []) => Vec::new(),
            (5, []) if matches!(second, 0 | 0xff00) => vec![u16::from(second != 0)],
            (6, []) => vec![second],
            (15, [said, data @ ..]) if usize::from(*said) == data.len() && data.len() == size.div_ceil(8) => {
                (0..size).map(|place| u16::from(data[place / 8] >> (place % 8) & 1)).collect()
            }
            (16, [said, data @ ..]) if usize::from(*said) == data.len() && data.len() == 2 * size => {
                data.chunks(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()
            }
            _ => return Err(ILLEGAL_VALUE),
        };
        Ok(Request { function, address: Register { table, offset }, count, values })
    }

    /// Returns whether the request writes registers or coils.
    pub(super) fn is_write(&self) -> bool {
        !self.values.is_empty()
    }

    /// Executes the request on `bank`, and returns the answer. `pdu` is the protocol data unit from which the request
    /// was decoded.
    ///
    /// # Errors
    /// The exception code with which a failed request is answered.
    pub(super) fn answer(&self, pdu: &[u8], bank: &mut Bank) -> Result<Vec<u8>, u8> {
        if self.is_write() {
            bank.write(&self.address.into(), &self.values).ok_or(ILLEGAL_ADDRESS)?;
            return Ok(pdu.iter().take(5).copied().collect());
        }
        let cells = bank.registers(self.address, self.count).ok_or(ILLEGAL_ADDRESS)?;
        let data: Vec<u8> = if self.address.table.is_bits() {
            cells.chunks(8).map(packed).collect()
        } else {
            cells.iter().flat_map(|cell| cell.to_be_bytes()).collect()
        };
        Ok([&[self.function, u8::try_from(data.len()).unwrap_or(u8::MAX)], data.as_slice()].concat())
    }
}

/// Returns the answers to the requests in these bytes, by a unit with sixteen registers or bits in each table. A
/// connection of a virtual machine gives the same answers. Fuzz tests use this function.
pub fn answered(bytes: &[u8], is_rtu: bool) -> Vec<u8> {
    let framing = if is_rtu { Framing::Rtu } else { Framing::Tcp };
    let mut bank = Bank::default();
    for table in [Table::Coil, Table::Discrete, Table::Input, Table::Holding] {
        bank.reserve(&Register { table, offset: 0 }.into(), 16);
    }
    let (mut left, mut answers) = (bytes, Vec::new());
    while let Ok(Some((header, pdu))) = framing.request(left) {
        let behind = pdu.end + framing.trailer();
        let pdu = &left[pdu];
        let answer = Request::decode(pdu).and_then(|request| request.answer(pdu, &mut bank));
        let answer = answer.unwrap_or_else(|code| exception(pdu, code));
        answers.extend(framing.frame(header.transaction, header.unit, &answer));
        left = &left[behind..];
    }
    answers
}

/// Returns the answer to a request with this exception code.
pub(super) fn exception(pdu: &[u8], code: u8) -> Vec<u8> {
    vec![pdu.first().copied().unwrap_or_default() | 0x80, code]
}

fn packed(bits: &[u16]) -> u8 {
    bits.iter().enumerate().fold(0, |byte, (place, bit)| byte | (u8::from(*bit != 0) << place))
}

#[cfg(test)]
mod tests;
