//! Reports about the register of an output, for the log and the axes.

use super::register::OutputRegister;
use crate::clock::Clock;
use crate::gateway::shared::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_core::codec::Inadmissible;
use isotherm_core::explained::Explained;
use isotherm_core::output::{self, Account, Controller};
use isotherm_core::quantity::Counts;
use isotherm_profile::{Output, OutputId};

/// Converts an event of an output controller to an event for the event journal of the gateway. Returns `None` if
/// other code reports the event.
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

/// Disarms the axis of this output, because the control would read a wrong value, or a value beyond the limit.
pub(super) fn not_sent(shared: &LineHandle, id: OutputId, why: Inadmissible) {
    let output = shared.profile.output(id);
    let axis = &shared.profile.axis(output.axis).settings.name;
    let (name, at) = (&output.name, &output.address);
    let why = Explained::new(
        format!("nothing is sent to output {name} ({at}): {why}"),
        format!(
            "check whether scale, bias and type of the output, and limit and diameter of axis {axis}, fit \
             the control"
        ),
    );
    shared.core().disarm(output.axis, why);
}

/// Returns the event with a question to the operator about the value of a shared register: which part is the operator
/// offset, and which part is from the gateway?
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
            "{doubt}; the register holds {holds}, and the gateway share in it is assumed to be \
             {share}{perhaps}"
        ),
        format!("set the register to the operator offset plus {share}, then arm the axis"),
    );
    Event::LedgerDoubt { output, why }
}

fn share_in_text(register: &OutputRegister, share: Counts) -> String {
    register.units.in_text(share + register.settings.bias)
}
