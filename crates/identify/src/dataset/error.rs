//! Errors in the log files.

/// All errors found in the logs. Each message names the file, and the line if it is known.
#[derive(Clone, Debug, Default, PartialEq, Eq, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct BadLog(pub Vec<String>);

impl BadLog {
    /// Returns `good` if `wrong` contains no messages; otherwise returns an error with these messages.
    pub(crate) fn unless<T>(wrong: Vec<String>, good: T) -> Result<T, BadLog> {
        if wrong.is_empty() { Ok(good) } else { Err(BadLog(wrong)) }
    }
}

/// Column that cannot be used, with the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Name of the column.
    pub column: String,
    /// Message with file, line and value.
    pub message: String,
}
