//! Values that were sent and may still arrive at the register, and the range of the values that may be sent
//! meanwhile.
//!
//! A sent value is **under way** until one of these events:
//!
//! | | event |
//! |---|---|
//! | a | the write was acknowledged, and a read requested after that answer shows the value |
//! | b | the write was refused or not sent: it is not added at all |
//! | c | a read showed another value, and a later read shows this value. Between the two reads, no other write of this value could arrive. Not valid for zero (which a restarted CNC shows too), for an expired value, and for a write with `is_pinned` |
//! | d | a read was requested when the write could no longer arrive. If the output cannot be read: a write begun after that time was acknowledged |
//!
//! A write that ends by (d) without an answer is **expired**. It is still recognised for a while, in case a device on
//! the way was slower than the configured time.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::slots::Slots;
use crate::quantity::{Counts, Moment, shifted};

/// Largest number of writes to one register that may still arrive. If this number is reached, the next write waits.
pub const MOST_UNDER_WAY: usize = 8;
/// Largest number of writes to one register that may still arrive or are still recognised. If this number is reached,
/// the next write waits.
pub const MOST_REMEMBERED: usize = 24;

/// Write of a value that may still arrive at the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct InFlightWrite {
    /// Register value of the write, including the operator offset of a shared register.
    pub value: Counts,
    /// Time at which the write was sent, for messages to the operator.
    pub at: Moment,
    /// Time after the last byte was sent. The write arrives within `late` of this time, or never.
    pub left: Moment,
    /// Time at which the device answered that it has carried out the write. `None` without such an answer.
    pub answered: Option<Moment>,
    /// Time of the first read that showed another value. `None` if there was no such read, or if the same value was
    /// sent again since then.
    pub other_seen: Option<Moment>,
    /// Whether a read of this value does not prove that an unanswered write has arrived. Possible reasons: the write is
    /// from before the start, the operator may have entered the value, or the value was sent twice.
    pub is_pinned: bool,
}

/// Write without an answer whose longest delay is over. If its value appears in the register before `until`,
/// the gateway still recognises this write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ExpiredWrite {
    /// Register value of the write, including the operator offset of a shared register.
    pub value: Counts,
    /// Time at which the write was sent, for messages to the operator.
    pub at: Moment,
    /// Time at which the value is forgotten.
    pub until: Moment,
}

/// All values of the gateway that may still appear in one register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct InFlightWrites {
    /// Writes that may still arrive. The list has room for two more writes than are ever sent. A start of the gateway
    /// adds two values from disk: the value that was saved before its write, and the register value.
    under_way: Slots<InFlightWrite, { MOST_UNDER_WAY + 2 }>,
    #[serde(rename = "lately")]
    expired: Slots<ExpiredWrite, { MOST_REMEMBERED + 2 }>,
}

shifted!(InFlightWrites: under_way, expired);
shifted!(InFlightWrite: at, left, answered, other_seen);
shifted!(ExpiredWrite: at, until);

/// Result of a read, with the settings that decide which writes can no longer arrive after this read.
#[derive(Clone, Copy, Debug)]
pub(super) struct ReadResult {
    pub(super) found: Counts,
    pub(super) asked: Moment,
    pub(super) late: Duration,
    pub(super) remembered: Duration,
    /// Earliest time of a read that may prove that a write had not arrived yet. Before this time, writes of the
    /// previous run may still arrive.
    pub(super) pairs_from: Moment,
    /// Bias: register value for an offset of zero, which a restarted CNC may show instead of zero.
    pub(super) bias: Counts,
}

impl InFlightWrites {
    /// Returns whether the list has room for another write.
    pub fn has_room(&self) -> bool {
        self.under_way.len() < MOST_UNDER_WAY && self.under_way.len() + self.expired.len() < MOST_REMEMBERED
    }

    /// Returns the writes that may still arrive at the register.
    pub fn under_way(&self) -> impl Iterator<Item = &InFlightWrite> {
        self.under_way.iter()
    }

    /// Returns the writes whose longest delay is over, and whose values are still recognised in the register.
    pub fn expired(&self) -> impl Iterator<Item = &ExpiredWrite> {
        self.expired.iter()
    }

    /// Returns the newest write of this value that may still arrive.
    pub fn of(&self, value: Counts) -> Option<&InFlightWrite> {
        self.under_way.iter().filter(|sent| sent.value == value).last()
    }

    /// Returns the write of this value whose longest delay is over, if the value is still recognised.
    pub fn expired_of(&self, value: Counts) -> Option<&ExpiredWrite> {
        self.expired.iter().find(|sent| sent.value == value)
    }

    /// Returns the range of values that may be sent. These values are at most one `step` from the register value, and
    /// at most `reach` from every value that may still arrive.
    pub fn room(&self, current: Counts, step: Counts, reach: Counts) -> SendRange {
        let around = SendRange { low: current - step, high: current + step };
        self.under_way.iter().fold(around, |room, sent| SendRange {
            low: room.low.max(sent.value - reach),
            high: room.high.min(sent.value + reach),
        })
    }

    /// Adds a write that was sent. An earlier write of the same value is merged with the new write if the two cannot be
    /// distinguished. Returns false if the list was full; the write is then not added.
    #[must_use]
    pub(super) fn add(&mut self, mut sent: InFlightWrite) -> bool {
        if sent.answered.is_some()
            && let Some(before) =
                self.under_way.iter_mut().find(|one| one.value == sent.value && one.answered.is_some())
        {
            // Both writes were carried out. Only the times of the last write are kept.
            (before.left, before.answered) = (sent.left, sent.answered);
            return true;
        }
        if sent.answered.is_none()
            && let Some(before) =
                self.under_way.iter_mut().find(|one| one.value == sent.value && one.answered.is_none())
        {
            // Two copies of one value cannot be distinguished when one arrives, so only time ends them.
            (before.left, before.at, before.other_seen, before.is_pinned) = (sent.left, sent.at, None, true);
            return true;
        }
        for same in self.under_way.iter_mut().filter(|one| one.value == sent.value) {
            (same.other_seen, sent.other_seen) = (None, None);
        }
        self.under_way.push(sent)
    }

    /// Adds a write whose longest delay is over. Returns false if the list was full; the write is then not added.
    #[must_use]
    pub(super) fn add_expired(&mut self, sent: ExpiredWrite) -> bool {
        if let Some(same) = self.expired.iter_mut().find(|one| one.value == sent.value) {
            (same.at, same.until) = (same.at.max(sent.at), same.until.max(sent.until));
            return true;
        }
        self.expired.push(sent)
    }

    /// Removes the writes that, according to this read, have arrived or can no longer arrive. Returns true if the list
    /// of writes that may still arrive has changed.
    pub(super) fn apply_read(&mut self, result: ReadResult) -> bool {
        let before = *self;
        self.under_way.retain(|sent| {
            let was_done = sent.answered.is_some_and(|answered| result.asked >= answered);
            let may_pair = sent.value != Counts::ZERO
                && sent.value != result.bias
                && !sent.is_pinned
                && before.expired_of(sent.value).is_none();
            let is_paired = may_pair && sent.other_seen.is_some();
            !(sent.value == result.found && (was_done || is_paired))
        });
        self.end_late(result.asked, result.late, result.remembered);
        let after = *self;
        let is_sole = |value: Counts| after.under_way.iter().filter(|one| one.value == value).count() == 1;
        for sent in self.under_way.iter_mut().filter(|sent| sent.value != result.found) {
            if result.asked > result.pairs_from && is_sole(sent.value) {
                sent.other_seen.get_or_insert(result.asked);
            }
        }
        self.under_way != before.under_way
    }

    /// Removes the writes whose longest delay `late` was over when a request was sent at `asked`. If such a write has
    /// no answer, its value is still recognised for the time `remembered`.
    pub(super) fn end_late(&mut self, asked: Moment, late: Duration, remembered: Duration) {
        let before = self.under_way;
        for sent in before.iter().filter(|sent| asked > sent.left.after(late) && sent.answered.is_none()) {
            let until = asked.after(remembered);
            // There is room, because `has_room` also counts the expired writes.
            let _ = self.add_expired(ExpiredWrite { value: sent.value, at: sent.at, until });
        }
        self.under_way.retain(|sent| asked <= sent.left.after(late));
    }

    /// Forgets the values that need no longer be recognised. Returns true if at least one value was forgotten.
    pub(super) fn expire(&mut self, now: Moment) -> bool {
        let before = self.expired.len();
        self.expired.retain(|sent| sent.until > now);
        self.expired.len() != before
    }

    /// Pins all writes: from now on, a read of their value does not prove that an unanswered write has arrived.
    pub(super) fn pin(&mut self) {
        self.under_way.iter_mut().for_each(|sent| sent.is_pinned = true);
    }

    /// Returns the time after which no write of the list can arrive any more. `None` if no write may still arrive.
    pub fn all_over(&self, late: Duration) -> Option<Moment> {
        self.under_way.iter().map(|sent| sent.left.after(late)).max()
    }

    /// Returns the earliest time after which one of the writes can no longer arrive. `None` if no write may still
    /// arrive.
    pub fn first_over(&self, late: Duration) -> Option<Moment> {
        self.under_way.iter().map(|sent| sent.left.after(late)).min()
    }

    /// Returns a copy in which `to` is applied to every moment that affects decisions, for the comparison of two states
    /// that differ only in time. The other moments are cleared.
    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment) -> InFlightWrites {
        let mut copies = *self;
        for sent in copies.under_way.iter_mut() {
            sent.at = Moment::default();
            sent.left = to(sent.left);
            sent.answered = sent.answered.map(|_| Moment::default());
            sent.other_seen = sent.other_seen.map(|_| Moment::default());
        }
        for sent in copies.expired.iter_mut() {
            (sent.at, sent.until) = (Moment::default(), to(sent.until));
        }
        copies
    }
}

/// Range of the values that may be sent now. The range is empty if its lowest value is above its highest value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SendRange {
    low: Counts,
    high: Counts,
}

impl SendRange {
    /// Returns true if this value is in the range of the values that may be sent.
    pub fn contains(self, value: Counts) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// Returns the value of the range that is nearest to this value. `None` if the range is empty.
    pub fn nearest(self, value: Counts) -> Option<Counts> {
        (self.low <= self.high).then(|| value.clamp(self.low, self.high))
    }
}
