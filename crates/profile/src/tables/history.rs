//! `[history]`: storage of state and logs.

use std::path::PathBuf;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::KeyContext;
use crate::duration::Timespan;
use crate::size::Size;

/// Default time for keeping logs.
const KEEP: Duration = Duration::from_hours(90 * 24);
/// Default limit for the size of all logs, in bytes.
const MAX_SIZE: u64 = 2_000_000_000;

/// Storage of state and logs.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "History")]
pub(crate) struct RawHistory {
    /// Directory of the saved state (with the register ledger) and of the logs. Default: the state directory of the
    /// platform.
    directory: Option<String>,
    /// Time for keeping logs, counted back from the date of the newest log. Default "90d".
    keep: Option<Timespan>,
    /// Largest size of all logs together. If the logs exceed this size, the oldest logs are deleted, but never the logs
    /// of today. Default "2GB".
    max_size: Option<Size>,
}

/// Storage of state and logs.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// Directory of the saved state and of the logs. `None` for the state directory of the platform.
    pub directory: Option<PathBuf>,
    /// Time for keeping logs. Older logs are deleted.
    pub keep: Duration,
    /// Largest size of all logs together, in bytes. Above it, the oldest logs are deleted.
    pub max_size: u64,
}

impl Default for History {
    fn default() -> History {
        History { directory: None, keep: KEEP, max_size: MAX_SIZE }
    }
}

impl RawHistory {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> History {
        let keep = at.key("keep").duration(self.keep).unwrap_or(KEEP);
        let max_size = match self.max_size {
            None => MAX_SIZE,
            Some(Size(0)) => {
                at.key("max_size")
                    .invalid("a size of zero is too small for a log", "write a larger size, as \"2GB\"");
                MAX_SIZE
            }
            Some(Size(size)) => size,
        };
        History { directory: self.directory.clone().map(PathBuf::from), keep, max_size }
    }
}
