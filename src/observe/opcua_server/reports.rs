//! Reports about refused clients and logins, at most one report a minute of each kind.

use std::sync::Arc;
use std::time::Duration;

use super::pki::RejectedClient;
use super::refusals::Refusals;
use crate::observe::events::{Event, OpcUaServerEvent};
use crate::observe::requester::{Channel, Requester};
use crate::observe::status::GatewayApi;

/// Minimum time between two reports of one kind.
const EVERY: Duration = Duration::from_secs(60);
/// Interval of the checks for refused clients. Until the next check, the library stores the certificate of each refused
/// client.
pub(super) const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Reporter of refused clients and logins, with the times of its last reports.
#[derive(Debug, Default)]
pub(super) struct Reports {
    login: Option<Duration>,
    client: Option<Duration>,
    /// Refused clients that are not reported yet: the last refused client, and the number of further clients.
    waiting: Option<(RejectedClient, u64)>,
}

/// Returns whether the time `every` has passed since `last`. If so, stores the present time in `last`.
pub(super) fn is_due(last: &mut Option<Duration>, every: Duration, now: Duration) -> bool {
    let is_due = last.is_none_or(|last| now >= last + every);
    if is_due {
        *last = Some(now);
    }
    is_due
}

impl Reports {
    /// Reports the clients and logins that were refused. `now` is the time since the start of the computer.
    pub(super) fn report(
        &mut self,
        now: Duration,
        (rejected, refusals): (Vec<RejectedClient>, &Refusals),
        source: &Arc<dyn GatewayApi>,
    ) {
        for client in rejected {
            let others = self.waiting.take().map_or(0, |(_, others)| others + 1);
            self.waiting = Some((client, others));
        }
        if self.waiting.is_some() && is_due(&mut self.client, EVERY, now) {
            let refused = self.waiting.take().map(|(RejectedClient { subject, thumbprint }, others)| {
                OpcUaServerEvent::ClientRefused { client: subject, thumbprint, others }
            });
            refused.into_iter().for_each(|refused| source.report(&Event::OpcUaServer(refused)));
        }
        if refusals.any() && is_due(&mut self.login, EVERY, now) {
            let (count, name) = refusals.take();
            let why = format!("wrong user, password or certificate: {count} since the last report");
            source.turned_away("log in", &Requester::new(Channel::OpcUa, name), &why);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clients_that_come_and_go_do_not_make_the_state_be_copied_more_often() {
        let mut refreshed = None;
        let (every, step) = (Duration::from_millis(100), Duration::from_millis(1));
        let due = (0..1000_u32).filter(|at| is_due(&mut refreshed, every, step * *at));
        assert_eq!(due.count(), 10);
    }

    #[test]
    fn of_many_refused_clients_one_a_minute_is_due() {
        let mut last = None;
        let second = Duration::from_secs(1);
        let due = (0..200_u32).filter(|at| is_due(&mut last, EVERY, second * *at));
        assert_eq!(due.collect::<Vec<_>>(), [0, 60, 120, 180]);
    }
}
