//! What a node complains of: EMCY messages.

use std::fmt;

use super::NodeId;
use crate::codec::can::Frame;

/// The identifiers on which emergencies come: this and the node's number.
pub const SERVICE: u16 = 0x080;

/// One emergency message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// What is wrong; 0x00xx: it is over.
    pub code: u16,
    /// What kinds of errors stand in the device at all (object 1001h).
    pub register: ErrorRegister,
    /// The maker's own five bytes; those that were not sent are zero.
    pub detail: [u8; 5],
}

/// Object 1001h: a bit for each kind of error that stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ErrorRegister(pub u8);

impl Emergency {
    /// The node and what it says; `None` where the frame is no emergency, or too short for code and register.
    pub fn of(frame: &Frame) -> Option<(NodeId, Emergency)> {
        let node = NodeId::sender(frame, SERVICE)?;
        let [low, high, register, rest @ ..] = frame.data() else { return None };
        let mut detail = [0; 5];
        detail.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
        let code = u16::from_le_bytes([*low, *high]);
        Some((node, Emergency { code, register: ErrorRegister(*register), detail }))
    }

    /// The error that was told before is over.
    pub const fn is_over(self) -> bool {
        self.code >> 8 == 0
    }

    /// What the code means by the standard's classes; the narrowest that is known.
    pub const fn words(self) -> &'static str {
        match self.code {
            0x8110 => "frames were lost: the receive buffer ran over",
            0x8120 => "the CAN controller is error passive",
            0x8130 => "a heartbeat or life guarding is missed",
            0x8140 => "recovered from bus-off",
            0x8150 => "another node sends with the same identifier",
            0x8210 => "a PDO was too short and not taken",
            0x8220 => "a PDO was longer than its map",
            0x8230 => "the destination of a multiplexed PDO is not available",
            0x8240 => "SYNC came with a wrong length",
            0x8250 => "an awaited PDO did not come",
            _ => match self.code >> 8 {
                0x00 => "no error, or an error is over",
                0x10 => "a generic error",
                0x20 => "current",
                0x21 => "current on the input side",
                0x22 => "current inside the device",
                0x23 => "current on the output side",
                0x30 => "voltage",
                0x31 => "mains voltage",
                0x32 => "voltage inside the device",
                0x33 => "output voltage",
                0x40 => "temperature",
                0x41 => "ambient temperature",
                0x42 => "device temperature",
                0x50 => "the device's hardware",
                0x60 => "the device's software",
                0x61 => "internal software",
                0x62 => "user software",
                0x63 => "a data set",
                0x70 => "an additional module",
                0x80 => "monitoring",
                0x81 => "communication",
                0x82 => "a protocol error",
                0x90 => "an external error",
                0xf0 => "an additional function",
                0xff => "an error of the maker's own",
                class => match class >> 4 {
                    0x1 => "a generic error",
                    0x2 => "current",
                    0x3 => "voltage",
                    0x4 => "temperature",
                    0x5 => "the device's hardware",
                    0x6 => "the device's software",
                    0x7 => "an additional module",
                    0x8 => "monitoring",
                    0x9 => "an external error",
                    0xf => "an error of the maker's own",
                    _ => "an error that the standard does not know",
                },
            },
        }
    }
}

impl fmt::Display for Emergency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}h: {}", self.code, self.words())?;
        if self.register.0 != 0 {
            write!(f, "; {}", self.register)?;
        }
        if self.detail != [0; 5] {
            let [a, b, c, d, e] = self.detail;
            write!(f, "; {a:02X} {b:02X} {c:02X} {d:02X} {e:02X}")?;
        }
        Ok(())
    }
}

impl ErrorRegister {
    /// The kinds of error that stand.
    pub fn kinds(self) -> impl Iterator<Item = &'static str> {
        const KINDS: [&str; 8] = [
            "generic",
            "current",
            "voltage",
            "temperature",
            "communication",
            "device profile",
            "reserved",
            "maker's own",
        ];
        KINDS.into_iter().enumerate().filter(move |(bit, _)| self.0 >> bit & 1 == 1).map(|(_, kind)| kind)
    }
}

impl fmt::Display for ErrorRegister {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds: Vec<_> = self.kinds().collect();
        if kinds.is_empty() {
            write!(f, "no error stands")
        } else {
            write!(f, "stands: {}", kinds.join(", "))
        }
    }
}
