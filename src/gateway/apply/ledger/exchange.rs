//! The exchanges with a register that is not ours alone: read it, write a share, read that back.

use super::super::register::send;
use super::super::{Order, Trouble, Words, Writer};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::Outcome;
use crate::fieldbus::line::DeviceLine;
use crate::gateway::ledger::{Account, Doubt, Finding, ReadBack};
use crate::gateway::shared::Shared;
use crate::gateway::words::{cz_factor, words_in_text};
use crate::observe::events::Event;
use crate::profile::Output;
use crate::quantity::{Micron, Moment};

/// What stands in the register.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) counts: i64,
    /// It reads as it does after a restart of the CNC.
    pub(super) cleared: bool,
    /// It is the first look since the CNC was restarted.
    pub(super) rebooted: bool,
    pub(super) words: Words,
}

impl Writer {
    /// Reads the register; what goes wrong is told.
    pub(super) async fn find(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
    ) -> Option<Found> {
        let words = match self.read(line, output).await {
            Ok(words) => words,
            Err(fault) => {
                self.fail(shared, output, fault);
                return None;
            }
        };
        let counts = output.encoding.counts(words.words())?;
        let cleared = counts == 0 || words.words().iter().all(|word| *word == 0);
        let rebooted = std::mem::take(&mut self.restarted);
        Some(Found { counts, cleared, rebooted, words })
    }

    /// Writes base + this share, which the account on disk names, and reads it back.
    pub(super) async fn write_share(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        order: &Order,
        share: i64,
    ) {
        let Some(account) = &mut self.joint.account else { return };
        let before = account.clone();
        *account = account.promising(share);
        let target = Words::of(output.encoding.encode_counts(account.with(share)).words());
        let now = shared.clock.now();
        self.joint.promised_at = now;
        let not_after = if before.share() == share { Moment::END } else { order.not_after };
        if let Err(fault) = send(line, shared, output, target, Leave::Here(not_after)).await {
            if fault.outcome() == Outcome::NotDone {
                // What stood there still stands.
                self.joint.account = Some(before);
                self.keep(shared, output);
            }
            if fault.has_lapsed() {
                self.compare = true;
                return;
            }
            return self.fail(shared, output, fault);
        }
        let Some(found) = self.find(line, shared, output).await else { return };
        let Some(account) = &mut self.joint.account else { return };
        let read_back = account.read_back(share, found.counts, found.cleared);
        let was_odd = std::mem::replace(&mut self.joint.odd, matches!(read_back, ReadBack::Then(_)));
        match read_back {
            ReadBack::Ignored => {
                if self.trouble != Some(Trouble::Verify) {
                    let (output, wrote) = (output.name.clone(), words_in_text(output, &target));
                    let found = words_in_text(shared.profile.output(self.id), &found.words);
                    shared.tell(&Event::VerifyFailed { output, wrote, found });
                }
                self.doubt(shared, Trouble::Verify);
                shared.core().outputs[self.id.0].failures += 1;
                return;
            }
            ReadBack::Verified => self.keep(shared, output),
            ReadBack::Then(_) if was_odd => {
                // A device that stores something else than it is told looks like an operator who is always quicker.
                account.doubt_for(Doubt::Unsteady);
                return self.question(shared, output, found);
            }
            ReadBack::Then(finding) => {
                let arrived = Account::clone(account);
                let before = if finding == Finding::Restarted { before } else { arrived };
                self.report(shared, output, &before, finding, found, now);
                if finding != Finding::Restarted && self.joint.doubt().is_none() {
                    self.settle_share(shared, output, now, true);
                }
            }
        }
        if read_back == ReadBack::Verified {
            self.settle_share(shared, output, now, true);
        }
        (self.applied, self.written_at) = (order.decided, now);
    }

    /// The register is known to hold base + share. After trouble the axis goes on from there.
    pub(super) fn settle_share(
        &mut self,
        shared: &Shared,
        output: &Output,
        now: Moment,
        is_written: bool,
    ) -> Micron {
        let Some(account) = &self.joint.account else { return Micron::ZERO };
        let value = |counts| output.encoding.value_of(counts);
        let (base, share) = (value(account.base()), value(account.share()));
        let sum = value(account.with(account.share()));
        let cz = Micron::new(share / cz_factor(&shared.profile, output)).unwrap_or_default();
        let recovered = self.trouble.is_some();
        self.settle_as(shared, cz, Some(sum), now, is_written);
        let mut core = shared.core();
        core.outputs[self.id.0].shares = Some((base, share));
        if recovered {
            core.found(&shared.profile, self.id, cz);
        }
        cz
    }
}
