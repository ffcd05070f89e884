//! Error frames of a CAN controller as text, with advice on what to check.

use std::fmt;

use socketcan::errors::{ControllerProblems, ErrorCause, Location};
use socketcan::{CanError, CanErrorFrame};

/// Error frame, in which the CAN controller of this computer reports a problem of the bus.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorFrame(CanError);

/// Severity of an error frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ErrorSeverity {
    /// The controller has recovered, or only reports its error counters.
    Over,
    /// A frame failed, and the controller repeats it.
    Error,
    /// Many frames failed. The controller is error-passive: its error flags no longer disturb the frames of other
    /// devices.
    Passive,
    /// The controller has disconnected itself from the bus: it sends and receives nothing.
    BusOff,
}

impl ErrorFrame {
    pub(super) fn of(frame: CanErrorFrame) -> ErrorFrame {
        ErrorFrame(frame.into_error())
    }

    /// Returns an error frame with this class (an error bit of the kernel, `CAN_ERR_…`) and without details.
    #[cfg(test)]
    pub(crate) fn from_class(class: u32) -> ErrorFrame {
        ErrorFrame::of(CanErrorFrame::new_error(class, &[0; 8]).unwrap())
    }

    /// Returns the severity of the problem; the highest severity, if the frame reports several problems.
    pub fn gravity(&self) -> ErrorSeverity {
        let gravity = |cause: &ErrorCause| match cause {
            ErrorCause::BusOff => ErrorSeverity::BusOff,
            ErrorCause::Restarted => ErrorSeverity::Over,
            ErrorCause::Controller(problems) if problems.contains(ControllerProblems::ACTIVE) => {
                ErrorSeverity::Over
            }
            ErrorCause::Controller(problems) if problems.intersects(PASSIVE) => ErrorSeverity::Passive,
            ErrorCause::Counters { .. } => ErrorSeverity::Over,
            _ => ErrorSeverity::Error,
        };
        self.0.causes().map(gravity).max().unwrap_or(ErrorSeverity::Error)
    }
}

const PASSIVE: ControllerProblems = ControllerProblems::RX_PASSIVE.union(ControllerProblems::TX_PASSIVE);

impl fmt::Display for ErrorFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Counters next to another cause do not help the user.
        let is_reported = |cause: &&ErrorCause| !matches!(cause, ErrorCause::Counters { .. });
        let mut causes = self.0.causes().filter(is_reported);
        let Some(first) = causes.next() else { return f.write_str("errors counted by the controller") };
        tell(first, f)?;
        causes.try_for_each(|cause| {
            f.write_str("; ")?;
            tell(cause, f)
        })
    }
}

fn tell(cause: &ErrorCause, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match cause {
        ErrorCause::BusOff => f.write_str("bus-off: the controller has disconnected itself from the bus"),
        ErrorCause::NoAck | ErrorCause::Protocol { location: Location::AckSlot, .. } => {
            f.write_str("no node acknowledges: is another node on the bus, with this bit rate?")
        }
        ErrorCause::TransmitTimeout => f.write_str("a frame could not be sent in time"),
        ErrorCause::BusError => f.write_str("bus error"),
        ErrorCause::Restarted => f.write_str("the controller is back on the bus"),
        ErrorCause::Transceiver { .. } => write!(f, "{cause}: check the cable"),
        ErrorCause::Protocol { .. } => write!(f, "{cause}: check bitrate, cable and termination"),
        ErrorCause::Controller(problems) if problems.contains(ControllerProblems::ACTIVE) => {
            f.write_str("the controller has recovered")
        }
        ErrorCause::Controller(problems) if problems.intersects(PASSIVE) => {
            write!(f, "the controller is error-passive ({problems}): check bitrate, cable and termination")
        }
        other => write!(f, "{other}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trouble(class: u32, data: [u8; 8]) -> ErrorFrame {
        ErrorFrame::of(CanErrorFrame::new_error(class, &data).unwrap())
    }

    #[test]
    fn an_error_frame_says_what_to_look_at() {
        for (class, data, gravity, words) in [
            (0x040, [0; 8], ErrorSeverity::BusOff, "bus-off"),
            (0x100, [0; 8], ErrorSeverity::Over, "back on the bus"),
            (0x020, [0; 8], ErrorSeverity::Error, "no node acknowledges"),
            (0x008, [0, 0, 0x80, 0x19, 0, 0, 0, 0], ErrorSeverity::Error, "no node acknowledges"),
            (0x008, [0, 0, 0x04, 0x08, 0, 0, 0, 0], ErrorSeverity::Error, "termination"),
            (0x204, [0, 0x30, 0, 0, 0, 0, 0x80, 0], ErrorSeverity::Passive, "error-passive"),
            (0x204, [0, 0x40, 0, 0, 0, 0, 0, 0], ErrorSeverity::Over, "recovered"),
            (0x010, [0, 0, 0, 0, 0x04, 0, 0, 0], ErrorSeverity::Error, "cable"),
            (0x200, [0, 0, 0, 0, 0, 0, 3, 9], ErrorSeverity::Over, "counted"),
        ] {
            let reported = trouble(class, data);
            assert_eq!(reported.gravity(), gravity, "{reported}");
            assert!(reported.to_string().contains(words), "{reported}");
        }
    }
}
