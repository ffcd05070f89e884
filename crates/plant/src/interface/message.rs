//! Messages to and from an MQTT broker, independent of the message format.

use isotherm_core::compensation::MeasuredReport;

/// Message to a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Topic to which the message is published.
    pub topic: String,
    /// Content of the message, in the chosen format.
    pub payload: Vec<u8>,
    /// Quality of service: how the MQTT broker confirms the message.
    pub qos: Qos,
    /// Whether the broker retains the message for later subscribers.
    pub retained: bool,
}

/// Quality of service: the delivery guarantee.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Qos {
    /// QoS 0: delivered once or never.
    AtMostOnce,
    /// QoS 1: delivered once or more often.
    AtLeastOnce,
}

/// Subscription to topics of a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Topic filter, in which `+` and `#` are the wildcards of MQTT.
    pub filter: String,
    /// Maximum quality of service of the messages that the broker sends for this subscription.
    pub qos: Qos,
}

/// Encoded data that is stored on disk until the broker is available again. Only the message format that created a
/// record can read it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record(pub Vec<u8>);

/// Effect of a message that was received from the broker: replies to publish, and a command for the gateway.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reaction {
    /// Messages to publish immediately.
    pub messages: Vec<Message>,
    /// Command for the gateway, or the reason why it is refused. `None` if the message contains no command.
    pub outcome: Option<Outcome>,
}

/// Result of a command that arrived from the MQTT broker.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Permitted command. The gateway decides whether it executes the command.
    Asked(Command),
    /// Command that is not allowed or cannot be understood.
    Refused {
        /// Name of the refused command.
        command: String,
        /// Reason for the refusal, as a sentence.
        why: String,
    },
}

/// Command that the gateway may accept from the broker, if the profile allows it. No such command arms, disarms or
/// moves an axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Measured error of an axis.
    Measured {
        /// Name of the axis in the profile.
        axis: String,
        /// Measured error, with the time and the identification of the measurement if the sender gives them.
        report: MeasuredReport,
    },
}

impl Command {
    /// Returns whether the sender has given an identification of the measurement.
    pub fn is_identified(&self) -> bool {
        let Command::Measured { report, .. } = self;
        report.is_identified()
    }
}
