//! What happens on a CAN line.

use std::fmt;
use std::time::Duration;

use super::Level;

/// Something that happened on a CAN line, in the names of the profile.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "each field is what its name says")]
pub enum CanEvent {
    /// A node was reset, or has left its work for another reason; it is set up and started again.
    NodeReset { device: String, node: u8, what: String },
    /// A node complains of something.
    Emergency { device: String, what: String },
    /// It does not any more; so many messages came.
    EmergencyOver { device: String, count: u64 },
    /// The controller, the queue or the receiver is in trouble.
    BusTrouble { bus: String, address: String, what: String },
    /// It is over.
    BusWell { bus: String, address: String, count: u64, what: &'static str, within: Duration },
}

impl CanEvent {
    /// One word for programs.
    pub(super) const fn kind(&self) -> &'static str {
        match self {
            CanEvent::NodeReset { .. } => "node-reset",
            CanEvent::Emergency { .. } => "emergency",
            CanEvent::EmergencyOver { .. } => "emergency-over",
            CanEvent::BusTrouble { .. } => "bus-trouble",
            CanEvent::BusWell { .. } => "bus-well",
        }
    }

    pub(super) const fn level(&self) -> Level {
        match self {
            CanEvent::NodeReset { .. } | CanEvent::Emergency { .. } | CanEvent::BusTrouble { .. } => {
                Level::Warning
            }
            CanEvent::EmergencyOver { .. } | CanEvent::BusWell { .. } => Level::Info,
        }
    }
}

impl fmt::Display for CanEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CanEvent::NodeReset { device, node, what } => write!(f, "device {device} (node {node}): {what}"),
            CanEvent::Emergency { device, what } => write!(f, "device {device}: emergency: {what}"),
            CanEvent::EmergencyOver { device, count } => {
                write!(f, "device {device}: its emergencies are over, {count} messages came")
            }
            CanEvent::BusTrouble { bus, address, what } => write!(f, "bus {bus} ({address}): {what}"),
            CanEvent::BusWell { bus, address, count, what, within } => {
                let seconds = Duration::from_secs(within.as_secs().max(1));
                let span = humantime::format_duration(seconds);
                write!(f, "bus {bus} ({address}): well again: {count} {what} within {span}")
            }
        }
    }
}
