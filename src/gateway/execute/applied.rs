//! What the control says it applies of an offset, in a register beside the one that is written: it verifies the write.
//!
//! The register that is written is compared as every other is. After each change of it the control has `settle` to apply
//! what stands there; until it does, nothing else is sent, and after that the axis holds.

use std::time::Duration;

use super::register::Register;
use super::trouble::{Access, Trouble};
use super::{LineTurn, RETRY};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::wire::Request;
use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::Output;

#[derive(Debug, Default)]
pub(super) struct AppliedOffset {
    /// What stands in the register that is written, and since when.
    stands: Option<(Counts, Moment)>,
    /// The control was seen to apply that.
    is_seen: bool,
    /// That it does not was reported.
    is_reported: bool,
    read_at: Option<Moment>,
}

#[derive(Clone, Copy, Debug)]
struct Times {
    /// The last change.
    since: Moment,
    /// How long the control has to apply it; a quick one is not waited for longer than it takes.
    settle: Duration,
    /// The axis's own.
    every: Duration,
}

/// Reads what is applied of a register where that is due, and says what comes of it. When it wants to be called again.
pub(super) async fn look(register: &mut Register, turn: &mut LineTurn<'_>) -> Moment {
    let output = turn.shared.profile.output(register.id);
    let (Some(applied), true) = (&output.applied, register.is_known()) else { return Moment::END };
    let now = turn.line.looked();
    let every = turn.shared.profile.axis(output.axis).settings.every;
    let since = register.applied.since(register.stands(), now);
    let times = Times { since, settle: applied.settle, every };
    if now < register.applied.due(times) {
        register.is_unapplied = !register.applied.is_seen && register.is_driven();
        return register.applied.due(times);
    }
    register.applied.read_at = Some(now);
    let request = Request::Read { from: applied.address, count: applied.encoding.data_type.registers() };
    match turn.line.request(output.device, request, Leave::Whenever).await {
        Ok(answered) => {
            let stands = register.units.value(register.stands());
            let found = applied.encoding.decode(answered.answer.registers()).ok();
            // The arithmetic of floats must not decide.
            let within = applied.tolerance * (1.0 + 1e-9);
            register.applied.is_seen = found.is_some_and(|found| (found - stands).abs() <= within);
            turn.shared.core().outputs[register.id.0].applied = found.map(|found| (found, answered.asked));
            let is_over = now >= times.since.after(applied.settle);
            judge(register, turn.shared, output, (stands, found), is_over);
        }
        Err(fault) => register.fail(turn.shared, fault, Access::Read),
    }
    register.is_unapplied = !register.applied.is_seen && register.is_driven();
    if register.applied.is_seen {
        register.recover(turn.shared);
    }
    register.applied.due(times)
}

fn judge(
    register: &mut Register,
    shared: &LineHandle,
    output: &Output,
    (stands, found): (f64, Option<f64>),
    is_over: bool,
) {
    if register.applied.is_seen {
        register.applied.is_reported = false;
    } else if is_over && register.is_driven() {
        register.is_not_taken(shared);
        if !std::mem::replace(&mut register.applied.is_reported, true) {
            let unit = output.writes.unit();
            let text = |value: f64| format!("{value:.1} {unit}");
            let address = output.applied.as_ref().map(|applied| applied.address);
            shared.report(&Event::NotApplied {
                output: output.name.clone(),
                stands: text(stands),
                applies: found.map_or("no number".to_owned(), text),
                register: address.map_or(String::new(), |address| address.to_string()),
            });
        }
    } else if register.troubles.now == Some(Trouble::Untaken) {
        register.applied.is_reported = false;
    }
}

impl AppliedOffset {
    /// Since when this has stood in the register that is written.
    fn since(&mut self, value: Counts, now: Moment) -> Moment {
        if self.stands.is_none_or(|(stands, _)| stands != value) {
            (self.stands, self.is_seen, self.read_at) = (Some((value, now)), false, None);
        }
        self.stands.map_or(now, |(_, since)| since)
    }

    /// At once after a change, soon, and each time after twice as long, until the control must have settled; each second
    /// while it has not, else with the axis.
    fn due(&self, times: Times) -> Moment {
        let over = times.since.after(times.settle);
        match self.read_at {
            None => Moment::default(),
            Some(read) if self.is_seen => read.after(times.every),
            Some(read) if read < over => {
                let soon = (times.settle / 8).max(2 * read.since(times.since));
                over.min(times.since.after(soon))
            }
            Some(read) => read.after(RETRY),
        }
    }
}
