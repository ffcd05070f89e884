//! State of an output that is saved on disk, because it must survive the end of the process. A promise is a value that
//! is saved before the gateway sends it.

use serde::{Deserialize, Serialize};

use super::event::Doubt;
use super::in_flight::{ExpiredWrite, InFlightWrite, InFlightWrites, MOST_REMEMBERED};
use super::settings::Settings;
use super::slots::Slots;
use crate::quantity::{Counts, Moment, shifted};

/// State of an output on disk. Values are absolute register values, so a changed operator offset does not change them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedOutput {
    /// Whether the last run was stopped cleanly: no write may still arrive, and nothing has been written since.
    pub in_order: bool,
    /// Both parts of a shared register's value (operator offset and gateway share), if they are known.
    pub account: Option<Account>,
    /// Last register value that was read. For an output that cannot be read, the last acknowledged value.
    pub stood: Option<Counts>,
    /// Values that were sent, or are about to be sent, and may still appear in the register.
    pub promises: Slots<Promise, { MOST_REMEMBERED + 4 }>,
}

/// Account of a register that the operator also writes to. The register value is the sum of base (operator offset) and
/// share (gateway share).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Account {
    /// Operator offset: the part of the register value that the operator has entered.
    pub base: Counts,
    /// Gateway share: the part of the register value that the gateway has written.
    pub share: Counts,
    /// Reason why `base` and `share` are uncertain. `None` if they are certain. Only the operator ends a doubt.
    pub doubt: Option<Doubt>,
}

/// Value that the gateway has sent or is about to send, and that may appear in the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Promise {
    /// Absolute register value, including the operator offset of a shared register.
    pub value: Counts,
    /// Time at which the value was sent, for messages to the operator.
    pub at: Moment,
    /// Whether the value may still arrive at the register. If not, its longest delay is over, and the value is only
    /// remembered.
    pub is_under_way: bool,
}

shifted!(SavedOutput: promises);
shifted!(Promise: at);

impl SavedOutput {
    /// Creates the state of a shared register whose saved state is missing or unreadable. The gateway share (part that
    /// the gateway added) is assumed to be zero until the operator confirms it.
    pub fn in_question(doubt: Doubt) -> SavedOutput {
        SavedOutput {
            account: Some(Account { doubt: Some(doubt), ..Account::default() }),
            ..SavedOutput::default()
        }
    }

    /// Returns the writes of earlier runs that may still arrive, from the state on disk at the start.
    pub(super) fn copies(&self, settings: &Settings, now: Moment) -> InFlightWrites {
        let mut copies = InFlightWrites::default();
        // A whole register waits until nothing from before the start can arrive. Then the values are sufficient.
        let waits = !settings.promises();
        let until = now.after(settings.late).after(settings.remembered);
        for promise in self.promises.iter() {
            if promise.is_under_way && !waits {
                add(&mut copies, promise.value, promise.at, now);
            } else {
                let _ = copies.add_expired(ExpiredWrite { value: promise.value, at: promise.at, until });
            }
        }
        if !self.in_order && !waits {
            let sum = |account: Account| Some(account.base + account.share);
            let stood = self.account.map_or(self.stood, sum);
            stood.into_iter().for_each(|value| add(&mut copies, value, now, now));
        }
        copies
    }
}

/// Adds a write that was sent at an unknown time before the start.
fn add(copies: &mut InFlightWrites, value: Counts, at: Moment, start: Moment) {
    let sent = InFlightWrite { value, at, left: start, answered: None, other_seen: None, is_pinned: true };
    // The capacity is sufficient for all promises and the last register value.
    let _ = copies.of(value).is_some() || copies.add(sent);
}
