//! Result of a test connection to a broker or to a server of messages.

use serde::Serialize;

/// Result of a test connection.
#[derive(Debug, Serialize)]
pub(super) struct ConnectionTest {
    /// Name in the profile.
    name: String,
    to: String,
    /// Text if the connection succeeded.
    #[serde(skip)]
    well: &'static str,
    fault: Option<String>,
}

impl ConnectionTest {
    pub(super) fn at(name: &str, to: String, well: &'static str, fault: Option<String>) -> ConnectionTest {
        ConnectionTest { name: name.to_owned(), to, well, fault }
    }

    /// Line in the output of `check --online`.
    pub(super) fn line(&self) -> String {
        format!("  {} ({}): {}", self.name, self.to, self.fault.as_deref().unwrap_or(self.well))
    }

    /// Fails if the connection failed.
    pub(super) fn assess(&self) -> anyhow::Result<()> {
        let ConnectionTest { name, to, fault, .. } = self;
        fault.as_ref().map_or(Ok(()), |fault| Err(anyhow::anyhow!("{name} ({to}): {fault}")))
    }
}
