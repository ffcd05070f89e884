//! MQTT messages about a machine for its plant: from the state of the gateway to messages, and from received messages
//! to commands.
//!
//! Everything is pure: there is no connection and no clock, and time is an argument. The gateway makes a [`Snapshot`]
//! of its state, a [`Publisher`] makes [`Message`]s from it, and the gateway sends them to a broker.

pub mod json;
pub mod seam;
pub mod sparkplug;
pub mod store;

pub use json::{Json, JsonSettings};
pub use seam::{
    Command, Happening, Importance, Message, Metric, Outcome, Publisher, Qos, Reaction, Record, Snapshot,
    Subject, Subscription, Value,
};
