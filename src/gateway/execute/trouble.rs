//! What is wrong with a register, from the first failure until it holds what it should again.

use crate::fieldbus::error::{Fault, Outcome};
use isotherm_core::explained::Cause;
use isotherm_core::output::{Fact, Verify};
use isotherm_profile::counted;

/// So many writes in a row that were not answered by a device whose reads are, are reported.
const DEAF: u64 = 3;
/// Requests that fail in a row for another reason before that is reported.
const CHANGED_AFTER: u32 = 20;

/// Why the register is not what was decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trouble {
    /// The device did not answer.
    Link,
    /// It did not answer a write, and nothing was written since.
    Unanswered,
    /// The device answered, but the register does not hold what was written.
    Untaken,
    /// What must be on disk is not.
    Disk,
}

/// Kind of request that a device was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
}

/// What is wrong, and what is known of it.
#[derive(Debug, Default)]
pub(super) struct Troubles {
    pub(super) now: Option<Trouble>,
    /// What failed and was reported, until it does not fail any more.
    reported: Option<Access>,
    /// Its cause.
    cause: Option<Cause<Fault>>,
    /// Writes that failed since the last one that was answered.
    failed_writes: u64,
    /// The last read was answered.
    is_read: bool,
    /// A write was acknowledged that no read has shown yet.
    is_to_be_seen: bool,
    /// At the end of the last turn its register had not taken what was written.
    pub(super) was_untaken: bool,
}

impl Troubles {
    /// A request has failed. A device that is lost is reported elsewhere; of one that refuses, what is to be reported, which
    /// is put into words then.
    pub(super) fn fails(
        &mut self,
        fault: Fault,
        access: Access,
        in_words: impl FnOnce() -> String,
    ) -> Option<String> {
        self.failed_writes += u64::from(access == Access::Write);
        // One whose reads are answered is not lost, and nobody else reports that its writes are not.
        let is_deaf = access == Access::Write && self.failed_writes >= DEAF && self.is_read;
        let is_reported = !fault.spoils_connection() || is_deaf;
        if is_reported && self.reported.replace(access).is_none() {
            self.cause = None;
        }
        let is_new = is_reported && Cause::is_news(&mut self.cause, fault, CHANGED_AFTER);
        let trouble = match access {
            Access::Read => Trouble::Link,
            Access::Write if fault.spoils_connection() || fault.outcome() == Outcome::Unknown => {
                Trouble::Unanswered
            }
            Access::Write => Trouble::Untaken,
        };
        if !matches!(self.now, Some(Trouble::Untaken | Trouble::Unanswered)) {
            self.now = Some(trouble);
        }
        is_new.then(|| match is_deaf {
            true => format!("{}, {} in a row", in_words(), counted(self.failed_writes, "time")),
            false => in_words(),
        })
    }

    /// An exchange has come to its end with this. Whether what was written is known to stand there now; `None` where the
    /// exchange says nothing of that.
    pub(super) fn comes_of(
        &mut self,
        fact: Fact,
        verify: Verify,
        is_armed: bool,
        is_untaken: bool,
    ) -> Option<bool> {
        match fact {
            Fact::Done { .. } => {
                self.failed_writes = 0;
                self.reported = self.reported.filter(|access| *access != Access::Write);
                self.is_to_be_seen = if verify == Verify::Reading { is_armed } else { self.is_to_be_seen };
                Some(verify == Verify::Echo)
            }
            Fact::Read { .. } => {
                self.is_read = true;
                self.reported = self.reported.filter(|access| *access != Access::Read);
                Some(std::mem::take(&mut self.is_to_be_seen) && !is_untaken)
            }
            Fact::NoAnswer => {
                self.is_read = false;
                None
            }
            _ => None,
        }
    }

    /// It did not take what was written. Whether that was so before.
    pub(super) fn is_untaken(&mut self) -> bool {
        let before = self.now;
        if before != Some(Trouble::Unanswered) {
            self.now = Some(Trouble::Untaken);
        }
        before == Some(Trouble::Untaken)
    }
}
