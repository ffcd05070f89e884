//! What the control says it applies of an offset, in a register beside the one that is written: it verifies the write.
//!
//! The register that is written is compared as every other is. After each change of it the control has `settle` to apply
//! what stands there; until it does, nothing else is sent, and after that the axis holds.

use std::time::Duration;

use super::register::Register;
use super::{Asked, RETRY, Trouble};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_core::quantity::Moment;
use isotherm_profile::Output;

/// What is known of it.
#[derive(Debug, Default)]
pub(super) struct AppliedOffset {
    /// What stands in the register that is written, and since when.
    stands: Option<(i64, Moment)>,
    /// The control was seen to apply that.
    is_seen: bool,
    /// That it does not was told.
    is_told: bool,
    /// When it was read last.
    read_at: Option<Moment>,
}

/// When it is looked at.
#[derive(Clone, Copy, Debug)]
struct Times {
    /// The last change.
    since: Moment,
    /// How long the control has to apply it; a quick one is not waited for longer than it takes.
    settle: Duration,
    /// The axis's own.
    every: Duration,
}

impl AppliedOffset {
    /// Reads it where that is due, and says what comes of it. When it wants to be called again.
    pub(super) async fn look(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        output: &Output,
        register: &mut Register,
    ) -> Moment {
        let (Some(applied), true) = (&output.applied, register.is_known()) else { return Moment::END };
        let now = line.looked();
        let value = register.stands();
        if self.stands.is_none_or(|(stands, _)| stands != value) {
            (self.stands, self.is_seen, self.read_at) = (Some((value, now)), false, None);
        }
        let since = self.stands.map_or(now, |(_, since)| since);
        let every = shared.profile.axis(output.axis).settings.every;
        let times = Times { since, settle: applied.settle, every };
        if now < self.due(times) {
            register.is_unapplied = !self.is_seen && register.is_driven();
            return self.due(times);
        }
        self.read_at = Some(now);
        let request = Request::Read { from: applied.address, count: applied.encoding.data_type.registers() };
        match line.request(output.device, request, Leave::Whenever).await {
            Ok(answered) => {
                let Answer::Words(words) = answered.answer else { return self.due(times) };
                let stands = register.units.value(&output.encoding, value);
                let found = applied.encoding.decode(&words).ok();
                // The arithmetic of floats must not decide.
                let within = applied.tolerance * (1.0 + 1e-9);
                self.is_seen = found.is_some_and(|found| (found - stands).abs() <= within);
                shared.core().outputs[register.id.0].applied = found.map(|found| (found, answered.asked));
                self.judge(shared, output, register, (stands, found), now >= since.after(applied.settle));
            }
            Err(fault) => register.fail(shared, output, fault, Asked::Read),
        }
        register.is_unapplied = !self.is_seen && register.is_driven();
        if self.is_seen {
            register.recover(shared, output);
        }
        self.due(times)
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

    fn judge(
        &mut self,
        shared: &LineHandle,
        output: &Output,
        register: &mut Register,
        (stands, found): (f64, Option<f64>),
        is_over: bool,
    ) {
        if self.is_seen {
            self.is_told = false;
        } else if is_over && register.is_driven() {
            register.is_not_taken(shared);
            if !std::mem::replace(&mut self.is_told, true) {
                let unit = output.writes.unit();
                let text = |value: f64| format!("{value:.1} {unit}");
                shared.report(&Event::NotApplied {
                    output: output.name.clone(),
                    stands: text(stands),
                    applies: found.map_or("no number".to_owned(), text),
                    register: output
                        .applied
                        .as_ref()
                        .map_or(String::new(), |applied| applied.address.to_string()),
                });
            }
        } else if register.trouble == Some(Trouble::Untaken) {
            self.is_told = false;
        }
    }
}
