//! Framing of the messages on a line.

use isotherm_core::codec::checksum;

/// Transaction, protocol, length and unit.
const HEADER: usize = 7;
/// Number of the device on each line.
const UNIT: u8 = 1;
/// Bytes of a checksum.
const SUM: usize = 2;

/// Kind of the frames on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Framing {
    /// Modbus TCP: an answer has the transaction of its question.
    Tcp,
    /// RTU through a serial server, which passes the bytes on: an answer does not name its question.
    Rtu,
}

impl Framing {
    /// Returns the message in a frame, or `None` if the frame is too short for one.
    pub(crate) fn message(self, frame: &[u8]) -> Option<&[u8]> {
        match self {
            Framing::Tcp => frame.get(HEADER..),
            Framing::Rtu => frame.get(1..frame.len().checked_sub(SUM)?),
        }
    }

    /// Returns the transaction of a question; zeros if frames have none.
    pub(crate) fn transaction(self, frame: &[u8]) -> [u8; 2] {
        match (self, frame) {
            (Framing::Tcp, [high, low, ..]) => [*high, *low],
            _ => [0; 2],
        }
    }

    /// Returns the frame of a message.
    pub(crate) fn frame(self, transaction: [u8; 2], message: &[u8]) -> Vec<u8> {
        match self {
            Framing::Tcp => {
                let length = u16::try_from(message.len() + 1).unwrap_or_default().to_be_bytes();
                [&transaction[..], &[0, 0], &length, &[UNIT], message].concat()
            }
            Framing::Rtu => {
                let mut frame = [&[UNIT][..], message].concat();
                frame.extend(checksum(&frame).to_le_bytes());
                frame
            }
        }
    }
}
