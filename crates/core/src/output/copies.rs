//! What was put on the wire and may still arrive, and what may be sent beside it.
//!
//! A value that was sent is **under way** until one of these:
//!
//! | | what was seen |
//! |---|---|
//! | a | it was answered as done, and a read asked after that answer shows it |
//! | b | it was refused, or never sent: then it is not even added here |
//! | c | a read showed another value, a later one shows it, and in between it was the only copy of its value that could arrive; never for zero, which a restarted CNC shows too, for a value lately sent, or for a copy that is pinned |
//! | d | a read was asked when it could not arrive any more; of an output that cannot be read: a write was acknowledged that was begun then |
//!
//! What ends by (d) without ever having been answered is **lately sent**: it is recognised for a while if a box on the
//! way was slower than anybody allowed for.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::slots::Slots;
use crate::quantity::{Counts, Moment, shifted};

/// At most so many are under way when another one is sent.
pub const MOST_UNDER_WAY: usize = 8;
/// At most so many are under way or lately sent then; the next one waits.
pub const MOST_REMEMBERED: usize = 24;

/// One copy of a value on its way to the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Sent {
    /// As the register will hold it.
    pub value: Counts,
    /// When it was sent, for people.
    pub at: Moment,
    /// It arrives within `late` of this or never.
    pub left: Moment,
    /// When it was answered as done.
    pub answered: Option<Moment>,
    /// When a read was asked that showed another value, if it has been the only copy of its value since.
    pub other_seen: Option<Moment>,
    /// Only time ends it: it was found on disk, or was under way when a person armed.
    pub is_pinned: bool,
}

/// A value whose answer never came, and which should not arrive any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct LatelySent {
    /// As the register would hold it.
    pub value: Counts,
    /// When it was sent, for people.
    pub at: Moment,
    /// It is forgotten then.
    pub until: Moment,
}

/// Everything of ours that may still appear in one register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Copies {
    /// Two more than are ever sent: a promise and what stood there, found on disk at a start.
    under_way: Slots<Sent, { MOST_UNDER_WAY + 2 }>,
    lately: Slots<LatelySent, { MOST_REMEMBERED + 2 }>,
}

shifted!(Copies: under_way, lately);
shifted!(Sent: at, left, answered, other_seen);
shifted!(LatelySent: at, until);

/// What a read says about copies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub(super) found: Counts,
    pub(super) asked: Moment,
    pub(super) late: Duration,
    pub(super) remembered: Duration,
    /// A read asked before this is no first read of a pair: what was sent before the start may still arrive.
    pub(super) pairs_from: Moment,
    /// What a restarted CNC may show as well as zero.
    pub(super) bias: Counts,
}

impl Copies {
    /// Another one may be sent without forgetting any.
    pub fn has_room(&self) -> bool {
        self.under_way.len() < MOST_UNDER_WAY && self.under_way.len() + self.lately.len() < MOST_REMEMBERED
    }

    /// The copies under way.
    pub fn under_way(&self) -> impl Iterator<Item = &Sent> {
        self.under_way.iter()
    }

    /// The values lately sent.
    pub fn lately(&self) -> impl Iterator<Item = &LatelySent> {
        self.lately.iter()
    }

    /// The newest copy of this value that is under way.
    pub fn of(&self, value: Counts) -> Option<&Sent> {
        self.under_way.iter().filter(|sent| sent.value == value).last()
    }

    /// This value, if it was lately sent.
    pub fn lately_of(&self, value: Counts) -> Option<&LatelySent> {
        self.lately.iter().find(|sent| sent.value == value)
    }

    /// The values that may be sent where this one stands: at most one `step` from it, and at most `reach` from
    /// everything that may still arrive.
    pub fn room(&self, stands: Counts, step: Counts, reach: Counts) -> Room {
        let around = Room { low: stands - step, high: stands + step };
        self.under_way.iter().fold(around, |room, sent| Room {
            low: room.low.max(sent.value - reach),
            high: room.high.min(sent.value + reach),
        })
    }

    /// Takes note of one that was sent directly after a read asked at `other_seen` had shown another value. Whether there
    /// was room for it.
    #[must_use]
    pub(super) fn add(&mut self, mut sent: Sent) -> bool {
        if sent.answered.is_some()
            && let Some(before) =
                self.under_way.iter_mut().find(|one| one.value == sent.value && one.answered.is_some())
        {
            // Both have been carried out; only the answer that came last is still to be compared with.
            (before.left, before.answered) = (sent.left, sent.answered);
            return true;
        }
        if sent.answered.is_none()
            && let Some(before) =
                self.under_way.iter_mut().find(|one| one.value == sent.value && one.answered.is_none())
        {
            // Two of them, of which one arriving says nothing of the other: only time ends both.
            (before.left, before.at, before.other_seen, before.is_pinned) = (sent.left, sent.at, None, true);
            return true;
        }
        for same in self.under_way.iter_mut().filter(|one| one.value == sent.value) {
            (same.other_seen, sent.other_seen) = (None, None);
        }
        self.under_way.push(sent)
    }

    /// Takes note of a value that was lately sent. Whether there was room for it.
    #[must_use]
    pub(super) fn add_lately(&mut self, sent: LatelySent) -> bool {
        if let Some(same) = self.lately.iter_mut().find(|one| one.value == sent.value) {
            (same.at, same.until) = (same.at.max(sent.at), same.until.max(sent.until));
            return true;
        }
        self.lately.push(sent)
    }

    /// Ends what a read ends. Whether anything did.
    pub(super) fn look(&mut self, look: Look) -> bool {
        let before = *self;
        self.under_way.retain(|sent| {
            let was_done = sent.answered.is_some_and(|answered| look.asked >= answered);
            let may_pair = sent.value != Counts::ZERO
                && sent.value != look.bias
                && !sent.is_pinned
                && before.lately_of(sent.value).is_none();
            let is_paired = may_pair && sent.other_seen.is_some();
            !(sent.value == look.found && (was_done || is_paired))
        });
        self.end_late(look.asked, look.late, look.remembered);
        let after = *self;
        let is_sole = |value: Counts| after.under_way.iter().filter(|one| one.value == value).count() == 1;
        for sent in self.under_way.iter_mut().filter(|sent| sent.value != look.found) {
            if look.asked > look.pairs_from && is_sole(sent.value) {
                sent.other_seen.get_or_insert(look.asked);
            }
        }
        self.under_way != before.under_way
    }

    /// Ends what could not arrive any more when something was asked at this moment.
    pub(super) fn end_late(&mut self, asked: Moment, late: Duration, remembered: Duration) {
        let before = self.under_way;
        for sent in before.iter().filter(|sent| asked > sent.left.after(late) && sent.answered.is_none()) {
            let until = asked.after(remembered);
            // There is always room: as many as are under way and lately sent together fit.
            let _ = self.add_lately(LatelySent { value: sent.value, at: sent.at, until });
        }
        self.under_way.retain(|sent| asked <= sent.left.after(late));
    }

    /// Forgets what was lately sent for long enough. Whether anything was.
    pub(super) fn expire(&mut self, now: Moment) -> bool {
        let before = self.lately.len();
        self.lately.retain(|sent| sent.until > now);
        self.lately.len() != before
    }

    /// Only time ends what is under way now.
    pub(super) fn pin(&mut self) {
        self.under_way.iter_mut().for_each(|sent| sent.is_pinned = true);
    }

    /// When the last of them cannot arrive any more; `None` where nothing is under way.
    pub fn all_over(&self, late: Duration) -> Option<Moment> {
        self.under_way.iter().map(|sent| sent.left.after(late)).max()
    }

    /// When the first of them cannot arrive any more; `None` where nothing is under way.
    pub fn first_over(&self, late: Duration) -> Option<Moment> {
        self.under_way.iter().map(|sent| sent.left.after(late)).min()
    }

    /// With every moment moved by this rule.
    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment) -> Copies {
        let mut copies = *self;
        for sent in copies.under_way.iter_mut() {
            sent.at = Moment::default();
            sent.left = to(sent.left);
            sent.answered = sent.answered.map(|_| Moment::default());
            sent.other_seen = sent.other_seen.map(|_| Moment::default());
        }
        for sent in copies.lately.iter_mut() {
            (sent.at, sent.until) = (Moment::default(), to(sent.until));
        }
        copies
    }
}

/// The values that may be sent now, from the lowest to the highest; none where the lowest is above the highest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    low: Counts,
    high: Counts,
}

impl Room {
    /// This value may be sent.
    pub fn contains(self, value: Counts) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// The value nearest to this one that may be sent.
    pub fn nearest(self, value: Counts) -> Option<Counts> {
        (self.low <= self.high).then(|| value.clamp(self.low, self.high))
    }
}
