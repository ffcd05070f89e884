//! Pauses of the computer. After a pause, readings and decisions from before the pause are not used, and every
//! register is read again.

use isotherm_core::quantity::Moment;

/// Number of pauses of the computer, and the end of the last pause.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::gateway) struct Pauses {
    count: u64,
    ended: Moment,
}

impl Pauses {
    pub(in crate::gateway) fn count(self) -> u64 {
        self.count
    }

    /// Records that a task could not sample the clock from `since` until `now`. Returns `false` if the same pause was
    /// recorded already.
    pub(in crate::gateway) fn begins(&mut self, since: Moment, now: Moment) -> bool {
        let is_new = since >= self.ended;
        if is_new {
            *self = Pauses { count: self.count + 1, ended: now };
        }
        is_new
    }
}
