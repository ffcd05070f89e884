//! Reports that the primary host has gone offline, or is online again. The gateway publishes only while the
//! primary host of the profile, for example a SCADA system, is online.

use std::time::Duration;

use isotherm_plant::PrimaryHost;

/// Time after which a host without any message about its state is reported. The broker sends a retained state at once.
const UNKNOWN_FOR: Duration = Duration::from_secs(5);

/// State of the primary host that was reported last.
#[derive(Debug, Default)]
pub(super) enum HostReport {
    /// The host is online, or nothing was reported yet.
    #[default]
    Present,
    /// The host is offline.
    Absent,
}

/// Change of the primary host's state that must be reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HostNews {
    /// The host is offline, for this reason.
    Offline(&'static str),
    Online,
}

impl HostReport {
    /// Evaluates the state of the host. `waited` is the time since the subscription to this state. Returns a change
    /// that must be reported; `None` if there is none.
    pub(super) fn check(&mut self, host: PrimaryHost, waited: Duration) -> Option<HostNews> {
        let (report, news) = match (&self, host) {
            (HostReport::Present, PrimaryHost::Offline) => {
                (HostReport::Absent, HostNews::Offline("the host is offline"))
            }
            (HostReport::Present, PrimaryHost::Unknown) if waited >= UNKNOWN_FOR => (
                HostReport::Absent,
                HostNews::Offline("the broker has no message about the state of this host"),
            ),
            (HostReport::Absent, PrimaryHost::Online) => (HostReport::Present, HostNews::Online),
            _ => return None,
        };
        *self = report;
        Some(news)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_is_reported_once_when_it_goes_and_once_when_it_is_back() {
        use PrimaryHost::{NotNeeded, Offline, Online, Unknown};
        let offline = |why| Some(HostNews::Offline(why));
        let table = [
            (Unknown, 0, None),
            (Online, 1, None),
            (Offline, 0, offline("the host is offline")),
            (Offline, 100, None),
            (Unknown, 0, None),
            (Unknown, 100, None),
            (Online, 0, Some(HostNews::Online)),
            (Online, 1, None),
            (Unknown, 4, None),
            (Unknown, 5, offline("the broker has no message about the state of this host")),
            (Offline, 6, None),
            (Online, 7, Some(HostNews::Online)),
            (NotNeeded, 100, None),
        ];
        let mut report = HostReport::default();
        for (place, (host, waited, expected)) in table.into_iter().enumerate() {
            assert_eq!(report.check(host, Duration::from_secs(waited)), expected, "{place}: {host:?}");
        }
    }
}
