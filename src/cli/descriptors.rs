//! Limits on the file descriptors of the web page, the command socket and the OPC UA server. The other
//! descriptors of the process are reserved for bus lines, log files and saved state, which have priority.

use rustix::process::{Resource, getrlimit};

/// Number of descriptors that the program itself uses: its streams, runtimes, listeners, logs, and saved state.
const OWN: u64 = 32;
/// Maximum number of descriptors that a bus line uses at one time: a closing connection, the next connection, and a
/// name lookup.
const OF_A_LINE: u64 = 3;
/// Number of descriptors for each client of the OPC UA server: its connection, and both ends of the internal connection
/// to the OPC UA library.
const OF_A_CLIENT: u64 = 3;
/// Number of descriptors of a connection to the command socket: the connection, and a copy by which its end is
/// detected.
const OF_A_COMMAND: u64 = 2;

/// Maximum numbers of simultaneous connections to the web page, to the command socket, and to the OPC UA server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shares {
    pub(super) page: usize,
    pub(super) commands: usize,
    /// Connections to the OPC UA server, if the profile has one.
    #[cfg_attr(not(feature = "opcua"), allow(dead_code, reason = "only the OPC UA server reads it"))]
    pub(super) opcua: usize,
}

impl Shares {
    /// Returns the limits for this process. `lines` is the number of bus lines of the gateway.
    pub(super) fn now(lines: usize) -> Shares {
        Shares::of(getrlimit(Resource::Nofile).current, lines)
    }

    /// Calculates the limits. `limit` is the maximum number of descriptors of a process (`ulimit -n`); `None`: no
    /// limit.
    fn of(limit: Option<u64>, lines: usize) -> Shares {
        let taken = OWN.saturating_add(OF_A_LINE.saturating_mul(lines as u64));
        let left = limit.unwrap_or(u64::MAX).saturating_sub(taken);
        // At least two connections of each kind are always allowed.
        let commands = (left / (4 * OF_A_COMMAND)).clamp(2, 32);
        let page = left.saturating_sub(OF_A_COMMAND * commands).clamp(2, 64);
        let rest = left.saturating_sub(OF_A_COMMAND * commands + page);
        let opcua = (rest / OF_A_CLIENT).clamp(2, 32);
        let [page, commands, opcua] =
            [page, commands, opcua].map(|share| usize::try_from(share).unwrap_or(2));
        Shares { page, commands, opcua }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_files_come_first_and_page_and_commands_are_always_there() {
        for (limit, lines, page, commands, opcua) in [
            (None, 3, 64, 32, 32),
            (Some(1024), 3, 64, 32, 32),
            (Some(256), 3, 64, 26, 32),
            (Some(64), 1, 23, 3, 2),
            (Some(32), 1, 2, 2, 2),
            (Some(1024), 500, 2, 2, 2),
        ] {
            assert_eq!(Shares::of(limit, lines), Shares { page, commands, opcua }, "{limit:?} {lines}");
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
                let with_clients = taken + shared + OF_A_CLIENT * shares.opcua as u64;
                assert!(with_clients <= limit.max(taken + shared + 6), "{limit} {lines} {shares:?}");
            }
        }
    }
}
