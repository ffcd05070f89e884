//! From a decision to a register: read what stands there, write, verify.
//!
//! One [`Writer`] per output, owned by the task of the output's line. What it knows of the register is the anchor of
//! every write: a value is at most one `step` away from it, a write is never repeated without reading first, and
//! what somebody else wrote is left alone.
//!
//! While the axis is off the register is only looked at, so that arming starts from what stands there. After trouble
//! and behind an interlock it is read and compared before anything is written again.

use std::time::Duration;

use crate::codec::Encoded;
use crate::compensation::AxisState;
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::Line;
use crate::fieldbus::wire::{Answer, Request};
use crate::observe::events::Event;
use crate::profile::{Output, OutputId, Profile, Verify, Writes};
use crate::quantity::{Micron, Moment};
use crate::reading::SignalId;

use super::output::Standing;
use super::poll;
use super::shared::Shared;
use super::words::{can_be_read, cz_factor, in_micron, one_step, words_in_text};

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
    /// The decision that was carried out last; the position that was corrected last.
    applied: Moment,
    /// The share of Cz in the last corrected position, and the decision it followed.
    corrected: Option<(Micron, Moment)>,
    /// A share of Cz that was sent and may or may not have arrived: only the same again is near to both.
    sent: Option<Micron>,
    written_at: Moment,
    tried_at: Moment,
    trouble: Option<Trouble>,
    saturated: bool,
    interlocked: bool,
    /// Nothing is to be written for now: off, dry run, interlock.
    idle: bool,
}

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The device did not answer.
    Link,
    /// It answered, and something else stood there; only a good write ends this.
    Verify,
}

/// What is to be done now, as the shared state says.
struct Order {
    cz: Micron,
    decided: Moment,
    off: bool,
    /// The position to be corrected, where it may be used.
    position: Option<f64>,
    /// Whether the interlock allows writing; `None` where that cannot be known.
    allowed: Option<bool>,
    /// What stands in the register has not been taken over yet: the decision is older than that.
    outdated: bool,
}

impl Writer {
    pub(super) fn new(id: OutputId) -> Writer {
        Writer {
            id,
            known: None,
            uncertain: None,
            compare: false,
            applied: Moment::default(),
            corrected: None,
            sent: None,
            written_at: Moment::default(),
            tried_at: Moment::default(),
            trouble: None,
            saturated: false,
            interlocked: false,
            idle: true,
        }
    }

    /// When it wants to be called again even without a new decision.
    pub(super) fn due(&self, profile: &Profile) -> Option<Moment> {
        let output = profile.output(self.id);
        let retries = output.writes == Writes::Offset && (self.trouble.is_some() || self.compare);
        match output.refresh {
            _ if retries => Some(self.tried_at.after(RETRY)),
            Some(refresh) if !self.idle => Some(self.written_at.after(refresh)),
            _ => None,
        }
    }

    /// The position this output corrects, if it does.
    pub(super) fn position(&self, profile: &Profile) -> Option<SignalId> {
        match profile.output(self.id).writes {
            Writes::Corrected { position } => Some(position),
            Writes::Offset => None,
        }
    }

    /// Carries out the axis's last decision, where there is something to do.
    pub(super) async fn offset(&mut self, line: &mut Line, shared: &Shared) {
        let (output, now) = (shared.profile.output(self.id), shared.clock.now());
        let order = self.order(shared, now);
        self.idle = order.off || shared.dry_run;
        if self.idle {
            return self.watch(line, shared, output, &order, now).await;
        }
        if order.outdated || self.holds_back(shared, output, &order) {
            return;
        }
        let refresh = output.refresh.is_some_and(|refresh| now >= self.written_at.after(refresh));
        let unsettled = self.compare || self.trouble.is_some() || self.known.is_none();
        if order.decided == self.applied && !refresh && !unsettled {
            return;
        }
        if line.is_resting(output.device, now) {
            self.tried_at = now;
            return self.doubt(shared, Trouble::Link);
        }
        if self.trouble.is_some() && now < self.tried_at.after(RETRY) {
            return;
        }
        let target = self.target(shared, output, &order);
        if !refresh && !unsettled && self.known == Some(target) {
            self.applied = order.decided;
            return;
        }
        self.tried_at = now;
        let first_reads = output.verify == Verify::ReadBack || unsettled || self.uncertain.is_some();
        if first_reads && !self.is_ours(line, shared, output).await {
            return;
        }
        let target = match self.uncertain.take() {
            // It cannot be read: the same absolute value once more is the only one that is near to what may stand there.
            Some(sent) if !can_be_read(shared, output) => sent,
            _ => self.target(shared, output, &order),
        };
        if self.write(line, shared, output, target).await {
            self.applied = order.decided;
            self.written_at = now;
            self.settle(shared, output, target, true);
        }
    }

    /// Writes position + Cz as soon as a new position has been read.
    pub(super) async fn corrected(&mut self, line: &mut Line, shared: &Shared, position: SignalId) {
        let taken = shared.core().board.taken(position);
        if taken == self.applied {
            return;
        }
        let (output, now) = (shared.profile.output(self.id), shared.clock.now());
        let order = self.order(shared, now);
        if order.off || shared.dry_run {
            (self.corrected, self.sent) = (None, None);
            self.applied = taken;
            return;
        }
        if line.is_resting(output.device, now) {
            return;
        }
        self.applied = taken;
        let Some(position) = order.position else { return };
        if self.holds_back(shared, output, &order) {
            return;
        }
        let cz = self.share(shared, output, &order);
        let factor = cz_factor(&shared.profile, output);
        let target = self.encode(shared, output, position + cz.get() * factor / 1000.0);
        let is_written = self.write(line, shared, output, target).await;
        self.sent = self.uncertain.map(|_| cz);
        if is_written {
            self.corrected = Some((cz, order.decided));
            self.settle_as(shared, cz, output.encoding.decode(target.words()).ok(), true);
        }
    }

    /// Cz as it goes into a position: one step nearer to the axis's at each of its decisions. The axis's own may jump,
    /// where it takes over what a restarted CNC holds.
    fn share(&self, shared: &Shared, output: &Output, order: &Order) -> Micron {
        if let Some(sent) = self.sent {
            return sent;
        }
        let Some((last, decided)) = self.corrected else { return order.cz };
        let step = shared.profile.axis(output.axis).settings.guard.step;
        if decided == order.decided { last } else { last + (order.cz - last).clamp_to(step) }
    }

    fn order(&self, shared: &Shared, now: Moment) -> Order {
        let output = shared.profile.output(self.id);
        let core = shared.core();
        let decision = core.compensation.decision(output.axis.0);
        let arming = &core.arming[output.axis.0];
        let value = |id: SignalId| core.board.value(&shared.profile, id, now);
        Order {
            cz: decision.map_or(Micron::ZERO, |decision| decision.cz),
            decided: decision.map_or(Moment::default(), |decision| decision.at),
            position: self.position(&shared.profile).and_then(value),
            off: !arming.armed || decision.is_none_or(|decision| decision.state == AxisState::Off),
            allowed: output.when.as_ref().map_or(Some(true), |when| when.holds(&value)),
            outdated: arming.take_over.is_some(),
        }
    }

    /// While the axis is off: looks at the register again with each decision.
    async fn watch(&mut self, line: &mut Line, shared: &Shared, output: &Output, order: &Order, now: Moment) {
        (self.compare, self.interlocked) = (false, false);
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
            return self.settle(shared, output, known, false);
        }
        match self.read(line, shared, output).await {
            Ok(found) => {
                // Nothing of ours is to be verified any more.
                self.trouble = None;
                self.settle(shared, output, found, false);
            }
            Err(fault) => self.fail(shared, output, fault),
        }
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
                self.compare |= std::mem::take(&mut self.idle) && output.writes == Writes::Offset;
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
        self.idle = true;
        true
    }

    /// The registers for this decision, at most one step from what stands there.
    fn target(&mut self, shared: &Shared, output: &Output, order: &Order) -> Words {
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

    async fn read(&self, line: &mut Line, shared: &Shared, output: &Output) -> Result<Words, Fault> {
        let count = output.encoding.data_type.registers();
        let request = Request::Read { from: output.address, count };
        match poll::call(line, shared, output.device, request).await? {
            Answer::Words(words) => Ok(Encoded::of(&words)),
            Answer::Bits(_) | Answer::Done => Ok(Encoded::of(&[])),
        }
    }

    /// Reads the register. Whether what stands there is ours and the decision is still to be carried out.
    async fn is_ours(&mut self, line: &mut Line, shared: &Shared, output: &Output) -> bool {
        if !can_be_read(shared, output) {
            self.compare = false;
            return true;
        }
        let found = match self.read(line, shared, output).await {
            Ok(found) => found,
            Err(fault) => {
                self.fail(shared, output, fault);
                return false;
            }
        };
        let (known, sent) = (self.known, self.uncertain.take());
        let compared = std::mem::take(&mut self.compare);
        let arrived = sent == Some(found);
        if known.is_some_and(|known| known != found) && !arrived {
            self.not_ours(shared, output, found);
            return false;
        }
        self.known = Some(found);
        let is_settled = match self.trouble {
            _ if arrived || known.is_none() => true,
            Some(Trouble::Verify) => false,
            // What was sent did not arrive: only a write that does shows that the device can be written again.
            Some(Trouble::Link) => sent.is_none(),
            None => compared,
        };
        if is_settled {
            self.take_over(shared, output, found);
        }
        !is_settled
    }

    /// Something else stands there than what was written last.
    fn not_ours(&mut self, shared: &Shared, output: &Output, found: Words) {
        let expected = self.known.map_or(String::new(), |known| words_in_text(output, &known));
        let name = output.name.clone();
        let zero = output.encoding.encode(0.0);
        if found == zero || found.words().iter().all(|word| *word == 0) {
            shared.tell(&Event::CncRestarted { output: name, expected });
            return self.take_over(shared, output, found);
        }
        shared.tell(&Event::ForeignChange { output: name, expected, found: words_in_text(output, &found) });
        self.leave_alone(
            shared,
            output,
            found,
            "somebody else wrote to its register; arm it again when that is settled",
        );
    }

    /// What stands in the register is known again: the axis goes on from there.
    fn take_over(&mut self, shared: &Shared, output: &Output, found: Words) {
        let cz = in_micron(output, cz_factor(&shared.profile, output), &found);
        let limit = shared.profile.axis(output.axis).settings.guard.limit;
        let Some(cz) = cz.filter(|cz| cz.abs() <= limit) else {
            return self.leave_alone(shared, output, found, "its register holds a value beyond its limit");
        };
        self.settle(shared, output, found, false);
        shared.core().found(&shared.profile, self.id, cz);
        shared.ring_others(shared.profile.device(output.device).bus);
    }

    /// The axis is off until a person arms it; what stands in the register stays.
    fn leave_alone(&mut self, shared: &Shared, output: &Output, found: Words, why: &str) {
        (self.known, self.uncertain, self.trouble) = (Some(found), None, None);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        state.standing = Standing::Foreign;
        state.cz = in_micron(output, cz_factor(&shared.profile, output), &found);
        state.value = output.encoding.decode(found.words()).ok();
        let axis = &shared.profile.axis(output.axis).settings.name;
        let told = core.disarm(output.axis, axis, why);
        drop(core);
        told.iter().for_each(|event| shared.tell(event));
    }

    /// Writes and verifies; what went wrong is told, and known afterwards.
    async fn write(&mut self, line: &mut Line, shared: &Shared, output: &Output, target: Words) -> bool {
        let single = target.words().len() == 1 && shared.profile.device(output.device).functions.write_single;
        let request = if single {
            Request::WriteSingle { at: output.address.offset, word: target.words()[0] }
        } else {
            Request::WriteMultiple { at: output.address.offset, words: target.words() }
        };
        self.uncertain = Some(target);
        if let Err(fault) = poll::call(line, shared, output.device, request).await {
            if !fault.spoils_connection() {
                // The device refused: what stood there still stands.
                self.uncertain = None;
            }
            self.fail(shared, output, fault);
            return false;
        }
        if output.verify == Verify::ReadBack {
            match self.read(line, shared, output).await {
                Ok(found) if found.words() == target.words() => {}
                Ok(found) => {
                    self.uncertain = None;
                    let factor = cz_factor(&shared.profile, output);
                    let limit = shared.profile.axis(output.axis).settings.guard.limit;
                    if in_micron(output, factor, &found).is_none_or(|cz| cz.abs() > limit) {
                        self.not_ours(shared, output, found);
                        return false;
                    }
                    self.known = Some(found);
                    if self.trouble != Some(Trouble::Verify) {
                        let wrote = words_in_text(output, &target);
                        let found = words_in_text(output, &found);
                        shared.tell(&Event::VerifyFailed { output: output.name.clone(), wrote, found });
                    }
                    self.doubt(shared, Trouble::Verify);
                    shared.core().outputs[self.id.0].failures += 1;
                    return false;
                }
                Err(fault) => {
                    self.fail(shared, output, fault);
                    return false;
                }
            }
        }
        self.uncertain = None;
        self.known = Some(target);
        true
    }

    fn fail(&mut self, shared: &Shared, output: &Output, fault: Fault) {
        // A device that is lost has been told; one that refuses has not.
        if !fault.spoils_connection() && self.trouble.is_none() {
            shared.tell(&Event::WriteFailed { output: output.name.clone(), fault: fault.to_string() });
        }
        self.doubt(shared, if fault.spoils_connection() { Trouble::Link } else { Trouble::Verify });
        shared.core().outputs[self.id.0].failures += 1;
    }

    /// What stands in the register is not certain any more.
    fn doubt(&mut self, shared: &Shared, trouble: Trouble) {
        if self.trouble != Some(Trouble::Verify) {
            self.trouble = Some(trouble);
        }
        shared.core().outputs[self.id.0].doubt();
    }

    /// An offset register is known to hold this, because it was read or because it was written. After trouble the axis goes on from there.
    fn settle(&mut self, shared: &Shared, output: &Output, words: Words, is_written: bool) {
        let cz = in_micron(output, cz_factor(&shared.profile, output), &words);
        let recovered = self.trouble.is_some();
        (self.known, self.uncertain) = (Some(words), None);
        let value = output.encoding.decode(words.words()).ok();
        self.settle_as(shared, cz.unwrap_or_default(), value, is_written);
        if recovered {
            shared.core().found(&shared.profile, self.id, cz.unwrap_or_default());
        }
    }

    fn settle_as(&mut self, shared: &Shared, cz: Micron, value: Option<f64>, is_written: bool) {
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let failures = std::mem::take(&mut state.failures);
        state.standing = Standing::Verified;
        state.writes += u64::from(is_written);
        state.cz = Some(cz);
        state.value = value;
        state.verified_at = Some(shared.clock.now());
        drop(core);
        if self.trouble.take() == Some(Trouble::Verify) {
            let output = shared.profile.output(self.id).name.clone();
            shared.tell(&Event::Verified { output, failures });
        }
    }
}
