//! State of one output: its last known register value, the writes that may still arrive, and the pending action.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::event::Event;
use super::in_flight::{InFlightWrite, InFlightWrites};
use super::plan;
use super::reports::Reports;
use super::saved_output::{Account, Promise, SavedOutput};
use super::settings::{Rule, Settings, Verify};
use super::slots::Slots;
use super::state_parts::{
    ArmState, DiskState, Evidence, OutputView, PendingAction, RequiredRead, Setpoint, TimedValue,
    WriteFailure,
};
use super::turns::Turns;
use crate::quantity::{Counts, Moment, shifted};

/// Minimum time before a failed action is repeated. Also the period of reads while the register value is uncertain.
pub(super) const RETRY: Duration = Duration::from_secs(1);

/// State of one output. The serialised form contains everything that determines the next actions, but no pending
/// events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct State {
    #[serde(rename = "doing")]
    pub(super) pending_action: PendingAction,
    pub(super) copies: InFlightWrites,
    /// Last register value that was read. For an output that cannot be read, the last acknowledged value.
    pub(super) verified: Option<TimedValue>,
    /// Value of the last write that was acknowledged. `None` once the register has been read after that write.
    pub(super) answered: Option<Counts>,
    /// Both parts of a shared register's value (operator offset and gateway share), if they are known.
    pub(super) account: Option<Account>,
    pub(super) standing: ArmState,
    pub(super) is_interlocked: bool,
    /// Decision to carry out, with the last moment for sending it.
    pub(super) order: Option<Setpoint>,
    /// Value that the gateway sends as soon as the value is saved on disk.
    pub(super) promised: Option<Counts>,
    /// Last moment for sending the value in `promised`, given by the age of the readings on which the value depends.
    #[serde(default)]
    pub(super) promised_until: Option<Moment>,
    #[serde(flatten)]
    pub(super) disk: DiskState,
    /// Time until which late writes of a previous run may arrive. `Some` only if that run was not stopped
    /// cleanly, and did not save its values as promises. The register is written only after a read later than
    /// this time.
    pub(super) settles_at: Option<Moment>,
    /// Earliest time of a read that may prove that a write had not arrived yet. Before this time, writes of the
    /// previous run may still arrive.
    pub(super) pairs_from: Moment,
    #[serde(flatten)]
    pub(super) required_read: RequiredRead,
    /// Change of the register value by the last write, if the write was not acknowledged. `None` after the next read.
    pub(super) unanswered_change: Option<Counts>,
    #[serde(flatten)]
    pub(super) evidence: Evidence,
    /// Numbers of changes of a shared register by the gateway and by another client, to detect a second gateway.
    #[serde(default)]
    pub(super) turns: Turns,
    /// Whether a change waits for earlier writes that may still arrive.
    pub(super) is_waiting: bool,
    /// Time when a change last waited for an earlier write.
    pub(super) waited_at: Moment,
    /// Earliest time for the next read of the register.
    pub(super) reads_from: Moment,
    /// Earliest time for the next write to the register.
    pub(super) writes_from: Moment,
    /// Earliest time for the next write to disk.
    pub(super) keeps_from: Moment,
    /// Time of the last write to the register.
    pub(super) written_at: Moment,
    /// Failure of the last write; `None` if a write has been verified since.
    #[serde(rename = "untaken")]
    pub(super) write_failure: Option<WriteFailure>,
    #[serde(skip)]
    pub(super) reports: Reports,
}

shifted!(State: pending_action, copies, verified, order, promised_until, settles_at, pairs_from, waited_at,
    reads_from, writes_from, keeps_from, written_at);

impl State {
    /// Creates the state at a start of the gateway, from the state that the last run left on disk.
    pub fn new(settings: &Settings, kept: Option<&SavedOutput>, now: Moment) -> State {
        let nothing = SavedOutput::default();
        let was_in_order = kept.is_some_and(|kept| kept.in_order);
        let kept = kept.unwrap_or(&nothing);
        let is_read = settings.verify == Verify::Reading;
        let acknowledged = TimedValue { value: kept.stood.unwrap_or(settings.bias), asked: now };
        let account = kept.account.filter(|_| settings.is_shared);
        let is_doubtful = account.is_some_and(|account| account.doubt.is_some());
        let late_over = now.after(settings.late);
        State {
            pending_action: PendingAction::Nothing,
            copies: kept.copies(settings, now),
            verified: (!is_read).then_some(acknowledged),
            answered: None,
            account,
            standing: if is_doubtful { ArmState::Barred } else { ArmState::Off },
            is_interlocked: false,
            order: None,
            promised: None,
            promised_until: None,
            disk: DiskState::default(),
            settles_at: (!was_in_order && !settings.promises()).then_some(late_over),
            pairs_from: if was_in_order { now } else { late_over },
            required_read: if is_read { RequiredRead::Pending } else { RequiredRead::None },
            unanswered_change: None,
            evidence: Evidence::default(),
            turns: Turns::default(),
            is_waiting: false,
            waited_at: now,
            reads_from: now,
            writes_from: now,
            keeps_from: now,
            written_at: now,
            write_failure: None,
            reports: Reports::default(),
        }
    }

    /// Returns the part of the state that is displayed to the operator.
    pub fn shown(&self, settings: &Settings) -> OutputView {
        OutputView {
            verified: self.verified,
            is_only_acknowledged: settings.verify == Verify::Echo,
            account: self.account,
            standing: self.standing,
            under_way: self.copies.under_way().count(),
            waits_until: self.is_waiting.then(|| self.waits_until(settings)).flatten(),
            is_untaken: self.write_failure.is_some(),
        }
    }

    /// Returns the writes of the gateway that may still arrive, and the expired writes whose values are still
    /// recognised.
    pub fn copies(&self) -> &InFlightWrites {
        &self.copies
    }

    /// Returns the values that may still appear in the register: those of earlier writes that may still
    /// arrive, and the value of the pending write. The value that the last read showed is left out.
    pub fn may_arrive(&self) -> impl Iterator<Item = Counts> {
        let sent = self.copies.under_way().map(|sent| sent.value);
        sent.chain(self.being_written()).filter(|value| self.verified.map(|seen| seen.value) != Some(*value))
    }

    /// Returns the value of the pending write. `None` if no write is pending.
    fn being_written(&self) -> Option<Counts> {
        match self.pending_action {
            PendingAction::Writing { value, .. } => Some(value),
            _ => None,
        }
    }

    /// Returns the events since the last call of this function, oldest first.
    pub fn take_events(&mut self) -> Slots<Event, 8> {
        self.reports.take()
    }

    /// Returns the state to write to disk now.
    pub fn kept(&self) -> SavedOutput {
        let mut promises = Slots::default();
        let mut add = |value, at, is_under_way| {
            // The capacity is sufficient for all copies and one more.
            let _ = promises.push(Promise { value, at, is_under_way });
        };
        self.copies.under_way().for_each(|sent| add(sent.value, sent.at, true));
        self.promised
            .or(self.being_written())
            .into_iter()
            .for_each(|value| add(value, self.written_at, true));
        self.copies.expired().for_each(|sent| add(sent.value, sent.at, false));
        SavedOutput {
            in_order: false,
            account: self.account,
            stood: self.verified.map(|verified| verified.value),
            promises,
        }
    }

    /// Ends the work on the output, and returns the last state to save to disk. No further action is begun. The state
    /// is marked as a clean stop if no write may still arrive.
    pub fn end(&mut self) -> SavedOutput {
        (self.promised, self.promised_until) = (None, None);
        let is_writing = self.being_written().is_some();
        let current = self.verified.map(|verified| verified.value);
        // An acknowledged write of the value that the register held before has changed nothing.
        let is_repeat = |sent: &InFlightWrite| sent.answered.is_some() && Some(sent.value) == current;
        let in_order = !is_writing && self.copies.under_way().all(is_repeat) && self.settles_at.is_none();
        let kept = SavedOutput { in_order, ..self.kept() };
        self.pending_action = PendingAction::Ended;
        kept
    }

    /// Drops the decision: from now on, its value is not sent.
    pub(super) fn drop_order(&mut self, settings: &Settings) {
        if settings.rules.has(Rule::LastMoment) {
            self.order = None;
        }
    }

    /// Returns the offset that the register is expected to hold. `None` if the register value is unknown.
    pub(super) fn expected_offset(&self, settings: &Settings) -> Option<Counts> {
        self.expected().map(|value| value - self.centre(settings))
    }

    /// Returns the expected register value: the last acknowledged value, else the last verified value, else the value
    /// saved on disk.
    pub(super) fn expected(&self) -> Option<Counts> {
        let from_disk = || self.account.map(|account| account.base + account.share);
        self.acknowledged().or_else(from_disk)
    }

    /// Returns whether a part of the register value comes from the gateway, or a write of the gateway may still arrive.
    pub(super) fn has_anything_of_ours(&self) -> bool {
        self.account.is_some_and(|account| account.share != Counts::ZERO)
            || self.copies.under_way().next().is_some()
    }

    /// Returns whether the register changed by exactly the difference that an unacknowledged write should
    /// have caused, for the second time in a row. `change` is the present change of the register.
    pub(super) fn is_like_our_own_again(&self, change: Counts) -> bool {
        self.evidence.was_like_our_own && self.unanswered_change == Some(change)
    }

    /// Returns the register value that means an offset of zero: the operator offset of a shared register, or the bias.
    pub(super) fn centre(&self, settings: &Settings) -> Counts {
        self.account.map_or(settings.bias, |account| account.base)
    }

    /// Returns whether the last verified register value contains this offset.
    pub fn is_at(&self, settings: &Settings, offset: Counts) -> bool {
        self.verified.is_some_and(|seen| plan::is_there(self, settings, seen.value, offset))
    }

    /// Returns whether the interlock is open, so that the register must not be written.
    pub fn is_interlocked(&self) -> bool {
        self.is_interlocked
    }

    /// Returns whether an action is pending: its result has not arrived yet.
    pub fn is_asking(&self) -> bool {
        self.pending_action != PendingAction::Nothing
    }

    /// Returns whether writes from before the start can no longer arrive.
    pub fn is_settled(&self) -> bool {
        self.settles_at.is_none()
    }

    /// Returns whether the output will request a write if the next read shows the expected value.
    pub fn may_write(&self, settings: &Settings, now: Moment) -> bool {
        let is_wanted =
            self.order.is_some_and(|order| now <= order.not_after && !self.is_at(settings, order.offset));
        let is_driven = self.standing == ArmState::Armed && !self.is_interlocked;
        is_driven && now >= self.writes_from && (is_wanted || self.write_failure.is_some())
    }

    /// Returns whether a write was acknowledged, and no read has shown its value yet.
    pub(super) fn has_answered(&self) -> bool {
        self.answered.is_some()
    }

    /// Returns the last acknowledged register value, or else the last verified value.
    pub(super) fn acknowledged(&self) -> Option<Counts> {
        self.answered.or(self.verified.map(|verified| verified.value))
    }

    /// Returns the last moment for sending the pending decision, if that moment has passed and the decision was not
    /// sent.
    pub(super) fn overdue(&self, settings: &Settings, now: Moment) -> Option<Moment> {
        let order = self.order.filter(|order| now > order.not_after && !self.is_at(settings, order.offset));
        order.filter(|_| settings.rules.has(Rule::LastMoment)).map(|order| order.not_after)
    }

    /// Returns whether a value waits to be sent until it is saved on disk.
    pub fn is_promising(&self) -> bool {
        self.promised.is_some()
    }

    /// Returns the time until which earlier writes, of this run or the previous run, can delay a change. `None` if no
    /// earlier write can delay a change.
    pub fn waits_until(&self, settings: &Settings) -> Option<Moment> {
        self.copies.all_over(settings.late).into_iter().chain(self.settles_at).max()
    }

    /// Returns a copy in which `to` is applied to every moment, without the data that only reports use. Two states with
    /// equal copies behave equally.
    #[doc(hidden)]
    pub fn moved(&self, to: impl Fn(Moment) -> Moment) -> State {
        State {
            pending_action: match self.pending_action {
                PendingAction::Writing { value, begun, read } => {
                    PendingAction::Writing { value, begun: to(begun), read: read.map(&to) }
                }
                other => other,
            },
            copies: self.copies.moved(&to),
            verified: self.verified.map(|seen| TimedValue { asked: to(seen.asked), ..seen }),
            order: self.order.map(|order| Setpoint { not_after: to(order.not_after), ..order }),
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
