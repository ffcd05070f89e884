//! The register itself: read, compared, written, verified. What is known of it afterwards is true.

use super::exchange::{self, Cells};
use super::{Trouble, Words, Writer};
use crate::codec::Encoded;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::output::Standing;
use crate::gateway::shared::Shared;
use crate::gateway::words::{can_be_read, cz_factor, in_micron, within_limit, words_in_text};
use crate::observe::events::Event;
use crate::profile::{Output, Stretch};
use crate::quantity::{Micron, Moment};

impl Writer {
    pub(super) async fn read(&self, line: &mut DeviceLine, output: &Output) -> Result<Words, Fault> {
        let request = Request::read(&output.reads_at(), output.encoding.data_type);
        let request = request.ok_or(Fault::Caller(CallerFault::Function))?;
        match line.request(output.device, request, Leave::Whenever).await?.answer {
            Answer::Words(words) => Ok(Encoded::of(&words)),
            Answer::Bits(_) | Answer::Done => Ok(Encoded::of(&[])),
        }
    }

    /// Reads the register. Whether what stands there is ours and the decision is still to be carried out.
    pub(super) async fn is_ours(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        now: Moment,
    ) -> bool {
        if !can_be_read(shared, output) {
            self.compare = false;
            if std::mem::take(&mut self.restarted) {
                // What a restarted control holds that nobody can read: nothing.
                self.take_over(shared, output, Words::of(output.encoding.encode(0.0).words()), now);
                return false;
            }
            return true;
        }
        let found = match self.read(line, output).await {
            Ok(found) => found,
            Err(fault) => {
                self.fail(shared, output, fault);
                return false;
            }
        };
        self.judge(shared, output, found, now)
    }

    /// Whether what was found in the register is ours and the decision is still to be carried out.
    pub(super) fn judge(&mut self, shared: &Shared, output: &Output, found: Words, now: Moment) -> bool {
        let (known, sent) = (self.known, self.uncertain.take());
        let compared = std::mem::take(&mut self.compare);
        let restarted = std::mem::take(&mut self.restarted);
        let arrived = sent == Some(found);
        if known.is_some_and(|known| known != found) && !arrived {
            if restarted {
                self.take_over(shared, output, found, now);
                return false;
            }
            self.not_ours(shared, output, found, now);
            return false;
        }
        self.known = Some(found);
        let is_settled = match self.trouble {
            _ if arrived || known.is_none() => true,
            Some(Trouble::Verify) => false,
            // What was sent did not arrive: only a write that does shows that the device can be written again.
            Some(Trouble::Link | Trouble::Disk) => sent.is_none(),
            None => compared,
        };
        if is_settled {
            self.take_over(shared, output, found, now);
        }
        !is_settled
    }

    /// Something else stands there than what was written last.
    pub(super) fn not_ours(&mut self, shared: &Shared, output: &Output, found: Words, now: Moment) {
        let expected = self.known.map_or(String::new(), |known| words_in_text(output, &known));
        let name = output.name.clone();
        let zero = output.encoding.encode(0.0);
        if found == zero || found.words().iter().all(|word| *word == 0) {
            shared.tell(&Event::CncRestarted { output: name, expected });
            return self.take_over(shared, output, found, now);
        }
        shared.tell(&Event::ForeignChange { output: name, expected, found: words_in_text(output, &found) });
        self.leave_alone(
            shared,
            output,
            found,
            "somebody else wrote to its register; arm it again when that is settled",
        );
    }

    /// What stands in the register is known again: the axis goes on from there.
    pub(super) fn take_over(&mut self, shared: &Shared, output: &Output, found: Words, now: Moment) {
        let Some(cz) = within_limit(&shared.profile, output, &found) else {
            return self.leave_alone(shared, output, found, "its register holds a value beyond its limit");
        };
        self.settle(shared, output, found, now, false);
        shared.core().found(&shared.profile, self.id, cz);
        shared.ring_others(shared.profile.device(output.device).bus);
    }

    /// The axis is off until a person arms it; what stands in the register stays.
    pub(super) fn leave_alone(&mut self, shared: &Shared, output: &Output, found: Words, why: &str) {
        (self.known, self.uncertain, self.trouble) = (Some(found), None, None);
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        state.standing = Standing::Foreign;
        state.cz = in_micron(output, cz_factor(&shared.profile, output), &found);
        state.value = output.encoding.decode(found.words()).ok();
        let axis = &shared.profile.axis(output.axis).settings.name;
        let told = core.disarm(output.axis, axis, why);
        drop(core);
        told.iter().for_each(|event| shared.tell(event));
    }

    /// Writes and verifies; what went wrong is told, and known afterwards.
    pub(super) async fn write(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        target: Words,
        (now, not_after): (Moment, Moment),
    ) -> bool {
        let before = self.uncertain.replace(target);
        let goes_by_reads = output.writes.is_scheduled() && can_be_read(shared, output);
        let leave = if goes_by_reads { Leave::Here(not_after) } else { Leave::By(not_after) };
        if let Err((fault, outcome)) = self.send_all(line, shared, output, target, leave).await {
            if outcome == Outcome::NotDone {
                // What stood there still stands.
                self.uncertain = before;
            }
            if fault.has_lapsed() {
                self.compare = can_be_read(shared, output);
            } else {
                self.fail(shared, output, fault);
            }
            return false;
        }
        if output.verify.reads() {
            match self.read(line, output).await {
                Ok(found) if self.is_verified(shared, output, target, found, now) => {}
                Ok(_) => return false,
                Err(fault) => {
                    self.fail(shared, output, fault);
                    return false;
                }
            }
        }
        self.uncertain = None;
        self.known = Some(target);
        true
    }

    /// Whether what was read back is what was written; where it is not, that is told.
    pub(super) fn is_verified(
        &mut self,
        shared: &Shared,
        output: &Output,
        wrote: Words,
        found: Words,
        now: Moment,
    ) -> bool {
        if found.words() == wrote.words() {
            return true;
        }
        self.uncertain = None;
        if within_limit(&shared.profile, output, &found).is_none() {
            self.not_ours(shared, output, found, now);
            return false;
        }
        self.known = Some(found);
        if self.trouble != Some(Trouble::Verify) {
            let (wrote, found) = (words_in_text(output, &wrote), words_in_text(output, &found));
            shared.tell(&Event::VerifyFailed { output: output.name.clone(), wrote, found });
        }
        self.doubt(shared, Trouble::Verify);
        shared.core().outputs[self.id.0].failures += 1;
        false
    }

    pub(super) fn fail(&mut self, shared: &Shared, output: &Output, fault: Fault) {
        // A device that is lost has been told; one that refuses has not.
        if !fault.spoils_connection() && self.trouble.is_none() {
            shared.tell(&Event::WriteFailed { output: output.name.clone(), fault: fault.to_string() });
        }
        self.doubt(shared, if fault.spoils_connection() { Trouble::Link } else { Trouble::Verify });
        shared.core().outputs[self.id.0].failures += 1;
    }

    /// What stands in the register is not certain any more.
    pub(super) fn doubt(&mut self, shared: &Shared, trouble: Trouble) {
        if self.trouble != Some(Trouble::Verify) {
            self.trouble = Some(trouble);
        }
        shared.core().outputs[self.id.0].doubt();
    }

    /// A register is known to hold this, because it was read or because it was written. After trouble the axis goes on
    /// from there.
    pub(super) fn settle(
        &mut self,
        shared: &Shared,
        output: &Output,
        words: Words,
        now: Moment,
        is_written: bool,
    ) {
        let cz = in_micron(output, cz_factor(&shared.profile, output), &words);
        let recovered = self.trouble.is_some();
        (self.known, self.uncertain) = (Some(words), None);
        let value = output.encoding.decode(words.words()).ok();
        self.settle_as(shared, cz.unwrap_or_default(), value, now, is_written);
        if recovered {
            shared.core().found(&shared.profile, self.id, cz.unwrap_or_default());
        }
    }

    pub(super) fn settle_as(
        &mut self,
        shared: &Shared,
        cz: Micron,
        value: Option<f64>,
        now: Moment,
        is_written: bool,
    ) {
        let mut core = shared.core();
        let state = &mut core.outputs[self.id.0];
        let failures = std::mem::take(&mut state.failures);
        state.standing = Standing::Verified;
        state.writes += u64::from(is_written);
        state.cz = Some(cz);
        state.value = value;
        state.verified_at = Some(now);
        drop(core);
        if self.trouble.take() == Some(Trouble::Verify) {
            let output = shared.profile.output(self.id).name.clone();
            shared.tell(&Event::Verified { output, failures });
        }
    }
}

impl Writer {
    /// The value, with the words of a display that belong beside it.
    async fn send_all(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        output: &Output,
        target: Words,
        leave: Leave,
    ) -> Result<(), (Fault, Outcome)> {
        if output.display.beside.is_empty() {
            let sent = send(line, shared, output, target, leave).await;
            return sent.map_err(|fault| (fault, fault.outcome()));
        }
        let value = output.cells(target.words());
        let shown = self.shown(shared, output);
        let beside = output.display.beside.iter().map(|beside| (beside.register, beside.word(shown)));
        send_cells(line, shared, output, value.chain(beside).collect(), leave).await
    }
}

/// Writes registers, those side by side in one request. The first decides; what belongs to it follows, however late, and
/// where that fails the first has arrived all the same.
pub(super) async fn send_cells(
    line: &mut DeviceLine,
    shared: &Shared,
    output: &Output,
    cells: Cells,
    leave: Leave,
) -> Result<(), (Fault, Outcome)> {
    let device = shared.profile.device(output.device);
    let (mut leave, mut has_sent) = (leave, false);
    let each = cells.keys().map(|register| (*register, 1)).collect();
    for stretch in Stretch::joined(each, device.longest_request()) {
        let words = exchange::words(&cells, &stretch);
        let request = Request::write_holding(stretch.from, &words, device.functions);
        let (leave, has_begun) = (std::mem::replace(&mut leave, Leave::Whenever), has_sent);
        let sent = line.request(output.device, request, leave).await;
        sent.map_err(|fault| (fault, if has_begun { Outcome::Unknown } else { fault.outcome() }))?;
        has_sent = true;
    }
    Ok(())
}

/// Writes the registers of one value; that they stand there is not known yet.
pub(super) async fn send(
    line: &mut DeviceLine,
    shared: &Shared,
    output: &Output,
    target: Words,
    leave: Leave,
) -> Result<(), Fault> {
    let functions = shared.profile.device(output.device).functions;
    let request = Request::write(&output.address, target.words(), functions);
    line.request(output.device, request, leave).await.map(|_| ())
}
