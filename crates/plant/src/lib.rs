//! MQTT messages about a machine for its plant: from the state of the gateway to messages, and from received messages
//! to commands.
//!
//! Everything is pure: there is no connection and no clock, and time is an argument. The gateway makes a [`Snapshot`]
//! of its state, a [`Publisher`] makes [`Message`]s from it, and the gateway sends them to a broker.

pub mod interface;
pub mod json;
pub mod sparkplug;
pub mod store;

pub use interface::{
    Command, Importance, Message, Metric, Outcome, PlantEvent, Publisher, Qos, Reaction, Record, Snapshot,
    Subject, Subscription, Value,
};
pub use json::{Json, JsonSettings};
