//! What waits for a broker that is away: in memory, or on disk where the format tells it later as what was then.

use std::collections::VecDeque;
use std::path::Path;

use isotherm_core::quantity::Moment;
use isotherm_plant::Record;
use isotherm_plant::store::{DiskNews, Store};

/// So many records wait in memory; of more the oldest go.
const MOST: usize = 1000;
/// Records that are told at a time, beside what is new.
const AT_A_TIME: usize = 500;

/// Records, oldest first.
pub(super) enum Kept {
    /// They wait no more once they are told: whoever tells them gives those back that may not have arrived.
    Memory { records: VecDeque<Record>, dropped: u64 },
    /// They wait until the broker has them; so many were told at this moment.
    Disk { store: Store, told: Option<(Moment, usize)> },
}

impl Kept {
    pub(super) fn in_memory() -> Kept {
        Kept::Memory { records: VecDeque::new(), dropped: 0 }
    }

    /// In this directory, which may take so many bytes.
    pub(super) fn on_disk(directory: &Path, most_bytes: u64) -> std::io::Result<Kept> {
        Ok(Kept::Disk { store: Store::open(directory, most_bytes)?, told: None })
    }

    pub(super) fn push(&mut self, new: impl IntoIterator<Item = Record>) {
        for record in new {
            match self {
                Kept::Memory { records, dropped } => {
                    if records.len() == MOST {
                        records.pop_front();
                        *dropped += 1;
                    }
                    records.push_back(record);
                }
                // What a disk does not take is counted, and said once.
                Kept::Disk { store, .. } => drop(store.push(&record)),
            }
        }
    }

    /// These were told before all that waits, and may not have arrived.
    pub(super) fn take_back(&mut self, told: Vec<Record>) {
        match self {
            Kept::Memory { records, .. } => {
                let behind = std::mem::take(records);
                self.push(told.into_iter().chain(behind));
            }
            // They are new to it: what it keeps it has given to nobody.
            Kept::Disk { .. } => self.push(told),
        }
    }

    /// The oldest, to be told now. The broker has everything that was told before `heard`.
    pub(super) fn next(&mut self, now: Moment, heard: Moment) -> Vec<Record> {
        match self {
            Kept::Memory { records, .. } => {
                let count = AT_A_TIME.min(records.len());
                records.drain(..count).collect()
            }
            Kept::Disk { store, told } => {
                match told.take() {
                    Some((at, count)) if heard > at => drop(store.drop_first(count)),
                    still => *told = still,
                }
                if told.is_some() {
                    return Vec::new();
                }
                let records = store.first(AT_A_TIME).unwrap_or_default();
                *told = (!records.is_empty()).then_some((now, records.len()));
                records
            }
        }
    }

    /// There is no next time: all that would be lost, to be told now. A disk keeps its own.
    pub(super) fn ends(&mut self) -> Vec<Record> {
        match self {
            Kept::Memory { records, .. } => std::mem::take(records).into(),
            Kept::Disk { .. } => Vec::new(),
        }
    }

    /// The connection has broken: what was told last is told again.
    pub(super) fn is_broken(&mut self) {
        if let Kept::Disk { told, .. } = self {
            *told = None;
        }
    }

    pub(super) fn len(&self) -> u64 {
        match self {
            Kept::Memory { records, .. } => u64::try_from(records.len()).unwrap_or(u64::MAX),
            Kept::Disk { store, .. } => store.len(),
        }
    }

    /// How many were lost since this was asked last.
    pub(super) fn dropped(&mut self) -> u64 {
        match self {
            Kept::Memory { dropped, .. } => std::mem::take(dropped),
            Kept::Disk { store, .. } => store.dropped(),
        }
    }

    /// Why the disk takes none, once when that begins.
    pub(super) fn fails(&mut self) -> Option<String> {
        let Kept::Disk { store, .. } = self else { return None };
        std::iter::from_fn(|| store.news()).find_map(|news| match news {
            DiskNews::Fails(why) => Some(why),
            DiskNews::Works { .. } => None,
        })
    }
}
