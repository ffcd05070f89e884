//! Output for people and programs: events, status, the web page, metrics and messages. The tasks of the bus lines never
//! wait for this output.

mod decision_history;
pub mod events;
pub mod http;
#[cfg(feature = "mqtt")]
pub mod mqtt;
pub mod notify;
#[cfg(feature = "opcua")]
pub mod opcua_server;
mod page;
mod prometheus;
pub mod requester;
pub mod status;
mod status_pages;
