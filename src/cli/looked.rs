//! What came of a look at somebody who is to be told of the machine: a broker, a server of messages.

use serde::Serialize;

/// Whether somebody is there.
#[derive(Debug, Serialize)]
pub(super) struct Looked {
    /// What the profile calls it.
    name: String,
    to: String,
    /// What is said where nothing is in the way.
    #[serde(skip)]
    well: &'static str,
    fault: Option<String>,
}

impl Looked {
    pub(super) fn at(name: &str, to: String, well: &'static str, fault: Option<String>) -> Looked {
        Looked { name: name.to_owned(), to, well, fault }
    }

    /// The line of `check --online`.
    pub(super) fn line(&self) -> String {
        format!("  {} ({}): {}", self.name, self.to, self.fault.as_deref().unwrap_or(self.well))
    }

    /// Whoever cannot be told is a failure of the verb.
    pub(super) fn judge(&self) -> anyhow::Result<()> {
        let Looked { name, to, fault, .. } = self;
        fault.as_ref().map_or(Ok(()), |fault| Err(anyhow::anyhow!("{name} ({to}): {fault}")))
    }
}
