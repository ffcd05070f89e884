//! The numbers of state and ledger as a log of outputs names them: where both are replaced by an older pair, it still
//! knows.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::checksum;
use crate::gateway::log::outputs::{ENDING, SEALED};
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
    let begins = format!("{machine}-");
    let is_log = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with(&begins) && name.ends_with(ENDING)
    };
    let entries = std::fs::read_dir(directory).ok()?;
    let mut logs: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_log).collect();
    logs.sort();
    let mut all = logs.iter().rev().take(LOGS).filter_map(|log| last_of(log));
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
