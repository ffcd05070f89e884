//! The address of a broker, as a profile writes it.

use std::fmt;
use std::net::{IpAddr, Ipv6Addr};

/// A broker: whether it is spoken to inside TLS, its host and its port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerUrl {
    /// It is `mqtts`.
    pub tls: bool,
    /// Its name or address, without brackets.
    pub host: String,
    /// Its port.
    pub port: u16,
}

impl fmt::Display for BrokerUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.tls { "mqtts" } else { "mqtt" };
        match self.host.contains(':') {
            true => write!(f, "{scheme}://[{}]:{}", self.host, self.port),
            false => write!(f, "{scheme}://{}:{}", self.host, self.port),
        }
    }
}

const EXAMPLE: &str = "write it as \"mqtts://broker.plant.example:8883\"";

impl BrokerUrl {
    /// The parts of an address.
    ///
    /// # Errors
    /// What is wrong with it, and the remedy. Of a user or a password in it nothing is quoted.
    pub(super) fn parse(text: &str) -> Result<BrokerUrl, (String, &'static str)> {
        let (scheme, place) = text.split_once("://").unwrap_or_default();
        let tls = match scheme {
            "mqtts" => true,
            "mqtt" => false,
            _ => return Err(("it does not begin with mqtts:// or mqtt://".to_owned(), EXAMPLE)),
        };
        if place.contains('@') {
            let help =
                "remove what stands before `@`, and write `user = { name = \"…\", password_file = \"…\" }`";
            return Err(("the address of a broker names no user and no password".to_owned(), help));
        }
        let place = place.strip_suffix('/').unwrap_or(place);
        let (host, port) = host_and_port(place, if tls { 8883 } else { 1883 })
            .ok_or_else(|| (format!("`{place}` is no host and port"), EXAMPLE))?;
        Ok(BrokerUrl { tls, host: host.to_owned(), port })
    }

    /// What is said there never leaves this computer.
    pub fn is_loopback(&self) -> bool {
        self.host == "localhost" || self.host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
    }
}

fn host_and_port(place: &str, usual: u16) -> Option<(&str, u16)> {
    let (host, port) = match place.strip_prefix('[') {
        Some(rest) => {
            let (host, port) = rest.split_once(']')?;
            host.parse::<Ipv6Addr>().ok()?;
            (host, port)
        }
        None => {
            let (host, port) = place.split_at(place.find(':').unwrap_or(place.len()));
            let is_of_a_name = |byte: u8| byte.is_ascii_alphanumeric() || b"-._".contains(&byte);
            (!host.is_empty() && host.bytes().all(is_of_a_name)).then_some((host, port))?
        }
    };
    match port.strip_prefix(':') {
        Some(port) => Some((host, port.parse().ok().filter(|port| *port > 0)?)),
        None => port.is_empty().then_some((host, usual)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broker_is_named_with_its_scheme_and_has_the_usual_port_where_none_is_written() {
        for (text, shown) in [
            ("mqtt://10.0.0.7", "mqtt://10.0.0.7:1883"),
            ("mqtts://broker.plant.example/", "mqtts://broker.plant.example:8883"),
            ("mqtts://broker:8884", "mqtts://broker:8884"),
            ("mqtt://[::1]:1884", "mqtt://[::1]:1884"),
        ] {
            assert_eq!(BrokerUrl::parse(text).unwrap().to_string(), shown);
        }
        for (text, why) in [
            ("broker:1883", "does not begin with"),
            ("tcp://broker:1883", "does not begin with"),
            ("mqtt://me:secret@broker", "names no user"),
            ("mqtt://:1883", "no host and port"),
            ("mqtt://broker:0", "no host and port"),
            ("mqtt://broker/path", "no host and port"),
            ("mqtt://::1", "no host and port"),
        ] {
            let (message, _) = BrokerUrl::parse(text).unwrap_err();
            assert!(message.contains(why) && !message.contains("secret"), "{text}: {message}");
        }
    }
}
