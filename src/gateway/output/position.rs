//! Corrected positions: the gateway reads a position D, and at once writes the corrected position D' = D + Cz
//! (compensation value) to a display or control. [`PositionController`] decides about the writes.

use std::fmt::Display;

use super::demand::OutputDemand;
use super::failures::{Failures, RequestKind};
use super::report;
use super::set_modbus;
use super::turn::LineTurn;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::explain::advised_on;
use crate::fieldbus::seen::Seen;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::state::output::RegisterHealth;
use crate::gateway::state::output_faults::{of_an_output, write_of};
use crate::gateway::state::units::{cz_factor, registers_in_text};
use crate::gateway::store::log::outputs::{ControllerSnapshot, ControllerState, PositionSnapshot, Turn};
use crate::gateway::store::storage::{CountedWrite, TurnRecord};
use crate::observe::events::Event;
use isotherm_core::codec::{ControlView, Encoded};
use isotherm_core::compensation::AxisState;
use isotherm_core::output::{
    Condition, Fact, Input, PositionAction, PositionController, PositionDemand, PositionEvent,
    PositionResult, PositionTurn, Trouble,
};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_core::reading::SignalId;
use isotherm_profile::{Arm, Output, OutputId, Shown};

/// Executor of an output that writes a position plus Cz (corrected position).
#[derive(Debug)]
pub(in crate::gateway) struct Position {
    id: OutputId,
    position: SignalId,
    controller: PositionController,
    failures: Failures,
    is_saturated: bool,
    /// Conversion by which the control gets a value from the registers. With this conversion, the executor
    /// checks each value before the write.
    control: Option<ControlView>,
}

impl Position {
    /// Creates the executor of an output that writes a position plus Cz. The output continues from the Cz of its last
    /// write, in this run or in the previous run.
    pub(in crate::gateway) fn new(shared: &LineHandle, id: OutputId, position: SignalId) -> Position {
        let profile = &shared.profile;
        Position {
            id,
            position,
            control: profile.control_view(profile.output(id)),
            controller: PositionController::resuming(shared.core().outputs[id.0].cz),
            failures: Failures::default(),
            is_saturated: false,
        }
    }

    /// Executes one turn of the output (work of the line task on it): writes position + Cz if a new position has been
    /// read.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let (shared, now) = (turn.shared, turn.now);
        let output = shared.profile.output(self.id);
        let has_dashes = output.display.stale.is_some();
        let (read_at, written, demand) = {
            let core = shared.core();
            let read_at = core.board.taken(self.position);
            if self.controller.has_corrected(read_at) && !has_dashes {
                return;
            }
            (read_at, core.outputs[self.id.0].cz, OutputDemand::of(shared, &core, self.id, now))
        };
        // With manual arming, the gateway does not write the display before the first arming.
        let is_ours = !shared.dry_run && (shared.profile.arm == Arm::Auto || shared.core().was_armed);
        let asked = PositionDemand {
            read_at,
            is_usable: demand.position.is_some(),
            decision: demand.of_position().filter(|_| !shared.dry_run),
            interlock: demand.interlock,
            backs_off: turn.line.is_backing_off(output.device, now),
            may_show_dashes: has_dashes && is_ours,
        };
        let (step, before) = (shared.profile.axis(output.axis).settings.guard.step, self.controller);
        let (action, event) = self.controller.next(&asked, step, now);
        self.report(shared, output, event);
        let mut sent = None;
        let result = match (action, demand.position) {
            (PositionAction::Correct(cz), Some(position)) => {
                sent = self.correct(turn, output, (position, cz, written), demand.not_after).await;
                sent.as_ref().map(PositionWrite::result)
            }
            (PositionAction::ShowDashes, _) => self.show_dashes(turn, output).await,
            (PositionAction::Interlocked(condition), _) => {
                let state = &mut shared.core().outputs[self.id.0];
                match condition {
                    Condition::Unknown => state.doubt(),
                    _ => state.standing = RegisterHealth::Interlocked,
                }
                None
            }
            _ => None,
        };
        let ended = PositionTurn { demand: asked, action, result };
        let event = self.controller.result(&ended, now);
        if let Some(sent) = sent {
            self.publish(shared, output, sent, event);
        }
        let (turn, state) = (Turn::Position(ended), ControllerState::Position);
        let ended = TurnRecord { before: state(before), turn, after: state(self.controller) };
        let snapshot = || ControllerSnapshot::Position(PositionSnapshot { step, position: before });
        shared.core().storage.outputs.turned(CountedWrite::Position(self.id), ended, snapshot, now);
    }

    /// Writes the position plus the given Cz. `written` is the Cz that the register holds now. Writes nothing and
    /// returns `None` if the control would read another value from the registers, or a value beyond the limit.
    async fn correct(
        &mut self,
        turn: &mut LineTurn<'_>,
        output: &Output,
        (position, cz, written): (f64, Micron, Option<Micron>),
        not_after: Moment,
    ) -> Option<PositionWrite> {
        let shared = turn.shared;
        let factor = cz_factor(&shared.profile, output);
        let target = self.encode(shared, output, position + cz.get() * factor / 1000.0);
        // If the limit is smaller than in the previous run, a Cz beyond it returns in steps.
        if let Some(control) = &self.control
            && let Err(why) = control.admit(target.registers(), cz, position, written.unwrap_or_default())
        {
            report::not_sent(shared, self.id, why);
            return None;
        }
        let asked = turn.line.last_sample();
        let answer = write(turn, output, &target, not_after).await;
        Some(PositionWrite { target, cz, asked, answer })
    }

    fn publish(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        sent: PositionWrite,
        event: Option<PositionEvent>,
    ) {
        let result = sent.result();
        let PositionWrite { target, cz, asked, answer } = sent;
        match answer {
            Ok(_) if result == PositionResult::Written => {
                self.is_written(shared, output, &target, (cz, asked));
            }
            Ok(found) => self.is_not_shown(shared, output, (&target, found), event),
            Err((fault, _)) => self.fail(shared, output, fault),
        }
    }

    fn is_written(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        target: &Encoded,
        (cz, asked): (Micron, Moment),
    ) {
        self.failures.result(Input::Fact(Fact::Done { left: asked }));
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        state.standing = RegisterHealth::Verified;
        state.writes += 1;
        state.cz = Some(cz);
        state.value = output.encoding.decode(target.registers()).ok();
        state.verified_at = Some(asked);
        let failures = std::mem::take(&mut state.failures);
        if self.failures.end() {
            core.events.push(Event::Verified { output: output.name.clone(), failures });
        }
        core.storage.outputs.wrote(CountedWrite::Position(self.id), asked);
    }

    fn report(&self, shared: &LineHandle, output: &Output, event: Option<PositionEvent>) {
        let (name, when) = (|| output.name.clone(), output.when.as_ref());
        let event = match event {
            Some(PositionEvent::Interlocked) => {
                let when = when.map_or(String::new(), |when| when.text.clone());
                Event::Interlocked { output: name(), when }
            }
            Some(PositionEvent::Released) => Event::Released { output: name() },
            Some(PositionEvent::NotShown) | None => return,
        };
        shared.core().events.push(event);
    }

    fn encode(&mut self, shared: &LineHandle, output: &Output, value: f64) -> Encoded {
        let encoded = output.encoding.encode(value);
        if encoded.saturated && !self.is_saturated {
            shared.report(&Event::Saturated { output: output.name.clone(), wanted: value });
        }
        self.is_saturated = encoded.saturated;
        encoded
    }

    /// Handles a write after which the value read back differs from the written value. The difference is reported
    /// once. The next position is written as usual.
    fn is_not_shown(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        (wrote, found): (&Encoded, Option<Encoded>),
        event: Option<PositionEvent>,
    ) {
        if event == Some(PositionEvent::NotShown) {
            let found = found.map_or(String::new(), |found| registers_in_text(output, found.registers()));
            let wrote = registers_in_text(output, wrote.registers());
            let (output, is_in_a_node) = (output.name.clone(), output.address.node().is_some());
            self.failures.raise();
            shared.report(&Event::VerifyFailed { output, wrote, found, is_in_a_node });
        }
        self.is_unverified(shared, &"the value read back is not the written value");
    }

    /// Handles a failed write. Reports a device that refuses the write. Other code reports a lost device.
    fn fail(&mut self, shared: &LineHandle, output: &Output, fault: Fault) {
        if fault.has_lapsed() {
            return;
        }
        let transport = shared.profile.bus(shared.profile.device(output.device).bus).transport;
        let is_lost = shared.core().device_health.devices[output.device.0].is_reported_lost();
        self.failures.device_answers(!is_lost);
        let words = || of_an_output(&shared.profile, self.id, fault);
        if let Some(words) = self.failures.fails(fault, RequestKind::Write, words) {
            let seen = Seen::of(fault, write_of(&shared.profile, self.id));
            let fault = advised_on(transport, seen, words);
            shared.report(&Event::WriteFailed { output: output.name.clone(), fault });
        }
        self.is_unverified(shared, &fault);
    }

    fn is_unverified(&self, shared: &LineHandle, why: &dyn Display) {
        let now = shared.clock.now();
        let mut core = shared.core();
        core.storage.outputs.not_written(CountedWrite::Position(self.id), why, now);
        let state = &mut core.outputs[self.id.0];
        state.failures += 1;
        state.doubt();
    }

    /// Writes dashes to a display while its position is not corrected. Returns `None` if the write failed. The next
    /// call by the line task then writes the dashes again.
    async fn show_dashes(&self, turn: &mut LineTurn<'_>, output: &Output) -> Option<PositionResult> {
        let stale = output.display.stale.as_ref()?;
        let text = (stale.register..).zip(stale.words.iter().copied());
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(Shown::Fault)));
        // Failed requests are reported with the health of the device.
        set_modbus::write(turn, output.device, &beside.collect(), SendDeadline::None).await.ok()?;
        set_modbus::write(turn, output.device, &text.collect(), SendDeadline::None).await.ok()?;
        Some(PositionResult::Written)
    }
}

/// Position plus Cz that was sent, and the answer of the device. The answer contains the value read back, if the output
/// is read back.
#[derive(Debug)]
struct PositionWrite {
    target: Encoded,
    cz: Micron,
    asked: Moment,
    answer: Result<Option<Encoded>, (Fault, Outcome)>,
}

impl PositionWrite {
    fn result(&self) -> PositionResult {
        match &self.answer {
            Ok(found) if found.is_none_or(|found| found.registers() == self.target.registers()) => {
                PositionResult::Written
            }
            Ok(_) => PositionResult::NotShown,
            Err((fault, Outcome::NotDone)) if fault.has_lapsed() => PositionResult::Lapsed,
            Err((fault, outcome)) => PositionResult::Failed {
                trouble: if fault.spoils_connection() { Trouble::Link } else { Trouble::Untaken },
                may_have_arrived: *outcome != Outcome::NotDone,
            },
        }
    }
}

/// Writes the value, together with further registers of a display. Returns the value read back, or `None` if the output
/// is not read back.
async fn write(
    turn: &mut LineTurn<'_>,
    output: &Output,
    target: &Encoded,
    not_after: Moment,
) -> Result<Option<Encoded>, (Fault, Outcome)> {
    let leave = SendDeadline::By(not_after);
    if output.display.beside.is_empty() {
        let functions = turn.shared.profile.device(output.device).functions;
        let request = Request::write(&output.address, target.registers(), functions);
        let sent = turn.line.request(output.device, request, leave).await;
        sent.map_err(|fault| (fault, fault.outcome()))?;
    } else {
        let shown = shown(turn.shared, output);
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(shown)));
        let cells = output.cells(target.registers()).chain(beside).collect();
        set_modbus::write(turn, output.device, &cells, leave).await?;
    }
    if !output.verify.reads() {
        return Ok(None);
    }
    let at = output.reads_at();
    let request = Request::read(&at, output.encoding.data_type);
    let request = request.ok_or((Fault::Caller(CallerFault::Function), Outcome::Unknown))?;
    let read = turn.line.read_confirmed(output.device, request).await;
    let answer = read.and_then(|answered| answered.answer.accepted());
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
