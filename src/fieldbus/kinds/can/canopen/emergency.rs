//! Emergency messages (EMCY), with which a node reports an error of its device, or the end of an error.

use std::fmt;

use super::NodeId;
use isotherm_core::codec::Frame;

/// First CAN identifier of emergency messages, to which the number of the node is added.
pub const SERVICE: u16 = 0x080;

/// Emergency message of a node: its error code, its error register, and bytes of the manufacturer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// Error code. A code of the form 0x00xx reports that an earlier error is over.
    pub code: u16,
    /// Kinds of errors that the device has at present (object 1001h).
    pub register: ErrorRegister,
    /// Five bytes that the manufacturer defines; bytes that the node did not send are zero.
    pub detail: [u8; 5],
}

/// Error register (object 1001h): one bit for each kind of error that is present.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ErrorRegister(pub u8);

impl Emergency {
    /// Returns the node and its message; `None` if the frame is not an emergency message, or is too short for the code
    /// and the register.
    pub fn of(frame: &Frame) -> Option<(NodeId, Emergency)> {
        let node = NodeId::sender(frame, SERVICE)?;
        let [low, high, register, rest @ ..] = frame.data() else { return None };
        let mut detail = [0; 5];
        detail.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
        let code = u16::from_le_bytes([*low, *high]);
        Some((node, Emergency { code, register: ErrorRegister(*register), detail }))
    }

    /// Returns whether the message reports that an earlier error is over.
    pub const fn is_over(self) -> bool {
        self.code >> 8 == 0
    }
}

/// Text of code, register and details. The meaning of the code is not included, because it depends on the device.
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
    /// Returns a word for each kind of error that is present, for example `temperature`.
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
