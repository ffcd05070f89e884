//! Messages to a broker, and what comes of those from it.

use isotherm_core::compensation::MeasuredReport;

/// A message to a broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Its topic.
    pub topic: String,
    /// Its content.
    pub payload: Vec<u8>,
    /// How it is delivered.
    pub qos: Qos,
    /// The broker keeps it for whoever subscribes later.
    pub retained: bool,
}

/// How often a message arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Qos {
    /// Once or never.
    AtMostOnce,
    /// Once or more often.
    AtLeastOnce,
}

/// What a broker is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Topics, with the wildcards of MQTT.
    pub filter: String,
    /// How they are delivered.
    pub qos: Qos,
}

/// What is kept on disk until the broker is there again: the format alone can read it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record(pub Vec<u8>);

/// What comes of a message that has arrived.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reaction {
    /// Told at once, as after [`Publisher::publish`](super::Publisher::publish).
    pub messages: Vec<Message>,
    /// What is asked of the gateway, or why it is not done.
    pub outcome: Option<Outcome>,
}

/// What somebody asks for over the broker.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It is one of the few things that may be asked for: the gateway still has to say whether it does it.
    Asked(Command),
    /// It is not done: the command as it was named, and a sentence.
    Refused {
        /// What was asked for.
        command: String,
        /// Why not.
        why: String,
    },
}

/// What may be asked of a gateway over a broker, where the profile allows it. Nothing here arms, disarms or moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// An axis's measured error.
    Measured {
        /// The axis's name in the profile.
        axis: String,
        /// The error, and which measurement it is of.
        report: MeasuredReport,
    },
}

impl Command {
    /// The sender says which measurement it is of.
    pub fn is_identified(&self) -> bool {
        let Command::Measured { report, .. } = self;
        report.is_identified()
    }
}
