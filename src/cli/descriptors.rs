//! What page and command socket may take of the program's file descriptors. The rest belongs to the lines and to what is kept
//! on disk: they are what the program is for.

use rustix::process::{Resource, getrlimit};

/// What the program itself has open, beside its lines: its streams, its runtimes, listeners, logs, state, ledger.
const OWN: u64 = 32;
/// What a line may have open for a moment: a connection that ends, its successor, and the answer where its device is.
const OF_A_LINE: u64 = 3;
/// A connection of the command socket, and its twin by which it is known to be there.
const OF_A_COMMAND: u64 = 2;

/// How many connections each may have at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shares {
    pub(super) page: usize,
    pub(super) commands: usize,
}

impl Shares {
    /// Of this process, which has so many lines.
    pub(super) fn now(lines: usize) -> Shares {
        Shares::of(getrlimit(Resource::Nofile).current, lines)
    }

    /// `limit` is how many descriptors there may be (`ulimit -n`); `None`: as many as one wants.
    fn of(limit: Option<u64>, lines: usize) -> Shares {
        let taken = OWN.saturating_add(OF_A_LINE.saturating_mul(lines as u64));
        let left = limit.unwrap_or(u64::MAX).saturating_sub(taken);
        // Both are always there.
        let commands = (left / (4 * OF_A_COMMAND)).clamp(2, 32);
        let page = left.saturating_sub(OF_A_COMMAND * commands).clamp(2, 64);
        let [page, commands] = [page, commands].map(|share| usize::try_from(share).unwrap_or(2));
        Shares { page, commands }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_files_come_first_and_page_and_commands_are_always_there() {
        for (limit, lines, page, commands) in [
            (None, 3, 64, 32),
            (Some(1024), 3, 64, 32),
            (Some(256), 3, 64, 26),
            (Some(64), 1, 23, 3),
            (Some(32), 1, 2, 2),
            (Some(1024), 500, 2, 2),
        ] {
            assert_eq!(Shares::of(limit, lines), Shares { page, commands }, "{limit:?} {lines}");
        }
    }

    #[test]
    fn all_shares_together_are_within_the_limit() {
        for limit in 48..2000 {
            for lines in [1, 2, 4] {
                let shares = Shares::of(Some(limit), lines);
                let taken = OWN + OF_A_LINE * lines as u64;
                let shared = shares.page as u64 + OF_A_COMMAND * shares.commands as u64;
                assert!(taken + shared <= limit.max(taken + 6), "{limit} {lines} {shares:?}");
            }
        }
    }
}
