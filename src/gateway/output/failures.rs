//! Failed requests to a register of an output, and the decision which of the failures are reported.

use crate::fieldbus::error::Fault;
use isotherm_core::explained::Cause;
use isotherm_core::output::{Fact, Input};
use isotherm_profile::counted;

/// Number of consecutive unanswered writes after which the failure is reported, although the device answers reads.
const DEAF: u64 = 3;
/// Number of consecutive failures with a new cause, after which this cause is reported.
const CHANGED_AFTER: u32 = 20;

/// Kind of request to the register of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RequestKind {
    Read,
    /// Read of the additional register in which the control reports the value that it applies.
    ReadApplied,
    Write,
}

/// Whether an alarm of the output is active.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Alarm {
    #[default]
    Off,
    Raised,
}

/// Failures of the requests of one register.
#[derive(Debug, Default)]
pub(super) struct Failures {
    /// Kind of the failed request that was reported. `None` if no failure was reported, or if a request of this kind
    /// has succeeded since then.
    reported: Option<RequestKind>,
    /// Reported cause of the failures, and the number of consecutive later failures with another cause.
    cause: Option<Cause<Fault>>,
    /// Number of failed writes since the last answered write.
    failed_writes: u64,
    last_read: LastRead,
    alarm: Alarm,
}

/// Whether the last read of a register was answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum LastRead {
    #[default]
    NotAnswered,
    Answered,
}

impl Failures {
    /// Records a failed request. Returns the text for a report, or `None` if nothing must be reported. Other code
    /// reports a lost device.
    pub(super) fn fails(
        &mut self,
        fault: Fault,
        access: RequestKind,
        in_words: impl FnOnce() -> String,
    ) -> Option<String> {
        self.failed_writes += u64::from(access == RequestKind::Write);
        // A device that answers reads is not lost, so nothing else reports its unanswered writes.
        let is_deaf = access == RequestKind::Write && self.failed_writes >= DEAF;
        let is_deaf = is_deaf && self.last_read == LastRead::Answered;
        let is_reported = !fault.spoils_connection() || is_deaf;
        if is_reported && self.reported.replace(access).is_none() {
            self.cause = None;
        }
        let is_new = is_reported && Cause::is_news(&mut self.cause, fault, CHANGED_AFTER);
        if is_new {
            self.raise();
        }
        is_new.then(|| match is_deaf {
            true => format!("{}, {} in a row", in_words(), counted(self.failed_writes, "time")),
            false => in_words(),
        })
    }

    /// Records that an alarm of the output was reported.
    pub(super) fn raise(&mut self) {
        self.alarm = Alarm::Raised;
    }

    /// Ends the alarm. Returns true if an alarm had been raised.
    pub(super) fn end(&mut self) -> bool {
        std::mem::take(&mut self.alarm) == Alarm::Raised
    }

    /// Records whether the device answers other requests. If it does, the device is not reported as lost. The
    /// output then reports its unanswered writes itself.
    pub(super) fn device_answers(&mut self, answers: bool) {
        self.last_read = if answers { LastRead::Answered } else { LastRead::NotAnswered };
    }

    /// Records the result of an exchange. After a success, the next failure is reported again.
    pub(super) fn result(&mut self, input: Input) {
        match input {
            Input::Fact(Fact::Done { .. }) => {
                self.failed_writes = 0;
                self.reported = self.reported.filter(|access| *access != RequestKind::Write);
            }
            Input::Fact(Fact::Read { .. }) => {
                self.last_read = LastRead::Answered;
                self.reported = self.reported.filter(|access| *access == RequestKind::Write);
            }
            Input::Fact(Fact::NoAnswer) => self.last_read = LastRead::NotAnswered,
            _ => {}
        }
    }
}
