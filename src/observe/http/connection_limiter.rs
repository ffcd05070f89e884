//! Limits on simultaneous connections to the web page, in total and for each client address.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Limits on connections to the web page, and their timeouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of simultaneous connections.
    pub connections: usize,
    /// Maximum number of simultaneous connections from one IPv4 address, or from one IPv6 network (64-bit prefix).
    pub of_one_address: usize,
    /// Maximum number of simultaneous connections from one trusted proxy. A proxy may have more connections than a
    /// client, because it has many clients.
    pub of_one_proxy: usize,
    /// Maximum number of simultaneous live streams of the status (`/api/live`).
    pub streams: usize,
    /// Timeout for the head of a request, or for the TLS handshake and the first head.
    pub head: Duration,
    /// Timeout for the body of a request.
    pub body: Duration,
    /// Timeout of a connection between two requests.
    pub idle: Duration,
    /// Timeout while an answer is sent and the client accepts no byte of the answer.
    pub stall: Duration,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits::of(64)
    }
}

impl Limits {
    /// Returns the limits for this maximum number of simultaneous connections.
    pub fn of(connections: usize) -> Limits {
        let most = (connections - connections.div_ceil(4)).max(1);
        Limits {
            connections,
            of_one_address: most.min(16),
            of_one_proxy: most,
            streams: connections.div_ceil(2),
            head: Duration::from_secs(10),
            body: Duration::from_secs(10),
            idle: Duration::from_secs(60),
            stall: Duration::from_secs(120),
        }
    }
}

/// Counter of the open connections of each client address.
#[derive(Debug)]
pub(in crate::observe) struct ConnectionLimiter {
    limits: Limits,
    inside: Mutex<HashMap<IpAddr, usize>>,
}

/// Permit for one connection. When the permit is dropped, another connection may be accepted.
#[derive(Debug)]
pub(in crate::observe) struct Permit {
    limiter: Arc<ConnectionLimiter>,
    address: IpAddr,
}

impl ConnectionLimiter {
    pub(in crate::observe) fn new(limits: Limits) -> ConnectionLimiter {
        ConnectionLimiter { limits, inside: Mutex::default() }
    }

    /// Returns a permit for a connection from this address. `None` if a limit is reached.
    pub(in crate::observe) fn admit(self: &Arc<ConnectionLimiter>, address: IpAddr) -> Option<Permit> {
        self.admit_up_to(self.limits.of_one_address, address)
    }

    /// Returns a permit for a connection from this trusted proxy. `None` if a limit is reached.
    pub(in crate::observe) fn admit_proxy(self: &Arc<ConnectionLimiter>, address: IpAddr) -> Option<Permit> {
        self.admit_up_to(self.limits.of_one_proxy, address)
    }

    fn admit_up_to(self: &Arc<ConnectionLimiter>, most: usize, address: IpAddr) -> Option<Permit> {
        let address = counted(address);
        let mut inside = self.inside.lock().unwrap_or_else(PoisonError::into_inner);
        let (all, of_it) = (inside.values().sum::<usize>(), inside.get(&address).copied().unwrap_or(0));
        if all >= self.limits.connections || of_it >= most {
            return None;
        }
        inside.insert(address, of_it + 1);
        Some(Permit { limiter: Arc::clone(self), address })
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        let mut inside = self.limiter.inside.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = inside.get_mut(&self.address) {
            *count -= 1;
            if *count == 0 {
                inside.remove(&self.address);
            }
        }
    }
}

/// Returns the address under which a client is counted. For IPv6, this is the network, because each user has
/// a whole network. Each loopback address is counted separately. A common limit is not needed, because a
/// local user can overload the computer in other ways.
fn counted(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) if !address.is_loopback() => {
            IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)))
        }
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_of_ipv6_counts_as_one_and_ipv4_within_ipv6_as_itself() {
        for (address, as_this) in [
            ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::"),
            ("::ffff:192.0.2.7", "192.0.2.7"),
            ("::1", "::1"),
            ("10.0.0.7", "10.0.0.7"),
        ] {
            assert_eq!(counted(address.parse().unwrap()), as_this.parse::<IpAddr>().unwrap());
        }
    }

    #[test]
    fn one_address_never_has_all_where_there_are_two() {
        for connections in 1..100 {
            let Limits { of_one_address, .. } = Limits::of(connections);
            assert!(
                of_one_address >= 1 && (connections == 1 || of_one_address < connections),
                "{connections}"
            );
        }
    }

    #[test]
    fn a_trusted_proxy_has_more_and_never_all() {
        let limiter = Arc::new(ConnectionLimiter::new(Limits::of(64)));
        let [proxy, other] = ["127.0.0.1", "127.0.0.2"].map(|address| address.parse().unwrap());
        let of_proxy: Vec<Permit> = std::iter::from_fn(|| limiter.admit_proxy(proxy)).collect();
        let of_other: Vec<Permit> = std::iter::from_fn(|| limiter.admit(other)).collect();
        assert_eq!((of_proxy.len(), of_other.len()), (48, 16));
    }

    #[test]
    fn a_place_is_free_again_when_it_is_left_and_one_address_never_has_all() {
        let limiter = Arc::new(ConnectionLimiter::new(Limits::of(8)));
        let [here, there] = ["127.0.0.1", "127.0.0.2"].map(|address| address.parse().unwrap());
        let mut places: Vec<Permit> = std::iter::from_fn(|| limiter.admit(here)).collect();
        assert_eq!(places.len(), 6);
        let others: Vec<Permit> = std::iter::from_fn(|| limiter.admit(there)).collect();
        assert_eq!(others.len(), 2);
        drop(others);
        assert!(limiter.admit(here).is_none());
        places.pop();
        assert!(limiter.admit(here).is_some());
        drop(places);
        assert!(limiter.inside.lock().unwrap().is_empty());
    }
}
