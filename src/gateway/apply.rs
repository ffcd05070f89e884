//! From a decision to a register, where that is not [`super::execute`]'s: registers that an operator writes to as well,
//! sets, corrected positions, constants. Read what stands there, write, verify.
//!
//! One [`Writer`] per output, owned by the task of the output's line. What it knows of the register is the anchor of
//! every write: a value is at most one `step` away from it, a write is never repeated without reading first, and
//! what somebody else wrote is left alone.
//!
//! While the axis is off the register is only looked at, so that arming starts from what stands there. After trouble
//! and behind an interlock it is read and compared before anything is written again.

use std::time::Duration;

use crate::codec::Encoded;
use crate::fieldbus::line::DeviceLine;
use crate::observe::events::Event;
use crate::profile::{Output, OutputId, Profile, Share, Writes};
use crate::quantity::{Micron, Moment};
use crate::reading::SignalId;

use super::output::Standing;
use super::shared::{Core, Shared};
use super::words::{can_be_read, cz_factor, in_micron, one_step};

mod corrected;
mod exchange;
mod handshake;
mod ledger;
mod order;
mod register;
mod set;

pub(super) use order::Order;
pub(super) use set::SetWriter;

/// The registers of one value.
type Words = Encoded;

/// What failed is tried again after this long at the earliest, where the line does not make it wait longer.
const RETRY: Duration = Duration::from_secs(1);

/// Owns one output.
#[derive(Debug)]
pub(super) struct Writer {
    id: OutputId,
    /// What stands in the register, as last seen there.
    known: Option<Words>,
    /// A write whose end is not known: it may or may not have arrived.
    uncertain: Option<Words>,
    /// Something may have happened to the register: it is compared before anything else is done.
    compare: bool,
    /// The control was restarted since: whatever stands there now is taken over.
    restarted: bool,
    /// Restarts taken note of.
    restarts: u64,
    /// Times in which the computer stood still, taken note of.
    pauses: u64,
    /// The decision that was carried out last; the position that was corrected last.
    applied: Moment,
    /// The share of Cz in the last corrected position, and the decision it followed.
    corrected: Option<(Micron, Moment)>,
    /// A share of Cz that was sent and may or may not have arrived: only the same again is near to both.
    sent: Option<Micron>,
    /// When a display was last given dashes; `None` while it shows a value.
    dashes_at: Option<Moment>,
    written_at: Moment,
    tried_at: Moment,
    trouble: Option<Trouble>,
    saturated: bool,
    interlocked: bool,
    /// Its interlock kept it from being written, or could not be known.
    held: bool,
    /// Nothing is to be written for now: off, dry run, interlock.
    idle: bool,
    /// Its turn came too late for what was decided last.
    pub(super) is_late: bool,
    /// Where the register is shared with an operator: what of it is ours.
    joint: ledger::Joint,
}

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The device did not answer.
    Link,
    /// It answered, and something else stood there; only a good write ends this.
    Verify,
    /// The ledger is not on disk, so nothing may be sent.
    Disk,
}

impl Writer {
    pub(super) fn new(id: OutputId) -> Writer {
        Writer {
            id,
            known: None,
            uncertain: None,
            compare: false,
            restarted: false,
            restarts: 0,
            pauses: 0,
            applied: Moment::default(),
            corrected: None,
            sent: None,
            dashes_at: None,
            written_at: Moment::default(),
            tried_at: Moment::default(),
            trouble: None,
            saturated: false,
            interlocked: false,
            held: false,
            idle: true,
            is_late: false,
            joint: ledger::Joint::default(),
        }
    }

    /// When it wants to be called again even without a new decision.
    pub(super) fn due(&self, profile: &Profile) -> Option<Moment> {
        let output = profile.output(self.id);
        let retries = output.writes.is_scheduled() && (self.trouble.is_some() || self.compare);
        match output.refresh {
            _ if self.joint.waits() => Some(self.tried_at),
            _ if retries => Some(self.tried_at.after(RETRY)),
            Some(refresh) if !self.idle => Some(self.written_at.after(refresh)),
            _ => None,
        }
    }

    /// The position this output corrects, if it does.
    pub(super) fn position(&self, profile: &Profile) -> Option<SignalId> {
        profile.output(self.id).writes.position()
    }

    /// Carries out the axis's last decision in a register that is shared with an operator, or writes the reference
    /// position, a constant.
    pub(super) async fn scheduled(&mut self, line: &mut DeviceLine, shared: &Shared, now: Moment) {
        let output = shared.profile.output(self.id);
        match output.share {
            Share::Ledger => self.joint_offset(line, shared, output, now).await,
            Share::Whole => self.constant(line, shared, output, now).await,
        }
    }

    async fn constant(&mut self, line: &mut DeviceLine, shared: &Shared, output: &Output, now: Moment) {
        let order = self.order(shared, &shared.core(), now);
        self.note_restarts(&order);
        self.idle = order.off || shared.dry_run;
        if self.idle {
            return self.watch(line, shared, output, &order, now).await;
        }
        if self.holds_back(shared, output, &order) {
            return;
        }
        let target = self.target(shared, output, &order);
        let refresh = output.refresh.is_some_and(|refresh| now >= self.written_at.after(refresh));
        let unsettled = self.compare || self.trouble.is_some() || self.known != Some(target);
        if !refresh && !unsettled {
            return;
        }
        if line.is_resting(output.device, now) {
            self.tried_at = now;
            return self.doubt(shared, Trouble::Link);
        }
        if self.trouble.is_some() && now < self.tried_at.after(RETRY) {
            return;
        }
        self.tried_at = now;
        let first_reads = output.verify.reads() || unsettled || self.uncertain.is_some();
        if first_reads && !self.is_ours(line, shared, output, now).await {
            return;
        }
        if self.write(line, shared, output, target, (now, Moment::END)).await {
            self.written_at = now;
            self.settle(shared, output, target, now, true);
        }
    }

    /// An axis that holds decides no other value than the one which never left: it goes on from what stands there.
    fn holds_what_stands(&self, shared: &Shared) {
        let output = shared.profile.output(self.id);
        let cz = self.known.and_then(|known| in_micron(output, cz_factor(&shared.profile, output), &known));
        if let Some(cz) = cz {
            shared.core().found(&shared.profile, self.id, cz);
        }
    }

    fn order(&self, shared: &Shared, core: &Core, now: Moment) -> Order {
        Order::of(shared, core, self.id, now)
    }

    /// After a restart, and after the computer has stood still, the register is read and compared before anything else.
    fn note_restarts(&mut self, order: &Order) {
        self.compare |= std::mem::replace(&mut self.pauses, order.pauses) != order.pauses;
        if std::mem::replace(&mut self.restarts, order.restarts) != order.restarts {
            (self.compare, self.restarted) = (true, true);
        }
    }

    /// While the axis is off: looks at the register again with each decision.
    async fn watch(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        order: &Order,
        now: Moment,
    ) {
        self.rest();
        let fresh = order.decided == self.applied && self.known.is_some() && self.trouble.is_none();
        if fresh || line.is_resting(output.device, now) {
            return;
        }
        if self.trouble.is_some() && now < self.tried_at.after(RETRY) {
            return;
        }
        (self.tried_at, self.applied) = (now, order.decided);
        if !can_be_read(shared, output) {
            // Nothing to go by but our own word: what was written last, and zero before that.
            let known = self.known.unwrap_or_else(|| Words::of(output.encoding.encode(0.0).words()));
            return self.settle(shared, output, known, now, false);
        }
        match self.read(line, output).await {
            Ok(found) => {
                // Nothing of ours is to be verified any more.
                self.trouble = None;
                self.settle(shared, output, found, now, false);
            }
            Err(fault) => self.fail(shared, output, fault),
        }
    }

    /// Nothing is to be compared or held back while the axis is off: what is read is what it starts from.
    fn rest(&mut self) {
        (self.compare, self.restarted, self.interlocked, self.held) = (false, false, false, false);
    }

    /// Whether the interlock keeps it from being written now. Where its condition cannot be known that is a fault, which
    /// the lost signal has told.
    fn holds_back(&mut self, shared: &Shared, output: &Output, order: &Order) -> bool {
        match order.allowed {
            Some(true) => {
                if std::mem::take(&mut self.interlocked) {
                    shared.tell(&Event::Released { output: output.name.clone() });
                }
                // Whatever happened meanwhile, the axis goes on from what stands there now.
                self.compare |= std::mem::take(&mut self.held) && output.writes.is_scheduled();
                self.idle = false;
                return false;
            }
            Some(false) => {
                shared.core().outputs[self.id.0].standing = Standing::Interlocked;
                if !std::mem::replace(&mut self.interlocked, true) {
                    let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
                    shared.tell(&Event::Interlocked { output: output.name.clone(), when });
                }
            }
            None => shared.core().outputs[self.id.0].doubt(),
        }
        (self.held, self.idle) = (true, true);
        true
    }

    /// The registers for this decision, at most one step from what stands there. A reference position is no correction:
    /// it is written at once, and no slope acts before it stands there.
    fn target(&mut self, shared: &Shared, output: &Output, order: &Order) -> Words {
        let apart = shared.profile.axis(output.axis).settings.apart;
        if let (Writes::Reference, Some(apart)) = (output.writes, apart) {
            return self.encode(shared, output, apart.reference);
        }
        let wanted = order.cz.get() * cz_factor(&shared.profile, output);
        let standing = self.known.and_then(|known| output.encoding.decode(known.words()).ok());
        let most = one_step(&shared.profile, output);
        let value = standing.map_or(wanted, |standing| standing + (wanted - standing).clamp(-most, most));
        self.encode(shared, output, value)
    }

    fn encode(&mut self, shared: &Shared, output: &Output, value: f64) -> Words {
        let encoded = output.encoding.encode(value);
        if encoded.saturated && !self.saturated {
            shared.tell(&Event::Saturated { output: output.name.clone(), wanted: value });
        }
        self.saturated = encoded.saturated;
        Words::of(encoded.words())
    }
}
