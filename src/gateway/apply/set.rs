//! Outputs that land together: read as one, written as one, believed as one.
//!
//! A [`SetWriter`] owns the outputs of a set and drives a [`Writer`] for each. Each keeps what it knows of its register;
//! the set decides when all of them are read and written. A member whose axis is off, or whose interlock is open, is
//! written with what was just read there, so that nothing of it changes; only where somebody else writes to it in that
//! very moment, that is lost.
//!
//! What was sent but not taken as a whole (a request was lost between the values and the sequence; no acknowledge came)
//! stands in the registers and perhaps not in the control. Only the same values again are within a step of both: they
//! are read back, compared, and sent again. After a gateway died at that very point the next one knows the registers
//! alone; the control may then see two steps at once.

use crate::compensation::AxisState;
use crate::fieldbus::line::DeviceLine;
use crate::gateway::output::Wait;
use crate::gateway::shared::Shared;
use crate::profile::{Control, Output, Profile, SetId};
use crate::quantity::Moment;

use super::exchange::{self, Cells, Sent};
use super::handshake::{Stands, Strobe, Waited};
use super::{Order, RETRY, Trouble, Words, Writer};

mod transfer;

/// Owns the outputs of one set, and its strobe.
#[derive(Debug)]
pub(in crate::gateway) struct SetWriter {
    pub(super) id: SetId,
    members: Vec<Writer>,
    /// The number of the last set, as it stands in the register.
    sequence: u16,
    /// The count of its writes, as it stands in the register.
    beat: u16,
    /// The control word that was sent last.
    told_control: Option<u16>,
    /// Sent, and not known to have been taken as a whole.
    unfinished: Option<Sent>,
    pub(super) strobe: Strobe,
    written_at: Moment,
    tried_at: Moment,
}

/// What a member does in this round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Its axis is off: its register is only looked at.
    Off,
    /// Interlocked, or its axis takes something over first: it keeps what stands there.
    Kept,
    /// It writes what was decided.
    Free,
}

impl SetWriter {
    pub(in crate::gateway) fn new(shared: &Shared, id: SetId) -> SetWriter {
        let outputs = &shared.profile.set(id).outputs;
        // The task before this one ended in the middle of an exchange.
        let was_up = outputs.iter().any(|id| shared.core().outputs[id.0].handshake.strobe_up);
        let stands = if was_up { Stands::Up } else { Stands::Unknown };
        SetWriter {
            id,
            members: outputs.iter().copied().map(Writer::new).collect(),
            sequence: 0,
            beat: 0,
            told_control: None,
            unfinished: None,
            strobe: Strobe { stands, ..Strobe::default() },
            written_at: Moment::default(),
            tried_at: Moment::default(),
        }
    }

    /// When it wants to be called again even without a new decision.
    pub(in crate::gateway) fn due(&self, profile: &Profile) -> Option<Moment> {
        let troubled = self.members.iter().any(|member| member.trouble.is_some() || member.compare);
        if troubled || self.strobe.stands == Stands::Up {
            return Some(self.tried_at.after(RETRY));
        }
        let busy = self.members.iter().filter(|member| !member.idle);
        let refreshes = busy.filter_map(|member| profile.output(member.id).refresh);
        refreshes.min().map(|refresh| self.written_at.after(refresh))
    }

    /// When the acknowledge is to be asked for again.
    pub(in crate::gateway) fn asks(&self) -> Option<Moment> {
        self.strobe.waits.map(|(.., ask)| ask)
    }

    /// Goes on with an exchange, or begins one where there is something to do. Never waits for the control.
    pub(in crate::gateway) async fn advance(&mut self, line: &mut DeviceLine, shared: &Shared, now: Moment) {
        if shared.core().leaving {
            return self.leave(line, shared).await;
        }
        while let Some((wait, ..)) = self.strobe.waits {
            match (self.wait(line, shared).await, wait) {
                (Waited::Still | Waited::Failed, _) => return,
                (Waited::Over, Wait::Clear) => {}
                (Waited::Over, Wait::Acknowledge) => {
                    if !self.lower(line, shared).await {
                        return self.doubt_sent(shared);
                    }
                    let timeout = shared.profile.set(self.id).handshake.map(|handshake| handshake.timeout);
                    self.wait_for(shared, Wait::Release, timeout.unwrap_or_default());
                }
                (Waited::Over, Wait::Release) => {
                    if let Some(sent) = &mut self.unfinished {
                        sent.is_taken = true;
                    }
                    return self.finish(line, shared).await;
                }
            }
        }
        self.begin(line, shared, now).await;
    }

    /// The gateway ends: whatever was under way, the strobe does not stay up.
    async fn leave(&mut self, line: &mut DeviceLine, shared: &Shared) {
        self.strobe.waits = None;
        if self.strobe.stands == Stands::Up && !self.lower(line, shared).await {
            self.tried_at = shared.clock.now();
        }
        self.show(shared);
    }

    async fn begin(&mut self, line: &mut DeviceLine, shared: &Shared, now: Moment) {
        let profile = &shared.profile;
        if self.strobe.stands == Stands::Up {
            // Left up by an exchange that failed: ours to drop, also while the axis is off.
            if now < self.tried_at.after(RETRY) {
                return;
            }
            self.tried_at = now;
            if !self.lower(line, shared).await {
                return;
            }
        }
        let orders: Vec<Order> = {
            let core = shared.core();
            self.members.iter().map(|member| member.order(shared, &core, now)).collect()
        };
        let parts: Vec<Part> =
            self.members.iter_mut().zip(&orders).map(|(member, order)| member.part(shared, order)).collect();
        self.forget_off(&parts);
        let refresh = self.wants_refresh(profile, &parts, now) || self.has_news(shared, &parts);
        let unsettled = self.unfinished.is_some() || self.any(&parts, Part::Free, Writer::is_unsettled);
        let calls = |((member, order), part): ((&Writer, &Order), &Part)| match part {
            Part::Free => order.decided != member.applied,
            Part::Off => {
                order.decided != member.applied || member.known.is_none() || member.trouble.is_some()
            }
            Part::Kept => false,
        };
        let called = self.members.iter().zip(&orders).zip(&parts).any(calls);
        let is_free = parts.contains(&Part::Free);
        if !(called || refresh || (unsettled && is_free)) {
            return;
        }
        let device = profile.set(self.id).device;
        if line.is_resting(device, now) {
            self.tried_at = now;
            return self.each(&parts, |member, part| {
                if part == Part::Free {
                    member.doubt(shared, Trouble::Link);
                }
            });
        }
        if self.members.iter().any(|member| member.trouble.is_some()) && now < self.tried_at.after(RETRY) {
            return;
        }
        let targets = self.targets(shared, &orders, &parts, None, now);
        self.tell_lapsed(shared, &orders, &parts);
        let stands = self.members.iter().zip(&targets).all(|(member, target)| member.known == *target);
        let looks = parts.contains(&Part::Off);
        if stands && !refresh && !unsettled && !looks {
            return self.apply(&orders, &parts);
        }
        self.tried_at = now;
        if is_free && !self.is_clear(line, shared).await {
            return;
        }
        let Some(cells) = self.look(line, shared, &parts).await else { return };
        if !self.is_ours(shared, &orders, &parts, &cells, now) || !is_free {
            return;
        }
        let targets = self.targets(shared, &orders, &parts, Some(&cells), now);
        let stands = self.members.iter().zip(&targets).all(|(member, target)| member.known == *target);
        let settled = self.unfinished.is_none() && !self.any(&parts, Part::Free, Writer::is_unsettled);
        if stands && settled && !refresh {
            return self.apply(&orders, &parts);
        }
        let not_after = self.not_after(&orders, &parts, &targets);
        self.send(line, shared, &parts, targets, not_after).await;
        self.apply(&orders, &parts);
    }

    /// The last moment for what changes; what stays as it is rests on no reading.
    fn not_after(&self, orders: &[Order], parts: &[Part], targets: &[Option<Words>]) -> Moment {
        let all = self.members.iter().zip(orders).zip(parts).zip(targets);
        let changes = all.filter(|(((member, _), part), target)| {
            **part == Part::Free && (member.known != **target || member.uncertain.is_some())
        });
        changes.map(|(((_, order), _), _)| order.not_after).min().unwrap_or(Moment::END)
    }

    /// An axis that is off begins from its register when it is armed: nothing of it is sent again.
    fn forget_off(&mut self, parts: &[Part]) {
        let Some(sent) = &mut self.unfinished else { return };
        for (value, part) in sent.values.iter_mut().zip(parts) {
            *value = value.filter(|_| *part != Part::Off);
        }
        if sent.values.iter().all(Option::is_none) {
            self.unfinished = None;
        }
    }

    /// The acknowledge is down, so that the next one answers the next strobe.
    async fn is_clear(&mut self, line: &mut DeviceLine, shared: &Shared) -> bool {
        let Some(handshake) = shared.profile.set(self.id).handshake else { return true };
        if self.strobe.stands == Stands::Unknown && !self.lower(line, shared).await {
            self.doubt_sent(shared);
            return false;
        }
        self.wait_for(shared, Wait::Clear, handshake.timeout);
        matches!(self.wait(line, shared).await, Waited::Over)
    }

    /// Compares what was found; whether the decisions are still to be carried out.
    fn is_ours(
        &mut self,
        shared: &Shared,
        orders: &[Order],
        parts: &[Part],
        cells: &Cells,
        now: Moment,
    ) -> bool {
        let has_handshake = shared.profile.set(self.id).handshake.is_some();
        let arrived = |sent: &Sent| (!has_handshake || sent.is_taken) && sent.cells == *cells;
        if self.unfinished.as_ref().is_some_and(arrived) {
            self.unfinished = None;
        }
        let again = self.unfinished.is_some();
        let mut goes_on = true;
        for ((member, order), part) in self.members.iter_mut().zip(orders).zip(parts) {
            let output = shared.profile.output(member.id);
            let found = found(output, cells);
            match part {
                Part::Kept => {}
                Part::Off => {
                    (member.trouble, member.applied) = (None, order.decided);
                    member.settle(shared, output, found, now, false);
                }
                Part::Free => {
                    let is_sent = Some(found) == member.known || Some(found) == member.uncertain;
                    if !(again && is_sent && !member.restarted) {
                        goes_on &= member.judge(shared, output, found, now);
                    }
                }
            }
        }
        if !goes_on {
            self.unfinished = None;
        }
        goes_on
    }

    /// What each member shall hold: what was sent and not taken; else its decision, where that is not too late; else what
    /// stands there.
    fn targets(
        &mut self,
        shared: &Shared,
        orders: &[Order],
        parts: &[Part],
        cells: Option<&Cells>,
        now: Moment,
    ) -> Vec<Option<Words>> {
        let sent = self.unfinished.as_ref().map(|sent| sent.values.clone()).unwrap_or_default();
        let mut sent = sent.into_iter();
        let mut targets = Vec::new();
        for ((member, order), part) in self.members.iter_mut().zip(orders).zip(parts) {
            let output = shared.profile.output(member.id);
            targets.push(match (part, sent.next().flatten()) {
                (Part::Free, Some(sent)) => Some(sent),
                (Part::Free, None) => {
                    let target = member.target(shared, output, order);
                    member.is_late = now > order.not_after
                        && member.trouble.is_none()
                        && member.uncertain.is_none()
                        && member.known.is_some_and(|known| known != target);
                    if member.is_late { member.known } else { Some(target) }
                }
                _ => cells.map(|cells| found(output, cells)).or(member.known),
            });
        }
        targets
    }

    /// What became too late for its turn rests on readings that are too old now: the set goes without it, and first with the
    /// next decision.
    fn tell_lapsed(&mut self, shared: &Shared, orders: &[Order], parts: &[Part]) {
        let members = self.members.iter().zip(orders).zip(parts);
        let late = members.filter(|((member, order), part)| {
            **part == Part::Free && member.is_late && member.applied != order.decided
        });
        for ((member, order), _) in late {
            if order.follows {
                shared.order_lapsed(member.id, order.not_after);
            } else {
                member.holds_what_stands(shared);
            }
        }
    }

    /// The turn of one of its members came too late for what was decided.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.members.iter().any(|member| member.is_late && !member.idle)
    }

    /// What was sent may have been taken or not.
    pub(super) fn doubt_sent(&mut self, shared: &Shared) {
        self.tried_at = shared.clock.now();
        for member in self.members.iter_mut().filter(|member| !member.idle) {
            member.doubt(shared, Trouble::Verify);
            shared.core().outputs[member.id.0].failures += 1;
        }
    }

    fn wants_refresh(&self, profile: &Profile, parts: &[Part], now: Moment) -> bool {
        let refresh = |member: &Writer| profile.output(member.id).refresh;
        let over =
            |member: &Writer| refresh(member).is_some_and(|refresh| now >= self.written_at.after(refresh));
        self.any(parts, Part::Free, over)
    }

    /// The control word says something else than what was sent.
    fn has_news(&self, shared: &Shared, parts: &[Part]) -> bool {
        let told = self.told_control;
        parts.contains(&Part::Free)
            && shared.profile.set(self.id).control.is_some()
            && told.is_some_and(|told| told != self.control(shared))
    }

    /// What the gateway does with the axes of this set, in bits.
    fn control(&self, shared: &Shared) -> u16 {
        let core = shared.core();
        let mut control = Control::ENABLE;
        for member in &self.members {
            let axis = shared.profile.output(member.id).axis.0;
            let state = core.compensation.decision(axis).map(|decision| decision.state);
            if !core.arming[axis].armed {
                control &= !Control::ENABLE;
            }
            control |= match state {
                Some(AxisState::Holding(_)) => Control::HOLD | Control::FAULT,
                Some(AxisState::Ramping | AxisState::Zeroed) => Control::FAULT,
                Some(AxisState::Degraded) => Control::DEGRADED,
                _ => 0,
            };
        }
        control
    }

    fn any(&self, parts: &[Part], wanted: Part, holds: impl Fn(&Writer) -> bool) -> bool {
        self.members.iter().zip(parts).any(|(member, part)| *part == wanted && holds(member))
    }

    fn each(&mut self, parts: &[Part], act: impl Fn(&mut Writer, Part)) {
        self.members.iter_mut().zip(parts).for_each(|(member, part)| act(member, *part));
    }

    /// These decisions are carried out, or on their way.
    fn apply(&mut self, orders: &[Order], parts: &[Part]) {
        for ((member, order), part) in self.members.iter_mut().zip(orders).zip(parts) {
            if *part == Part::Free {
                member.applied = order.decided;
            }
        }
    }
}

impl Writer {
    fn part(&mut self, shared: &Shared, order: &Order) -> Part {
        let output = shared.profile.output(self.id);
        self.note_restarts(order);
        self.idle = order.off || shared.dry_run;
        if self.idle {
            self.rest();
            Part::Off
        } else if order.outdated || self.holds_back(shared, output, order) {
            Part::Kept
        } else {
            Part::Free
        }
    }

    fn is_unsettled(&self) -> bool {
        self.compare || self.trouble.is_some() || self.known.is_none()
    }
}

fn found(output: &Output, cells: &Cells) -> Words {
    let count = output.encoding.data_type.registers();
    let first = output.address.register();
    first.map_or(Words::of(&[]), |first| exchange::value(cells, first.offset, count))
}
