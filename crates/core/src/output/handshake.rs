//! Failures of a handshake with a control.

use serde::{Deserialize, Serialize};

/// Stage at which a handshake failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HandshakeFault {
    /// The acknowledge was up before the strobe, and stayed up.
    AcknowledgeEarly,
    /// The strobe could not be raised.
    StrobeNotWritten,
    /// The acknowledge did not come.
    AcknowledgeMissing,
    /// The acknowledge could not be read.
    AcknowledgeNotRead,
    /// The strobe could not be dropped.
    StrobeNotDropped,
    /// The acknowledge did not drop after the strobe.
    AcknowledgeStuck,
}

impl HandshakeFault {
    /// Name for programs: label of the counter.
    pub const fn kind(self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly => "acknowledge-early",
            HandshakeFault::StrobeNotWritten => "strobe-not-written",
            HandshakeFault::AcknowledgeMissing => "acknowledge-missing",
            HandshakeFault::AcknowledgeNotRead => "acknowledge-not-read",
            HandshakeFault::StrobeNotDropped => "strobe-not-dropped",
            HandshakeFault::AcknowledgeStuck => "acknowledge-stuck",
        }
    }

    /// Failure, as text for a status line.
    pub const fn message(self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly => "the acknowledge is up before the strobe",
            HandshakeFault::StrobeNotWritten => "the strobe could not be written",
            HandshakeFault::AcknowledgeMissing => "the acknowledge did not come",
            HandshakeFault::AcknowledgeNotRead => "the acknowledge could not be read",
            HandshakeFault::StrobeNotDropped => "the strobe could not be dropped",
            HandshakeFault::AcknowledgeStuck => "the acknowledge did not drop",
        }
    }

    /// Hint for the operator.
    pub const fn hint(self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly | HandshakeFault::AcknowledgeStuck => {
                "does the control's program drop the acknowledge when the strobe drops?"
            }
            HandshakeFault::AcknowledgeMissing => {
                "does the control's program run, does it read this strobe? If so, raise `timeout` of the \
                 handshake"
            }
            HandshakeFault::StrobeNotWritten
            | HandshakeFault::StrobeNotDropped
            | HandshakeFault::AcknowledgeNotRead => {
                "is the control on, may the gateway read and write this address?"
            }
        }
    }

    /// Returns whether the failure concerns the strobe, not the acknowledge.
    pub const fn is_of_the_strobe(self) -> bool {
        matches!(self, HandshakeFault::StrobeNotWritten | HandshakeFault::StrobeNotDropped)
    }

    /// Builds a sentence about `set` ("output cnc_z", "set plc"). `register` is that of the strobe or the acknowledge.
    /// `cause` is "within 500 ms", or the fault of the request.
    pub fn sentence(self, set: &str, register: &str, cause: &str) -> String {
        let flag = if self.is_of_the_strobe() { "strobe" } else { "acknowledge" };
        let failed = match self {
            HandshakeFault::AcknowledgeEarly => {
                format!("was up before the strobe and did not drop {cause} ({register})")
            }
            HandshakeFault::AcknowledgeMissing => format!("did not come {cause} ({register})"),
            HandshakeFault::AcknowledgeStuck => format!("did not drop {cause} after the strobe ({register})"),
            HandshakeFault::StrobeNotWritten => format!("could not be written ({register}): {cause}"),
            HandshakeFault::StrobeNotDropped => format!("could not be dropped ({register}): {cause}"),
            HandshakeFault::AcknowledgeNotRead => format!("could not be read ({register}): {cause}"),
        };
        format!("{flag} of {set} {failed}")
    }
}
