//! MQTT messages about a machine for its plant. The crate makes messages from the state of the gateway, and commands
//! from received messages.
//!
//! The message formats use no connection and no clock: time is an argument. The gateway makes a [`Snapshot`] of its
//! state, a [`Publisher`] makes [`Message`]s from the snapshot, and the gateway sends them to a broker.

pub mod interface;
pub mod json;
pub mod sparkplug;
pub mod store;

pub use interface::{
    Command, Importance, Message, Metric, Outcome, PlantEvent, PrimaryHost, Publisher, Qos, Reaction, Record,
    Snapshot, Subject, Subscription, Value,
};
pub use json::{Json, JsonSettings};
