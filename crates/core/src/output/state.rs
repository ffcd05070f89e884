//! What is known of one output, and how each fact changes it.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::copies::{Copies, Look, Sent};
use super::event::{Doubt, Event};
use super::judge::{self, Meaning};
use super::kept::{Account, Kept, Promise};
use super::reports::Reports;
use super::settings::{Settings, Verify};
use super::slots::Slots;
use super::standing::{Doing, Order, Seen, Shown, Standing, Untaken};
use super::{Fact, Who, plan};
use crate::quantity::{Counts, Moment};

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
    /// Whose part is what in a shared register, once that is known.
    pub(super) account: Option<Account>,
    pub(super) standing: Standing,
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
    unanswered_change: Option<Counts>,
    /// The operator's last change equalled an unanswered one of ours.
    was_like_our_own: bool,
    /// Where a write was answered as done last, something else stood there afterwards.
    pub(super) was_unsteady: bool,
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
            standing: if is_doubtful { Standing::Barred } else { Standing::Off },
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
        let about_to_be = self.promised.or(match self.doing {
            Doing::Writing { value, .. } => Some(value),
            _ => None,
        });
        about_to_be.into_iter().for_each(|value| add(value, self.written_at, true));
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
        let is_writing = matches!(self.doing, Doing::Writing { .. });
        let stands = self.verified.map(|verified| verified.value);
        // A repeat of what stands there that was answered as done has moved nothing.
        let is_repeat = |sent: &Sent| sent.answered.is_some() && Some(sent.value) == stands;
        let in_order = !is_writing && self.copies.under_way().all(is_repeat) && self.settles_at.is_none();
        let kept = Kept { in_order, ..self.kept() };
        self.doing = Doing::Ended;
        kept
    }

    /// Takes a fact in. When a read shows nothing new, the moment at which it was asked.
    pub(super) fn take(&mut self, settings: &Settings, fact: Fact, now: Moment) -> Option<Moment> {
        self.is_unsaved |= self.copies.expire(now);
        match fact {
            Fact::Look | Fact::GoesAlong => {}
            Fact::WentAlong { value, left, is_done } => {
                let answered = is_done.then_some(now);
                let sent = Sent { value, at: left, left, answered, other_seen: None, is_pinned: false };
                // Where there is no room, as many are under way already, and this one is what was just read.
                let _ = self.copies.add(sent);
            }
            Fact::Decided { offset, not_after } => {
                let offset =
                    if settings.rules.limit { offset.clamp(-settings.limit, settings.limit) } else { offset };
                self.order = Some(Order { offset, not_after });
            }
            Fact::Read { found, asked } if self.ends(Doing::Reading) || self.doing == Doing::Nothing => {
                return self.read(settings, found, asked, now);
            }
            Fact::NoAnswer if self.ends(Doing::Reading) => {
                self.reads_from = now.after(RETRY);
                self.drop_order(settings);
            }
            Fact::Done { left } => self.written(settings, Some(now), left, now),
            Fact::Unknown { left } => self.written(settings, None, left, now),
            Fact::Refused => {
                if let Some(value) = self.not_written(settings, now) {
                    self.unanswered_change = self.expected().map(|stood| value - stood);
                    self.report_untaken(Untaken::Refused, Event::WriteRefused { value });
                }
            }
            Fact::NotSent => {
                // Of what cannot be read only a write that is acknowledged shows that there is somebody to write to.
                if self.not_written(settings, now).is_some() && settings.verify == Verify::Echo {
                    self.untaken = Some(Untaken::Refused);
                }
            }
            Fact::Kept if self.ends(Doing::Keeping) => {
                self.has_begun_on_disk = true;
                self.reports.disk_keeps();
            }
            Fact::NotKept if self.ends(Doing::Keeping) => {
                self.is_unsaved = true;
                self.keeps_from = now.after(RETRY);
                self.drop_order(settings);
                self.reports.report_disk();
            }
            Fact::Restarted => self.restarted(settings, now),
            Fact::Interlocked => {
                self.is_interlocked = true;
                self.drop_order(settings);
            }
            Fact::Released => {
                let was_interlocked = std::mem::take(&mut self.is_interlocked);
                self.must_read |= was_interlocked && settings.verify == Verify::Reading;
            }
            Fact::Paused => {
                self.must_read = settings.verify == Verify::Reading;
                self.drop_order(settings);
            }
            Fact::Armed { by } => self.arm(settings, by),
            Fact::Off => {
                let is_barred = matches!(self.standing, Standing::Barred | Standing::Confirming(_));
                self.switch_off(if is_barred { Standing::Barred } else { Standing::Off });
            }
            // Nobody asked for it.
            Fact::Read { .. } | Fact::NoAnswer | Fact::Kept | Fact::NotKept => {}
        }
        None
    }

    fn read(&mut self, settings: &Settings, found: Counts, asked: Moment, now: Moment) -> Option<Moment> {
        let meaning = judge::meaning(self, settings, found, asked);
        if self.answered.is_some() {
            self.was_unsteady = matches!(meaning, Meaning::Moved { .. });
        }
        let is_believed = self.account.is_none_or(|account| account.doubt.is_none());
        if is_believed {
            self.follow(settings, meaning, found, now);
        }
        let look = Look {
            found,
            asked,
            late: settings.late,
            remembered: settings.remembered,
            pairs_from: self.pairs_from,
            bias: settings.bias,
        };
        self.is_unsaved |= self.copies.look(look);
        if self.settles_at.is_some_and(|settles| asked > settles) {
            self.settles_at = None;
        }
        self.verified = Some(Seen { value: found, asked });
        (self.answered, self.unanswered_change) = (None, None);
        (self.must_read, self.is_rebooted) = (false, false);
        self.confirm(settings, found);
        (meaning == Meaning::Same).then_some(asked)
    }

    fn follow(&mut self, settings: &Settings, meaning: Meaning, found: Counts, now: Moment) {
        let expected = self.expected();
        match meaning {
            Meaning::Same => {
                if self.answered.is_some() {
                    self.untaken = None;
                }
                self.share_is(found);
            }
            Meaning::First if settings.is_shared && !settings.is_zero(found) => {
                if self.standing != Standing::Barred {
                    self.reports.report(Event::FirstAccount { found });
                }
                self.switch_off(Standing::Barred);
            }
            Meaning::First if settings.is_shared => self.has_nothing_of_ours(found),
            Meaning::First => {}
            Meaning::Ours { sent, is_late } => {
                self.drop_order(settings);
                self.untaken = None;
                self.share_is(found);
                if is_late {
                    self.reports.report(Event::OwnWriteArrivedLate { value: found, sent });
                }
            }
            Meaning::FromBefore => {
                self.drop_order(settings);
                self.reports.report(Event::PerhapsFromBefore { value: found });
            }
            Meaning::NotTaken => {
                let event = Event::NotTaken { wrote: expected.unwrap_or(found), found };
                self.report_untaken(Untaken::Ignored, event);
                self.writes_from = now.after(RETRY);
            }
            Meaning::Restarted => {
                self.drop_order(settings);
                self.reports.report(Event::CncRestarted { stood: expected.unwrap_or(found) });
                if settings.is_shared {
                    self.has_nothing_of_ours(found);
                }
                if found.abs_diff(settings.bias) > settings.limit.unsigned_abs() && !settings.is_shared {
                    self.bar_foreign(settings.bias, found);
                }
            }
            Meaning::Foreign => self.bar_foreign(expected.unwrap_or(found), found),
            Meaning::Moved { by } => {
                self.was_like_our_own = self.unanswered_change == Some(by);
                expected.into_iter().for_each(|expected| self.share_is(expected));
                let Some(account) = self.account else { return };
                let to = account.base + by;
                self.reports.report(Event::OperatorChanged { from: account.base, to });
                self.account_is(Account { base: to, ..account });
            }
            Meaning::Doubtful(doubt) => self.doubt(doubt, found),
        }
    }

    /// Once, until a write stands there.
    fn report_untaken(&mut self, how: Untaken, event: Event) {
        if self.untaken.replace(how).is_none() {
            self.reports.report(event);
        }
    }

    /// The sum is known, and the operator's part has not changed.
    fn share_is(&mut self, sum: Counts) {
        if let Some(account) = self.account {
            self.account_is(Account { share: sum - account.base, ..account });
        }
    }

    fn account_is(&mut self, account: Account) {
        self.is_unsaved |= self.account != Some(account);
        self.account = Some(account);
    }

    fn has_nothing_of_ours(&mut self, found: Counts) {
        self.account_is(Account { base: found, ..Account::default() });
    }

    fn doubt(&mut self, doubt: Doubt, found: Counts) {
        let account = self.account.unwrap_or_default();
        self.account_is(Account { doubt: Some(doubt), ..account });
        self.reports.report(Event::Doubted { doubt, found, share: account.share });
        self.switch_off(Standing::Barred);
    }

    fn bar_foreign(&mut self, expected: Counts, found: Counts) {
        if self.standing == Standing::Armed {
            self.reports.report(Event::ForeignValue { expected, found });
            self.switch_off(Standing::Barred);
        }
    }

    fn arm(&mut self, settings: &Settings, by: Who) {
        // Whoever arms takes over what stands there: what was decided before started from something else.
        self.drop_order(settings);
        let is_confirmed = self.account.is_some_and(|account| account.doubt.is_none());
        match (self.standing, by) {
            (Standing::Armed | Standing::Confirming(_), _) | (Standing::Barred, Who::Policy) => {}
            _ if !settings.is_shared || is_confirmed => {
                if by == Who::Person {
                    self.copies.pin();
                }
                self.standing = Standing::Armed;
            }
            (_, Who::Policy) => {}
            (_, Who::Person) => {
                self.copies.pin();
                self.must_read = true;
                let shown = self.verified.map(|verified| Standing::Confirming(verified.value));
                self.standing = shown.unwrap_or(self.standing);
            }
        }
    }

    /// A person has said that the register is right: our share is what it was taken to be, the rest is the operator's.
    /// He may have done that after it was last read; but what may have come from us, or from a restarted CNC, need not be
    /// what he said. What stood before the doubt is the same, whoever put it there again.
    fn confirm(&mut self, settings: &Settings, found: Counts) {
        let Standing::Confirming(shown) = self.standing else { return };
        let account = self.account.unwrap_or_default();
        let is_ours = self.copies.of(found).is_some() || self.copies.lately_of(found).is_some();
        if settings.is_zero(found) && account.share != Counts::ZERO {
            self.doubt(Doubt::ZeroOrOurs, found);
        } else if found == shown || !is_ours || found == account.base + account.share {
            self.account_is(Account { base: found - account.share, share: account.share, doubt: None });
            self.standing = Standing::Armed;
        } else {
            self.doubt(Doubt::ChangedWhileArming, found);
        }
    }

    fn restarted(&mut self, settings: &Settings, now: Moment) {
        self.drop_order(settings);
        if settings.verify == Verify::Reading {
            (self.is_rebooted, self.must_read) = (true, true);
        } else {
            // What a restarted control holds that nobody can read: nothing.
            let stood = self.verified.map_or(settings.bias, |verified| verified.value);
            self.reports.report(Event::CncRestarted { stood });
            self.verified = Some(Seen { value: settings.bias, asked: now });
            self.is_unsaved = true;
        }
    }

    /// A write has left: it was answered as done at this moment, or nobody knows.
    fn written(&mut self, settings: &Settings, answered: Option<Moment>, left: Moment, now: Moment) {
        let Doing::Writing { value, begun, read } = self.doing else { return };
        self.doing = Doing::Nothing;
        self.written_at = now;
        let stood = self.expected();
        if settings.verify == Verify::Echo && answered.is_some() {
            self.acknowledged(settings, value, begun, left);
            return;
        }
        let other_seen = read.filter(|asked| *asked > self.pairs_from);
        let sent = Sent { value, at: left, left, answered, other_seen, is_pinned: false };
        // A write is only begun where there is room for it.
        let _ = self.copies.add(sent);
        self.must_read |= settings.verify == Verify::Reading && (answered.is_none() || read.is_some());
        if answered.is_some() {
            self.answered = Some(value);
        } else {
            self.unanswered_change = stood.map(|stood| value - stood);
            self.writes_from = now.after(RETRY);
            self.drop_order(settings);
            // A shared register is not written again to find out: that it is read shows enough.
            if self.standing == Standing::Armed && !settings.is_shared {
                self.untaken = Some(Untaken::Refused);
            }
        }
    }

    fn acknowledged(&mut self, settings: &Settings, value: Counts, begun: Moment, left: Moment) {
        self.copies.end_late(begun, settings.late, settings.remembered);
        self.verified = Some(Seen { value, asked: left });
        (self.is_unsaved, self.untaken) = (true, None);
        self.reports.report_acknowledged();
    }

    /// A write did not take place. What it was.
    fn not_written(&mut self, settings: &Settings, now: Moment) -> Option<Counts> {
        let Doing::Writing { value, .. } = self.doing else { return None };
        self.doing = Doing::Nothing;
        self.is_unsaved |= settings.promises();
        self.writes_from = now.after(RETRY);
        self.drop_order(settings);
        Some(value)
    }

    /// What was decided before this is not sent any more.
    pub(super) fn drop_order(&mut self, settings: &Settings) {
        if settings.rules.last_moment {
            self.order = None;
        }
    }

    fn switch_off(&mut self, to: Standing) {
        if to == Standing::Barred {
            // A person may type anything now, also what is under way: that ends nothing.
            self.copies.pin();
        }
        self.standing = to;
        (self.order, self.untaken) = (None, None);
        self.is_waiting = false;
        self.promised_until = None;
        if self.promised.take().is_some() {
            self.is_unsaved = true;
        }
    }

    /// What was asked for has come to its end, if it was this.
    fn ends(&mut self, what: Doing) -> bool {
        let is_it = self.doing == what;
        if is_it {
            self.doing = Doing::Nothing;
        }
        is_it
    }

    /// What should stand there: what was answered as done last, else what was verified last.
    pub(super) fn expected(&self) -> Option<Counts> {
        let from_disk = || self.account.map(|account| account.base + account.share);
        self.answered.or(self.verified.map(|verified| verified.value)).or_else(from_disk)
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
        let is_driven = self.standing == Standing::Armed && !self.is_interlocked;
        is_driven && now >= self.writes_from && (is_wanted || self.untaken.is_some())
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
