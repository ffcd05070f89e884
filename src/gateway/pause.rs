//! Times in which the computer stood still. What was read and decided before is not used after, and what stands in the
//! registers is looked at again.

use super::shared::Shared;
use crate::observe::events::Event;
use isotherm_core::quantity::Moment;

/// How often the computer stood still, and until when.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pauses {
    count: u64,
    ended: Moment,
}

impl Pauses {
    /// How often so far.
    pub(super) fn count(self) -> u64 {
        self.count
    }
}

impl Shared {
    /// How often the computer has stood still.
    pub(super) fn pauses(&self) -> u64 {
        self.core().pauses.count
    }

    /// Somebody has not been able to look at the clock since then. Each notices by himself; the first one tells.
    pub(super) fn stood_still(&self, since: Moment) {
        let now = self.clock.now();
        let mut core = self.core();
        if since < core.pauses.ended {
            return;
        }
        core.pauses = Pauses { count: core.pauses.count + 1, ended: now };
        core.board.forget();
        core.not_after.fill(Moment::default());
        drop(core);
        self.tell(&Event::StoodStill { span: now.since(since) });
        self.ring();
    }
}
