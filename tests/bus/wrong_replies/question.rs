//! Request as the device received it, and possible replies to it.

use std::time::Duration;

use isotherm_core::codec::checksum;

/// Temperature of the device in tenths of a degree. `LIE` is a value that it never has.
pub(crate) const TRUTH: i32 = 215;
pub(crate) const LIE: i32 = 777;

/// Kind of line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Tcp,
    RtuOverTcp,
    Port,
}

impl Kind {
    pub(crate) const ALL: [Kind; 3] = [Kind::Tcp, Kind::RtuOverTcp, Kind::Port];

    /// Timeout of the gateway. The kernel moves the bytes of a pseudo-terminal in a thread of its own, in both directions.
    /// Beside a load this takes longer than the answer on a socket.
    pub(crate) fn timeout(self) -> Duration {
        Duration::from_millis(if self == Kind::Port { 100 } else { 50 })
    }

    pub(crate) fn is_rtu(self) -> bool {
        self != Kind::Tcp
    }

    /// Returns the frame of a protocol data unit on this kind of line.
    pub(crate) fn frame(self, transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
        if self.is_rtu() { rtu(unit, pdu) } else { tcp(transaction, 0, pdu.len() + 1, unit, pdu) }
    }
}

pub(crate) fn rtu(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut bytes = [&[unit], pdu].concat();
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// Returns a frame with any header.
pub(crate) fn tcp(transaction: u16, protocol: u16, length: usize, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let length = u16::try_from(length).unwrap();
    let words = [transaction, protocol, length];
    let header = words.into_iter().flat_map(u16::to_be_bytes);
    header.chain([unit]).chain(pdu.iter().copied()).collect()
}

/// Returns the answer to a read of this temperature.
pub(crate) fn reading(function: u8, tenths: i32) -> Vec<u8> {
    [&[function, 4], tenths.to_be_bytes().as_slice()].concat()
}

#[derive(Clone, Debug)]
pub(crate) struct Question {
    pub(crate) kind: Kind,
    pub(crate) transaction: u16,
    pub(crate) unit: u8,
    pub(crate) pdu: Vec<u8>,
}

impl Question {
    /// Returns the first whole request in these bytes, and its end.
    pub(crate) fn find(kind: Kind, bytes: &[u8]) -> Option<(Question, usize)> {
        if !kind.is_rtu() {
            let header = bytes.first_chunk::<7>()?;
            let length = usize::from(u16::from_be_bytes([header[4], header[5]]));
            let pdu = bytes.get(7..6 + length)?.to_vec();
            let transaction = u16::from_be_bytes([header[0], header[1]]);
            return Some((Question { kind, transaction, unit: header[6], pdu }, 6 + length));
        }
        (0..bytes.len()).find_map(|from| {
            let rest = &bytes[from..];
            let length = if *rest.get(1)? == 16 { 9 + usize::from(*rest.get(6)?) } else { 8 };
            let (frame, sum) = rest.get(..length)?.split_at(length - 2);
            let is_whole = checksum(frame).to_le_bytes() == sum;
            let asked = || Question { kind, transaction: 0, unit: frame[0], pdu: frame[1..].to_vec() };
            is_whole.then(|| (asked(), from + length))
        })
    }

    pub(crate) fn function(&self) -> u8 {
        self.pdu[0]
    }

    pub(crate) fn is_read(&self) -> bool {
        self.function() < 5
    }

    /// Returns a frame with the transaction and unit of the request.
    pub(crate) fn framed(&self, pdu: &[u8]) -> Vec<u8> {
        self.kind.frame(self.transaction, self.unit, pdu)
    }

    /// Returns a frame with the transaction of the request and another unit.
    pub(crate) fn framed_for(&self, unit: u8) -> Vec<u8> {
        self.kind.frame(self.transaction, unit, &self.content())
    }

    /// Returns the correct answer.
    pub(crate) fn right(&self) -> Vec<u8> {
        self.framed(&self.pdu_of(TRUTH))
    }

    /// Returns an answer of the correct form with the false temperature. A write has only one form.
    pub(crate) fn content(&self) -> Vec<u8> {
        self.pdu_of(LIE)
    }

    pub(crate) fn pdu_of(&self, tenths: i32) -> Vec<u8> {
        if self.is_read() { reading(self.function(), tenths) } else { self.pdu[..5].to_vec() }
    }
}
