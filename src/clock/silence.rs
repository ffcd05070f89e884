//! Silence on a physical line: the time since the last transmission. Its length is measured in wall-clock time, even
//! under a virtual clock.

#![allow(clippy::disallowed_types, reason = "a silence on a line lasts in wall-clock time")]

use std::time::Duration;

use tokio::time::Instant;

/// Start of a silence: the end of the last transmission.
#[derive(Clone, Copy, Debug)]
pub struct Silence {
    since: Instant,
}

impl Silence {
    /// Returns a silence that begins now.
    pub fn begin() -> Silence {
        Silence { since: Instant::now() }
    }

    /// Returns a silence that begins after `span`, when the transmission in progress ends.
    pub fn begin_after(span: Duration) -> Silence {
        Silence { since: Instant::now() + span }
    }

    /// Returns the remaining time until the silence has lasted for `span`; zero if it has already lasted that long.
    pub fn left_of(&self, span: Duration) -> Duration {
        (self.since + span).saturating_duration_since(Instant::now())
    }
}
