//! What waits for a broker that is away.

use std::collections::VecDeque;

use isotherm_plant::Record;

/// So many records wait in memory; of more the oldest go.
const MOST: usize = 1000;

/// Records, oldest first.
#[derive(Debug, Default)]
pub(super) struct Kept {
    records: VecDeque<Record>,
    dropped: u64,
}

impl Kept {
    pub(super) fn push(&mut self, records: impl IntoIterator<Item = Record>) {
        for record in records {
            if self.records.len() == MOST {
                self.records.pop_front();
                self.dropped += 1;
            }
            self.records.push_back(record);
        }
    }

    /// The oldest, at most so many; they wait no more.
    pub(super) fn take(&mut self, most: usize) -> Vec<Record> {
        let count = most.min(self.records.len());
        self.records.drain(..count).collect()
    }

    pub(super) fn len(&self) -> usize {
        self.records.len()
    }

    /// How many were lost since this was asked last.
    pub(super) fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}
