//! Queue of records for an unreachable broker. A record is the state or the events of one time, encoded for the message
//! format. The queue is on disk if the message format supports values of the past. Otherwise, it is in memory.

use std::collections::VecDeque;
use std::path::Path;

use isotherm_core::quantity::Moment;
use isotherm_plant::Record;
use isotherm_plant::store::{DiskNews, Store};

/// Maximum number of records in memory. Above this number, the oldest records are dropped.
const MOST: usize = 1000;
/// Maximum number of old records that are published together with new values.
const AT_A_TIME: usize = 500;

/// Queue of records that wait for the broker, oldest first.
pub(super) enum RecordQueue {
    /// Records in memory. They are removed when they are published. After a lost connection, the publisher puts back
    /// the records that may be undelivered.
    Memory { records: VecDeque<Record>, dropped: u64 },
    /// Records on disk. They are removed when the broker has received them. `told` contains the time of the
    /// last publication, and the number of its records.
    Disk { store: Store, told: Option<(Moment, usize)> },
}

impl RecordQueue {
    pub(super) fn in_memory() -> RecordQueue {
        RecordQueue::Memory { records: VecDeque::new(), dropped: 0 }
    }

    /// Opens the queue in this directory. Its files take at most `most_bytes` bytes.
    pub(super) fn on_disk(directory: &Path, most_bytes: u64) -> std::io::Result<RecordQueue> {
        Ok(RecordQueue::Disk { store: Store::open(directory, most_bytes)?, told: None })
    }

    pub(super) fn push(&mut self, new: impl IntoIterator<Item = Record>) {
        for record in new {
            match self {
                RecordQueue::Memory { records, dropped } => {
                    if records.len() == MOST {
                        records.pop_front();
                        *dropped += 1;
                    }
                    records.push_back(record);
                }
                // Records that the disk does not accept are counted, and reported once.
                RecordQueue::Disk { store, .. } => drop(store.push(&record)),
            }
        }
    }

    /// Puts published records that may be undelivered back to the front of the queue. Call this function before
    /// [`is_broken`](RecordQueue::is_broken).
    pub(super) fn take_back(&mut self, told: Vec<Record>) {
        match self {
            RecordQueue::Memory { records, .. } => {
                let behind = std::mem::take(records);
                self.push(told.into_iter().chain(behind));
            }
            // Records of the last publication are still in the file, and would be in it twice.
            RecordQueue::Disk { store, told: last } => {
                let count = last.map_or(0, |(_, count)| count);
                let stored = store.first(count).unwrap_or_default();
                self.push(told.into_iter().filter(|record| !stored.contains(record)));
            }
        }
    }

    /// Returns the oldest records, for publishing now. The broker has received everything that was published
    /// before `heard`. With records on disk, the result is empty until the broker has received the last
    /// publication.
    pub(super) fn next(&mut self, now: Moment, heard: Moment) -> Vec<Record> {
        match self {
            RecordQueue::Memory { records, .. } => {
                let count = AT_A_TIME.min(records.len());
                records.drain(..count).collect()
            }
            RecordQueue::Disk { store, told } => {
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

    /// Returns the records that would be lost at the end of the program, for publishing now. Records on disk remain
    /// there.
    pub(super) fn ends(&mut self) -> Vec<Record> {
        match self {
            RecordQueue::Memory { records, .. } => std::mem::take(records).into(),
            RecordQueue::Disk { .. } => Vec::new(),
        }
    }

    /// Records that the connection is broken. The records of the last publication are then published again.
    pub(super) fn is_broken(&mut self) {
        if let RecordQueue::Disk { told, .. } = self {
            *told = None;
        }
    }

    pub(super) fn len(&self) -> u64 {
        match self {
            RecordQueue::Memory { records, .. } => u64::try_from(records.len()).unwrap_or(u64::MAX),
            RecordQueue::Disk { store, .. } => store.len(),
        }
    }

    /// Returns the number of records that were lost since the last call.
    pub(super) fn dropped(&mut self) -> u64 {
        match self {
            RecordQueue::Memory { dropped, .. } => std::mem::take(dropped),
            RecordQueue::Disk { store, .. } => store.dropped(),
        }
    }

    /// Returns the disk error once when the disk begins to fail. Otherwise, returns `None`.
    pub(super) fn fails(&mut self) -> Option<String> {
        let RecordQueue::Disk { store, .. } = self else { return None };
        std::iter::from_fn(|| store.news()).find_map(|news| match news {
            DiskNews::Fails(why) => Some(why),
            DiskNews::Works { .. } => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(second: u64) -> Moment {
        Moment::from_nanos(second * 1_000_000_000)
    }

    fn record(number: u8) -> Record {
        Record(vec![number; 10])
    }

    /// A primary host that flaps must not fill the disk with repetitions.
    #[test]
    fn a_record_that_is_still_in_the_file_is_not_stored_a_second_time() {
        let directory = tempfile::tempdir().unwrap();
        let mut queue = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
        queue.push([1, 2, 3].map(record));
        for round in 1..=5 {
            assert_eq!(queue.next(at(round), at(0)).len(), 3);
            queue.take_back([1, 2, 3].map(record).into());
            queue.is_broken();
        }
        assert_eq!(queue.len(), 3);
        // Record 4 was never in the file.
        queue.take_back(vec![record(4)]);
        assert_eq!(queue.next(at(10), at(0)), [1, 2, 3, 4].map(record));
        // All have reached the broker, and are removed. The host may have lost one of them.
        assert!(queue.next(at(12), at(11)).is_empty());
        queue.take_back(vec![record(1)]);
        assert_eq!(queue.next(at(13), at(11)), [record(1)]);
    }
}
