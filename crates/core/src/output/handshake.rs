//! Failures of a handshake with a control. In a handshake, the gateway sets a strobe signal, and the control answers
//! with an acknowledge signal.

use serde::{Deserialize, Serialize};

use crate::events::EventKind;

/// Stage at which a handshake failed. In a handshake, the gateway sets a strobe signal, and the control answers with an
/// acknowledge signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HandshakeFault {
    /// The acknowledge signal of the control was up before the strobe signal was raised, and stayed up.
    AcknowledgeEarly,
    /// The gateway could not set the strobe signal of a handshake.
    StrobeNotWritten,
    /// The control did not raise its acknowledge signal in time.
    AcknowledgeMissing,
    /// The acknowledge signal of the control could not be read.
    AcknowledgeNotRead,
    /// The gateway could not reset the strobe signal of a handshake.
    StrobeNotDropped,
    /// The control did not drop its acknowledge signal after the strobe signal was dropped.
    AcknowledgeStuck,
}

impl HandshakeFault {
    /// Returns the kind of the event that reports this failure.
    pub const fn kind(self) -> EventKind {
        match self {
            HandshakeFault::AcknowledgeEarly => EventKind::AcknowledgeEarly,
            HandshakeFault::StrobeNotWritten => EventKind::StrobeNotWritten,
            HandshakeFault::AcknowledgeMissing => EventKind::AcknowledgeMissing,
            HandshakeFault::AcknowledgeNotRead => EventKind::AcknowledgeNotRead,
            HandshakeFault::StrobeNotDropped => EventKind::StrobeNotDropped,
            HandshakeFault::AcknowledgeStuck => EventKind::AcknowledgeStuck,
        }
    }

    /// Returns the failure as a text for the status of the output.
    pub const fn message(self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly => "the acknowledge signal is set before the strobe signal",
            HandshakeFault::StrobeNotWritten => "the strobe signal could not be written",
            HandshakeFault::AcknowledgeMissing => "the acknowledge signal did not come",
            HandshakeFault::AcknowledgeNotRead => "the acknowledge signal could not be read",
            HandshakeFault::StrobeNotDropped => "the strobe signal could not be reset",
            HandshakeFault::AcknowledgeStuck => "the acknowledge signal did not drop",
        }
    }

    /// Returns the hint for the operator; empty if there is none.
    pub fn hint(self) -> &'static str {
        self.kind().hint().unwrap_or_default()
    }

    /// Returns whether the failure concerns the strobe signal, not the acknowledge signal.
    pub const fn is_of_the_strobe(self) -> bool {
        matches!(self, HandshakeFault::StrobeNotWritten | HandshakeFault::StrobeNotDropped)
    }

    /// Builds a sentence about the failed handshake of `set` ("output cnc_z", "set plc"). `register` is the register of
    /// the failed signal, strobe or acknowledge. `cause` is "within 500 ms", or the fault of the request.
    pub fn sentence(self, set: &str, register: &str, cause: &str) -> String {
        let flag = if self.is_of_the_strobe() { "strobe signal" } else { "acknowledge signal" };
        let failed = match self {
            HandshakeFault::AcknowledgeEarly => {
                format!("was set before the strobe signal and did not drop {cause} ({register})")
            }
            HandshakeFault::AcknowledgeMissing => format!("did not come {cause} ({register})"),
            HandshakeFault::AcknowledgeStuck => {
                format!("did not drop {cause} after the strobe signal ({register})")
            }
            HandshakeFault::StrobeNotWritten => format!("could not be written ({register}): {cause}"),
            HandshakeFault::StrobeNotDropped => format!("could not be reset ({register}): {cause}"),
            HandshakeFault::AcknowledgeNotRead => format!("could not be read ({register}): {cause}"),
        };
        format!("{flag} of {set} {failed}")
    }
}
