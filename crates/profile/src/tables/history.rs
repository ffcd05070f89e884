//! `[history]`: state and logs.

use std::path::PathBuf;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use crate::duration::Timespan;
use crate::size::Size;

/// Logs are kept this long where nothing else is said.
const KEEP: Duration = Duration::from_hours(90 * 24);
/// And need no more room than this, in bytes.
const MAX_SIZE: u64 = 2_000_000_000;

/// State and logs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "History")]
pub(crate) struct RawHistory {
    /// Where state, ledger and log are kept. Default: the platform's state directory.
    directory: Option<String>,
    /// How long logs are kept, by the newest log's date. Default "90d".
    keep: Option<Timespan>,
    /// How much room all logs together may take; then the oldest go, but never today's. Default "2GB".
    max_size: Option<Size>,
}

/// State and logs.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// `None`: the platform's state directory.
    pub directory: Option<PathBuf>,
    /// How long logs are kept.
    pub keep: Duration,
    /// How many bytes all logs together may need.
    pub max_size: u64,
}

impl Default for History {
    fn default() -> History {
        History { directory: None, keep: KEEP, max_size: MAX_SIZE }
    }
}

impl RawHistory {
    pub(super) fn resolve(&self, at: &At<'_>) -> History {
        let keep = at.key("keep").duration(self.keep).unwrap_or(KEEP);
        let max_size = match self.max_size {
            None => MAX_SIZE,
            Some(Size(0)) => {
                at.key("max_size").wrong("no log fits into nothing", "write a larger size, as \"2GB\"");
                MAX_SIZE
            }
            Some(Size(size)) => size,
        };
        History { directory: self.directory.clone().map(PathBuf::from), keep, max_size }
    }
}
