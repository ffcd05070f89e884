//! The server's side of Modbus TCP: frames, requests and answers as bytes. Pure, and nothing it is sent makes it panic.

use super::registers::Bank;
use isotherm_core::codec::{Register, Table};
use isotherm_profile::Functions;

/// Bytes before the protocol data unit: transaction, protocol, length, unit.
pub(super) const HEADER: usize = 7;
/// Largest protocol data unit.
pub(super) const LARGEST_PDU: usize = 253;

/// Exception codes.
pub(super) const ILLEGAL_FUNCTION: u8 = 1;
const ILLEGAL_ADDRESS: u8 = 2;
const ILLEGAL_VALUE: u8 = 3;
/// A gateway's answer for a unit that is not there.
pub(super) const NO_SUCH_UNIT: u8 = 0x0b;

/// The frame header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) transaction: u16,
    pub(super) unit: u8,
    /// How long the protocol data unit behind it is.
    pub(super) pdu: usize,
}

impl Header {
    /// `None` where this is no Modbus TCP: there is no way to find the next frame then.
    pub(super) fn decode(bytes: [u8; HEADER]) -> Option<Header> {
        let [t1, t2, p1, p2, l1, l2, unit] = bytes;
        let length = usize::from(u16::from_be_bytes([l1, l2]));
        let pdu = length.checked_sub(1)?;
        let is_modbus = p1 == 0 && p2 == 0 && (1..=LARGEST_PDU).contains(&pdu);
        is_modbus.then_some(Header { transaction: u16::from_be_bytes([t1, t2]), unit, pdu })
    }
}

/// A frame around a protocol data unit.
pub(super) fn frame(transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let length = u16::try_from(pdu.len() + 1).unwrap_or(u16::MAX);
    let mut bytes = Vec::with_capacity(HEADER + pdu.len());
    bytes.extend(transaction.to_be_bytes());
    bytes.extend([0, 0]);
    bytes.extend(length.to_be_bytes());
    bytes.push(unit);
    bytes.extend(pdu);
    bytes
}

/// A well-formed request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Request {
    Read {
        address: Register,
        count: u16,
    },
    /// Function 05 or 06.
    WriteOne {
        address: Register,
        value: u16,
    },
    /// Function 15 or 16.
    WriteMany {
        address: Register,
        values: Vec<u16>,
    },
}

impl Request {
    /// Reads a protocol data unit.
    ///
    /// # Errors
    /// The exception code it deserves.
    pub(super) fn decode(pdu: &[u8]) -> Result<Request, u8> {
        let (function, body) = pdu.split_first().ok_or(ILLEGAL_FUNCTION)?;
        let at = |table| field(body, 0).map(|offset| Register { table, offset }).ok_or(ILLEGAL_VALUE);
        let read = |table, most| {
            let count = field(body, 2).filter(|count| (1..=most).contains(count));
            match (body.len(), count) {
                (4, Some(count)) => Ok(Request::Read { address: at(table)?, count }),
                _ => Err(ILLEGAL_VALUE),
            }
        };
        match function {
            1 => read(Table::Coil, 2000),
            2 => read(Table::Discrete, 2000),
            3 => read(Table::Holding, 125),
            4 => read(Table::Input, 125),
            5 => match (field(body, 2), body.len()) {
                (Some(0xff00), 4) => Ok(Request::WriteOne { address: at(Table::Coil)?, value: 1 }),
                (Some(0), 4) => Ok(Request::WriteOne { address: at(Table::Coil)?, value: 0 }),
                _ => Err(ILLEGAL_VALUE),
            },
            6 => match (field(body, 2), body.len()) {
                (Some(value), 4) => Ok(Request::WriteOne { address: at(Table::Holding)?, value }),
                _ => Err(ILLEGAL_VALUE),
            },
            15 => {
                let (count, data) = counted(body, 1968, |count| count.div_ceil(8))?;
                let bit = |place: usize| data.get(place / 8).map(|byte| u16::from(byte >> (place % 8) & 1));
                let values = (0..count).map_while(bit).collect();
                Ok(Request::WriteMany { address: at(Table::Coil)?, values })
            }
            16 => {
                let (_, data) = counted(body, 123, |count| count * 2)?;
                let values = (0..data.len() / 2).map_while(|place| field(data, 2 * place)).collect();
                Ok(Request::WriteMany { address: at(Table::Holding)?, values })
            }
            _ => Err(ILLEGAL_FUNCTION),
        }
    }

    /// The first cell it speaks of, and how many.
    pub(super) fn extent(&self) -> (Register, u16) {
        match self {
            Request::Read { address, count } => (*address, *count),
            Request::WriteOne { address, .. } => (*address, 1),
            Request::WriteMany { address, values } => {
                (*address, u16::try_from(values.len()).unwrap_or(u16::MAX))
            }
        }
    }

    /// Changes a register or a coil.
    pub(super) fn is_write(&self) -> bool {
        !matches!(self, Request::Read { .. })
    }

    /// The cells it writes, with the values they shall have.
    pub(super) fn written(&self) -> Option<(Register, &[u16])> {
        match self {
            Request::Read { .. } => None,
            Request::WriteOne { address, value } => Some((*address, std::slice::from_ref(value))),
            Request::WriteMany { address, values } => Some((*address, values)),
        }
    }

    /// Whether a device that knows only these functions accepts it.
    pub(super) fn is_among(&self, functions: &Functions) -> bool {
        match self {
            Request::Read { address, .. } => match address.table {
                Table::Coil => functions.read_coils,
                Table::Discrete => functions.read_discrete,
                Table::Holding => functions.read_holding,
                Table::Input => functions.read_input,
            },
            Request::WriteOne { address, .. } if address.table.is_bits() => functions.write_coil,
            Request::WriteOne { .. } => functions.write_single,
            Request::WriteMany { address, .. } if address.table.is_bits() => functions.write_coils,
            Request::WriteMany { .. } => functions.write_multiple,
        }
    }

    /// Carries it out. `pdu` is what it was decoded from.
    ///
    /// # Errors
    /// The exception code.
    pub(super) fn answer(&self, pdu: &[u8], bank: &mut Bank) -> Result<Vec<u8>, u8> {
        let echo = |length: usize| pdu.iter().take(length).copied().collect();
        match self {
            Request::Read { address, count } => {
                let cells = bank.registers(*address, *count).ok_or(ILLEGAL_ADDRESS)?;
                let data = if address.table.is_bits() { packed(cells) } else { big_endian(cells) };
                let function = pdu.first().copied().unwrap_or_default();
                Ok([&[function, u8::try_from(data.len()).unwrap_or(u8::MAX)], data.as_slice()].concat())
            }
            Request::WriteOne { address, value } => {
                bank.write(&(*address).into(), &[*value]).map(|()| echo(5)).ok_or(ILLEGAL_ADDRESS)
            }
            Request::WriteMany { address, values } => {
                bank.write(&(*address).into(), values).map(|()| echo(5)).ok_or(ILLEGAL_ADDRESS)
            }
        }
    }
}

/// The answer that says no.
pub(super) fn exception(pdu: &[u8], code: u8) -> Vec<u8> {
    vec![pdu.first().copied().unwrap_or_default() | 0x80, code]
}

/// The 16-bit field at this byte.
fn field(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..at + 2).and_then(|pair| pair.try_into().ok()).map(u16::from_be_bytes)
}

/// Count and data of a write to several cells, if they agree with each other.
fn counted(body: &[u8], most: u16, bytes: fn(usize) -> usize) -> Result<(usize, &[u8]), u8> {
    let count = field(body, 2).filter(|count| (1..=most).contains(count)).ok_or(ILLEGAL_VALUE)?;
    let (said, data) = body.get(4..).and_then(<[u8]>::split_first).ok_or(ILLEGAL_VALUE)?;
    let needed = bytes(usize::from(count));
    if usize::from(*said) != needed || data.len() != needed {
        return Err(ILLEGAL_VALUE);
    }
    Ok((usize::from(count), data))
}

fn packed(bits: &[u16]) -> Vec<u8> {
    let byte = |bits: &[u16]| {
        bits.iter().enumerate().fold(0u8, |byte, (place, bit)| byte | (u8::from(*bit != 0) << place))
    };
    bits.chunks(8).map(byte).collect()
}

fn big_endian(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_be_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bank() -> Bank {
        let mut bank = Bank::default();
        for table in [Table::Coil, Table::Discrete, Table::Input, Table::Holding] {
            bank.reserve(&Register { table, offset: 0 }.into(), 32);
        }
        bank
    }

    fn ask(bank: &mut Bank, pdu: &[u8]) -> Vec<u8> {
        let answer = Request::decode(pdu).and_then(|request| request.answer(pdu, bank));
        answer.unwrap_or_else(|code| exception(pdu, code))
    }

    #[test]
    fn each_function_answers_as_the_specification_shows() {
        let bank = &mut bank();
        assert_eq!(ask(bank, &[6, 0, 1, 0x12, 0x34]), [6, 0, 1, 0x12, 0x34]);
        assert_eq!(ask(bank, &[16, 0, 2, 0, 2, 4, 0xab, 0xcd, 0, 1]), [16, 0, 2, 0, 2]);
        assert_eq!(ask(bank, &[3, 0, 1, 0, 3]), [3, 6, 0x12, 0x34, 0xab, 0xcd, 0, 1]);
        assert_eq!(ask(bank, &[4, 0, 0, 0, 1]), [4, 2, 0, 0]);
        assert_eq!(ask(bank, &[5, 0, 3, 0xff, 0]), [5, 0, 3, 0xff, 0]);
        assert_eq!(ask(bank, &[15, 0, 8, 0, 3, 1, 0b101]), [15, 0, 8, 0, 3]);
        assert_eq!(ask(bank, &[1, 0, 0, 0, 11]), [1, 2, 0b1000, 0b101]);
        assert_eq!(ask(bank, &[2, 0, 0, 0, 8]), [2, 1, 0]);
    }

    #[test]
    fn what_cannot_be_done_is_answered_with_the_right_exception() {
        let bank = &mut bank();
        assert_eq!(ask(bank, &[7]), [0x87, 1]);
        assert_eq!(ask(bank, &[3, 0, 31, 0, 2]), [0x83, 2]);
        assert_eq!(ask(bank, &[16, 0, 31, 0, 2, 4, 0, 0, 0, 0]), [0x90, 2]);
        assert_eq!(ask(bank, &[3, 0, 0, 0, 126]), [0x83, 3]);
        assert_eq!(ask(bank, &[3, 0, 0]), [0x83, 3]);
        assert_eq!(ask(bank, &[5, 0, 0, 1, 0]), [0x85, 3]);
        assert_eq!(ask(bank, &[15, 0, 0, 0, 9, 1, 0]), [0x8f, 3]);
        assert_eq!(ask(bank, &[16, 0, 0, 0, 2, 4, 0, 0]), [0x90, 3]);
        assert_eq!(ask(bank, &[]), [0x80, 1]);
    }

    #[test]
    fn a_header_that_is_no_modbus_is_refused() {
        assert_eq!(Header::decode([0, 9, 0, 0, 0, 6, 3]), Some(Header { transaction: 9, unit: 3, pdu: 5 }));
        for bad in
            [[0, 9, 0, 1, 0, 6, 3], [0, 9, 0, 0, 0, 1, 3], [0, 9, 0, 0, 0, 0, 3], [0, 9, 0, 0, 1, 0, 3]]
        {
            assert_eq!(Header::decode(bad), None);
        }
    }

    proptest! {
        #[test]
        fn no_request_makes_the_server_panic(pdu in proptest::collection::vec(any::<u8>(), 0..260)) {
            let answer = ask(&mut bank(), &pdu);
            prop_assert!(answer.len() >= 2 && answer.len() <= LARGEST_PDU);
        }

        #[test]
        fn no_body_of_a_known_function_makes_the_server_panic(
            function in prop_oneof![1u8..=6, 15u8..=16],
            body in proptest::collection::vec(prop_oneof![0u8..4, any::<u8>()], 0..20),
        ) {
            let answer = ask(&mut bank(), &[&[function], body.as_slice()].concat());
            prop_assert!(answer.len() >= 2 && answer.len() <= LARGEST_PDU);
        }
    }
}
