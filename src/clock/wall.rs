//! The wall's time: the Unix time at start plus what the monotonic clock has counted since.

#![allow(clippy::disallowed_types, reason = "this is where time comes from")]

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use crate::quantity::Moment;

#[derive(Debug)]
pub(super) struct Wall {
    anchor: Moment,
    started: Instant,
}

impl Wall {
    pub(super) fn start() -> Wall {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Wall { anchor: Moment::default().after(since_epoch), started: Instant::now() }
    }

    pub(super) fn now(&self) -> Moment {
        self.anchor.after(self.started.elapsed())
    }
}
