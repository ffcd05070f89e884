//! A register that an operator writes to as well: our share of it, by the [ledger](crate::gateway::ledger).
//!
//! One change is: promised on disk, the register read, the sum written, the sum read back, settled on disk. A line waits
//! for the disk as long as it would for a device's answer, and once; then it goes on with its other work and looks again
//! in its next cycles. What is not promised is not sent.

use std::time::Duration;

use super::{Order, RETRY, Trouble, Writer};
use crate::fieldbus::line::DeviceLine;
use crate::gateway::ledger::{Account, Doubt, Finding};
use crate::gateway::saver::Kept;
use crate::gateway::shared::Shared;
use crate::gateway::words::{counts_in_text, cz_factor, one_step};
use crate::observe::events::Event;
use crate::profile::Output;
use crate::quantity::Moment;

mod exchange;
mod meaning;

/// A disk that has not answered for this long is a fault.
const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// An operator who writes while we are about to is let go first, this many times a cycle.
const TRIES: usize = 2;

/// What a writer knows of a register that is not its own.
#[derive(Debug, Default)]
pub(super) struct Joint {
    /// `None` until the register was read.
    account: Option<Account>,
    /// The account has been on disk since it was opened or confirmed.
    is_kept: bool,
    /// It has not been told that it was opened or confirmed.
    is_new: bool,
    promise: Option<Promise>,
    promised_at: Moment,
    /// The last write was acknowledged, and then something else stood there.
    odd: bool,
    doubt_told: bool,
}

/// A share that may be sent as soon as the account that names it is on disk.
#[derive(Clone, Copy, Debug)]
struct Promise {
    share: i64,
    version: u64,
    since: Moment,
}

impl Joint {
    /// The disk is waited for.
    pub(super) fn waits(&self) -> bool {
        self.promise.is_some()
    }

    fn doubt(&self) -> Option<Doubt> {
        self.account.as_ref().and_then(Account::doubt)
    }
}

impl Writer {
    /// Carries out the axis's last decision, where there is something to do.
    pub(super) async fn joint_offset(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        now: Moment,
    ) {
        let order = self.order(shared, &shared.core(), now);
        self.note_restarts(&order);
        self.idle = order.off || shared.dry_run;
        if self.idle {
            (self.compare, self.interlocked) = (false, false);
        } else if order.outdated || self.holds_back(shared, output, &order) {
            return self.withdraw(shared, output);
        }
        let refresh =
            !self.idle && output.refresh.is_some_and(|refresh| now >= self.written_at.after(refresh));
        let in_question = self.joint.doubt().is_some();
        let opening = !self.joint.is_kept && (!shared.dry_run || self.joint.account.is_none());
        let unsettled = self.compare
            || self.trouble.is_some()
            || self.joint.waits()
            || if in_question { !self.idle } else { opening };
        if order.decided == self.applied && !refresh && !unsettled {
            return;
        }
        if line.is_resting(output.device, now) {
            self.tried_at = now;
            return if self.idle { self.withdraw(shared, output) } else { self.doubt(shared, Trouble::Link) };
        }
        if self.trouble.is_some() && now < self.tried_at.after(RETRY) {
            return;
        }
        self.tried_at = now;
        let looks = self.idle || unsettled || refresh;
        if looks && !self.joint.waits() && !self.look(line, shared, output, &order, now).await {
            return;
        }
        if refresh {
            // An operator's register is looked at; to write the same again could only undo what he does meanwhile.
            self.written_at = now;
        }
        let is_changed = self.next_share(shared, output, &order) != self.standing_share();
        if self.trouble.is_none() && now > order.not_after && is_changed {
            // Its turn has come too late; the next decision is carried out.
            (self.applied, self.is_late) = (order.decided, order.follows);
            self.withdraw(shared, output);
            if order.follows {
                shared.order_lapsed(self.id, order.not_after);
            }
            return;
        }
        self.is_late = false;
        for _ in 0..TRIES {
            let Some(share) = self.promised(line, shared, output, &order, now).await else { return };
            let Some(found) = self.find(line, shared, output).await else { return };
            match self.note(shared, output, found, now) {
                Finding::Same => return self.write_share(line, shared, output, &order, share).await,
                Finding::Moved { .. } => {}
                Finding::Arrived | Finding::Restarted | Finding::InQuestion => return,
            }
        }
        self.compare = true;
    }

    /// Reads the register and takes note of what it means. Whether the decision is still to be carried out.
    async fn look(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        order: &Order,
        now: Moment,
    ) -> bool {
        if self.idle {
            self.applied = order.decided;
        }
        let Some(found) = self.find(line, shared, output).await else { return false };
        self.compare = false;
        if !self.idle && self.joint.doubt().is_some() {
            // Only a person arms an axis whose account is in question.
            self.open(|account| account.confirm(found.counts));
        }
        if self.joint.account.is_none() {
            let new = shared.ledger.new_account(&shared.profile, output, found.counts);
            let known = shared.ledger.account(output);
            let is_new = known.is_none();
            self.joint.account = Some(known.unwrap_or(new));
            if is_new {
                self.open(|_| ());
            }
        }
        match self.note(shared, output, found, now) {
            Finding::Arrived | Finding::Restarted if self.joint.is_kept => return false,
            Finding::InQuestion => return false,
            _ => {}
        }
        if !self.joint.is_kept && !shared.dry_run {
            // A first account is on disk before anything depends on it.
            let nothing = self.promised(line, shared, output, order, now).await;
            debug_assert_eq!(nothing, None, "an account is opened with the share that it has");
            return false;
        }
        let promised = self.joint.account.as_ref().is_some_and(|account| !account.promised().is_empty());
        let is_settled = match self.trouble {
            _ if self.idle => true,
            None => true,
            // What was sent did not arrive: only a write that does shows that the device can be written again.
            Some(Trouble::Link) => !promised,
            Some(Trouble::Verify | Trouble::Disk) => false,
        };
        let goes_on = !self.idle && self.trouble.is_none();
        if self.idle {
            // Nothing of ours is to be verified any more.
            self.trouble = None;
        }
        if is_settled {
            self.settle_share(shared, output, now, false);
        }
        goes_on || !is_settled
    }

    /// The share that is to be sent now, once the account on disk names it; `None` where there is nothing to do, or not
    /// yet.
    async fn promised(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        order: &Order,
        now: Moment,
    ) -> Option<i64> {
        let share = self.next_share(shared, output, order)?;
        if self.joint.promise.is_some_and(|promise| promise.share != share) {
            self.withdraw(shared, output);
        }
        let account = self.joint.account.as_ref()?;
        let stands = account.share() == share;
        if stands && self.joint.is_kept && self.trouble.is_none() && !self.joint.waits() {
            self.applied = order.decided;
            return None;
        }
        let promise = self.joint.promise.unwrap_or_else(|| Promise {
            share,
            version: shared.ledger.keep(output, account.promising(share)),
            since: now,
        });
        let is_new = self.joint.promise.replace(promise).is_none();
        let timeout = shared.profile.bus(shared.profile.device(output.device).bus).timeout;
        let span = if is_new { timeout } else { Duration::ZERO };
        line.away_for(span);
        let kept = shared.ledger.kept(promise.version, span).await;
        line.look();
        match kept {
            Kept::NotYet => {
                if now.since(promise.since) >= DISK_PATIENCE && self.trouble != Some(Trouble::Disk) {
                    let why = format!("the disk has not answered for {} s", DISK_PATIENCE.as_secs());
                    shared.tell(&Event::NotKept { what: "the ledger".to_owned(), why });
                    self.doubt(shared, Trouble::Disk);
                }
                return None;
            }
            Kept::No => {
                self.joint.promise = None;
                self.doubt(shared, Trouble::Disk);
                return None;
            }
            Kept::Yes => self.joint.promise = None,
        }
        let was_kept = std::mem::replace(&mut self.joint.is_kept, true);
        self.tell_opened(shared, output);
        if stands && (!was_kept || matches!(self.trouble, None | Some(Trouble::Disk))) {
            self.applied = order.decided;
            self.settle_share(shared, output, now, false);
            return None;
        }
        Some(share)
    }

    fn standing_share(&self) -> Option<i64> {
        self.joint.account.as_ref().map(Account::share)
    }

    /// What is promised and not sent need not be sent any more.
    fn withdraw(&mut self, shared: &Shared, output: &Output) {
        if self.joint.promise.take().is_some() {
            self.keep(shared, output);
        }
    }

    /// Has the account put on disk; nobody waits for it.
    fn keep(&mut self, shared: &Shared, output: &Output) {
        self.joint.promise = None;
        if let Some(account) = &self.joint.account
            && !shared.dry_run
        {
            shared.ledger.keep(output, account.clone());
        }
    }

    /// An account begins, or a person says that it is right.
    fn open(&mut self, change: impl FnOnce(&mut Account)) {
        self.joint.account.as_mut().map(change);
        (self.joint.is_kept, self.joint.is_new, self.joint.doubt_told) = (false, true, false);
    }

    /// Tells what begins, once it is on disk: before that a restart could still ask again.
    fn tell_opened(&mut self, shared: &Shared, output: &Output) {
        let Some(account) = self.joint.account.as_ref().filter(|_| self.joint.is_new) else { return };
        shared.tell(&Event::LedgerOpened {
            output: output.name.clone(),
            base: counts_in_text(output, account.base()),
            share: counts_in_text(output, account.share()),
        });
        self.joint.is_new = false;
    }

    /// Our share after this decision: at most one step from the one that stands, and as much as the register can hold
    /// beside the operator's part.
    fn next_share(&mut self, shared: &Shared, output: &Output, order: &Order) -> Option<i64> {
        let account = self.joint.account.as_ref()?;
        let (stands, base) = (account.share(), account.base());
        // What was decided before the device was lost is not made up for: that it can be written again is shown by what
        // stands there, once more.
        let is_over = self.trouble == Some(Trouble::Link) && !order.follows;
        if self.idle || !self.joint.is_kept || is_over {
            return Some(stands);
        }
        let encoding = &output.encoding;
        let wanted = encoding.nearest_counts(order.cz.get() * cz_factor(&shared.profile, output));
        let most = encoding.nearest_counts(one_step(&shared.profile, output)).abs();
        let share = stands + (wanted - stands).clamp(-most, most);
        let (low, high) = encoding.range_of_counts()?;
        let fits = share.clamp(low - base, (high - base).max(low - base));
        if fits != share && !self.saturated {
            let wanted = encoding.value_of(base + share);
            shared.tell(&Event::Saturated { output: output.name.clone(), wanted });
        }
        self.saturated = fits != share;
        Some(fits)
    }
}
