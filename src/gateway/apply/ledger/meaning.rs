//! What a register that is not ours alone means, and who is told.

use std::time::Duration;

use super::super::Writer;
use super::exchange::Found;
use crate::gateway::ledger::{Account, Finding};
use crate::gateway::output::Standing;
use crate::gateway::shared::Shared;
use crate::gateway::words::{counts_in_text, cz_factor, words_in_text};
use crate::observe::events::Event;
use crate::profile::Output;
use crate::quantity::{Micron, Moment};

/// What was sent and not seen for this long has not arrived and will not.
const LATEST_ARRIVAL: Duration = Duration::from_secs(10);

impl Writer {
    /// Takes note of what the register means, tells it, and has it kept.
    pub(super) fn note(&mut self, shared: &Shared, output: &Output, found: Found, now: Moment) -> Finding {
        let Some(account) = &mut self.joint.account else { return Finding::Same };
        let before = account.clone();
        let finding = match found.rebooted {
            true => account.find_rebooted(found.counts, found.cleared),
            false => account.find(found.counts, found.cleared),
        };
        if finding == Finding::Same
            && !account.promised().is_empty()
            && now.since(self.joint.promised_at) >= LATEST_ARRIVAL
        {
            if self.joint.promised_at == Moment::default() {
                // Another run promised it: its time begins now.
                self.joint.promised_at = now;
            } else {
                account.forget_promises();
                self.keep(shared, output);
            }
        }
        self.report(shared, output, &before, finding, found, now);
        finding
    }

    pub(super) fn report(
        &mut self,
        shared: &Shared,
        output: &Output,
        before: &Account,
        finding: Finding,
        found: Found,
        now: Moment,
    ) {
        let name = output.name.clone();
        let text = |counts| counts_in_text(output, counts);
        match finding {
            Finding::Same => return,
            Finding::Arrived => {}
            Finding::Moved { from, to } => shared.tell(&Event::OperatorChange {
                output: name,
                from: text(from),
                to: text(to),
                share: text(before.share()),
            }),
            Finding::Restarted => {
                let expected = text(before.with(before.share()));
                shared.tell(&Event::CncRestarted { output: name, expected });
            }
            Finding::InQuestion => return self.question(shared, output, found),
        }
        self.keep(shared, output);
        if matches!(finding, Finding::Arrived | Finding::Restarted) && self.joint.is_kept {
            let cz = self.settle_share(shared, output, now, false);
            shared.core().found(&shared.profile, self.id, cz);
            shared.ring_others(shared.profile.device(output.device).bus);
        }
    }

    /// Only a person can say what of the register is ours: the axis is off until one arms it, and the register stays.
    pub(super) fn question(&mut self, shared: &Shared, output: &Output, found: Found) {
        let Some((account, doubt)) = self.joint.account.as_ref().zip(self.joint.doubt()) else { return };
        let share = counts_in_text(output, account.share());
        let others: Vec<_> = account.promised().iter().map(|share| counts_in_text(output, *share)).collect();
        let perhaps =
            if others.is_empty() { String::new() } else { format!(" (perhaps {})", others.join(" or ")) };
        let stands = words_in_text(output, &found.words);
        let why = format!(
            "{doubt}; it holds {stands}, of which {share}{perhaps} are taken to be ours: make it your own value plus {share}, \
             then arm the axis"
        );
        let cz = Micron::new(output.encoding.value_of(account.share()) / cz_factor(&shared.profile, output));
        self.trouble = None;
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        (state.standing, state.cz, state.shares) = (Standing::Foreign, cz, None);
        state.value = output.encoding.decode(found.words.words()).ok();
        if std::mem::replace(&mut self.joint.doubt_told, true) {
            // The person who arms it next must not be overruled.
            return;
        }
        let axis = &shared.profile.axis(output.axis).settings.name;
        let told = core.disarm(output.axis, axis, "what of its register is ours is in question");
        drop(core);
        self.keep(shared, output);
        shared.tell(&Event::LedgerDoubt { output: output.name.clone(), why });
        told.iter().for_each(|event| shared.tell(event));
    }
}
