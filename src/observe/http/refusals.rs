//! Rate limit for wrong tokens. After [`MOST`] wrong tokens from an address within a minute, tokens from that address
//! are not checked for a minute.
//!
//! The functions do not read a clock. Their argument `now` is the time since the start of the computer.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::time::Duration;

/// Number of wrong tokens within [`SPAN`] after which an address is blocked.
const MOST: u32 = 5;
const SPAN: Duration = Duration::from_secs(60);
/// Maximum number of addresses for which wrong tokens are counted. Above this number, the oldest addresses are removed.
const ADDRESSES: usize = 4096;

/// Maximum number of addresses within a minute for which rejected commands are reported.
const REPORTED: usize = 6;

/// Times at which a rejected command was reported, by address. Each address is reported once a minute. A client that
/// sends commands continuously can therefore not fill the disk.
#[derive(Debug, Default)]
pub(super) struct Reports(Vec<(IpAddr, Duration)>);

impl Reports {
    /// Returns whether a rejected command must be reported. `false` if a report about this address, or [`REPORTED`]
    /// reports in total, were made within the last minute.
    pub(super) fn take(&mut self, from: IpAddr, now: Duration) -> bool {
        let from = household(from);
        self.0.retain(|(_, reported)| now < *reported + SPAN);
        let is_due = self.0.len() < REPORTED && self.0.iter().all(|(known, _)| *known != from);
        if is_due {
            self.0.push((from, now));
        }
        is_due
    }
}

/// Wrong tokens that came from one address.
#[derive(Clone, Copy, Debug)]
struct Guesses {
    /// Start of the minute in which wrong tokens are counted, or in which the address is blocked.
    since: Duration,
    count: u32,
}

/// Wrong tokens by address, and the number of wrong tokens that are not reported yet.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    by_address: HashMap<IpAddr, Guesses>,
    /// Number of wrong or unchecked tokens that are not reported yet.
    unreported: u64,
    /// Address of the last token that is not reported yet. `None` if all tokens are reported.
    last: Option<IpAddr>,
    told: Option<Duration>,
}

/// Report about wrong tokens, which is made at most once a minute.
#[derive(Debug, PartialEq)]
pub(super) struct TokenReport {
    pub(super) count: u64,
    pub(super) last: IpAddr,
    /// Number of addresses that are blocked at present.
    pub(super) closed: usize,
}

impl Refusals {
    /// Returns `Ok` if a token from this address may be checked. Otherwise, the error is the time until a token may be
    /// checked again.
    pub(super) fn may(&self, from: IpAddr, now: Duration) -> Result<(), Duration> {
        let Some(guesses) = self.by_address.get(&household(from)) else { return Ok(()) };
        let left = (guesses.since + SPAN).saturating_sub(now);
        if guesses.count < MOST || left.is_zero() { Ok(()) } else { Err(left) }
    }

    /// Counts a wrong token from this address, and blocks the address if there are too many.
    pub(super) fn wrong(&mut self, from: IpAddr, now: Duration) {
        self.count_later(from);
        let from = household(from);
        if self.by_address.len() >= ADDRESSES && !self.by_address.contains_key(&from) {
            self.forget(now);
        }
        let guesses = self.by_address.entry(from).or_insert(Guesses { since: now, count: 0 });
        if now >= guesses.since + SPAN {
            *guesses = Guesses { since: now, count: 0 };
        }
        guesses.count += 1;
        if guesses.count == MOST {
            guesses.since = now;
        }
    }

    /// Counts a token that was not checked, because its address is blocked.
    pub(super) fn count_later(&mut self, from: IpAddr) {
        self.unreported += 1;
        self.last = Some(from.to_canonical());
    }

    /// Returns the report about wrong tokens if there is something to report, at most once a minute.
    pub(super) fn due(&mut self, now: Duration) -> Option<TokenReport> {
        let last = self.last?;
        if self.told.is_some_and(|told| now < told + SPAN) {
            return None;
        }
        self.told = Some(now);
        self.last = None;
        let closed = self.by_address.keys().filter(|from| self.may(**from, now).is_err()).count();
        Some(TokenReport { count: std::mem::take(&mut self.unreported), last, closed })
    }

    /// Removes addresses whose minute is over. If too many addresses remain, removes the oldest quarter of them.
    fn forget(&mut self, now: Duration) {
        self.by_address.retain(|_, guesses| now < guesses.since + SPAN);
        if self.by_address.len() >= ADDRESSES {
            let mut ages: Vec<Duration> = self.by_address.values().map(|guesses| guesses.since).collect();
            let (_, middle, _) = ages.select_nth_unstable(ADDRESSES / 4);
            let oldest = *middle;
            let mut room = ADDRESSES / 4;
            self.by_address.retain(|_, guesses| {
                let stays = room == 0 || guesses.since > oldest;
                room -= usize::from(!stays);
                stays
            });
        }
    }
}

/// Returns the address under which a client is counted. For IPv6, this is the network, because a user has 2⁶⁴
/// addresses. All addresses that begin with 127 count as one address.
fn household(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        address if address.is_loopback() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(second: u64) -> Duration {
        Duration::from_secs(1000 + second)
    }

    fn from(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn five_wrong_ones_within_a_minute_close_an_address_for_one() {
        for (seconds, now, closed) in [
            (&[0, 1, 2, 3][..], 3, false),
            (&[0, 1, 2, 3, 4], 4, true),
            (&[0, 1, 2, 3, 4], 63, true),
            (&[0, 1, 2, 3, 4], 64, false),
            // Slower attempts never block an address.
            (&[0, 15, 30, 45, 60], 60, false),
            (&[0, 15, 30, 45, 59], 118, true),
            (&[0, 15, 30, 45, 59], 119, false),
        ] {
            let mut refusals = Refusals::default();
            seconds.iter().for_each(|at| refusals.wrong(from("10.0.0.7"), second(*at)));
            assert_eq!(refusals.may(from("10.0.0.7"), second(now)).is_err(), closed, "{seconds:?} {now}");
            assert_eq!(refusals.may(from("10.0.0.8"), second(now)), Ok(()));
        }
    }

    #[test]
    fn a_network_of_ipv6_is_one_address_and_ipv4_in_it_is_ipv4() {
        let mut refusals = Refusals::default();
        (1..=5).for_each(|host| refusals.wrong(from(&format!("2001:db8:0:7:{host}::1")), second(0)));
        assert!(refusals.may(from("2001:db8:0:7:ffff::"), second(1)).is_err());
        assert!(refusals.may(from("2001:db8:0:8::1"), second(1)).is_ok());
        (0..5).for_each(|_| refusals.wrong(from("::ffff:10.0.0.7"), second(0)));
        assert!(refusals.may(from("10.0.0.7"), second(1)).is_err());
    }

    #[test]
    fn this_computer_is_one_address_however_many_it_has() {
        let mut refusals = Refusals::default();
        for address in ["127.0.0.1", "127.0.0.2", "127.9.9.9", "::1", "::ffff:127.0.0.4"] {
            refusals.wrong(from(address), second(0));
        }
        assert!(refusals.may(from("127.0.0.5"), second(1)).is_err());
        assert!(refusals.may(from("::1"), second(1)).is_err());
        assert!(refusals.may(from("::2"), second(1)).is_ok());
    }

    #[test]
    fn each_address_is_reported_once_a_minute_and_six_of_all() {
        let mut reports = Reports::default();
        let mut due = |address: &str, at| reports.take(from(address), second(at));
        assert!(due("10.0.0.7", 0) && due("10.0.0.8", 1));
        assert!((2..60).all(|at| !due("10.0.0.7", at)));
        assert!(due("10.0.0.7", 60));
        assert_eq!((9..=255).filter(|host| due(&format!("10.0.0.{host}"), 60)).count(), 4);
        assert!(due("10.0.0.9", 200));
    }

    #[test]
    fn memory_is_bounded_and_whoever_came_last_is_remembered() {
        let mut refusals = Refusals::default();
        for number in 0..100_000_u32 {
            refusals.wrong(IpAddr::from(number.to_be_bytes()), second(u64::from(number / 5000)));
            assert!(refusals.by_address.len() <= ADDRESSES);
        }
        (0..5).for_each(|_| refusals.wrong(from("10.0.0.7"), second(30)));
        (0..500_u32).for_each(|number| refusals.wrong(IpAddr::from(number.to_be_bytes()), second(30)));
        assert!(refusals.may(from("10.0.0.7"), second(31)).is_err());
    }

    #[test]
    fn it_is_told_at_once_and_then_once_a_minute_with_how_many() {
        let mut refusals = Refusals::default();
        assert_eq!(refusals.due(second(0)), None);
        refusals.wrong(from("10.0.0.7"), second(1));
        let told = |count, last, closed| Some(TokenReport { count, last: from(last), closed });
        assert_eq!(refusals.due(second(2)), told(1, "10.0.0.7", 0));
        for number in 0..50_000 {
            match refusals.may(from("10.0.0.9"), second(3)) {
                Ok(()) => refusals.wrong(from("10.0.0.9"), second(3)),
                Err(_) => refusals.count_later(from("10.0.0.9")),
            }
            assert_eq!(refusals.due(second(3)), None, "{number}");
        }
        assert_eq!(refusals.due(second(61)), None);
        assert_eq!(refusals.due(second(62)), told(50_000, "10.0.0.9", 1));
        assert_eq!(refusals.due(second(200)), None);
    }
}
