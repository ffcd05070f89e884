//! The wall's time: the Unix time at start plus what has passed since, suspension included.

#![allow(clippy::disallowed_types, reason = "this is where time comes from")]

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::Passing;
use isotherm_core::quantity::Moment;

#[derive(Debug)]
pub(super) struct Wall {
    anchor: Moment,
    started: Duration,
    passing: Passing,
}

impl Wall {
    pub(super) fn start(passing: Passing) -> Wall {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Wall::from(Moment::default().after(since_epoch), passing)
    }

    pub(super) fn from(anchor: Moment, passing: Passing) -> Wall {
        Wall { anchor, started: passing.passed(), passing }
    }

    pub(super) fn now(&self) -> Moment {
        self.anchor.after(self.passing.passed().saturating_sub(self.started))
    }
}
