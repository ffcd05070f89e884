//! How a handshake fails: each stage by its own name.

use std::fmt;
use std::time::Duration;

/// The stage at which a handshake failed. `register` is the profile's name of the strobe or the acknowledge.
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each field is what its name says")]
pub enum HandshakeFault {
    /// The acknowledge was up before the strobe, and stayed up.
    AcknowledgeEarly { within: Duration, register: String },
    /// The strobe could not be raised.
    StrobeNotWritten { register: String, fault: String },
    /// The acknowledge did not come.
    AcknowledgeMissing { within: Duration, register: String },
    /// The acknowledge could not be read.
    AcknowledgeNotRead { register: String, fault: String },
    /// The strobe could not be dropped.
    StrobeNotDropped { register: String, fault: String },
    /// The acknowledge did not drop after the strobe.
    AcknowledgeStuck { within: Duration, register: String },
}

impl HandshakeFault {
    /// One word for programs: the counter's label.
    pub fn kind(&self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly { .. } => "acknowledge-early",
            HandshakeFault::StrobeNotWritten { .. } => "strobe-not-written",
            HandshakeFault::AcknowledgeMissing { .. } => "acknowledge-missing",
            HandshakeFault::AcknowledgeNotRead { .. } => "acknowledge-not-read",
            HandshakeFault::StrobeNotDropped { .. } => "strobe-not-dropped",
            HandshakeFault::AcknowledgeStuck { .. } => "acknowledge-stuck",
        }
    }

    /// The same for a status line.
    pub fn words(&self) -> &'static str {
        match self {
            HandshakeFault::AcknowledgeEarly { .. } => "the acknowledge is up before the strobe",
            HandshakeFault::StrobeNotWritten { .. } => "the strobe could not be written",
            HandshakeFault::AcknowledgeMissing { .. } => "the acknowledge did not come",
            HandshakeFault::AcknowledgeNotRead { .. } => "the acknowledge could not be read",
            HandshakeFault::StrobeNotDropped { .. } => "the strobe could not be dropped",
            HandshakeFault::AcknowledgeStuck { .. } => "the acknowledge did not drop",
        }
    }

    /// The sentence, of `set`: "output cnc_z", "set plc".
    pub(super) fn write(&self, f: &mut fmt::Formatter<'_>, set: &str) -> fmt::Result {
        match self {
            HandshakeFault::AcknowledgeEarly { within, register } => write!(
                f,
                "acknowledge of {set} was up before the strobe and did not drop within {} ms ({register})",
                within.as_millis()
            ),
            HandshakeFault::AcknowledgeMissing { within, register } => {
                write!(f, "acknowledge of {set} did not come within {} ms ({register})", within.as_millis())
            }
            HandshakeFault::AcknowledgeStuck { within, register } => write!(
                f,
                "acknowledge of {set} did not drop within {} ms after the strobe ({register})",
                within.as_millis()
            ),
            HandshakeFault::StrobeNotWritten { register, fault } => {
                write!(f, "strobe of {set} could not be written ({register}): {fault}")
            }
            HandshakeFault::StrobeNotDropped { register, fault } => {
                write!(f, "strobe of {set} could not be dropped ({register}): {fault}")
            }
            HandshakeFault::AcknowledgeNotRead { register, fault } => {
                write!(f, "acknowledge of {set} could not be read ({register}): {fault}")
            }
        }
    }
}
