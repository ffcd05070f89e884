//! Parser for host and port in profiles and commands: `host`, `host:502`, `[::1]`, `[::1]:502`.

use std::net::{IpAddr, Ipv6Addr};

/// Reason why a text is not a host with an optional port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoPlace {
    /// The port number is above 65535.
    PortTooLarge {
        /// Host part of the text, before the port.
        host: String,
    },
    /// The text is an IPv6 address without brackets.
    Unbracketed {
        /// IPv6 address without brackets.
        address: String,
        /// Port after the address. `None` if the text contains no port.
        port: Option<u16>,
    },
    /// The text is invalid for any other reason.
    Other,
}

impl NoPlace {
    /// Returns the address that was probably meant. The port is `usual` if the text has no valid port. `None` if no
    /// address can be guessed.
    pub fn meant(&self, usual: u16) -> Option<String> {
        match self {
            NoPlace::PortTooLarge { host } => Some(format!("{host}:{usual}")),
            NoPlace::Unbracketed { address, port } => Some(format!("[{address}]:{}", port.unwrap_or(usual))),
            NoPlace::Other => None,
        }
    }

    /// Builds a hint with the address that was probably meant, formatted by `written`. `None` if no address can be
    /// guessed.
    pub fn help(&self, usual: u16, written: impl Fn(&str) -> String) -> Option<String> {
        let meant = written(&self.meant(usual)?);
        Some(match self {
            NoPlace::PortTooLarge { .. } => {
                format!("the port is above 65535: write a port from 1 to 65535, as {meant}")
            }
            _ => format!("an IPv6 address needs brackets: write {meant}"),
        })
    }
}

/// Splits a text into host and port. The host is returned as written, with the brackets of an IPv6 address.
///
/// # Errors
/// The reason why the text is not a host and port.
pub fn host_and_port(text: &str) -> Result<(&str, Option<u16>), NoPlace> {
    let end = match text.strip_prefix('[') {
        Some(rest) => rest.find(']').filter(|end| is_ipv6(&rest[..*end])).ok_or(NoPlace::Other)? + 2,
        None if text.matches(':').count() > 1 => return Err(unbracketed(text)),
        None => text.find(':').unwrap_or(text.len()),
    };
    let (host, port) = text.split_at(end);
    if host.is_empty() {
        return Err(NoPlace::Other);
    }
    let Some(port) = port.strip_prefix(':') else {
        return if port.is_empty() { Ok((host, None)) } else { Err(NoPlace::Other) };
    };
    match port.parse() {
        Ok(port) => Ok((host, Some(port))),
        Err(_) if is_number(port) => Err(NoPlace::PortTooLarge { host: host.to_owned() }),
        Err(_) => Err(NoPlace::Other),
    }
}

/// Returns why a text with several colons and without brackets is invalid.
fn unbracketed(text: &str) -> NoPlace {
    let unbracketed = |address: &str, port| NoPlace::Unbracketed { address: address.to_owned(), port };
    match text.rsplit_once(':').filter(|(address, _)| is_ipv6(address)) {
        Some((address, port)) if is_number(port) => match port.parse() {
            Ok(port) => unbracketed(address, Some(port)),
            Err(_) => NoPlace::PortTooLarge { host: format!("[{address}]") },
        },
        _ if is_ipv6(text) => unbracketed(text, None),
        _ => NoPlace::Other,
    }
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// Returns whether a text is an IPv6 address, which may end with the number of a network interface: `fe80::1%2`.
pub(crate) fn is_ipv6(text: &str) -> bool {
    let (address, interface) = text.split_once('%').unwrap_or((text, "0"));
    address.parse::<Ipv6Addr>().is_ok() && interface.parse::<u32>().is_ok()
}

/// Returns whether a text is an ASCII host name, an IPv4 address, or an IPv6 address in brackets without a network
/// interface.
pub(crate) fn is_host(text: &str) -> bool {
    match text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
        Some(address) => address.parse::<Ipv6Addr>().is_ok(),
        None => text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte)),
    }
}

/// Returns whether a host name or IP address means this computer (loopback). An IPv6 address may have brackets.
pub(crate) fn is_loopback(host: &str) -> bool {
    let plain = host.trim_matches(['[', ']']);
    plain == "localhost" || plain.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Formats a host without brackets as it is written in a URL.
pub(crate) fn in_url(host: &str) -> String {
    if host.contains(':') { format!("[{host}]") } else { host.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_taken_apart_as_it_is_written() {
        for (text, place) in [
            ("plc", ("plc", None)),
            ("192.168.0.10:502", ("192.168.0.10", Some(502))),
            ("plc:0", ("plc", Some(0))),
            ("[::1]", ("[::1]", None)),
            ("[::1]:65535", ("[::1]", Some(65535))),
            ("[fe80::1%2]:4840", ("[fe80::1%2]", Some(4840))),
        ] {
            assert_eq!(host_and_port(text), Ok(place), "{text}");
        }
    }

    #[test]
    fn what_is_no_place_says_what_was_meant() {
        let help = |text: &str| host_and_port(text).unwrap_err().help(502, str::to_owned);
        for (text, port) in
            [("127.0.0.1:65536", "127.0.0.1:502"), ("[::1]:99999", "[::1]:502"), ("::1:99999", "[::1]:502")]
        {
            let said = help(text).unwrap();
            assert!(said.starts_with("the port is above 65535") && said.ends_with(port), "{said}");
        }
        for (text, meant) in [
            ("::1:15921", "[::1]:15921"),
            ("::1", "[::1]:502"),
            ("fe80::1%2", "[fe80::1%2]:502"),
            ("2001:db8::8:502", "[2001:db8::8]:502"),
            ("1:2:3:4:5:6:7:8", "[1:2:3:4:5:6:7:8]:502"),
        ] {
            let said = help(text).unwrap();
            assert_eq!(said, format!("an IPv6 address needs brackets: write {meant}"), "{text}");
        }
        for text in ["", ":502", "plc:", "plc:http", "a:b:c", "[plc]:502", "[::1", "[::1]502", "plc:-1"] {
            assert_eq!(help(text), None, "{text}");
        }
    }
}
