//! Detection of a second gateway that writes to the same shared register. The sign of a second gateway is a small
//! change by another client, soon after each change of this gateway.
//!
//! The changes of two gateways do not alternate strictly. The criterion is that both clients make about the
//! same number of changes. An operator makes far fewer changes, or many at once with a handwheel. When the
//! criterion is met, this gateway makes six more changes before it reports the second gateway. The other
//! gateway can then detect it too.

use serde::{Deserialize, Serialize};

/// Number of changes that each of the two clients must have made before they are compared.
const ENOUGH: u8 = 6;
/// Largest difference between the two numbers of changes at which the other client can be a gateway. Above this
/// difference, counting begins again.
const AHEAD: u8 = 3;
const MORE: u8 = 6;

/// Numbers of changes of a shared register by this gateway and by another client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Turns {
    ours: u8,
    others: u8,
    /// Number of changes of this gateway since both clients had made [`ENOUGH`] changes; `None` before that.
    since: Option<u8>,
}

impl Turns {
    /// Counts a change of the register by this gateway that was verified.
    pub(super) fn ours(&mut self) {
        self.since = self.since.map(|since| since.saturating_add(1));
        // Changes of this gateway are counted only after the first change by another client.
        self.ours = self.ours.saturating_add(u8::from(self.others > 0));
        self.compare();
    }

    /// Counts a change by another client. A large change, which no gateway makes, restarts the count. A change is
    /// ignored if it is not soon after a change of this gateway.
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

    /// Returns true if another gateway writes to the register: both clients have made about the same number of small
    /// changes, more than an operator makes.
    pub(super) fn are_two_gateways(self) -> bool {
        self.since.is_some_and(|since| since >= MORE)
    }
}
