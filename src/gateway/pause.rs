//! Times in which the computer stood still. What was read and decided before is not used after, and what stands in the
//! registers is looked at again.

use isotherm_core::quantity::Moment;

/// How often the computer stood still, and until when.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pauses {
    count: u64,
    ended: Moment,
}

impl Pauses {
    pub(super) fn count(self) -> u64 {
        self.count
    }

    /// Somebody has not been able to look at the clock since then, until now; `false` where that was noticed already.
    pub(super) fn begins(&mut self, since: Moment, now: Moment) -> bool {
        let is_new = since >= self.ended;
        if is_new {
            *self = Pauses { count: self.count + 1, ended: now };
        }
        is_new
    }
}
