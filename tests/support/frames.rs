//! Frames on a serial line, for tests with Modbus RTU and Modbus ASCII. The tests build and read the frames of RTU.

use isotherm_core::codec::{AsciiFrames, ascii_frame};
use isotherm_profile::{Parity, Serial, Transport};

/// Kind of frames on a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Frames {
    Rtu,
    Ascii,
}

impl Frames {
    /// Transport of a serial port with these frames.
    pub(crate) fn on_port(self, baud: u32) -> Transport {
        let serial = Serial { baud, parity: Parity::None, stop_bits: 1 };
        match self {
            Frames::Rtu => Transport::Serial(serial),
            Frames::Ascii => Transport::ModbusAscii { serial, data_bits: 8 },
        }
    }

    /// Transport of these frames through a TCP connection.
    pub(crate) fn through_tcp(self) -> Transport {
        match self {
            Frames::Rtu => Transport::RtuOverTcp,
            Frames::Ascii => Transport::ModbusAsciiOverTcp,
        }
    }

    /// Type of a bus of these frames through a TCP connection.
    pub(crate) fn type_through_tcp(self) -> &'static str {
        match self {
            Frames::Rtu => "modbus-rtu-over-tcp",
            Frames::Ascii => "modbus-ascii",
        }
    }

    /// Returns the bytes on the line for a frame of RTU.
    pub(crate) fn encode(self, rtu: Vec<u8>) -> Vec<u8> {
        match self {
            Frames::Rtu => rtu,
            Frames::Ascii => ascii_frame(&rtu),
        }
    }
}

/// Received bytes as those of RTU.
pub(crate) struct Received {
    frames: Frames,
    ascii: AsciiFrames,
    pub(crate) bytes: Vec<u8>,
}

impl Received {
    pub(crate) fn new(frames: Frames) -> Received {
        Received { frames, ascii: AsciiFrames::default(), bytes: Vec::new() }
    }

    /// Adds bytes from the line.
    pub(crate) fn push(&mut self, bytes: &[u8]) {
        match self.frames {
            Frames::Rtu => self.bytes.extend(bytes),
            Frames::Ascii => self.ascii.push(bytes, &mut self.bytes),
        }
    }
}
