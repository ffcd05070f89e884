//! `[history]`: state and logs.

use std::path::PathBuf;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use crate::duration::Timespan;

/// Logs are kept this long where nothing else is said.
const KEEP: Duration = Duration::from_hours(90 * 24);

/// State and logs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "History")]
pub(crate) struct RawHistory {
    /// Where state, ledger and log are kept. Default: the platform's state directory.
    directory: Option<String>,
    /// How long logs are kept. Default "90d".
    keep: Option<Timespan>,
}

/// State and logs.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// `None`: the platform's state directory.
    pub directory: Option<PathBuf>,
    /// How long logs are kept.
    pub keep: Duration,
}

impl Default for History {
    fn default() -> History {
        History { directory: None, keep: KEEP }
    }
}

impl RawHistory {
    pub(super) fn resolve(&self, at: &At<'_>) -> History {
        let keep = at.key("keep").duration(self.keep).unwrap_or(KEEP);
        History { directory: self.directory.clone().map(PathBuf::from), keep }
    }
}
