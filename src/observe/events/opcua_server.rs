//! Events about the OPC UA server of `[opcua_server]`.

use serde::Serialize;

use super::description::{EventDescription, caused, plain};
use isotherm_core::events::EventKind;
use isotherm_profile::counted;

/// Change of the OPC UA server: its port is closed or open, or the server has refused a client.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum OpcUaServerEvent {
    /// The server cannot listen at its address, or has failed.
    Closed {
        /// Host and port on which the server listens.
        listen: String,
        /// Reason why the port is closed, as a sentence.
        why: String,
    },
    /// The server listens now.
    Open {
        /// Host and port on which the server listens.
        listen: String,
    },
    /// The server has refused a client, because its certificate is not trusted.
    ClientRefused {
        /// Subject of the client's certificate.
        client: String,
        /// SHA-1 digest of the certificate, in hexadecimal digits.
        thumbprint: String,
        /// Number of further certificates that were refused since the last event.
        others: u64,
    },
}

impl OpcUaServerEvent {
    pub(super) fn described(&self) -> EventDescription {
        match self {
            OpcUaServerEvent::Closed { listen, why } => {
                caused(format!("no OPC UA client is served on {listen}"), why.as_str())
                    .of(EventKind::OpcUaServerClosed)
            }
            OpcUaServerEvent::Open { listen } => {
                plain(format!("OPC UA clients are served on {listen}")).of(EventKind::OpcUaServerOpen)
            }
            OpcUaServerEvent::ClientRefused { client, thumbprint, others } => {
                let more = match others {
                    0 => String::new(),
                    others => format!(", and {}", counted(others, "further certificate")),
                };
                caused(
                    format!("the OPC UA client {client}"),
                    format!("its certificate {thumbprint} is not trusted{more}"),
                )
                .of(EventKind::OpcUaClientRefused)
            }
        }
    }
}
