//! Executor of an output set (outputs that are written together). It executes the actions of the set's controller,
//! and returns the results to the controller.

use std::slice::from_ref;

use super::demand::OutputDemand;
use super::failures::RequestKind;
use super::register::{OutputRegister, not_done};
use super::set_io::{self, SetReadings};
use super::set_modbus;
use super::turn::{LineTurn, MOST_EXCHANGES};
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::output::HandshakeStatus;
use crate::gateway::store::log::outputs::{ControllerSnapshot, ControllerState, SetSnapshot, SetTurn, Turn};
use crate::gateway::store::storage::{CountedWrite, TurnRecord};
use crate::observe::events::Event;
use isotherm_core::codec::Encoded;
use isotherm_core::display::control_word;
use isotherm_core::output::{
    Action, Cause, CommitTrigger, Controller, Fact, HandshakeFault, Input, MemberDemand, OwnWords, SetAction,
    SetController, SetDemand, SetInput, SetSettings, SetValue, SetWords, StandaloneWrite, Strobe,
    StrobeResult, WriteResult,
};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::{Bit, DeviceId, Handshake, OutputSet, Profile, SetId};

/// Executor of one output set (outputs that are written together), with its strobe signal.
#[derive(Debug)]
pub(in crate::gateway) struct Set {
    id: SetId,
    registers: Vec<OutputRegister>,
    settings: SetSettings,
    controller: SetController,
    /// Register value of each output of the set, from the last read.
    found: Vec<Encoded>,
    /// Reason for each output to make its axis continue from the register value; `None` for an output without such a
    /// reason.
    resumes: Vec<Option<Cause>>,
    /// Cause of the last failure of the handshake, as text.
    cause: String,
    /// Time of the next turn of the output set (work of the line task on it), if no event causes an earlier turn.
    pub(in crate::gateway) due: Moment,
}

impl Set {
    pub(in crate::gateway) fn new(shared: &LineHandle, id: SetId, now: Moment) -> Set {
        let set = shared.profile.set(id);
        let core = shared.core();
        // The previous task may have ended in the middle of an exchange.
        let was_up = set.outputs.iter().any(|id| core.outputs[id.0].handshake.strobe_up);
        let is_second = set.outputs.iter().any(|id| core.registers[id.0].is_some());
        drop(core);
        let each = set.outputs.iter().map(|id| OutputRegister::new(shared, *id, true, now));
        let (registers, controllers): (Vec<_>, Vec<Controller>) = each.unzip();
        let was_in_order = !is_second && controllers.iter().all(|one| one.state().is_settled());
        let settings = settings(&shared.profile, set, &registers);
        let strobe = Strobe::new(was_up);
        let controller = SetController::new(&settings, controllers, (strobe, was_in_order), now);
        let resumes = vec![None; registers.len()];
        let (found, cause) = (Vec::new(), String::new());
        Set { id, registers, settings, controller, found, resumes, cause, due: now }
    }

    /// Returns the time of the next read of the acknowledge signal. `None` if the output set does not wait for this
    /// signal.
    pub(in crate::gateway) fn next_read(&self) -> Option<Moment> {
        self.controller.strobe().next_read()
    }

    /// Returns whether the line task came too late to write the last decision to an output of this set.
    pub(in crate::gateway) fn is_late(&self) -> bool {
        self.controller.is_late()
    }

    /// Executes one turn of the output set (work of the line task on it): carries out the actions of its controller.
    /// A turn never waits for the control. If the acknowledge signal is not set yet, a later turn reads it again.
    pub(in crate::gateway) async fn turn(&mut self, turn: &mut LineTurn<'_>) {
        let shared = turn.shared;
        let (demands, demand) = self.demand(shared, turn.now);
        self.resumes.fill(None);
        let mut action = self.step(shared, &SetInput::Demand(demand), turn.now);
        for _ in 0..MOST_EXCHANGES + 3 * self.registers.len() {
            action = match action {
                SetAction::Nothing { .. } => break,
                SetAction::Keep(place) => self.keep(turn, place).await,
                SetAction::Read => self.read(turn).await,
                SetAction::Write { values, own, not_after } => {
                    self.write(turn, &values, own, not_after).await
                }
                SetAction::WriteOwn(own) => self.write_own(turn, own).await,
                SetAction::Acknowledge => self.acknowledge(turn).await,
                SetAction::Raise => self.strobe(turn, true).await,
                SetAction::Drop => self.strobe(turn, false).await,
            };
        }
        let is_waiting = self.next_read().is_some();
        let mut looks_again = Moment::END;
        for place in (0..self.registers.len()).filter(|_| !is_waiting) {
            let controllers = self.controller.members();
            if let Some(answer) = self.registers[place].read_applied(turn, &controllers[place]).await {
                self.step(shared, &SetInput::Member { place, answer }, turn.line.last_sample());
            }
            let due = self.controller.members()[place].applied_due(&self.registers[place].settings);
            looks_again = looks_again.min(due);
        }
        let action = self.step(shared, &SetInput::TurnEnds, turn.line.last_sample());
        for (place, demand) in demands.iter().enumerate() {
            let (controller, resumes) = (&self.controller.members()[place], self.resumes[place]);
            self.registers[place].publish(shared, controller, demand, resumes);
        }
        let until = if let SetAction::Nothing { until } = action { until } else { turn.line.last_sample() };
        self.due = until.min(looks_again);
    }

    fn demand(&self, shared: &LineHandle, now: Moment) -> (Vec<OutputDemand>, SetDemand) {
        let beat = shared.beat(now);
        let core = shared.core();
        let demands: Vec<OutputDemand> =
            self.registers.iter().map(|one| OutputDemand::of(shared, &core, one.id, now)).collect();
        let (control, is_leaving) = (self.control(shared, &core), core.phase.is_leaving());
        drop(core);
        let members = self.registers.iter().zip(&demands).map(|(register, demand)| MemberDemand {
            demand: demand.in_counts(shared, register.id, &register.units),
            again_until: (!demand.is_off()).then_some(demand.not_after),
        });
        let members = members.collect();
        (demands, SetDemand { members, control, beat, is_leaving })
    }

    fn control(&self, shared: &LineHandle, core: &GatewayState) -> u16 {
        let axes = self.registers.iter().map(|register| shared.profile.output(register.id).axis.0);
        let axes = axes.map(|axis| {
            (core.arming[axis].is_armed(), core.compensation.decision(axis).map(|decision| decision.state))
        });
        control_word(axes, core.phase.is_leaving() && core.runs_fault_actions())
    }

    /// Gives the controller the result of an exchange, and returns its next action.
    fn result(&mut self, turn: &LineTurn<'_>, input: &SetInput) -> SetAction {
        let (shared, now) = (turn.shared, turn.line.last_sample());
        if turn.line.send_guard.has_stalled() {
            self.step(shared, &SetInput::Paused, now);
        }
        self.step(shared, input, now)
    }

    /// Gives the controller an input, reports the controller's events, and writes input and action to the log. The
    /// new state is stored outside this task, so that it remains if the task fails.
    fn step(&mut self, shared: &LineHandle, input: &SetInput, now: Moment) -> SetAction {
        let is_logged = shared.core().storage.outputs.is_kept();
        let before = is_logged.then(|| self.controller.clone());
        let action = self.controller.step(&self.settings, input, now);
        let each = self.registers.iter_mut().zip(self.controller.members_mut()).zip(&mut self.resumes);
        for ((register, controller), resumes) in each {
            *resumes = register.report_events(shared, controller).or(*resumes);
        }
        for fault in self.controller.take_faults() {
            self.report(shared, fault);
        }
        let mut core = shared.core();
        for (register, controller) in self.registers.iter().zip(self.controller.members()) {
            core.registers[register.id.0] = Some(*controller);
        }
        self.publish(shared, &mut core);
        if let Some(before) = before {
            let state = |set: &SetController| ControllerState::Set(Box::new(set.clone()));
            let snapshot = || {
                let (settings, set) = (self.settings.clone(), before.clone());
                ControllerSnapshot::Set(Box::new(SetSnapshot { settings, set }))
            };
            let turn = Turn::Set(Box::new(SetTurn { input: input.clone(), action: action.clone() }));
            let ended = TurnRecord { before: state(&before), turn, after: state(&self.controller) };
            core.storage.outputs.turned(CountedWrite::Set(self.id), ended, snapshot, now);
        }
        action
    }

    fn report(&self, shared: &LineHandle, fault: HandshakeFault) {
        let set = shared.profile.set(self.id);
        let register = set.handshake.as_ref().map_or(String::new(), |handshake| {
            let bit = if fault.is_of_the_strobe() { &handshake.strobe } else { &handshake.acknowledge };
            bit.to_string()
        });
        shared.report(&Event::Handshake { set: set.label(), fault, register, cause: self.cause.clone() });
    }

    /// Publishes the status of the handshake in the state of each output of the output set.
    fn publish(&self, shared: &LineHandle, core: &mut GatewayState) {
        let strobe = self.controller.strobe();
        let status = HandshakeStatus {
            waits: strobe.awaits(),
            failed: strobe.failed(),
            strobe_up: strobe.may_be_up(),
            says_enabled: self.controller.may_say_enabled(),
            is_untaken: self.controller.is_bound(),
        };
        for id in &shared.profile.set(self.id).outputs {
            if core.outputs[id.0].handshake != status {
                core.outputs[id.0].handshake = status;
            }
        }
    }

    async fn keep(&mut self, turn: &mut LineTurn<'_>, place: usize) -> SetAction {
        let answer = self.registers[place].keep(turn, &self.controller.members()[place]).await;
        let input = answer.map_or(SetInput::DiskNotYet, |answer| SetInput::Member { place, answer });
        self.result(turn, &input)
    }

    async fn read(&mut self, turn: &mut LineTurn<'_>) -> SetAction {
        let shared = turn.shared;
        let input = match set_io::read(turn, shared.profile.set(self.id)).await {
            Ok(SetReadings { values, sequence: number, heartbeat: beat, asked }) => {
                let counts: Vec<Counts> = self
                    .registers
                    .iter()
                    .zip(&values)
                    .map(|(register, value)| register.units.found(value.registers()))
                    .collect();
                for (register, found) in self.registers.iter_mut().zip(&counts) {
                    register.note(Input::Fact(Fact::Read { found: *found, asked }));
                }
                self.found = values;
                SetInput::Read { values: counts, number, beat, asked }
            }
            Err(fault) => {
                for (register, controller) in self.registers.iter_mut().zip(self.controller.members()) {
                    if controller.action() == Action::Read {
                        register.fail(shared, controller, (fault, RequestKind::Read));
                        register.note(Input::Fact(Fact::NoAnswer));
                    }
                }
                SetInput::NoAnswer
            }
        };
        self.result(turn, &input)
    }

    async fn write(
        &mut self,
        turn: &mut LineTurn<'_>,
        values: &[SetValue],
        own: OwnWords,
        not_after: Moment,
    ) -> SetAction {
        let shared = turn.shared;
        let Some(registers) = self.encoded(shared, values) else {
            return self.result(turn, &SetInput::NotAdmitted);
        };
        let set = shared.profile.set(self.id);
        let sent = set_io::write(turn, set, &registers, own, SendDeadline::OnConnection(not_after)).await;
        let left = turn.line.last_sample();
        for (register, controller) in self.registers.iter_mut().zip(self.controller.members()) {
            if let Action::Write { .. } = controller.action() {
                match sent {
                    Ok(()) => register.note(Input::Fact(Fact::Done { left })),
                    Err(failed) => register.write_failed(shared, controller, failed),
                }
            }
        }
        self.words_sent(shared, sent, left);
        let result = sent.err().map_or(WriteResult::Done, not_done);
        self.result(turn, &SetInput::Sent { result, left })
    }

    /// Encodes the values as registers. Returns `None` if the control would read another value from the registers.
    fn encoded(&self, shared: &LineHandle, values: &[SetValue]) -> Option<Vec<Encoded>> {
        let each = self.registers.iter().zip(self.controller.members()).zip(values).zip(&self.found);
        each.map(|(((register, controller), value), found)| match value {
            SetValue::AsRead(_) => Some(*found),
            SetValue::New(value) => {
                let admitted = register.admitted(shared, controller, *value)?;
                Some(Encoded::of(admitted.registers()))
            }
        })
        .collect()
    }

    async fn write_own(&mut self, turn: &mut LineTurn<'_>, own: OwnWords) -> SetAction {
        let shared = turn.shared;
        let sent = set_io::write_own(turn, shared.profile.set(self.id), own).await;
        let left = turn.line.last_sample();
        self.words_sent(shared, sent, left);
        let result = sent.err().map_or(WriteResult::Done, not_done);
        self.result(turn, &SetInput::Sent { result, left })
    }

    /// Records in the log a write of the heartbeat and the control word of the output set.
    fn words_sent(&self, shared: &LineHandle, sent: Result<(), (Fault, Outcome)>, now: Moment) {
        if self.settings.words == SetWords::None {
            return;
        }
        let log = &mut shared.core().storage.outputs;
        match sent {
            Ok(()) => log.wrote(CountedWrite::Set(self.id), now),
            Err((fault, _)) => log.not_written(CountedWrite::Set(self.id), &fault, now),
        }
    }

    async fn acknowledge(&mut self, turn: &mut LineTurn<'_>) -> SetAction {
        let set = turn.shared.profile.set(self.id);
        let Some(Handshake { acknowledge, timeout, .. }) = &set.handshake else {
            return self.result(turn, &SetInput::Acknowledge(None));
        };
        let read = read_acknowledge(turn, set.device, acknowledge).await;
        self.cause = match &read {
            Ok(_) => format!("within {} ms", timeout.as_millis()),
            Err(fault) => fault.to_string(),
        };
        self.result(turn, &SetInput::Acknowledge(read.ok()))
    }

    async fn strobe(&mut self, turn: &mut LineTurn<'_>, up: bool) -> SetAction {
        let set = turn.shared.profile.set(self.id);
        let written = match &set.handshake {
            Some(Handshake { strobe, .. }) => write_strobe(turn, set.device, strobe, up).await,
            None => Ok(()),
        };
        let result = match &written {
            Ok(()) => StrobeResult::Done,
            Err(fault) if fault.outcome() == Outcome::NotDone => StrobeResult::NotDone,
            Err(_) => StrobeResult::Unknown,
        };
        // Dropping the strobe after a failure must not replace the cause of that failure.
        if let Err(fault) = written {
            self.cause = fault.to_string();
        }
        self.result(turn, &SetInput::Strobe(result))
    }
}

/// Sets or resets the strobe signal. The strobe signal tells the control to accept the written values.
async fn write_strobe(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    strobe: &Bit,
    up: bool,
) -> Result<(), Fault> {
    let functions = turn.shared.profile.device(device).functions;
    let content = match strobe {
        Bit::Flag(flag) => Encoded::of(&[if up { flag.raised() } else { 0 }]),
        Bit::Node(node) => node.word(u16::from(up)),
    };
    let request = match strobe {
        Bit::Flag(flag) if flag.address.table.is_bits() => Request::write_coil(flag.address.offset, up),
        Bit::Flag(flag) => Request::write_holding(flag.address.offset, content.registers(), functions),
        Bit::Node(node) => Request::write_nodes(from_ref(node), content.registers()),
    };
    turn.line.request(device, request, SendDeadline::None).await.map(|_| ())
}

/// Reads the acknowledge signal, with which the control confirms that it has accepted the values. Returns true if the
/// signal is set.
async fn read_acknowledge(
    turn: &mut LineTurn<'_>,
    device: DeviceId,
    acknowledge: &Bit,
) -> Result<bool, Fault> {
    let request = match acknowledge {
        Bit::Flag(flag) => Request::read_registers(flag.address, 1),
        Bit::Node(node) => Request::read_nodes(from_ref(node)),
    };
    let answered = turn.line.read_confirmed(device, request).await?;
    Ok(match (answered.answer.accepted()?, acknowledge) {
        (Answer::Bits(bits), _) => bits.first().copied().unwrap_or_default(),
        (answer, Bit::Flag(flag)) => answer.registers().first().is_some_and(|register| flag.is_up(*register)),
        (answer, Bit::Node(_)) => answer.registers().iter().any(|word| *word != 0),
    })
}

fn settings(profile: &Profile, set: &OutputSet, registers: &[OutputRegister]) -> SetSettings {
    let alone = if set.has_own_words_apart() { StandaloneWrite::Yes } else { StandaloneWrite::No };
    SetSettings {
        members: registers.iter().map(|register| register.settings).collect(),
        taking: taken_by(profile, set),
        has_number: set.sequence.is_some(),
        timeout: set.handshake.as_ref().map(|handshake| handshake.timeout),
        refresh: set.members(profile).filter_map(|output| output.refresh).min(),
        words: match (&set.control, &set.heartbeat) {
            (Some(_), _) => SetWords::Control(alone),
            (None, Some(_)) => SetWords::Heartbeat(alone),
            (None, None) => SetWords::None,
        },
    }
}

/// Returns the event on which the control accepts the values of the output set.
fn taken_by(profile: &Profile, set: &OutputSet) -> CommitTrigger {
    let is_in_one = set.sequence.is_none() || set_modbus::stretches(profile, set).len() == 1;
    match () {
        () if set.handshake.is_some() => CommitTrigger::Strobe,
        () if set.is_in_nodes(profile) => CommitTrigger::Nodes,
        () if is_in_one => CommitTrigger::AtOnce,
        () => CommitTrigger::Number,
    }
}
