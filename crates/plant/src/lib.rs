//! MQTT messages that report the state of a machine to other systems in the plant. The crate makes these
//! messages from the state of the gateway. It also converts received messages to commands.
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
