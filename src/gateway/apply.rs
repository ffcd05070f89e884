//! From a decision to a register: read what stands there, write, verify.
//!
//! One [`Writer`] per output, owned by the task of the output's line. What it knows of the register is the anchor of
//! every write: a value is at most one `step` away from it, a write is never repeated without reading first, and
//! what somebody else wrote is left alone.

use crate::codec::{Encoded, Encoding};
use crate::compensation::{AxisState, Decision};
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

/// The registers of one value.
type Words = Encoded;

/// Owns one output.
#[derive(Debug)]
pub(super) struct Writer {
    id: OutputId,
    /// What stands in the register, as last seen there.
    known: Option<Words>,
    /// A write whose end is not known: it may or may not have arrived.
    uncertain: Option<Words>,
    /// The decision that was carried out last; the position that was corrected last.
    applied: Moment,
    written_at: Moment,
    trouble: Option<Trouble>,
    saturated: bool,
    interlocked: bool,
}

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    /// The device did not answer; once it does, what stands there is taken over.
    Link,
    /// It answered, and something else stood there; only a good write ends this.
    Verify,
}

/// What is to be done now, as the shared state says.
struct Order {
    cz: Micron,
    decided: Moment,
    state: AxisState,
    interlocked: bool,
    disarmed: bool,
}

impl Order {
    fn is_off(&self) -> bool {
        self.disarmed || self.state == AxisState::Off
    }
}

impl Writer {
    pub(super) fn new(id: OutputId) -> Writer {
        Writer {
            id,
            known: None,
            uncertain: None,
            applied: Moment::default(),
            written_at: Moment::default(),
            trouble: None,
            saturated: false,
            interlocked: false,
        }
    }

    /// When it wants to be called again even without a new decision.
    pub(super) fn due(&self, profile: &Profile) -> Option<Moment> {
        profile.output(self.id).refresh.map(|refresh| self.written_at.after(refresh))
    }

    /// The position this output corrects, if it does.
    pub(super) fn position(&self, profile: &Profile) -> Option<SignalId> {
        match profile.output(self.id).writes {
            Writes::Corrected { position } => Some(position),
            _ => None,
        }
    }

    /// Carries out the axis's last decision, where there is something to do.
    pub(super) async fn offset(&mut self, line: &mut Line, shared: &Shared, now: Moment) {
        let output = shared.profile.output(self.id);
        if line.is_resting(output.device, now) {
            return self.doubt(shared, Trouble::Link);
        }
        let order = self.order(shared, now);
        let idle = order.is_off() || shared.dry_run;
        if idle && (order.decided != self.applied || self.trouble.is_some()) {
            // Nothing of ours stands there to be compared with: look again, so that arming starts from what is there.
            self.applied = order.decided;
            self.known = None;
        }
        if self.known.is_none() && !self.look(line, shared, now).await {
            return;
        }
        if self.holds_back(shared, output, &order) {
            return;
        }
        let decided = order.decided != self.applied;
        let refresh = self.due(&shared.profile).is_some_and(|due| now >= due);
        if !decided && !refresh && self.trouble.is_none() {
            return;
        }
        let target = self.target(shared, output, &order);
        let same = self.known.as_ref().is_some_and(|known| known.words() == target.words());
        if same && !refresh && self.trouble.is_none() {
            self.applied = order.decided;
            return;
        }
        let doubtful = self.uncertain.is_some() || self.trouble.is_some();
        if (output.verify == Verify::ReadBack || doubtful) && can_be_read(shared, output) {
            match self.read(line, shared, output, now).await {
                Ok(found) => {
                    if !self.recognises(shared, output, found) {
                        return;
                    }
                }
                Err(fault) => return self.fail(shared, output, fault),
            }
        }
        if self.write(line, shared, output, target, now).await {
            self.applied = order.decided;
            self.written_at = now;
            self.settle(shared, output, target, now);
        }
    }

    /// Writes position + Cz as soon as a new position has been read.
    pub(super) async fn corrected(
        &mut self,
        line: &mut Line,
        shared: &Shared,
        position: SignalId,
        now: Moment,
    ) {
        let output = shared.profile.output(self.id);
        let (value, taken) = shared.position(position, now);
        if taken == self.applied || line.is_resting(output.device, now) {
            return;
        }
        self.applied = taken;
        let Some(position) = value else { return };
        let order = self.order(shared, now);
        if self.holds_back(shared, output, &order) {
            return;
        }
        let factor = cz_factor(&shared.profile, output);
        let value = position + order.cz.get() * factor / 1000.0;
        let target = self.encode(shared, output, value);
        if self.write(line, shared, output, target, now).await {
            self.written_at = now;
            self.settle_as(shared, now, order.cz, output.encoding.decode(target.words()).ok());
            shared.core().outputs[self.id.0].writes += 1;
        }
    }

    fn order(&self, shared: &Shared, now: Moment) -> Order {
        let output = shared.profile.output(self.id);
        let core = shared.core();
        let decision = core.compensation.decision(output.axis.0);
        let value = |id: SignalId| core.board.value(&shared.profile, id, now);
        Order {
            cz: decision.map_or(Micron::ZERO, |decision| part(decision, output.writes)),
            decided: decision.map_or(Moment::default(), |decision| decision.at),
            state: decision.map_or(AxisState::Off, |decision| decision.state),
            interlocked: output.when.as_ref().is_some_and(|when| when.holds(&value) != Some(true)),
            disarmed: !core.arming[output.axis.0].armed,
        }
    }

    /// Whether nothing is to be written now: not armed, dry run, interlock open.
    fn holds_back(&mut self, shared: &Shared, output: &Output, order: &Order) -> bool {
        if order.is_off() || shared.dry_run {
            return true;
        }
        if order.interlocked != self.interlocked {
            self.interlocked = order.interlocked;
            let name = output.name.clone();
            if order.interlocked {
                shared.core().outputs[self.id.0].standing = Standing::Interlocked;
                let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
                shared.tell(&Event::Interlocked { output: name, when });
            } else {
                shared.tell(&Event::Released { output: name });
                // Whatever happened meanwhile, the axis goes on from what stands there now.
                self.known = None;
                shared.core().outputs[self.id.0].standing = Standing::Unknown;
                return output.writes.is_scheduled();
            }
        }
        order.interlocked
    }

    /// The registers for this decision, at most one step from what stands there.
    fn target(&mut self, shared: &Shared, output: &Output, order: &Order) -> Words {
        if let (Writes::Reference, Some(apart)) =
            (output.writes, shared.profile.axis(output.axis).settings.apart)
        {
            return self.encode(shared, output, apart.reference);
        }
        let factor = cz_factor(&shared.profile, output);
        let step = shared.profile.axis(output.axis).settings.guard.step;
        let standing = self.known.as_ref().and_then(|known| in_micron(output, factor, known));
        let cz = standing.map_or(order.cz, |standing| standing + (order.cz - standing).clamp_to(step));
        self.encode(shared, output, cz.get() * factor)
    }

    fn encode(&mut self, shared: &Shared, output: &Output, value: f64) -> Words {
        let encoded = output.encoding.encode(value);
        if encoded.saturated && !self.saturated {
            shared.tell(&Event::Saturated { output: output.name.clone(), wanted: value });
        }
        self.saturated = encoded.saturated;
        encoded
    }

    /// Reads what stands in the register and lets the axis go on from there.
    async fn look(&mut self, line: &mut Line, shared: &Shared, now: Moment) -> bool {
        let output = shared.profile.output(self.id);
        if !can_be_read(shared, output) {
            // Nothing to go by but our own word: the first write begins at zero.
            self.known = Some(output.encoding.encode(0.0));
            self.settle_as(shared, now, Micron::ZERO, None);
            return true;
        }
        match self.read(line, shared, output, now).await {
            Ok(found) => {
                let cz = in_micron(output, cz_factor(&shared.profile, output), &found);
                self.known = Some(found);
                self.uncertain = None;
                if self.trouble != Some(Trouble::Verify) {
                    self.trouble = None;
                    let value = output.encoding.decode(found.words()).ok();
                    self.settle_as(shared, now, cz.unwrap_or_default(), value);
                }
                if let Some(cz) = cz
                    && !shared.dry_run
                {
                    shared.core().found(&shared.profile, self.id, cz);
                }
                true
            }
            Err(fault) => {
                self.fail(shared, output, fault);
                false
            }
        }
    }

    async fn read(
        &self,
        line: &mut Line,
        shared: &Shared,
        output: &Output,
        now: Moment,
    ) -> Result<Words, Fault> {
        let count = output.encoding.data_type.registers();
        let request = Request::Read { from: output.address, count };
        match poll::call(line, shared, output.device, request, now).await? {
            Answer::Words(words) => Ok(Encoded::of(&words)),
            Answer::Bits(_) | Answer::Done => Ok(Encoded::of(&[])),
        }
    }

    /// Whether what stands there is ours. If not, it is left alone.
    fn recognises(&mut self, shared: &Shared, output: &Output, found: Words) -> bool {
        let is = |words: &Option<Words>| words.as_ref().is_some_and(|words| words.words() == found.words());
        if is(&self.known) || is(&self.uncertain) {
            self.known = Some(found);
            self.uncertain = None;
            if self.trouble != Some(Trouble::Link) {
                return true;
            }
            // The device is back, and what stands there is ours: the axis goes on from it.
            self.known = None;
            self.trouble = None;
            return false;
        }
        let expected = self.known.as_ref().map_or(String::new(), |known| words_in_text(output, known));
        let name = output.name.clone();
        let zero = output.encoding.encode(0.0);
        if found.words() == zero.words() || found.words().iter().all(|word| *word == 0) {
            shared.tell(&Event::CncRestarted { output: name, expected });
            self.known = None;
            shared.core().outputs[self.id.0].standing = Standing::Unknown;
            return false;
        }
        shared.tell(&Event::ForeignChange { output: name, expected, found: words_in_text(output, &found) });
        self.known = Some(found);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        state.standing = Standing::Foreign;
        state.cz = in_micron(output, cz_factor(&shared.profile, output), &found);
        state.value = output.encoding.decode(found.words()).ok();
        let axis = &shared.profile.axis(output.axis).settings.name;
        core.disarm(
            shared,
            output.axis,
            axis,
            "somebody else wrote to its register; arm it again when that is settled",
        );
        false
    }

    /// Writes and verifies; what went wrong is told, and known afterwards.
    async fn write(
        &mut self,
        line: &mut Line,
        shared: &Shared,
        output: &Output,
        target: Words,
        now: Moment,
    ) -> bool {
        let single = target.words().len() == 1 && shared.profile.device(output.device).functions.write_single;
        let request = if single {
            Request::WriteSingle { at: output.address.offset, word: target.words()[0] }
        } else {
            Request::WriteMultiple { at: output.address.offset, words: target.words() }
        };
        self.uncertain = Some(target);
        if let Err(fault) = poll::call(line, shared, output.device, request, now).await {
            if !fault.spoils_connection() {
                // The device refused: what stood there still stands.
                self.uncertain = None;
            }
            self.fail(shared, output, fault);
            return false;
        }
        if output.verify == Verify::ReadBack {
            match self.read(line, shared, output, now).await {
                Ok(found) if found.words() == target.words() => {}
                Ok(found) => {
                    self.uncertain = None;
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
        let state = &mut shared.core().outputs[self.id.0];
        if state.standing != Standing::Unknown {
            state.standing = Standing::Unverified;
        }
    }

    fn settle(&mut self, shared: &Shared, output: &Output, target: Words, now: Moment) {
        let cz = in_micron(output, cz_factor(&shared.profile, output), &target).unwrap_or_default();
        let recovered = self.trouble.is_some();
        self.settle_as(shared, now, cz, output.encoding.decode(target.words()).ok());
        let mut core = shared.core();
        core.outputs[self.id.0].writes += 1;
        if recovered {
            core.found(&shared.profile, self.id, cz);
        }
    }

    fn settle_as(&mut self, shared: &Shared, now: Moment, cz: Micron, value: Option<f64>) {
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let (failures, had_trouble) = (state.failures, self.trouble == Some(Trouble::Verify));
        state.standing = Standing::Verified;
        state.cz = Some(cz);
        state.value = value;
        state.verified_at = Some(now);
        state.failures = 0;
        drop(core);
        self.trouble = None;
        if had_trouble {
            let output = shared.profile.output(self.id).name.clone();
            shared.tell(&Event::Verified { output, failures });
        }
    }
}

/// What an output makes of a decision: Cz, or what the slope comes to at the axis's reach.
pub(super) fn part(decision: &Decision, writes: Writes) -> Micron {
    if writes == Writes::Slope { decision.slope } else { decision.cz }
}

/// What 1 µm is in the register's unit. A diameter changes by twice what the radius does; a slope is its effect at the
/// axis's reach, divided by that.
fn cz_factor(profile: &Profile, output: &Output) -> f64 {
    let axis = profile.axis(output.axis);
    match (output.writes, axis.settings.apart) {
        (Writes::Slope, Some(apart)) => 1.0 / apart.reach,
        _ if axis.diameter => 2.0,
        _ => 1.0,
    }
}

fn in_micron(output: &Output, factor: f64, words: &Words) -> Option<Micron> {
    let value = output.encoding.decode(words.words()).ok()?;
    Micron::new(value / factor)
}

fn words_in_text(output: &Output, words: &Words) -> String {
    let unit = output.writes.unit();
    match output.encoding.decode(words.words()) {
        Ok(value) => format!("{} {unit}", tidy(value, &output.encoding)),
        Err(_) => format!("{:04x?}", words.words()),
    }
}

/// As many digits as a count has.
fn tidy(value: f64, encoding: &Encoding) -> String {
    let digits = (0..6).find(|digits| encoding.scale.abs() * 10f64.powi(*digits) >= 0.999).unwrap_or(6);
    format!("{value:.*}", usize::try_from(digits).unwrap_or(6))
}

fn can_be_read(shared: &Shared, output: &Output) -> bool {
    shared.profile.device(output.device).functions.read_holding
}
