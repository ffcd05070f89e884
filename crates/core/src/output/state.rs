//! What is known of one output.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::copies::{Copies, Sent};
use super::event::Event;
use super::kept::{Account, Kept, Promise};
use super::plan;
use super::reports::Reports;
use super::settings::{Settings, Verify};
use super::slots::Slots;
use super::standing::{ArmState, Doing, Order, Seen, Shown, Untaken};
use super::turns::Turns;
use crate::quantity::{Counts, Moment, shifted};

/// What failed is tried again after this long at the earliest; and what is not certain is looked at again.
pub(super) const RETRY: Duration = Duration::from_secs(1);

/// One output. As a text it is what a step behaves by, without what only its reports depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct State {
    pub(super) doing: Doing,
    pub(super) copies: Copies,
    /// What the last read showed; of an output that is not read what was acknowledged last.
    pub(super) verified: Option<Seen>,
    /// What was answered as done since then.
    pub(super) answered: Option<Counts>,
    /// Operator offset and gateway share of a shared register, once they are known.
    pub(super) account: Option<Account>,
    pub(super) standing: ArmState,
    pub(super) is_interlocked: bool,
    /// What is wanted, and until when a change to it may be sent.
    pub(super) order: Option<Order>,
    /// The value on disk that is about to be sent.
    pub(super) promised: Option<Counts>,
    /// When it must have left, by the readings below it.
    #[serde(default)]
    pub(super) promised_until: Option<Moment>,
    /// The disk does not say what it must say before the next write.
    pub(super) is_unsaved: bool,
    /// The disk says that this run has begun: it does not end in order unless it says so itself.
    pub(super) has_begun_on_disk: bool,
    /// After a start without an orderly stop a whole register is not written until a read was asked after this.
    pub(super) settles_at: Option<Moment>,
    /// No read before this can be the first of a pair.
    pub(super) pairs_from: Moment,
    /// The CNC was restarted since the last read.
    pub(super) is_rebooted: bool,
    /// The change that the last write would have made, if nobody answered it as done, until the next read.
    pub(super) unanswered_change: Option<Counts>,
    /// The operator's last change equalled an unanswered one of ours.
    pub(super) was_like_our_own: bool,
    /// Where a write was answered as done last, something else stood there afterwards.
    pub(super) was_unsteady: bool,
    /// Who has changed a shared register by turns.
    #[serde(default)]
    pub(super) turns: Turns,
    /// The register is to be read before anything else is decided.
    pub(super) must_read: bool,
    /// A change waits for what may still arrive.
    pub(super) is_waiting: bool,
    /// When it was last found to wait.
    pub(super) waited_at: Moment,
    /// No read is tried again before this.
    pub(super) reads_from: Moment,
    /// No write is tried again before this.
    pub(super) writes_from: Moment,
    /// Nothing is given to the disk again before this.
    pub(super) keeps_from: Moment,
    /// When something was last put there.
    pub(super) written_at: Moment,
    /// How the last write failed, if none has stood there since.
    pub(super) untaken: Option<Untaken>,
    #[serde(skip)]
    pub(super) reports: Reports,
}

shifted!(State: doing, copies, verified, order, promised_until, settles_at, pairs_from, waited_at, reads_from, writes_from,
    keeps_from, written_at);

impl State {
    /// At a start, with what the last run left on disk.
    pub fn new(settings: &Settings, kept: Option<&Kept>, now: Moment) -> State {
        let nothing = Kept::default();
        let was_in_order = kept.is_some_and(|kept| kept.in_order);
        let kept = kept.unwrap_or(&nothing);
        let is_read = settings.verify == Verify::Reading;
        let acknowledged = Seen { value: kept.stood.unwrap_or(settings.bias), asked: now };
        let account = kept.account.filter(|_| settings.is_shared);
        let is_doubtful = account.is_some_and(|account| account.doubt.is_some());
        let late_over = now.after(settings.late);
        State {
            doing: Doing::Nothing,
            copies: kept.copies(settings, now),
            verified: (!is_read).then_some(acknowledged),
            answered: None,
            account,
            standing: if is_doubtful { ArmState::Barred } else { ArmState::Off },
            is_interlocked: false,
            order: None,
            promised: None,
            promised_until: None,
            is_unsaved: false,
            has_begun_on_disk: false,
            settles_at: (!was_in_order && !settings.promises()).then_some(late_over),
            pairs_from: if was_in_order { now } else { late_over },
            is_rebooted: false,
            unanswered_change: None,
            was_like_our_own: false,
            was_unsteady: false,
            turns: Turns::default(),
            must_read: is_read,
            is_waiting: false,
            waited_at: now,
            reads_from: now,
            writes_from: now,
            keeps_from: now,
            written_at: now,
            untaken: None,
            reports: Reports::default(),
        }
    }

    /// What people see.
    pub fn shown(&self, settings: &Settings) -> Shown {
        Shown {
            verified: self.verified,
            is_only_acknowledged: settings.verify == Verify::Echo,
            account: self.account,
            standing: self.standing,
            under_way: self.copies.under_way().count(),
            waits_until: self.is_waiting.then(|| self.waits_until(settings)).flatten(),
            is_untaken: self.untaken.is_some(),
        }
    }

    /// What of ours may still appear in the register.
    pub fn copies(&self) -> &Copies {
        &self.copies
    }

    /// Values that the gateway has sent, or is sending now, and that the last read did not show. Each may still appear in the
    /// register.
    pub fn may_arrive(&self) -> impl Iterator<Item = Counts> {
        let sent = self.copies.under_way().map(|sent| sent.value);
        sent.chain(self.being_written()).filter(|value| self.verified.map(|seen| seen.value) != Some(*value))
    }

    /// Value of the write that has no result yet.
    fn being_written(&self) -> Option<Counts> {
        match self.doing {
            Doing::Writing { value, .. } => Some(value),
            _ => None,
        }
    }

    /// What has happened since this was last called.
    pub fn take_events(&mut self) -> Slots<Event, 8> {
        self.reports.take()
    }

    /// What is to be put on disk now.
    pub fn kept(&self) -> Kept {
        let mut promises = Slots::default();
        let mut add = |value, at, is_under_way| {
            // There is room for all that fits into the memory and one more.
            let _ = promises.push(Promise { value, at, is_under_way });
        };
        self.copies.under_way().for_each(|sent| add(sent.value, sent.at, true));
        self.promised
            .or(self.being_written())
            .into_iter()
            .for_each(|value| add(value, self.written_at, true));
        self.copies.lately().for_each(|sent| add(sent.value, sent.at, false));
        Kept {
            in_order: false,
            account: self.account,
            stood: self.verified.map(|verified| verified.value),
            promises,
        }
    }

    /// The end of the process: what goes on disk last. Nothing is begun any more. The stop is in order if nothing may
    /// still arrive.
    pub fn end(&mut self) -> Kept {
        (self.promised, self.promised_until) = (None, None);
        let is_writing = self.being_written().is_some();
        let stands = self.verified.map(|verified| verified.value);
        // A repeat of what stands there that was answered as done has moved nothing.
        let is_repeat = |sent: &Sent| sent.answered.is_some() && Some(sent.value) == stands;
        let in_order = !is_writing && self.copies.under_way().all(is_repeat) && self.settles_at.is_none();
        let kept = Kept { in_order, ..self.kept() };
        self.doing = Doing::Ended;
        kept
    }

    /// What was decided before this is not sent any more.
    pub(super) fn drop_order(&mut self, settings: &Settings) {
        if settings.rules.last_moment {
            self.order = None;
        }
    }

    /// Offset that the register is expected to hold. `None` until it was read.
    pub(super) fn expected_offset(&self, settings: &Settings) -> Option<Counts> {
        self.expected().map(|value| value - self.centre(settings))
    }

    /// What should stand there: what was answered as done last, else what was verified last.
    pub(super) fn expected(&self) -> Option<Counts> {
        let from_disk = || self.account.map(|account| account.base + account.share);
        self.acknowledged().or_else(from_disk)
    }

    /// Our share stands there, or something of ours may still arrive.
    pub(super) fn has_anything_of_ours(&self) -> bool {
        self.account.is_some_and(|account| account.share != Counts::ZERO)
            || self.copies.under_way().next().is_some()
    }

    /// For the second time in a row an unanswered write was followed by a change of just its size.
    pub(super) fn is_like_our_own_again(&self, change: Counts) -> bool {
        self.was_like_our_own && self.unanswered_change == Some(change)
    }

    /// What the offset is counted from: the operator's part, or the bias.
    pub(super) fn centre(&self, settings: &Settings) -> Counts {
        self.account.map_or(settings.bias, |account| account.base)
    }

    /// This offset is what stands there as last verified.
    pub fn is_at(&self, settings: &Settings, offset: Counts) -> bool {
        self.verified.is_some_and(|seen| plan::is_there(self, settings, seen.value, offset))
    }

    /// Its interlock is open.
    pub fn is_interlocked(&self) -> bool {
        self.is_interlocked
    }

    /// What it asked for has not come to its end.
    pub fn is_asking(&self) -> bool {
        self.doing != Doing::Nothing
    }

    /// Nothing from before the start may still arrive unknown.
    pub fn is_settled(&self) -> bool {
        self.settles_at.is_none()
    }

    /// A read that shows nothing new may be followed by a write.
    pub fn may_write(&self, settings: &Settings, now: Moment) -> bool {
        let is_wanted =
            self.order.is_some_and(|order| now <= order.not_after && !self.is_at(settings, order.offset));
        let is_driven = self.standing == ArmState::Armed && !self.is_interlocked;
        is_driven && now >= self.writes_from && (is_wanted || self.untaken.is_some())
    }

    /// Returns whether a write was answered as done that no read has shown yet.
    pub(super) fn has_answered(&self) -> bool {
        self.answered.is_some()
    }

    /// Register value that was answered as done last, else verified last.
    pub(super) fn acknowledged(&self) -> Option<Counts> {
        self.answered.or(self.verified.map(|verified| verified.value))
    }

    /// Last moment of a change that was decided and not sent, if that has passed.
    pub(super) fn overdue(&self, settings: &Settings, now: Moment) -> Option<Moment> {
        let order = self.order.filter(|order| now > order.not_after && !self.is_at(settings, order.offset));
        order.filter(|_| settings.rules.last_moment).map(|order| order.not_after)
    }

    /// A value is on disk that is about to be sent, or is to be: without it nothing is.
    pub fn is_promising(&self) -> bool {
        self.promised.is_some()
    }

    /// When what may still arrive no longer forbids anything, at the latest.
    pub fn waits_until(&self, settings: &Settings) -> Option<Moment> {
        self.copies.all_over(settings.late).into_iter().chain(self.settles_at).max()
    }

    /// The same state with every moment moved by `to`, and without what only people see: two states that are equal then
    /// behave alike.
    #[doc(hidden)]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment) -> State {
        State {
            doing: match self.doing {
                Doing::Writing { value, begun, read } => {
                    Doing::Writing { value, begun: to(begun), read: read.map(&to) }
                }
                other => other,
            },
            copies: self.copies.moved(&to),
            verified: self.verified.map(|seen| Seen { asked: to(seen.asked), ..seen }),
            order: self.order.map(|order| Order { not_after: to(order.not_after), ..order }),
            settles_at: self.settles_at.map(&to),
            pairs_from: to(self.pairs_from),
            reads_from: to(self.reads_from),
            writes_from: to(self.writes_from),
            keeps_from: to(self.keeps_from),
            written_at: to(self.written_at),
            waited_at: to(self.waited_at),
            reports: Reports::default(),
            ..*self
        }
    }
}
