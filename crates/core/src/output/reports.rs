//! Pending events of an output, and the conditions that have already been reported.

use serde::{Deserialize, Serialize};

use super::event::Event;
use super::slots::Slots;

/// Condition that is reported when it begins, and not repeated while it lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topic {
    /// The device acknowledges writes, and the register is not read.
    Acknowledged,
    /// The state of the output cannot be saved to disk.
    Disk,
    /// The decision exceeds the range of the register.
    Range,
    /// The interlock does not allow writing.
    Interlock,
    /// The control does not apply the register value.
    Applied,
    /// Only the operator can say which part of the register value is the operator offset.
    Question,
    /// Both parts of the register value (operator offset and gateway share) are known, and saved on disk.
    Division,
}

/// Conditions that have been reported and have not ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct ReportedTopics(u8);

impl ReportedTopics {
    const fn bit(topic: Topic) -> u8 {
        1 << topic as u8
    }

    /// Records that a condition is reported. Returns true if it was not reported before.
    pub(super) fn first(&mut self, topic: Topic) -> bool {
        let is_first = self.0 & ReportedTopics::bit(topic) == 0;
        self.0 |= ReportedTopics::bit(topic);
        is_first
    }

    /// Records that a condition has ended. Returns true if it had been reported.
    pub(super) fn over(&mut self, topic: Topic) -> bool {
        let was_said = self.0 & ReportedTopics::bit(topic) != 0;
        self.0 &= !ReportedTopics::bit(topic);
        was_said
    }
}

/// Events of [`step`](super::step) that the caller has not taken yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Reports {
    events: Slots<Event, 8>,
    said: ReportedTopics,
}

impl Reports {
    /// Adds an event. A step reports three at most, and the caller takes them after each step.
    pub(super) fn report(&mut self, event: Event) {
        let _ = self.events.push(event);
    }

    /// Reports that the state of the output cannot be saved to disk. The report is not repeated until a write to disk
    /// succeeds.
    pub(super) fn report_disk(&mut self) {
        if self.said.first(Topic::Disk) {
            self.report(Event::DiskDoesNotKeep);
        }
    }

    /// Reports that the device acknowledges writes, but the register is not read back. The report is not repeated.
    pub(super) fn report_acknowledged(&mut self) {
        if self.said.first(Topic::Acknowledged) {
            self.report(Event::AcknowledgedNotReadBack);
        }
    }

    pub(super) fn disk_keeps(&mut self) {
        self.said.over(Topic::Disk);
    }

    pub(super) fn take(&mut self) -> Slots<Event, 8> {
        std::mem::take(&mut self.events)
    }
}
