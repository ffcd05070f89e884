//! Canonical names of bus addresses. Two spellings of the same address have a common canonical name.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::sync::mpsc::channel;
use std::time::Duration;

use crate::clock::BootClock;
use crate::fieldbus::kinds;
use crate::fieldbus::kinds::kind::LinePlace;
use isotherm_profile::Bus;

/// Maximum time for the resolution of all host names. A host name that is not resolved in this time is compared as
/// text.
const PATIENCE: Duration = Duration::from_secs(2);

/// Address that Debian's /etc/hosts assigns to the computer's own name.
const OWN_NAME: Ipv4Addr = Ipv4Addr::new(127, 0, 1, 1);

/// Returns the canonical names of the address of each bus. Two addresses with a common name lead to the same line.
pub(super) fn of_each(buses: &[&Bus]) -> Vec<Vec<String>> {
    let places: Vec<LinePlace> = buses.iter().map(|bus| (kinds::of(bus.transport).place)(bus)).collect();
    let hosts: Vec<Option<String>> = places.iter().map(host_and_port).collect();
    let mut found: Vec<Vec<SocketAddr>> = hosts.iter().map(|host| numeric(host.as_deref())).collect();
    resolve(&hosts, &mut found);
    let name = |(place, found): (LinePlace, Vec<SocketAddr>)| match place {
        LinePlace::Name(name) => vec![name],
        LinePlace::Host(host) if found.is_empty() => vec![format!("tcp {}", host.to_lowercase())],
        LinePlace::Host(_) => {
            let mut names: Vec<String> = found.iter().map(|address| tcp(*address)).collect();
            names.sort();
            names.dedup();
            names
        }
    };
    places.into_iter().zip(found).map(name).collect()
}

/// Returns host and port of a bus line; `None` if the line does not use TCP.
fn host_and_port(place: &LinePlace) -> Option<String> {
    if let LinePlace::Host(host) = place { Some(host.clone()) } else { None }
}

/// Parses a numeric address with its port. Returns an empty list if `host` is a name, which must first be resolved.
fn numeric(host: Option<&str>) -> Vec<SocketAddr> {
    host.and_then(|host| host.parse().ok()).into_iter().collect()
}

/// Resolves the host names in a thread, so that a silent name server delays the start only for a limited time.
fn resolve(hosts: &[Option<String>], found: &mut [Vec<SocketAddr>]) {
    let wanted: Vec<(usize, String)> = hosts
        .iter()
        .enumerate()
        .filter_map(|(place, host)| Some((place, host.clone().filter(|_| found[place].is_empty())?)))
        .collect();
    if wanted.is_empty() {
        return;
    }
    let (sender, receiver) = channel();
    let thread = std::thread::Builder::new().name("names".to_owned()).spawn(move || {
        for (place, host) in wanted {
            let addresses = host.to_socket_addrs().map_or_else(|_| Vec::new(), Iterator::collect);
            if sender.send((place, addresses)).is_err() {
                return;
            }
        }
    });
    let until = BootClock::default().passed() + PATIENCE;
    while thread.is_ok()
        && let Ok((place, addresses)) =
            receiver.recv_timeout(until.saturating_sub(BootClock::default().passed()))
    {
        found[place] = addresses;
    }
}

fn tcp(address: SocketAddr) -> String {
    let (ip, port) = (address.ip().to_canonical(), address.port());
    if is_this_computer(ip) { format!("tcp this computer:{port}") } else { format!("tcp {ip}:{port}") }
}

/// Returns whether the address is a usual address of this computer. Any other loopback address may be a separate
/// device of a simulation, so the result is then `false`.
fn is_this_computer(ip: IpAddr) -> bool {
    match ip {
        IpAddr::V4(ip) if ip.is_loopback() => ip == Ipv4Addr::LOCALHOST || ip == OWN_NAME,
        ip if ip.is_loopback() => true,
        // A computer reaches its own address from that address.
        ip => source_address(ip).is_ok_and(|own| own == ip),
    }
}

/// Returns the address from which this computer would connect to `ip`. Connecting a datagram socket sends nothing.
fn source_address(ip: IpAddr) -> std::io::Result<IpAddr> {
    let any: IpAddr = if ip.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
    let socket = UdpSocket::bind((any, 0))?;
    socket.connect((ip, 9))?;
    Ok(socket.local_addr()?.ip())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(address: &str) -> Vec<String> {
        let mut found = [numeric(Some(address))];
        resolve(&[Some(address.to_owned())], &mut found);
        found[0].iter().map(|address| tcp(*address)).collect()
    }

    #[test]
    fn each_way_of_writing_this_computer_is_one_name_and_other_addresses_are_others() {
        for address in
            ["127.0.0.1:502", "[::1]:502", "localhost:502", "127.0.1.1:502", "[::ffff:127.0.0.1]:502"]
        {
            assert!(name(address).iter().all(|name| name == "tcp this computer:502"), "{address}");
            assert!(!name(address).is_empty(), "{address}");
        }
        assert_eq!(name("127.0.0.2:502"), ["tcp 127.0.0.2:502"]);
        assert_eq!(name("127.0.0.1:503"), ["tcp this computer:503"]);
        assert_eq!(name("192.0.2.1:502"), ["tcp 192.0.2.1:502"]);
    }
}
