//! Framing of the messages on a line.

use isotherm_core::codec::{AsciiFrames, ascii_frame, checksum};
use isotherm_profile::Transport;

/// Length of the header: transaction, protocol, length and unit.
const HEADER: usize = 7;
/// Unit number of the device on each line.
const UNIT: u8 = 1;
/// Length of a checksum in bytes.
const SUM: usize = 2;

/// Kind of frames on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Framing {
    /// Modbus TCP: a reply contains the transaction of its request.
    Tcp,
    /// RTU through a serial server, which forwards the bytes. A reply does not identify its request.
    Rtu,
    /// Modbus ASCII through a serial server. Its frames have the content of those of RTU.
    Ascii,
}

impl Framing {
    /// Frames of a line with this transport.
    pub(crate) fn of(transport: Transport) -> Framing {
        match transport {
            Transport::RtuOverTcp => Framing::Rtu,
            Transport::ModbusAsciiOverTcp => Framing::Ascii,
            _ => Framing::Tcp,
        }
    }

    /// Returns whether the frames are those of a serial line.
    pub(crate) fn is_serial(self) -> bool {
        self != Framing::Tcp
    }

    /// Returns the message in a frame; `None` if the frame is too short.
    pub(crate) fn message(self, frame: &[u8]) -> Option<Vec<u8>> {
        let message = match self {
            Framing::Tcp => frame.get(HEADER..),
            Framing::Rtu => frame.get(1..frame.len().checked_sub(SUM)?),
            Framing::Ascii => {
                let mut rtu = Vec::new();
                AsciiFrames::default().push(frame, &mut rtu);
                return Framing::Rtu.message(&rtu);
            }
        };
        message.map(<[u8]>::to_vec)
    }

    /// Returns the transaction of a request; zeros if frames have none.
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
            Framing::Ascii => ascii_frame(&Framing::Rtu.frame(transaction, message)),
        }
    }
}
