//! Queue of the events that are not published yet. Each sample of the status adds the new events to the
//! queue, because the status contains only the last events.

use std::collections::VecDeque;

use super::moment;
use crate::observe::events::{Entry, Level};
use crate::observe::status::Status;
use isotherm_plant::{Importance, PlantEvent};

/// Maximum number of events that wait for the broker. Above this number, the oldest events are dropped.
const MOST: usize = 1000;

/// Queue of the events that are not published yet.
#[derive(Debug, Default)]
pub(super) struct EventQueue {
    /// Number of events that the gateway had reported since its start when the last sample was taken.
    seen: u64,
    waiting: VecDeque<PlantEvent>,
    dropped: u64,
}

impl EventQueue {
    /// Adds the events that were reported after the last sample of the status.
    pub(super) fn sample(&mut self, status: &Status) {
        let all: u64 = status.event_counts.values().sum();
        let new = usize::try_from(all.saturating_sub(self.seen)).unwrap_or(usize::MAX);
        self.seen = all;
        let shown = new.min(status.events.len());
        // Events that the status does not contain any more are lost.
        self.dropped += u64::try_from(new - shown).unwrap_or(u64::MAX);
        for entry in status.events.iter().skip(status.events.len() - shown) {
            if self.waiting.len() == MOST {
                self.waiting.pop_front();
                self.dropped += 1;
            }
            self.waiting.push_back(happening(entry));
        }
    }

    /// Removes and returns all events that wait for the broker.
    pub(super) fn take(&mut self) -> Vec<PlantEvent> {
        std::mem::take(&mut self.waiting).into()
    }

    /// Returns the number of events that wait for the broker.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Returns the number of events that were lost since the last call.
    pub(super) fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}

fn happening(entry: &Entry) -> PlantEvent {
    PlantEvent {
        at: moment(&entry.at).unwrap_or_default(),
        kind: entry.kind.to_string(),
        importance: match entry.level {
            Level::Info => Importance::Info,
            Level::Warning => Importance::Warning,
            Level::Error => Importance::Error,
        },
        text: entry.text.clone(),
        data: if entry.data.is_null() { String::new() } else { entry.data.to_string() },
    }
}
