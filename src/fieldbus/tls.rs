//! TLS by rustls: clients for Modbus lines, for the MQTT broker and for servers in the plant, and the server
//! of the web page. Modbus TCP inside TLS is Modbus/TCP Security of the Modbus Organization (MB-TCP-Security
//! v2.1).

use std::time::Duration;

#[cfg(feature = "mqtt")]
mod broker;
mod client;
mod pem;
mod plant_client;
mod server;

#[cfg(feature = "mqtt")]
pub use broker::broker;
pub(super) use client::Client;
pub use client::check;
pub use plant_client::plant_client;
pub use server::{Wrong, server};

/// Longest time of a TLS handshake. A handshake needs two signatures, and a slow controller calculates them in a second
/// or two.
pub(super) const HANDSHAKE: Duration = Duration::from_secs(5);
