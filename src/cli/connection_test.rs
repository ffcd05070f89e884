//! Test connections to an MQTT broker or to a notification server, and their results.

use serde::Serialize;

/// Result of a test connection to an MQTT broker or to a notification server.
#[derive(Debug, Serialize)]
pub(super) struct ConnectionTest {
    /// Name of the server in the profile.
    name: String,
    to: String,
    /// Text to print if the connection succeeded.
    #[serde(skip)]
    well: &'static str,
    fault: Option<String>,
}

impl ConnectionTest {
    pub(super) fn at(name: &str, to: String, well: &'static str, fault: Option<String>) -> ConnectionTest {
        ConnectionTest { name: name.to_owned(), to, well, fault }
    }

    /// Returns the line about this connection for the output of `check --online`.
    pub(super) fn line(&self) -> String {
        format!("  {} ({}): {}", self.name, self.to, self.fault.as_deref().unwrap_or(self.well))
    }

    /// Returns an error if the test connection failed.
    pub(super) fn assess(&self) -> anyhow::Result<()> {
        let ConnectionTest { name, to, fault, .. } = self;
        fault.as_ref().map_or(Ok(()), |fault| Err(anyhow::anyhow!("{name} ({to}): {fault}")))
    }
}
