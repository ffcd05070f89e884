//! What people and programs see: events, the state of everything, the page, metrics. Never awaited by the loop.

pub mod asker;
pub mod events;
pub mod http;
mod metrics;
#[cfg(feature = "mqtt")]
pub mod mqtt;
pub mod notify;
mod page;
mod past;
pub mod status;
