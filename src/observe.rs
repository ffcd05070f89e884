//! Output for people and programs: events, status, the page, metrics and messages. The line tasks never wait for it.

pub mod asker;
pub mod events;
pub mod http;
#[cfg(feature = "mqtt")]
pub mod mqtt;
pub mod notify;
mod page;
mod past;
mod prometheus;
pub mod status;
