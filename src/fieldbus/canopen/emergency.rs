//! What a node complains of: EMCY messages.

use std::fmt;

use super::NodeId;
use isotherm_core::codec::Frame;

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
}

/// Without the words of its code, which are the device's.
impl fmt::Display for Emergency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}h", self.code)?;
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
            write!(f, "error register clear")
        } else {
            write!(f, "error register: {}", kinds.join(", "))
        }
    }
}
