//! How long something has been quiet: wall time always, because it is a real line that is quiet.

#![allow(clippy::disallowed_types, reason = "silence on a wire is wall time")]

use std::time::Duration;

use tokio::time::Instant;

/// The end of the last sound.
#[derive(Clone, Copy, Debug)]
pub struct Silence {
    since: Instant,
}

impl Silence {
    /// It begins now.
    pub fn begin() -> Silence {
        Silence { since: Instant::now() }
    }

    /// It begins when what takes this long is over.
    pub fn begin_after(span: Duration) -> Silence {
        Silence { since: Instant::now() + span }
    }

    /// What is missing until it has lasted for `span`.
    pub fn left_of(&self, span: Duration) -> Duration {
        (self.since + span).saturating_duration_since(Instant::now())
    }
}
