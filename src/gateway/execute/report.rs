//! What people, the axes and the disk learn of an output.

use super::{Asked, Executor, Trouble};
use crate::fieldbus::error::{Fault, Outcome};
use crate::gateway::apply::Order;
use crate::gateway::output::Standing;
use crate::gateway::shared::Shared;
use crate::observe::events::Event;
use crate::output::{self, Fact, Verify};
use crate::profile::Output;

impl Executor {
    /// Tells what the step has found out; what switches off does that here.
    pub(super) fn report(&mut self, shared: &Shared) {
        let output = shared.profile.output(self.id);
        let name = || output.name.clone();
        let in_text = |counts| self.units.in_text(output, counts);
        let mut has_restarted = false;
        for event in self.state.take_events().iter() {
            match *event {
                output::Event::OwnWriteArrivedLate { value, sent } => {
                    let (value, sent) = (in_text(value), sent.to_string());
                    shared.tell(&Event::OwnWriteLate { output: name(), value, sent });
                    self.goes_on_from_there = true;
                }
                output::Event::PerhapsFromBefore { value } => {
                    shared.tell(&Event::PerhapsFromBefore { output: name(), value: in_text(value) });
                    self.goes_on_from_there = true;
                }
                output::Event::CncRestarted { stood } => {
                    let seen = self.state.shown(&self.settings);
                    let is_zero = |value: i64| value == 0 || value == self.settings.bias;
                    if !seen.is_only_acknowledged && seen.verified.is_some_and(|seen| is_zero(seen.value)) {
                        shared.tell(&Event::CncRestarted { output: name(), expected: in_text(stood) });
                    }
                    (has_restarted, self.goes_on_from_there) = (true, true);
                }
                output::Event::ForeignValue { expected, found } => {
                    if !has_restarted {
                        let (expected, found) = (in_text(expected), in_text(found));
                        shared.tell(&Event::ForeignChange { output: name(), expected, found });
                    }
                    let is_beyond = found.abs_diff(self.settings.bias) > self.settings.limit.unsigned_abs();
                    let why = if is_beyond {
                        "its register holds a value beyond its limit"
                    } else {
                        "somebody else wrote to its register; arm it again when that is settled"
                    };
                    self.goes_on_from_there = false;
                    self.heard.is_armed = false;
                    self.disarm(shared, output, why);
                }
                output::Event::NotTaken { wrote, found } => {
                    let (wrote, found) = (in_text(wrote), in_text(found));
                    shared.tell(&Event::VerifyFailed { output: name(), wrote, found });
                }
                output::Event::WaitingForLateWrite { seconds } => {
                    shared.tell(&Event::WaitsForLateWrite { output: name(), seconds });
                }
                output::Event::AcknowledgedNotReadBack => {
                    shared.tell(&Event::NotReadBack { output: name() });
                }
                // Where the request failed, and where the disk did, that was told; the last three are of shared registers.
                output::Event::WriteRefused { .. }
                | output::Event::DiskDoesNotKeep
                | output::Event::OperatorChanged { .. }
                | output::Event::Doubted { .. }
                | output::Event::FirstAccount { .. } => {}
            }
        }
    }

    fn disarm(&self, shared: &Shared, output: &Output, why: &str) {
        let axis = &shared.profile.axis(output.axis).settings.name;
        let told = shared.core().disarm(output.axis, axis, why);
        told.iter().for_each(|event| shared.tell(event));
    }

    /// A request has failed. A device that is lost has been told; one that refuses has not.
    pub(super) fn fail(&mut self, shared: &Shared, output: &Output, fault: Fault, asked: Asked) {
        if !fault.spoils_connection() && self.told.replace(asked).is_none() {
            shared.tell(&Event::WriteFailed { output: output.name.clone(), fault: fault.to_string() });
        }
        let trouble = match asked {
            Asked::Read => Trouble::Link,
            Asked::Write if fault.spoils_connection() || fault.outcome() == Outcome::Unknown => {
                Trouble::Unanswered
            }
            Asked::Write => Trouble::Untaken,
        };
        if !matches!(self.trouble, Some(Trouble::Untaken | Trouble::Unanswered)) {
            self.trouble = Some(trouble);
        }
        shared.core().outputs[self.id.0].failures += 1;
    }

    /// What an exchange that has come to its end says of the trouble before it.
    pub(super) fn look_back(&mut self, shared: &Shared, output: &Output, fact: Fact) {
        let shown = self.state.shown(&self.settings);
        self.told = self.told.filter(|asked| match fact {
            Fact::Done { .. } => *asked != Asked::Write,
            Fact::Read { .. } => *asked != Asked::Read,
            _ => true,
        });
        let is_written = match fact {
            Fact::Done { .. } if self.settings.verify == Verify::Reading => {
                self.is_to_be_seen = true;
                false
            }
            Fact::Done { .. } => true,
            Fact::Read { .. } => std::mem::take(&mut self.is_to_be_seen) && !shown.is_untaken,
            _ => return,
        };
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        if shown.is_untaken {
            if !matches!(self.trouble, Some(Trouble::Unanswered)) {
                state.failures += u64::from(self.trouble == Some(Trouble::Untaken));
                self.trouble = Some(Trouble::Untaken);
            }
            return;
        }
        state.writes += u64::from(is_written);
        let is_over = match self.trouble {
            Some(Trouble::Untaken | Trouble::Unanswered | Trouble::Link) => true,
            None | Some(Trouble::Disk) => false,
        };
        if !is_over {
            return;
        }
        let failures = std::mem::take(&mut state.failures);
        drop(core);
        if self.trouble.take() == Some(Trouble::Untaken) && self.was_untaken {
            shared.tell(&Event::Verified { output: output.name.clone(), failures });
        }
        self.goes_on_from_there = true;
    }

    /// What is known of the register now.
    pub(super) fn publish(&mut self, shared: &Shared, output: &Output, order: &Order) {
        let shown = self.state.shown(&self.settings);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let copies = self.state.copies();
        let unanswered = copies.under_way().any(|sent| sent.answered.is_none());
        let waits = unanswered || shown.waits_until.is_some();
        state.waits_until = self.state.waits_until(&self.settings).filter(|_| waits);
        self.was_untaken = self.trouble == Some(Trouble::Untaken);
        let was_waiting = std::mem::replace(&mut self.is_waiting, shown.waits_until.is_some());
        self.goes_on_from_there |= was_waiting && !self.is_waiting;
        let Some(verified) = shown.verified else { return };
        let is_open = unanswered || copies.lately().next().is_some();
        let open = is_open.then_some(*copies);
        if std::mem::replace(&mut self.on_disk, open) != open {
            // In time for the next start, however this run ends; nobody waits for it.
            let _ = shared.promises.keep(&shared.profile, output, self.state.kept());
        }
        let cz = self.units.cz(&output.encoding, verified.value);
        state.cz = Some(cz);
        state.value = Some(self.units.value(&output.encoding, verified.value));
        state.verified_at = Some(verified.asked);
        state.standing = match (shown.standing, order.allowed) {
            (output::Standing::Barred, _) => Standing::Foreign,
            (_, Some(false)) if self.heard.is_held => Standing::Interlocked,
            (_, None) if self.heard.is_held => Standing::Unverified,
            _ if self.trouble.is_some() => Standing::Unverified,
            _ => Standing::Verified,
        };
        let goes_on = std::mem::take(&mut self.goes_on_from_there) && self.heard.is_armed;
        if goes_on && self.trouble.is_none() {
            core.found(&shared.profile, self.id, cz);
            drop(core);
            shared.ring_others(shared.profile.device(output.device).bus);
        }
    }
}
