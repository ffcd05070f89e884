//! Reports about the register of an output, for the log, the axes and the web page.

use super::demand::OutputDemand;
use super::register::OutputRegister;
use crate::clock::Clock;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::output::{OutputState, RegisterHealth};
use crate::observe::events::Event;
use isotherm_core::codec::Inadmissible;
use isotherm_core::explained::Explained;
use isotherm_core::output::{self, Account, Controller, OutputHealth, State};
use isotherm_core::quantity::{Counts, Micron};
use isotherm_profile::{Output, OutputId};

/// Converts an event of an output controller to an event of the gateway's event journal. Returns `None` if other code
/// reports it.
pub(super) fn event(
    (register, controller): (&OutputRegister, &Controller),
    output: &Output,
    event: output::Event,
    clock: &Clock,
) -> Option<Event> {
    let is_in_a_node = output.address.node().is_some();
    let when = output.when.as_ref().map_or(String::new(), |when| when.text.clone());
    let output = output.name.clone();
    let in_text = |counts| register.units.in_text(counts);
    let shown = controller.state().shown(&register.settings);
    Some(match event {
        output::Event::OwnWriteArrivedLate { value, sent } => {
            Event::OwnWriteLate { output, value: in_text(value), sent: clock.stamp(sent).to_string() }
        }
        output::Event::PerhapsFromBefore { value } => {
            Event::PerhapsFromBefore { output, value: in_text(value) }
        }
        output::Event::CncRestarted { stood } => {
            let is_zero = shown.verified.is_some_and(|seen| register.settings.is_zero(seen.value));
            let is_seen = !shown.is_only_acknowledged && is_zero;
            return is_seen.then(|| Event::CncRestarted { output, expected: in_text(stood) });
        }
        output::Event::ForeignValue { expected, found } => {
            Event::ForeignChange { output, expected: in_text(expected), found: in_text(found) }
        }
        output::Event::NotTaken { wrote, found } => {
            Event::VerifyFailed { output, wrote: in_text(wrote), found: in_text(found), is_in_a_node }
        }
        output::Event::WaitingForLateWrite { seconds } => Event::WaitsForLateWrite { output, seconds },
        output::Event::AcknowledgedNotReadBack => Event::NotReadBack { output },
        output::Event::OperatorChanged { from, to } => {
            let share = share_in_text(register, shown.account.unwrap_or_default().share);
            Event::OperatorChange { output, from: in_text(from), to: in_text(to), share }
        }
        output::Event::Saturated { value } => {
            Event::Saturated { output, wanted: register.units.value(value) }
        }
        output::Event::Interlocked => Event::Interlocked { output, when },
        output::Event::Released => Event::Released { output },
        output::Event::Opened { base, share } => {
            let share = share_in_text(register, share);
            Event::LedgerOpened { output, base: in_text(base), share }
        }
        // A failed request, a failed disk, and a question to the operator are reported elsewhere. The other events are
        // counted.
        output::Event::WriteRefused { .. }
        | output::Event::DiskDoesNotKeep
        | output::Event::Doubted { .. }
        | output::Event::FirstAccount { .. }
        | output::Event::Late { .. }
        | output::Event::TakeOver { .. }
        | output::Event::Written
        | output::Event::StillUntaken
        | output::Event::Recovered { .. }
        | output::Event::NotApplied
        | output::Event::Question => return None,
    })
}

/// Returns cause and hint for an axis that is switched off because another client wrote the value `found`.
pub(super) fn why_foreign(
    register: &OutputRegister,
    output: &Output,
    expected: Counts,
    found: Counts,
) -> Explained {
    let settings = &register.settings;
    let (name, at, holds) = (&output.name, &output.address, register.units.in_text(found));
    if found.abs_diff(settings.bias) > settings.limit.unsigned_abs() {
        Explained::new(
            format!("the register of output {name} ({at}) holds {holds}, beyond its limit"),
            "correct the value at the control, then arm the axis",
        )
    } else {
        let is_like_ours = found.abs_diff(expected) <= settings.step.unsigned_abs();
        let hint = match is_like_ours {
            true => {
                "the change is as small as a step of the gateway: does a second gateway write to the \
                 register? Correct the value at the control, then arm the axis"
            }
            false => "correct the value at the control, then arm the axis",
        };
        Explained::new(
            format!("the register of output {name} ({at}) holds {holds}, which this gateway did not write"),
            hint,
        )
    }
}

/// Disarms the axis of this output, because the control would read another value than the one to be sent, or one beyond
/// the limit.
pub(super) fn not_sent(shared: &LineHandle, id: OutputId, why: Inadmissible) {
    let output = shared.profile.output(id);
    let axis = &shared.profile.axis(output.axis).settings.name;
    let (name, at) = (&output.name, &output.address);
    let why = Explained::new(
        format!("nothing is sent to output {name} ({at}): {why}"),
        format!(
            "compare scale, bias and type of the output, and limit and diameter of axis {axis}, with the control and with the \
             profile"
        ),
    );
    shared.core().disarm(output.axis, why);
}

/// Reports that the control does not apply the register value within the time `settle`.
pub(super) fn not_applied(
    (register, controller): (&OutputRegister, &Controller),
    shared: &LineHandle,
    output: &Output,
) {
    let unit = output.writes.unit();
    let text = |value: f64| format!("{value:.1} {unit}");
    let address = output.applied.as_ref().map(|applied| applied.address);
    let found = shared.core().outputs[register.id.0].applied;
    shared.report(&Event::NotApplied {
        output: output.name.clone(),
        stands: text(register.units.value(controller.held(&register.settings))),
        applies: found.map_or("no number".to_owned(), |(found, _)| text(found)),
        register: address.map_or(String::new(), |address| address.to_string()),
    });
}

/// Returns the question to the operator which part of the register value is the operator offset, and which part the
/// gateway has added.
pub(super) fn question((register, controller): (&OutputRegister, &Controller), output: &str) -> Event {
    let holds = controller.held(&register.settings);
    let (output, holds) = (output.to_owned(), register.units.in_text(holds));
    let account = controller.state().shown(&register.settings).account;
    let Some(Account { base, share, doubt: Some(doubt) }) = account else {
        return Event::FirstAccount { output, holds };
    };
    let sent = controller.state().copies().under_way().map(|sent| sent.value - base);
    let others = sent.filter(|other| *other != share);
    let others: Vec<_> = others.map(|other| share_in_text(register, other)).collect();
    let perhaps = match others.is_empty() {
        true => String::new(),
        false => format!(" (perhaps {})", others.join(" or ")),
    };
    let share = share_in_text(register, share);
    let why = Explained::new(
        format!(
            "{doubt}; the register holds {holds}, and the gateway share in it is taken to be {share}{perhaps}"
        ),
        format!("set the register to your own offset plus {share}, then arm the axis"),
    );
    Event::LedgerDoubt { output, why }
}

fn share_in_text(register: &OutputRegister, share: Counts) -> String {
    register.units.in_text(share + register.settings.bias)
}

/// Reports the value of the register at its first read, if it is in doubt whether the output wrote to this register
/// before.
pub(super) fn note_place(
    (register, controller): (&OutputRegister, &Controller),
    output: &Output,
    core: &mut GatewayState,
) {
    let shown = controller.state().shown(&register.settings);
    let Some(seen) = shown.verified.filter(|_| !shown.is_only_acknowledged) else { return };
    let holds = || register.units.in_text(seen.value);
    let Some((event, why)) = core.places.read(register.id, &output.name, holds) else { return };
    core.events.push(event);
    let place = output.axis.0;
    let axis = &core.given.profile.axes[place].settings.name;
    let is_why = core.arming[place].is_latched() && core.places.is_why(axis, &core.arming[place].why);
    if is_why {
        core.arming[place].why = why;
    }
}

/// Returns whether a write was sent that was not answered and may still arrive.
pub(super) fn has_unanswered(state: &State) -> bool {
    state.copies().under_way().any(|sent| sent.answered.is_none())
}

/// Publishes the state of a register to axes and web page. Returns the Cz in the register, if it is known.
pub(super) fn show(
    (register, controller): (&OutputRegister, &Controller),
    demand: &OutputDemand,
    seen: &mut OutputState,
) -> Option<Micron> {
    let OutputRegister { units, settings, .. } = register;
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
