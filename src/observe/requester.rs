//! Requester of a command: its channel, its deadline, and whether it still waits for the answer.
//!
//! **A command begins within its deadline, or it is dropped.** A requester waits [`ANSWER_TIMEOUT`] for an
//! answer. If the gateway is suspended, a request may wait in a socket for a longer time. The gateway then
//! drops the request. The commands of isotherm send their deadline, by a clock that they share with the
//! gateway. For other requesters, the gateway checks two things: their connection, and for how long the
//! gateway did not serve the sockets ([`ServiceTimes`]).

use std::fmt;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Weak};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde::Serialize;

use crate::clock::{BootClock, Ticks};

/// Time for which a requester waits for an answer.
pub const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which [`ServiceTimes`] records that the sockets are served.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Threshold for a gap, in milliseconds: a longer time between two services of the sockets counts as a gap.
const SHORTEST_GAP: u64 = 1100;

/// Channel over which a command was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// Button on the web page.
    Page,
    /// Command socket of the gateway. Commands such as `isotherm arm` use this socket.
    Socket,
    /// HTTP request of a program other than the web page.
    Api,
    /// Message from the MQTT broker of `[mqtt]`.
    Broker,
    /// Method call of a client of the OPC UA server of `[opcua_server]`.
    OpcUa,
    /// Setting `arm = "auto"` of the profile, which arms without a command.
    Auto,
    /// Saved state before a restart: an axis that was armed is armed again.
    Restart,
}

impl Channel {
    /// Describes requester and channel as part of a sentence, for example `by 10.0.0.5 on the web page`.
    pub fn by(self, who: &str) -> String {
        match self {
            Channel::Page => format!("by {who} on the web page"),
            Channel::Socket => format!("by {who} over the command socket"),
            Channel::Api => format!("by {who} over the API"),
            Channel::Broker => format!("over the broker {who}"),
            Channel::OpcUa => format!("by {who} over OPC UA"),
            Channel::Auto => format!("automatically ({who})"),
            Channel::Restart => format!("after a restart ({who})"),
        }
    }
}

/// Connection that shows whether the requester still waits.
pub type Connection = dyn AsFd + Send + Sync;

/// Requester of a command.
pub struct Requester {
    /// Channel of the request.
    pub way: Channel,
    /// Address of the requester, or name and uid of a user.
    pub who: String,
    /// Deadline of the request, as time since the start of the computer; `None` if the request has no deadline.
    until: Option<Duration>,
    /// Connection of the requester. The requester has disconnected if either end is closed. A weak reference does not
    /// keep the file descriptor open.
    connection: Option<Weak<Connection>>,
    stays: bool,
}

impl fmt::Debug for Requester {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.way.by(&self.who))
    }
}

impl Requester {
    /// Creates a requester without a deadline and without a connection.
    pub fn new(way: Channel, who: impl Into<String>) -> Requester {
        Requester { way, who: who.into(), until: None, connection: None, stays: false }
    }

    /// Sets the deadline, as time since the start of the computer. A deadline later than [`ANSWER_TIMEOUT`] from now is
    /// shortened.
    #[must_use]
    pub fn until(self, until: Duration) -> Requester {
        let longest = BootClock::default().passed() + ANSWER_TIMEOUT;
        Requester { until: Some(until.min(longest)), ..self }
    }

    /// Sets the connection over which the requester waits for the answer.
    #[must_use]
    pub fn at(self, connection: &Arc<Connection>) -> Requester {
        Requester { connection: Some(Arc::downgrade(connection)), ..self }
    }

    /// Makes the request end as soon as the requester disconnects, even if the request has already begun.
    #[must_use]
    pub fn staying(self) -> Requester {
        Requester { stays: true, ..self }
    }

    /// Returns the reason why it is too late to begin the request, as a sentence; `None` if the request may begin.
    pub fn has_lapsed(&self) -> Option<String> {
        if self.until.is_some_and(|until| BootClock::default().passed() >= until) {
            return Some(format!("the request had to wait longer than {} s", ANSWER_TIMEOUT.as_secs()));
        }
        self.is_gone().then(|| "the client that sent the request has disconnected".to_owned())
    }

    /// Returns whether the request must end because its requester has disconnected. The result is always `false` if
    /// [`Requester::staying`] was not called.
    pub fn has_left(&self) -> bool {
        self.stays && self.is_gone()
    }

    /// Returns whether the requester has closed its connection. On the command socket, a requester may have finished
    /// sending but still wait, as in `echo arm | nc -U`. Such a connection does not count as closed. Over TCP, the two
    /// cases look the same, and both count as closed.
    fn is_gone(&self) -> bool {
        let Some(connection) = &self.connection else { return false };
        let Some(connection) = connection.upgrade() else { return true };
        let mut one = [PollFd::from_borrowed_fd(connection.as_fd(), PollFlags::RDHUP)];
        if poll(&mut one, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_err() {
            return false;
        }
        let closed = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
        let also = if self.way == Channel::Socket { PollFlags::empty() } else { PollFlags::RDHUP };
        one[0].revents().intersects(closed | also)
    }
}

/// Times at which the gateway served its sockets. From these times, the gateway calculates how long a request may have
/// waited in a socket.
#[derive(Clone, Debug, Default)]
pub struct ServiceTimes(Arc<SampleTimes>);

#[derive(Debug, Default)]
struct SampleTimes {
    /// Last time at which the sockets were served, in milliseconds since the start of the computer.
    last: AtomicU64,
    /// Start of the last gap of more than [`SHORTEST_GAP`] in which the sockets were not served. `after` is
    /// its end.
    before: AtomicU64,
    after: AtomicU64,
}

fn now() -> u64 {
    u64::try_from(BootClock::default().passed().as_millis()).unwrap_or(u64::MAX)
}

impl ServiceTimes {
    /// Records in an endless loop that the sockets are served.
    pub async fn keep(&self) {
        let mut ticks = Ticks::every(LOOK_EVERY);
        loop {
            self.record(now());
            ticks.next().await;
        }
    }

    fn record(&self, now: u64) {
        let last = self.0.last.swap(now, Ordering::Relaxed);
        if last > 0 && now.saturating_sub(last) > SHORTEST_GAP {
            self.0.before.store(last, Ordering::Relaxed);
            self.0.after.store(now, Ordering::Relaxed);
        }
    }

    /// Returns the maximum time for which a request that is received at `now` may have waited in its socket. If the
    /// gateway did not serve the sockets for a while, a request in the second after this gap may have arrived before
    /// the gap.
    fn longest_wait(&self, now: u64) -> Duration {
        let [last, before, after] =
            [&self.0.last, &self.0.before, &self.0.after].map(|moment| moment.load(Ordering::Relaxed));
        let since = if after > 0 && now.saturating_sub(after) < 1000 { before } else { last };
        Duration::from_millis(if since == 0 { 0 } else { now.saturating_sub(since) })
    }

    /// Returns a deadline for a requester that sends none, as time since the start of the computer.
    pub fn until(&self) -> Duration {
        let now = now();
        (Duration::from_millis(now) + ANSWER_TIMEOUT).saturating_sub(self.longest_wait(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixStream;

    fn requester(way: Channel) -> (Requester, Arc<Connection>, UnixStream) {
        let (here, there) = UnixStream::pair().unwrap();
        let here: Arc<Connection> = Arc::new(here);
        (Requester::new(way, "somebody").at(&here), here, there)
    }

    #[test]
    fn who_waits_is_there_who_has_gone_is_not_and_who_only_says_no_more_waits() {
        let (requester, _here, there) = requester(Channel::Socket);
        assert_eq!(requester.has_lapsed(), None);
        there.shutdown(std::net::Shutdown::Write).unwrap();
        assert_eq!(requester.has_lapsed(), None);
        drop(there);
        assert_eq!(requester.has_lapsed().unwrap(), "the client that sent the request has disconnected");
        assert!(!requester.has_left() && requester.staying().has_left());
    }

    #[test]
    fn whose_connection_was_closed_here_has_gone() {
        let (requester, here, _there) = requester(Channel::Api);
        assert_eq!(requester.has_lapsed(), None);
        drop(here);
        assert_eq!(requester.has_lapsed().unwrap(), "the client that sent the request has disconnected");
    }

    #[test]
    fn nobody_waits_longer_than_he_says_nor_than_five_seconds() {
        let now = BootClock::default().passed();
        let (requester, _here, _there) = requester(Channel::Socket);
        let requester = requester.until(now);
        assert_eq!(requester.has_lapsed().unwrap(), "the request had to wait longer than 5 s");
        let patient = Requester::new(Channel::Api, "somebody").until(now + Duration::from_secs(3600));
        assert!(patient.until.unwrap() <= BootClock::default().passed() + ANSWER_TIMEOUT);
    }

    #[test]
    fn what_is_found_after_a_gap_may_have_waited_since_before_it() {
        let attendance = ServiceTimes::default();
        assert_eq!(attendance.longest_wait(100_000), Duration::ZERO);
        attendance.record(100_000);
        assert_eq!(attendance.longest_wait(100_200), Duration::from_millis(200));
        // Before the sockets are served again, and after.
        assert_eq!(attendance.longest_wait(108_000), Duration::from_secs(8));
        attendance.record(108_000);
        assert_eq!(attendance.longest_wait(108_010), Duration::from_millis(8010));
        attendance.record(108_250);
        attendance.record(109_000);
        assert_eq!(attendance.longest_wait(109_100), Duration::from_millis(100));
        attendance.record(110_100);
        assert_eq!(attendance.longest_wait(110_200), Duration::from_millis(100));
        // One millisecond more is a gap.
        attendance.record(111_201);
        assert_eq!(attendance.longest_wait(111_301), Duration::from_millis(1201));
    }
}
