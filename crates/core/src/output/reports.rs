//! Which troubles have been reported, so that each is reported once.

use super::event::Event;
use super::slots::Slots;

/// Events that were not taken yet, and what was said already.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Reports {
    events: Slots<Event, 8>,
    has_said_acknowledged: bool,
    has_said_disk: bool,
}

impl Reports {
    /// A step reports three at most, and they are taken after each.
    pub(super) fn report(&mut self, event: Event) {
        let _ = self.events.push(event);
    }

    /// Once, until the disk keeps something again.
    pub(super) fn report_disk(&mut self) {
        if !std::mem::replace(&mut self.has_said_disk, true) {
            self.report(Event::DiskDoesNotKeep);
        }
    }

    /// Once.
    pub(super) fn report_acknowledged(&mut self) {
        if !std::mem::replace(&mut self.has_said_acknowledged, true) {
            self.report(Event::AcknowledgedNotReadBack);
        }
    }

    pub(super) fn disk_keeps(&mut self) {
        self.has_said_disk = false;
    }

    pub(super) fn take(&mut self) -> Slots<Event, 8> {
        std::mem::take(&mut self.events)
    }
}
