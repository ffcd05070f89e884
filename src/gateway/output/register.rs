//! Register of one output: its encoding, its failures, and its state on disk. Single registers and registers of an
//! output set use the same code.

use std::time::Duration;

use super::demand::OutputDemand;
use super::failures::{Failures, RequestKind};
use super::report;
use super::turn::LineTurn;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::explain::advised_on;
use crate::fieldbus::seen::Seen;
use crate::fieldbus::wire::Request;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::output::{OutputState, RegisterHealth};
use crate::gateway::state::output_faults::{of_an_output, read_of, write_of};
use crate::gateway::state::units::Units;
use crate::gateway::store::documents::WHAT;
use crate::gateway::store::ledger::{SaveCondition, SaveResult};
use crate::observe::events::Event;
use crate::observe::requester::Channel;
use isotherm_core::codec::Encoded;
use isotherm_core::explained::Explained;
use isotherm_core::output::{
    self, AppliedSettings, Cause, Controller, Fact, InFlightWrites, Input, OutputAnswer, OutputHealth, Rules,
    Settings, State, Trouble, Verify, WriteResult,
};
use isotherm_core::quantity::{Counts, Micron, Moment};
use isotherm_profile::{Output, OutputId, Share, Writes};

/// Factor for `late`, the time in which an unanswered write may still arrive. For `late` times this factor,
/// the gateway recognises the value of the write in the register.
const REMEMBERED: u32 = 10;
/// Maximum time for saving the state of an output to disk. After this time, a fault of the disk is reported.
const DISK_PATIENCE: Duration = Duration::from_secs(5);

/// Register of one output. The code executes the actions of the output's controller, and reports the controller's
/// events.
#[derive(Debug)]
pub(super) struct OutputRegister {
    pub(super) id: OutputId,
    pub(super) units: Units,
    pub(super) settings: Settings,
    failures: Failures,
    /// Failed requests to the register in which the control reports the applied value.
    failures_applied: Failures,
    /// Writes that may still arrive, as they were last saved on disk. `None` if all writes were answered, and none is
    /// remembered as late.
    on_disk: Option<InFlightWrites>,
    /// Version of the register ledger (saved record of the written values) that the disk has not stored yet, and the
    /// time at which saving began. `None` if saving is complete.
    keeping: Option<(u64, Moment)>,
}

impl OutputRegister {
    /// Creates the register of an output and the controller of the output, when the task of the bus line begins.
    /// `is_in_a_set`: whether the output belongs to an output set. The value of such an output is refreshed together
    /// with the set.
    pub(super) fn new(
        shared: &LineHandle,
        id: OutputId,
        is_in_a_set: bool,
        now: Moment,
    ) -> (OutputRegister, Controller) {
        let output = shared.profile.output(id);
        let units = Units::of(&shared.profile, output);
        let settings = settings(shared, output, &units);
        let settings = if is_in_a_set { Settings { refresh: None, ..settings } } else { settings };
        let before = shared.core().registers[id.0];
        let controller = match before {
            // The previous task ended in the middle of an exchange.
            Some(mut controller) => {
                controller.interrupted(&settings, now);
                controller
            }
            None => {
                let state = State::new(&settings, shared.ledger.at_start(output).as_ref(), now);
                if !state.is_settled() && !settings.late.is_zero() && !shared.dry_run {
                    let (output, late) = (output.name.clone(), settings.late);
                    shared.report(&Event::WaitsAfterStart { output, late });
                }
                Controller::new(&settings, state, shared.pauses(), now)
            }
        };
        let (failures, failures_applied) = (Failures::default(), Failures::default());
        let (on_disk, keeping) = (None, None);
        (OutputRegister { id, units, settings, failures, failures_applied, on_disk, keeping }, controller)
    }

    /// Reports the events of the controller. If the axis must continue from the register value, returns the cause;
    /// otherwise `None`.
    pub(super) fn report_events(
        &mut self,
        shared: &LineHandle,
        controller: &mut Controller,
    ) -> Option<Cause> {
        let output = shared.profile.output(self.id);
        let (mut resumes, mut has_restarted) = (None, false);
        let events = controller.take_events();
        for event in events.iter() {
            let of = (&*self, &*controller);
            let is_foreign = matches!(event, output::Event::ForeignValue { .. });
            if !(has_restarted && is_foreign)
                && let Some(event) = report::event(of, output, *event, &shared.clock)
            {
                shared.report(&event);
            }
            match *event {
                output::Event::CncRestarted { .. } => has_restarted = true,
                output::Event::ForeignValue { expected, found } => {
                    shared.core().disarm(output.axis, self.why_foreign(output, expected, found));
                    if !has_restarted {
                        self.failures.raise();
                    }
                }
                output::Event::Late { not_after } => shared.order_lapsed(self.id, not_after),
                output::Event::Written => shared.core().outputs[self.id.0].writes += 1,
                output::Event::StillUntaken => shared.core().outputs[self.id.0].failures += 1,
                output::Event::NotTaken { .. } | output::Event::Recovered { was_untaken: true } => {
                    self.failures.raise();
                }
                output::Event::NotApplied => {
                    self.not_applied(shared, controller, output);
                    self.failures.raise();
                }
                output::Event::Question if !shared.dry_run => {
                    shared.report(&report::question(of, &output.name));
                    let hint = "follow the hint in the alarm of the output, then arm the axis";
                    let why = Explained::new(
                        "it is not certain which part of the output's register value comes from the gateway",
                        hint,
                    );
                    shared.core().disarm(output.axis, why);
                }
                output::Event::TakeOver { cause } => resumes = Some(cause),
                _ => {}
            }
        }
        resumes
    }

    /// Encodes a register value for a write. If the control would read another value from the registers, or a value
    /// beyond the limit, disarms the axis with the reason, and returns `None`.
    pub(super) fn admitted(
        &self,
        shared: &LineHandle,
        controller: &Controller,
        value: Counts,
    ) -> Option<Encoded> {
        let base = controller.state().shown(&self.settings).account.map(|account| account.base);
        let encoded = self.units.admitted(value, base, controller.held(&self.settings));
        encoded.map_err(|why| report::not_sent(shared, self.id, why)).ok()
    }

    /// Records the result of an exchange. A failure is reported only once until the next success.
    pub(super) fn note(&mut self, input: Input) {
        self.failures.result(input);
    }

    /// Handles a failed request to the register. A failed write is ignored while the axis is off, because the write
    /// only repeated the register value together with the values of other outputs.
    pub(super) fn fail(
        &mut self,
        shared: &LineHandle,
        controller: &Controller,
        (fault, access): (Fault, RequestKind),
    ) {
        if access == RequestKind::Write && !controller.is_armed() {
            return;
        }
        let in_words = || of_an_output(&shared.profile, self.id, fault);
        let asked = match access {
            RequestKind::Read | RequestKind::ReadApplied => read_of(&shared.profile, self.id),
            RequestKind::Write => write_of(&shared.profile, self.id),
        };
        let seen = Seen::of(fault, asked);
        let failures = match access {
            RequestKind::ReadApplied => &mut self.failures_applied,
            RequestKind::Read | RequestKind::Write => &mut self.failures,
        };
        let reported = failures.fails(fault, access, in_words);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        (state.failures, state.cause) = (state.failures + 1, Some(seen));
        let output = || shared.profile.output(self.id).name.clone();
        let device = shared.profile.device(shared.profile.output(self.id).device);
        let transport = shared.profile.bus(device.bus).transport;
        core.events.extend(reported.map(|words| advised_on(transport, seen, words)).map(
            |fault| match access {
                RequestKind::Read | RequestKind::ReadApplied => Event::ReadFailed { output: output(), fault },
                RequestKind::Write => Event::WriteFailed { output: output(), fault },
            },
        ));
    }

    /// Handles a failed write. A write that was not sent, because its deadline had passed, does not count as
    /// a failure.
    pub(super) fn write_failed(
        &mut self,
        shared: &LineHandle,
        controller: &Controller,
        (fault, outcome): (Fault, Outcome),
    ) {
        if !fault.has_lapsed() || outcome != Outcome::NotDone {
            self.fail(shared, controller, (fault, RequestKind::Write));
        }
    }

    /// Reads the value that the control reports as applied, if the read is due. Returns `None` if the read is not
    /// due.
    pub(super) async fn read_applied(
        &mut self,
        turn: &mut LineTurn<'_>,
        controller: &Controller,
    ) -> Option<OutputAnswer> {
        let output = turn.shared.profile.output(self.id);
        let asked = turn.line.last_sample();
        let applied = output.applied.as_ref().filter(|_| asked >= controller.applied_due(&self.settings))?;
        let request = Request::read_registers(applied.address, applied.encoding.data_type.registers());
        Some(match turn.line.read_confirmed(output.device, request).await {
            Ok(answered) => {
                let found = applied.encoding.decode(answered.answer.registers()).ok();
                self.failures_applied.result(Input::Fact(Fact::Read { found: Counts::ZERO, asked }));
                turn.shared.core().outputs[self.id.0].applied = found.map(|found| (found, answered.asked));
                OutputAnswer::Applied(found.and_then(|found| self.units.thousandths(found)), asked)
            }
            Err(fault) => {
                self.fail(turn.shared, controller, (fault, RequestKind::ReadApplied));
                OutputAnswer::AppliedNoAnswer(asked)
            }
        })
    }

    /// Publishes the state of the register for the axes and the web page. If `resumes` contains a cause, makes the
    /// axis continue from the register value.
    pub(super) fn publish(
        &mut self,
        shared: &LineHandle,
        controller: &Controller,
        demand: &OutputDemand,
        resumes: Option<Cause>,
    ) {
        let state = controller.state();
        let output = shared.profile.output(self.id);
        let copies = *state.copies();
        let is_open = has_unanswered(state) || copies.expired().next().is_some();
        let open = is_open.then_some(copies);
        let is_known = state.shown(&self.settings).verified.is_some();
        if is_known && std::mem::replace(&mut self.on_disk, open) != open {
            // The next start needs this, however this run ends. No line waits for it.
            let _ = shared.ledger.keep(output, state.kept(), false);
        }
        let mut core = shared.core();
        let Some(cz) = self.show(controller, demand, &mut core.outputs[self.id.0]) else { return };
        self.note_place(controller, output, &mut core);
        if core.outputs[self.id.0].standing == RegisterHealth::Verified
            && core.arming[output.axis.0].is_armed()
        {
            let failures = std::mem::take(&mut core.outputs[self.id.0].failures);
            // Both calls are necessary: each ends an alarm.
            if self.failures.end() | self.failures_applied.end() {
                core.events.push(Event::Verified { output: output.name.clone(), failures });
            }
        }
        let Some(cause) = resumes else { return };
        if core.found(self.id, cz) && cause == Cause::Restart {
            let axis = shared.profile.axis(output.axis).settings.name.clone();
            core.events.push(Event::GoesOn { axis, from: cz, way: Channel::Restart });
        }
        drop(core);
        shared.wake_others(shared.profile.device(output.device).bus);
    }

    /// Saves the state of the output in the register ledger (saved record of the written values). Returns `None` if
    /// the disk has not stored the state yet. The next call by the line task then checks again.
    pub(super) async fn keep(
        &mut self,
        turn: &mut LineTurn<'_>,
        controller: &Controller,
    ) -> Option<OutputAnswer> {
        let (shared, now) = (turn.shared, turn.line.last_sample());
        if shared.dry_run {
            return Some(OutputAnswer::Kept);
        }
        let output = shared.profile.output(self.id);
        let is_new = self.keeping.is_none();
        let (version, since) = match self.keeping {
            Some(keeping) => keeping,
            None => {
                // An entry that no write waits for is on disk no later than the next entry that a write waits for.
                let must_keep = controller.must_keep(&self.settings);
                match shared.ledger.keep(output, controller.state().kept(), must_keep) {
                    SaveCondition::Version(version) => (version, now),
                    SaveCondition::Needless => return Some(OutputAnswer::Kept),
                    SaveCondition::Impossible => return Some(OutputAnswer::NotKept),
                }
            }
        };
        self.keeping = Some((version, since));
        let timeout = shared.profile.bus(shared.profile.device(output.device).bus).timeout;
        let span = if is_new || shared.clock.is_virtual() { timeout } else { Duration::ZERO };
        turn.line.send_guard.away_for(span);
        let kept = shared.ledger.kept(version, span, &shared.clock).await;
        let now = turn.line.sample();
        if kept == SaveResult::NotYet && now.since(since) < DISK_PATIENCE {
            return None;
        }
        self.keeping = None;
        if kept == SaveResult::Yes {
            return Some(OutputAnswer::OnDisk);
        }
        if kept == SaveResult::NotYet && controller.trouble() != Some(Trouble::Disk) {
            let why = Explained::new(
                format!("the disk has not answered for {} s", DISK_PATIENCE.as_secs()),
                "check whether the disk is full, slow or broken",
            );
            shared.report(&Event::NotKept { what: WHAT.to_owned(), why });
        }
        Some(OutputAnswer::NotKept)
    }

    /// Returns cause and hint for an axis that is switched off because another client wrote the value `found`.
    fn why_foreign(&self, output: &Output, expected: Counts, found: Counts) -> Explained {
        let settings = &self.settings;
        let (name, at, holds) = (&output.name, &output.address, self.units.in_text(found));
        if found.abs_diff(settings.bias) > settings.limit.unsigned_abs() {
            Explained::new(
                format!("{name} holds an unexpected value ({at}: {holds}, beyond its limit)"),
                "correct the value at the control, then arm the axis",
            )
        } else {
            let is_like_ours = found.abs_diff(expected) <= settings.step.unsigned_abs();
            let hint = match is_like_ours {
                true => {
                    "the change is as small as a step of the gateway: check whether a second gateway writes \
                     to the register. Correct the value at the control, then arm the axis"
                }
                false => "correct the value at the control, then arm the axis",
            };
            Explained::new(
                format!("{name} holds an unexpected value ({at}: {holds}, which this gateway did not write)"),
                hint,
            )
        }
    }

    /// Reports that the control has not applied the register value within the time `settle`.
    fn not_applied(&self, shared: &LineHandle, controller: &Controller, output: &Output) {
        let unit = output.writes.unit();
        let text = |value: f64| format!("{value:.1} {unit}");
        let address = output.applied.as_ref().map(|applied| applied.address);
        let found = shared.core().outputs[self.id.0].applied;
        shared.report(&Event::NotApplied {
            output: output.name.clone(),
            stands: text(self.units.value(controller.held(&self.settings))),
            applies: found.map_or("no number".to_owned(), |(found, _)| text(found)),
            register: address.map_or(String::new(), |address| address.to_string()),
        });
    }

    /// Reports the value of the present register after its first read, if address, scale or owner of the
    /// register has changed since the previous run. Also updates the reason why the axis is off, if the
    /// changed register is this reason.
    fn note_place(&self, controller: &Controller, output: &Output, core: &mut GatewayState) {
        let shown = controller.state().shown(&self.settings);
        let Some(seen) = shown.verified.filter(|_| !shown.is_only_acknowledged) else { return };
        let holds = || self.units.in_text(seen.value);
        let Some((event, why)) = core.places.read(self.id, &output.name, holds) else { return };
        core.events.push(event);
        let place = output.axis.0;
        let axis = &core.given.profile.axes[place].settings.name;
        let is_why = core.arming[place].is_latched() && core.places.is_why(axis, &core.arming[place].why);
        if is_why {
            core.arming[place].why = why;
        }
    }

    /// Publishes the state of a register for the axes and the web page. Returns the Cz in the register, if it is
    /// known.
    fn show(&self, controller: &Controller, demand: &OutputDemand, seen: &mut OutputState) -> Option<Micron> {
        let OutputRegister { units, settings, .. } = self;
        let state = controller.state();
        let shown = state.shown(settings);
        let waits = has_unanswered(state) || shown.waits_until.is_some();
        seen.waits_until = state.waits_until(settings).filter(|_| waits);
        seen.is_waiting = shown.waits_until.is_some();
        seen.is_only_acknowledged = shown.is_only_acknowledged;
        let verified = shown.verified?;
        let share = shown.account.map_or(Counts::ZERO, |account| account.share) + settings.bias;
        let cz = units.cz(if settings.is_shared { share } else { verified.value });
        let account = shown.account.filter(|account| account.doubt.is_none());
        seen.cz = Some(cz);
        seen.shares = account.map(|account| (units.value(account.base), units.value(share)));
        seen.value = Some(units.value(verified.value));
        seen.verified_at = Some(verified.asked);
        seen.standing = match controller.health(settings, demand.interlock)? {
            OutputHealth::Verified => RegisterHealth::Verified,
            OutputHealth::Unverified => RegisterHealth::Unverified,
            OutputHealth::Interlocked => RegisterHealth::Interlocked,
            OutputHealth::Foreign => RegisterHealth::Foreign,
        };
        Some(cz)
    }
}

/// Returns whether the register has an unanswered write that may still arrive.
fn has_unanswered(state: &State) -> bool {
    state.copies().under_way().any(|sent| sent.answered.is_none())
}

/// Converts the fault of an unconfirmed write to a result for the controller.
pub(super) fn not_done((fault, outcome): (Fault, Outcome)) -> WriteResult {
    match (fault, outcome) {
        (Fault::Caller(CallerFault::TooLate), Outcome::NotDone) => WriteResult::TooLate,
        (_, Outcome::NotDone) if fault.has_lapsed() => WriteResult::NotSent,
        (_, Outcome::NotDone) if fault.is_refusal() => WriteResult::Refused,
        (_, Outcome::NotDone) if fault.spoils_connection() => WriteResult::Unreachable,
        (_, Outcome::NotDone) => WriteResult::Rejected,
        _ => WriteResult::Unknown,
    }
}

fn settings(shared: &LineHandle, output: &Output, units: &Units) -> Settings {
    let profile = &shared.profile;
    let device = profile.device(output.device);
    // A constant may arrive at any time.
    let is_constant = output.writes == Writes::Reference;
    let late = if is_constant { Duration::ZERO } else { profile.bus(device.bus).late };
    let can_be_read = device.functions.reads_at(&output.reads_at());
    let (step, limit, bias) = units.bounds(profile, output);
    let applied = output.applied.as_ref().map(|applied| AppliedSettings {
        tolerance: units.thousandths_of(applied.tolerance),
        settle: applied.settle,
    });
    Settings {
        step,
        limit,
        bias,
        range: units.range(),
        late,
        remembered: late.saturating_mul(REMEMBERED),
        every: profile.axis(output.axis).settings.every,
        refresh: output.refresh,
        is_shared: output.share == Share::Ledger,
        verify: if can_be_read { Verify::Reading } else { Verify::Echo },
        applied,
        rules: Rules::default(),
    }
}
