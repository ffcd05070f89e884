//! What tells a second gateway from an operator: for each change of ours there is one of its own, small and soon after.
//!
//! Two gateways do not take turns as a clock does, so what counts is that both make as many changes, whichever comes first. Of an
//! operator there are far fewer, or many at once at a handwheel. When there were enough, some more of ours are made, so that the
//! other has seen enough as well.

use serde::{Deserialize, Serialize};

/// Changes of each of both.
const ENOUGH: u8 = 6;
/// One may be ahead of the other by so many.
const AHEAD: u8 = 3;
const MORE: u8 = 6;

/// Changes of a shared register, by us and by somebody else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Turns {
    ours: u8,
    others: u8,
    /// Changes of ours since there were enough.
    since: Option<u8>,
}

impl Turns {
    /// A change of ours stands there.
    pub(super) fn ours(&mut self) {
        self.since = self.since.map(|since| since.saturating_add(1));
        // Nobody counts before somebody else has changed anything.
        self.ours = self.ours.saturating_add(u8::from(self.others > 0));
        self.compare();
    }

    /// Somebody else's does: one that no gateway makes ends it; one that comes long after ours answers nothing.
    pub(super) fn another(&mut self, is_small: bool, is_soon: bool) {
        if !is_small {
            *self = Turns::default();
        }
        self.others = self.others.saturating_add(u8::from(is_small && is_soon));
        self.compare();
    }

    fn compare(&mut self) {
        if self.since.is_some() {
            return;
        }
        if self.ours.abs_diff(self.others) > AHEAD {
            *self = Turns::default();
        } else if self.ours.min(self.others) >= ENOUGH {
            self.since = Some(0);
        }
    }

    /// No person writes like that.
    pub(super) fn are_two_gateways(self) -> bool {
        self.since.is_some_and(|since| since >= MORE)
    }
}
