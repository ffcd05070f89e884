//! The numbers of state and ledger as a log of outputs names them: where both are replaced by an older pair, it still
//! knows.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::{Which, checksum};
use crate::gateway::log::outputs::{ENDING, SEALED};
use crate::gateway::storage::keeping::logs;
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::regular;

/// How much of the end of a log is looked at, and of how many, the newest first.
const TAIL: u64 = 256 * 1024;
const LOGS: usize = 8;

/// What a row says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) struct Named {
    pub(super) since: Moment,
    /// Of the state and of the ledger.
    pub(super) numbers: [u64; 2],
}

impl Named {
    /// The row, with its line break.
    pub(in crate::gateway) fn row(self, at: Moment) -> Vec<u8> {
        let mut line = Vec::new();
        time::write(&mut line, at);
        // Writing to a vector never fails.
        let _ = write!(line, ",,{SEALED},{},", self.numbers[0]);
        time::write(&mut line, self.since);
        let _ = write!(line, ",,{},,", self.numbers[1]);
        let checksum = checksum(&line);
        let _ = writeln!(line, "{checksum}");
        line
    }

    /// A clause where a document of this number is older than the log says, or not of the same history.
    pub(in crate::gateway) fn is_later(self, which: Which, since: Moment, number: u64) -> Option<String> {
        let known = self.numbers[which as usize];
        match self.since == since {
            false => Some("are not of the same machine's history".to_owned()),
            true if known > number => {
                Some(format!("know of a newer {} (its number is {known}, not {number})", which.name()))
            }
            true => None,
        }
    }

    fn read(row: &str) -> Option<Named> {
        let (row, found) = row.rsplit_once(',')?;
        let cells: Vec<&str> = row.split(',').collect();
        if cells.get(2) != Some(&SEALED) || found != checksum(format!("{row},").as_bytes()) {
            return None;
        }
        let number = |place: usize| cells.get(place)?.parse().ok();
        Some(Named { since: time::parse(cells.get(4)?).ok()?, numbers: [number(3)?, number(6)?] })
    }
}

/// What the newest of the logs of a machine says, as far as its end tells.
pub(in crate::gateway) fn newest(directory: &Path, machine: &str) -> Option<Named> {
    let logs = logs(directory, machine);
    let of_outputs = logs.iter().rev().filter(|log| log.name.ends_with(ENDING));
    let mut all = of_outputs.take(LOGS).filter_map(|log| last_of(&directory.join(&log.name)));
    let newest = all.next()?;
    // A clock that was wrong has named one of them after a day that has not come.
    let greatest =
        |numbers: [u64; 2], other: Named| [0, 1].map(|place| numbers[place].max(other.numbers[place]));
    let numbers = all.filter(|named| named.since == newest.since).fold(newest.numbers, greatest);
    Some(Named { numbers, ..newest })
}

fn last_of(log: &Path) -> Option<Named> {
    let mut file: File = regular::open(log).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL))).ok()?;
    let mut tail = Vec::new();
    file.take(TAIL).read_to_end(&mut tail).ok()?;
    String::from_utf8_lossy(&tail).lines().rev().find_map(Named::read)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logs_of_a_machine_whose_name_begins_alike_say_nothing_of_this_one() {
        let directory = tempfile::tempdir().unwrap();
        let of = |second: u64| Named {
            since: Moment::from_nanos(second * 1_000_000_000),
            numbers: [second, second],
        };
        for (name, second) in [("press-2026-01-31", 7), ("press-7-2026-02-01", 9), ("press-2026-01-30.2", 5)]
        {
            let row = of(second).row(Moment::from_nanos(1));
            std::fs::write(directory.path().join(format!("{name}{ENDING}")), row).unwrap();
        }
        assert_eq!(newest(directory.path(), "press"), Some(of(7)));
        assert_eq!(newest(directory.path(), "press-7"), Some(of(9)));
        assert_eq!(newest(directory.path(), "pres"), None);
    }
}
