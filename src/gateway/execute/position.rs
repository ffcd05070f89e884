//! Corrected positions: D' = D + Cz, as soon as D has been read.
//!
//! The newest position goes out at once in every armed state, also while the axis holds: see [`Inside`].

use std::fmt::Display;
use std::time::Duration;

use super::LineTurn;
use super::cells::{self, Cells};
use super::demand::{Decision, OutputDemand};
use super::interlock::Interlock;
use super::report;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::Standing;
use crate::gateway::storage::Steady;
use crate::gateway::units::{cz_factor, registers_in_text};
use crate::observe::events::Event;
use isotherm_core::codec::{ControlView, Encoded};
use isotherm_core::compensation::AxisState;
use isotherm_core::output::{Condition, Inside, Trouble};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::SignalId;
use isotherm_profile::{Arm, Output, OutputId, Profile, Shown, Stretch};

/// How often dashes are written again.
const DASHES_AGAIN: Duration = Duration::from_secs(10);

#[derive(Debug)]
pub(in crate::gateway) struct Position {
    id: OutputId,
    position: SignalId,
    corrected: Moment,
    inside: Inside,
    /// When a display was last given dashes; `None` while it shows a value.
    dashes_at: Option<Moment>,
    trouble: Option<Trouble>,
    is_saturated: bool,
    interlock: Interlock,
    /// How its control reads what is written.
    control: Option<ControlView>,
}

impl Position {
    pub(in crate::gateway) fn new(profile: &Profile, id: OutputId, position: SignalId) -> Position {
        Position {
            id,
            position,
            control: profile.control_view(profile.output(id)),
            corrected: Moment::default(),
            inside: Inside::Nothing,
            dashes_at: None,
            trouble: None,
            is_saturated: false,
            interlock: Interlock::default(),
        }
    }

    /// Writes position + Cz as soon as a new position has been read.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.now);
        let output = shared.profile.output(self.id);
        let has_dashes = output.display.stale.is_some();
        let (taken, demand) = {
            let core = shared.core();
            let taken = core.board.taken(self.position);
            if taken == self.corrected && !has_dashes {
                return;
            }
            (taken, OutputDemand::of(shared, &core, self.id, now))
        };
        if has_dashes && (demand.decision == Decision::Off || demand.position.is_none()) {
            self.show_nothing(turn, output).await;
        }
        if taken == self.corrected {
            return;
        }
        if demand.decision == Decision::Off || shared.dry_run {
            self.inside = Inside::Nothing;
            self.corrected = taken;
            return;
        }
        if turn.line.is_resting(output.device, now) {
            return;
        }
        self.corrected = taken;
        let Some(position) = demand.position else { return };
        self.interlock.hear(shared, self.id, demand.interlock);
        match demand.interlock {
            Condition::Met => self.correct(turn, output, position, &demand).await,
            Condition::NotMet => shared.core().outputs[self.id.0].standing = Standing::Interlocked,
            Condition::Unknown => shared.core().outputs[self.id.0].doubt(),
        }
    }

    async fn correct(
        &mut self,
        turn: &mut LineTurn<'_>,
        output: &Output,
        position: f64,
        demand: &OutputDemand,
    ) {
        let shared = turn.shared;
        let step = shared.profile.axis(output.axis).settings.guard.step;
        let cz = self.inside.next((demand.cz, demand.target, demand.decided), step);
        let factor = cz_factor(&shared.profile, output);
        let target = self.encode(shared, output, position + cz.get() * factor / 1000.0);
        if let Some(control) = &self.control
            && let Err(why) = control.admit(target.registers(), cz, position, Micron::ZERO)
        {
            return report::not_sent(shared, self.id, why);
        }
        let asked = turn.line.looked();
        match write(turn, output, &target, demand.not_after).await {
            Ok(found) if found.is_none_or(|found| found.registers() == target.registers()) => {}
            Ok(found) => {
                self.inside = Inside::Sent(cz);
                return self.is_not_shown(shared, output, &target, found);
            }
            Err((fault, outcome)) => {
                if outcome != Outcome::NotDone {
                    self.inside = Inside::Sent(cz);
                }
                return self.fail(shared, output, fault);
            }
        }
        self.dashes_at = None;
        self.inside = Inside::Written(cz, demand.decided);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let failures = std::mem::take(&mut state.failures);
        state.standing = Standing::Verified;
        state.writes += 1;
        state.cz = Some(cz);
        state.value = output.encoding.decode(target.registers()).ok();
        state.verified_at = Some(asked);
        core.storage.outputs.wrote(Steady::Position(self.id), Some(cz), asked);
        if self.trouble.take() == Some(Trouble::Untaken) {
            core.events.push(Event::Verified { output: output.name.clone(), failures });
        }
    }

    fn encode(&mut self, shared: &LineHandle, output: &Output, value: f64) -> Encoded {
        let encoded = output.encoding.encode(value);
        if encoded.saturated && !self.is_saturated {
            shared.report(&Event::Saturated { output: output.name.clone(), wanted: value });
        }
        self.is_saturated = encoded.saturated;
        encoded
    }

    /// Something else is read back than was written: reported once, and tried again with the next position.
    fn is_not_shown(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        wrote: &Encoded,
        found: Option<Encoded>,
    ) {
        if self.trouble.replace(Trouble::Untaken) != Some(Trouble::Untaken) {
            let found = found.map_or(String::new(), |found| registers_in_text(output, found.registers()));
            let wrote = registers_in_text(output, wrote.registers());
            let (output, is_in_a_node) = (output.name.clone(), output.address.node().is_some());
            shared.report(&Event::VerifyFailed { output, wrote, found, is_in_a_node });
        }
        self.is_unverified(shared, &"something else is read back than was written");
    }

    /// A device that is lost is reported elsewhere; one that refuses is not.
    fn fail(&mut self, shared: &LineHandle, output: &Output, fault: Fault) {
        if fault.has_lapsed() {
            return;
        }
        if !fault.spoils_connection() && self.trouble.is_none() {
            let transport = shared.profile.bus(shared.profile.device(output.device).bus).transport;
            let fault = explain_on(transport, fault);
            shared.report(&Event::WriteFailed { output: output.name.clone(), fault });
        }
        let trouble = if fault.spoils_connection() { Trouble::Link } else { Trouble::Untaken };
        self.trouble = self.trouble.filter(|known| *known == Trouble::Untaken).or(Some(trouble));
        self.is_unverified(shared, &fault);
    }

    fn is_unverified(&self, shared: &LineHandle, why: &dyn Display) {
        let now = shared.clock.now();
        let mut core = shared.core();
        core.storage.outputs.not_written(Steady::Position(self.id), why, now);
        let state = &mut core.outputs[self.id.0];
        state.failures += 1;
        state.doubt();
    }

    /// Dashes instead of a number that nobody corrects any more: when that begins, and again after each pause, because a
    /// display that was switched off and on shows something else.
    async fn show_nothing(&mut self, turn: &mut LineTurn<'_>, output: &Output) {
        let (shared, now) = (turn.shared, turn.now);
        let Some(stale) = &output.display.stale else { return };
        let is_fresh = self.dashes_at.is_some_and(|at| now < at.after(DASHES_AGAIN));
        // Where a person arms, the display is not ours before that.
        let is_ours = shared.profile.arm == Arm::Auto || shared.core().was_armed;
        if is_fresh || shared.dry_run || !is_ours || turn.line.is_resting(output.device, now) {
            return;
        }
        let text = (stale.register..).zip(stale.words.iter().copied());
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(Shown::Fault)));
        // What fails is reported where every request fails, and tried again.
        if send(turn, output, beside.collect(), Leave::Whenever).await.is_ok()
            && send(turn, output, text.collect(), Leave::Whenever).await.is_ok()
        {
            (self.dashes_at, self.inside) = (Some(now), Inside::Nothing);
        }
    }
}

/// Writes the value, with the registers of a display that belong beside it. What is read back, where it is.
async fn write(
    turn: &mut LineTurn<'_>,
    output: &Output,
    target: &Encoded,
    not_after: Moment,
) -> Result<Option<Encoded>, (Fault, Outcome)> {
    let leave = Leave::By(not_after);
    if output.display.beside.is_empty() {
        let functions = turn.shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, target.registers(), functions);
        let sent = turn.line.request(output.device, request, leave).await;
        sent.map_err(|fault| (fault, fault.outcome()))?;
    } else {
        let shown = shown(turn.shared, output);
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(shown)));
        send(turn, output, output.cells(target.registers()).chain(beside).collect(), leave).await?;
    }
    if !output.verify.reads() {
        return Ok(None);
    }
    let at = output.reads_at();
    let request = Request::read(&at, output.encoding.data_type);
    let request = request.ok_or((Fault::Caller(CallerFault::Function), Outcome::Unknown))?;
    let read = turn.line.request(output.device, request, Leave::Whenever).await;
    let answer = read.and_then(|answered| answered.answer.believed());
    let answer = answer.map_err(|fault| (fault, Outcome::Unknown))?;
    Ok(Some(Encoded::of(answer.registers())))
}

fn shown(shared: &LineHandle, output: &Output) -> Shown {
    let state = shared.core().compensation.decision(output.axis.0).map(|decision| decision.state);
    match state {
        Some(AxisState::Active) => Shown::Good,
        Some(AxisState::Degraded) => Shown::Degraded,
        _ => Shown::Fault,
    }
}

/// Writes registers, those side by side in one request.
async fn send(
    turn: &mut LineTurn<'_>,
    output: &Output,
    cells: Cells,
    leave: Leave,
) -> Result<(), (Fault, Outcome)> {
    let longest = turn.shared.profile.device(output.device).longest_request();
    let stretches = Stretch::joined(cells.keys().map(|register| (*register, 1)).collect(), longest);
    cells::write(turn, output.device, &stretches, &cells, leave).await
}
