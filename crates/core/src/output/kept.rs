//! What of an output must outlive the process.

use serde::{Deserialize, Serialize};

use super::copies::{Copies, LatelySent, MOST_REMEMBERED, Sent};
use super::event::Doubt;
use super::settings::Settings;
use super::slots::Slots;
use crate::quantity::{Counts, Moment, shifted};

/// What is on disk. Values are absolute, as the register would hold them: a base that moves does not move them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    /// The process ended when nothing was under way, and nothing was written since.
    pub in_order: bool,
    /// Operator offset and gateway share of a shared register.
    pub account: Option<Account>,
    /// What stood there last: of an output that cannot be read, what was acknowledged last.
    pub stood: Option<Counts>,
    /// What may still appear in the register.
    pub promises: Slots<Promise, { MOST_REMEMBERED + 4 }>,
}

/// A register that an operator writes to as well: his part and ours, which make up what stands there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Account {
    /// The operator's part.
    pub base: Counts,
    /// Ours.
    pub share: Counts,
    /// Why it is not believed; only a person ends that.
    pub doubt: Option<Doubt>,
}

/// A value of ours that may appear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Promise {
    /// As the register would hold it.
    pub value: Counts,
    /// When it was sent, for people.
    pub at: Moment,
    /// It is under way, or is about to be; else it was lately sent.
    pub is_under_way: bool,
}

shifted!(Kept: promises);
shifted!(Promise: at);

impl Kept {
    /// For an account that was lost or cannot be read: no share of ours is taken to be in the register, and a person
    /// decides.
    pub fn in_question(doubt: Doubt) -> Kept {
        Kept { account: Some(Account { doubt: Some(doubt), ..Account::default() }), ..Kept::default() }
    }

    /// What may still appear, as it stood on disk when the process started.
    pub(super) fn copies(&self, settings: &Settings, now: Moment) -> Copies {
        let mut copies = Copies::default();
        // A whole register waits until nothing from before the start can arrive; then it is enough to know the values.
        let waits = !settings.promises();
        let until = now.after(settings.late).after(settings.remembered);
        for promise in self.promises.iter() {
            if promise.is_under_way && !waits {
                add(&mut copies, promise.value, promise.at, now);
            } else {
                let _ = copies.add_lately(LatelySent { value: promise.value, at: promise.at, until });
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

/// Nobody knows when it left, but it was before the start.
fn add(copies: &mut Copies, value: Counts, at: Moment, start: Moment) {
    let sent = Sent { value, at, left: start, answered: None, other_seen: None, is_pinned: true };
    // There is room for each that was ever promised, and for what stood there.
    let _ = copies.of(value).is_some() || copies.add(sent);
}
