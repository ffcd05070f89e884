//! What people, the axes and the disk learn of an output.

use super::order::Order;
use super::register::Register;
use super::{Asked, DEAF, Trouble};
use crate::fieldbus::error::{Fault, Outcome};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::Standing;
use crate::observe::events::Event;
use isotherm_core::output::{self, Account, Fact, Verify};
use isotherm_profile::Output;

impl Register {
    /// Tells what the step has found out; what switches off does that here.
    pub(super) fn report(&mut self, shared: &LineHandle) {
        let output = shared.profile.output(self.id);
        let name = || output.name.clone();
        let in_text = |counts| self.units.in_text(output, counts);
        let mut has_restarted = false;
        for event in self.state.take_events().iter() {
            match *event {
                output::Event::OwnWriteArrivedLate { value, sent } => {
                    let (value, sent) = (in_text(value), sent.to_string());
                    shared.report(&Event::OwnWriteLate { output: name(), value, sent });
                    self.goes_on_from_there = true;
                }
                output::Event::PerhapsFromBefore { value } => {
                    shared.report(&Event::PerhapsFromBefore { output: name(), value: in_text(value) });
                    self.goes_on_from_there = true;
                }
                output::Event::CncRestarted { stood } => {
                    let seen = self.state.shown(&self.settings);
                    let is_zero = seen.verified.is_some_and(|seen| self.settings.is_zero(seen.value));
                    if !seen.is_only_acknowledged && is_zero {
                        shared.report(&Event::CncRestarted { output: name(), expected: in_text(stood) });
                    }
                    (has_restarted, self.goes_on_from_there) = (true, true);
                }
                output::Event::ForeignValue { expected, found } => {
                    if !has_restarted {
                        let (expected, found) = (in_text(expected), in_text(found));
                        shared.report(&Event::ForeignChange { output: name(), expected, found });
                    }
                    let is_beyond = found.abs_diff(self.settings.bias) > self.settings.limit.unsigned_abs();
                    let (holds, at) = (in_text(found), &output.address);
                    let why = if is_beyond {
                        format!(
                            "the register of output {} ({at}) holds {holds}, beyond its limit",
                            output.name
                        )
                    } else {
                        format!(
                            "somebody else wrote {holds} to the register of output {} ({at})",
                            output.name
                        )
                    };
                    self.goes_on_from_there = false;
                    self.heard.is_armed = false;
                    shared.core().disarm(output.axis, &why);
                }
                output::Event::NotTaken { wrote, found } => {
                    let (wrote, found) = (in_text(wrote), in_text(found));
                    shared.report(&Event::VerifyFailed { output: name(), wrote, found });
                }
                output::Event::WaitingForLateWrite { seconds } => {
                    shared.report(&Event::WaitsForLateWrite { output: name(), seconds });
                }
                output::Event::AcknowledgedNotReadBack => {
                    shared.report(&Event::NotReadBack { output: name() });
                }
                output::Event::OperatorChanged { from, to } => {
                    let account = self.state.shown(&self.settings).account.unwrap_or_default();
                    let share = self.share_in_text(output, account.share);
                    let (from, to) = (in_text(from), in_text(to));
                    shared.report(&Event::OperatorChange { output: name(), from, to, share });
                }
                // Where the request failed, and where the disk did, that was told; what a person has to say is asked at the
                // end of the turn.
                output::Event::WriteRefused { .. }
                | output::Event::DiskDoesNotKeep
                | output::Event::Doubted { .. }
                | output::Event::FirstAccount { .. } => {}
            }
        }
    }

    fn share_in_text(&self, output: &Output, share: i64) -> String {
        self.units.in_text(output, share.saturating_add(self.settings.bias))
    }

    /// Tells whose part is what, now that it is on disk.
    pub(super) fn tell_opened(&mut self, shared: &LineHandle, output: &Output) {
        let Some(account) = self.state.shown(&self.settings).account else { return };
        if std::mem::take(&mut self.opens) {
            shared.report(&Event::LedgerOpened {
                output: output.name.clone(),
                base: self.units.in_text(output, account.base),
                share: self.share_in_text(output, account.share),
            });
        }
    }

    /// Only a person can say what of the register is whose: the axis is off until one arms it, and the register stays.
    fn ask(&mut self, shared: &LineHandle, output: &Output) {
        let shown = self.state.shown(&self.settings);
        let is_asked = self.settings.is_shared && shown.standing == output::Standing::Barred;
        let Some(verified) = shown.verified.filter(|_| is_asked && !shared.dry_run) else { return };
        if std::mem::replace(&mut self.has_asked, true) {
            // The person who arms it next must not be overruled.
            return;
        }
        let name = output.name.clone();
        let holds = self.units.in_text(output, verified.value);
        shared.report(&match shown.account {
            Some(Account { base, share, doubt: Some(doubt) }) => {
                let sent = self.state.copies().under_way().map(|sent| sent.value.saturating_sub(base));
                let others = sent.filter(|other| *other != share);
                let others: Vec<_> = others.map(|other| self.share_in_text(output, other)).collect();
                let perhaps = match others.is_empty() {
                    true => String::new(),
                    false => format!(" (perhaps {})", others.join(" or ")),
                };
                let share = self.share_in_text(output, share);
                let why = format!(
                    "{doubt}; it holds {holds}, of which {share}{perhaps} are taken to be ours: make it your own value \
                     plus {share}, then arm the axis"
                );
                Event::LedgerDoubt { output: name, why }
            }
            _ => Event::FirstAccount { output: name, holds },
        });
        self.heard.is_armed = false;
        shared.core().disarm(output.axis, "what of its register is ours is in question");
    }

    /// A request has failed. A device that is lost has been told; one that refuses has not.
    pub(super) fn fail(&mut self, shared: &LineHandle, output: &Output, fault: Fault, asked: Asked) {
        if asked == Asked::Write && !self.heard.is_armed {
            // It only went along.
            return;
        }
        let in_a_row = if asked == Asked::Write { self.failed_writes + 1 } else { self.failed_writes };
        self.failed_writes = in_a_row;
        // One whose reads are answered is not lost, and nobody else tells that its writes are not.
        let is_deaf = asked == Asked::Write && in_a_row >= DEAF && self.is_read;
        if (!fault.spoils_connection() || is_deaf) && self.told.replace(asked).is_none() {
            let times = if is_deaf { format!(", {in_a_row} times in a row") } else { String::new() };
            let fault = format!("{fault}{times}");
            shared.report(&Event::WriteFailed { output: output.name.clone(), fault });
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
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        (state.failures, state.cause) = (state.failures + 1, Some(fault));
    }

    /// What an exchange that has come to its end says of the trouble before it.
    pub(super) fn look_back(&mut self, shared: &LineHandle, output: &Output, fact: Fact) {
        let shown = self.state.shown(&self.settings);
        match fact {
            Fact::Done { .. } => self.failed_writes = 0,
            Fact::Read { .. } => self.is_read = true,
            Fact::NoAnswer => self.is_read = false,
            _ => {}
        }
        self.told = self.told.filter(|asked| match fact {
            Fact::Done { .. } => *asked != Asked::Write,
            Fact::Read { .. } => *asked != Asked::Read,
            _ => true,
        });
        let is_written = match fact {
            Fact::Done { .. } if self.settings.verify == Verify::Reading => {
                self.is_to_be_seen = self.heard.is_armed;
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
        drop(core);
        if !self.is_bound && !self.is_unapplied {
            self.recover(shared, output);
        }
    }

    /// The control did not take what it holds.
    pub(super) fn is_not_taken(&mut self, shared: &LineHandle) {
        if self.is_driven() {
            self.trouble = Some(Trouble::Untaken);
            shared.core().outputs[self.id.0].failures += 1;
        }
    }

    /// It holds what it should, and can be written again.
    pub(super) fn recover(&mut self, shared: &LineHandle, output: &Output) {
        let is_over = match self.trouble {
            Some(Trouble::Untaken | Trouble::Unanswered | Trouble::Link) => true,
            None | Some(Trouble::Disk) => false,
        };
        if !is_over {
            return;
        }
        let failures = std::mem::take(&mut shared.core().outputs[self.id.0].failures);
        if self.trouble.take() == Some(Trouble::Untaken) && self.was_untaken {
            shared.report(&Event::Verified { output: output.name.clone(), failures });
        }
        self.goes_on_from_there = true;
    }

    /// What is known of the register now.
    pub(super) fn publish(&mut self, shared: &LineHandle, output: &Output, order: &Order) {
        self.ask(shared, output);
        let shown = self.state.shown(&self.settings);
        let copies = *self.state.copies();
        let unanswered = copies.under_way().any(|sent| sent.answered.is_none());
        self.was_untaken = self.trouble == Some(Trouble::Untaken);
        let was_waiting = std::mem::replace(&mut self.is_waiting, shown.waits_until.is_some());
        self.goes_on_from_there |= was_waiting && !self.is_waiting;
        let is_open = unanswered || copies.lately().next().is_some();
        let open = is_open.then_some(copies);
        if shown.verified.is_some() && std::mem::replace(&mut self.on_disk, open) != open {
            // In time for the next start, however this run ends; nobody waits for it.
            let _ = shared.ledger.keep(&shared.profile, output, self.state.kept(), false);
        }
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let waits = unanswered || shown.waits_until.is_some();
        state.waits_until = self.state.waits_until(&self.settings).filter(|_| waits);
        state.is_waiting = shown.waits_until.is_some();
        state.is_only_acknowledged = shown.is_only_acknowledged;
        let Some(verified) = shown.verified else { return };
        let encoding = &output.encoding;
        let share = shown.account.map_or(0, |account| account.share);
        let cz = match self.settings.is_shared {
            true => self.units.cz_of_share(encoding, share),
            false => self.units.cz(encoding, verified.value),
        };
        let account = shown.account.filter(|account| account.doubt.is_none());
        state.cz = Some(cz);
        state.shares = account
            .map(|account| (self.units.value(encoding, account.base), self.units.part(encoding, share)));
        state.value = Some(self.units.value(encoding, verified.value));
        state.verified_at = Some(verified.asked);
        state.standing = match (shown.standing, order.allowed) {
            (output::Standing::Barred, _) => Standing::Foreign,
            (_, Some(false)) if self.interlock.is_held => Standing::Interlocked,
            (_, None) if self.interlock.is_held => Standing::Unverified,
            _ if self.trouble.is_some() => Standing::Unverified,
            _ => Standing::Verified,
        };
        let goes_on = std::mem::take(&mut self.goes_on_from_there) && self.heard.is_armed;
        if goes_on && self.trouble.is_none() {
            core.found(&shared.profile, self.id, cz);
            drop(core);
            shared.wake_others(shared.profile.device(output.device).bus);
        }
    }
}
