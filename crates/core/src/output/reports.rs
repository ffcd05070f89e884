//! Events that were not taken yet, and topics that were reported, so that each is reported once.

use serde::{Deserialize, Serialize};

use super::event::Event;
use super::slots::Slots;

/// Something that is reported once until it is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Topic {
    /// The device acknowledges writes, and the register is not read.
    Acknowledged,
    /// The disk does not keep what it must.
    Disk,
    /// The decision is beyond the range of the register.
    Range,
    /// The interlock does not allow writing.
    Interlock,
    /// The control does not apply the register value.
    Applied,
    /// The operator is asked how the register value divides.
    Question,
    /// The division of the register value is known and on disk.
    Division,
}

/// Topics that were reported and are not over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Said(u8);

impl Said {
    const fn bit(topic: Topic) -> u8 {
        1 << topic as u8
    }

    /// Takes note that the topic is reported. Returns whether it was not reported before.
    pub(super) fn first(&mut self, topic: Topic) -> bool {
        let is_first = self.0 & Said::bit(topic) == 0;
        self.0 |= Said::bit(topic);
        is_first
    }

    /// The topic is over. Returns whether it was reported.
    pub(super) fn over(&mut self, topic: Topic) -> bool {
        let was_said = self.0 & Said::bit(topic) != 0;
        self.0 &= !Said::bit(topic);
        was_said
    }
}

/// Events of the register step that were not taken yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Reports {
    events: Slots<Event, 8>,
    said: Said,
}

impl Reports {
    /// A step reports three at most, and they are taken after each.
    pub(super) fn report(&mut self, event: Event) {
        let _ = self.events.push(event);
    }

    /// Reports once that the disk does not keep what it must, until it keeps something again.
    pub(super) fn report_disk(&mut self) {
        if self.said.first(Topic::Disk) {
            self.report(Event::DiskDoesNotKeep);
        }
    }

    /// Reports once that the device acknowledges what nobody reads back.
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
