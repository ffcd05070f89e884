//! What a plant is told of a machine over MQTT: from the state of the gateway to messages, and from messages that arrive to what
//! is to be done.
//!
//! Everything here is pure: no connection, no clock; time is an argument. The gateway makes a [`Snapshot`] of its state, a
//! [`Publisher`] makes [`Message`]s of it, and the gateway gives them to a broker.

pub mod json;
pub mod seam;
pub mod sparkplug;
pub mod store;

pub use json::{Json, JsonSettings};
pub use seam::{
    Command, Happening, Importance, Message, Metric, Outcome, Publisher, Qos, Reaction, Record, Snapshot,
    Subject, Subscription, Value,
};
