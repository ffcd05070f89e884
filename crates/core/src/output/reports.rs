//! Pending events, and topics that have been reported, so that each is reported once.

use serde::{Deserialize, Serialize};

use super::event::Event;
use super::slots::Slots;

/// Condition that is reported once until it is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topic {
    /// The device acknowledges writes, and the register is not read.
    Acknowledged,
    /// The state cannot be written to disk.
    Disk,
    /// The decision exceeds the range of the register.
    Range,
    /// The interlock does not allow writing.
    Interlock,
    /// The control does not apply the register value.
    Applied,
    /// The operator must divide the register value.
    Question,
    /// The division of the register value is known and on disk.
    Division,
}

/// Topics that have been reported and are not over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct ReportedTopics(u8);

impl ReportedTopics {
    const fn bit(topic: Topic) -> u8 {
        1 << topic as u8
    }

    /// Records that a topic is reported. Returns true if it was not reported before.
    pub(super) fn first(&mut self, topic: Topic) -> bool {
        let is_first = self.0 & ReportedTopics::bit(topic) == 0;
        self.0 |= ReportedTopics::bit(topic);
        is_first
    }

    /// Ends a topic. Returns true if the topic had been reported.
    pub(super) fn over(&mut self, topic: Topic) -> bool {
        let was_said = self.0 & ReportedTopics::bit(topic) != 0;
        self.0 &= !ReportedTopics::bit(topic);
        was_said
    }
}

/// Pending events of the register step.
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

    /// Reports once that the state cannot be written to disk, until a write succeeds.
    pub(super) fn report_disk(&mut self) {
        if self.said.first(Topic::Disk) {
            self.report(Event::DiskDoesNotKeep);
        }
    }

    /// Reports once that the device acknowledges writes without a read back.
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
