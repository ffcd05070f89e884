//! Published records whose delivery is not confirmed. After a lost connection, they are stored and published again.

use std::collections::VecDeque;
use std::time::Duration;

use isotherm_core::quantity::Moment;

use crate::interface::Record;

/// Time after which a record counts as delivered. If the broker is silent for this time, the connection has already
/// been closed.
const KEPT_FOR: Duration = Duration::from_secs(300);

/// Maximum size of all unconfirmed records together, in bytes.
const MOST_BYTES: usize = 1024 * 1024;

/// Published records that the broker may not have received, oldest first, each with its time of publication.
#[derive(Debug, Default)]
pub(super) struct Unconfirmed {
    published: VecDeque<(Moment, Record)>,
    bytes: usize,
    /// Numbers of records that were removed because the memory limit was reached, each with the time of
    /// publication of these records. Most of the removed records have reached the broker.
    removed: VecDeque<(Moment, u64)>,
    dropped: u64,
}

impl Unconfirmed {
    pub(super) fn keep(&mut self, now: Moment, records: Vec<Record>) {
        for record in records {
            self.bytes += record.0.len();
            self.published.push_back((now, record));
        }
        while let Some((at, record)) = self.published.front() {
            let is_old = now.since(*at) > KEPT_FOR;
            if !is_old && self.bytes <= MOST_BYTES {
                break;
            }
            match self.removed.back_mut() {
                _ if is_old => {}
                Some((last, count)) if last == at => *count += 1,
                _ => self.removed.push_back((*at, 1)),
            }
            self.bytes -= record.0.len();
            self.published.pop_front();
        }
        while self.removed.front().is_some_and(|(at, _)| now.since(*at) > KEPT_FOR) {
            self.removed.pop_front();
        }
    }

    /// Removes all records. Returns the records that may not have reached the broker, because they were published at or
    /// after `last_received` (time of the broker's last answer).
    pub(super) fn take(&mut self, last_received: Moment) -> Vec<Record> {
        let all = std::mem::take(&mut self.published);
        self.bytes = 0;
        let removed = std::mem::take(&mut self.removed).into_iter();
        let lost = removed.skip_while(|(at, _)| *at < last_received).map(|(_, count)| count);
        self.dropped += lost.sum::<u64>();
        all.into_iter().skip_while(|(at, _)| *at < last_received).map(|(_, record)| record).collect()
    }

    /// Returns the number of records that may be undelivered, but were removed because the limit of memory was reached.
    pub(super) fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(second: u64) -> Moment {
        Moment::from_nanos(second * 1_000_000_000)
    }

    fn kept(seconds: impl IntoIterator<Item = u64>, bytes: usize) -> Unconfirmed {
        let mut unconfirmed = Unconfirmed::default();
        for second in seconds {
            unconfirmed.keep(at(second), vec![Record(vec![u8::try_from(second % 251).unwrap(); bytes])]);
        }
        unconfirmed
    }

    fn seconds(records: &[Record]) -> Vec<u8> {
        records.iter().map(|record| record.0[0]).collect()
    }

    #[test]
    fn what_was_told_since_the_broker_was_heard_comes_back() {
        let mut unconfirmed = kept(1..=20, 1);
        assert_eq!(seconds(&unconfirmed.take(at(15))), [15, 16, 17, 18, 19, 20]);
        assert_eq!(unconfirmed.take(at(0)), []);
    }

    #[test]
    fn what_is_older_than_five_minutes_is_not_kept_and_not_counted() {
        let mut unconfirmed = kept([1, 2, 400], 1);
        assert_eq!(unconfirmed.take(at(0)), [Record(vec![149])]);
        assert_eq!(unconfirmed.dropped(), 0);
    }

    #[test]
    fn what_has_no_room_is_dropped_from_the_oldest_on_and_counted() {
        for (last_received, lost) in [(0, 96), (90, 7), (97, 0)] {
            let mut unconfirmed = kept(1..=200, 10_000);
            assert_eq!(unconfirmed.dropped(), 0, "all may arrive");
            assert_eq!(unconfirmed.take(at(last_received)).len(), 104);
            assert_eq!(unconfirmed.dropped(), lost, "{last_received}");
            assert_eq!((unconfirmed.take(at(0)).len(), unconfirmed.dropped()), (0, lost));
        }
    }

    #[test]
    fn a_clock_that_is_set_back_brings_back_more_and_loses_nothing() {
        let mut unconfirmed = kept([100, 101, 50, 51], 1);
        assert_eq!(seconds(&unconfirmed.take(at(51))), [100, 101, 50, 51]);
    }
}
