//! The events since the last look, out of a state that shows the last of them.

use std::collections::VecDeque;

use super::moment;
use crate::observe::events::{Entry, Level};
use crate::observe::status::Status;
use isotherm_plant::{Happening, Importance};

/// So many wait for a broker that takes nothing; of more the oldest go.
const MOST: usize = 1000;

/// Follows the events.
#[derive(Debug, Default)]
pub(super) struct Happenings {
    /// How many had happened at the last look.
    seen: u64,
    waiting: VecDeque<Happening>,
    dropped: u64,
}

impl Happenings {
    /// Takes what is new.
    pub(super) fn look(&mut self, status: &Status) {
        let all: u64 = status.event_counts.values().sum();
        let new = usize::try_from(all.saturating_sub(self.seen)).unwrap_or(usize::MAX);
        self.seen = all;
        let shown = new.min(status.events.len());
        // The state shows only so many: what is no more among them cannot be told.
        self.dropped += u64::try_from(new - shown).unwrap_or(u64::MAX);
        for entry in status.events.iter().skip(status.events.len() - shown) {
            if self.waiting.len() == MOST {
                self.waiting.pop_front();
                self.dropped += 1;
            }
            self.waiting.push_back(happening(entry));
        }
    }

    /// Those that wait.
    pub(super) fn take(&mut self) -> Vec<Happening> {
        std::mem::take(&mut self.waiting).into()
    }

    /// How many wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// How many were lost since this was asked last.
    pub(super) fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}

fn happening(entry: &Entry) -> Happening {
    Happening {
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
