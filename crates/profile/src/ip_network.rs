//! Networks of IP addresses in profiles: `10.0.0.7`, `10.0.0.0/24`, `2001:db8::/48`.

use std::net::IpAddr;

/// Network of IP addresses. A single address is a network that contains only this address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IpNetwork {
    /// Any address of the network. An IPv4 address is never stored as IPv6.
    address: IpAddr,
    /// Number of leading bits that all addresses of the network share.
    prefix: u32,
}

impl IpNetwork {
    /// Parses an address, or an address and the number of leading bits: `10.0.0.0/24`.
    ///
    /// # Errors
    /// The text is not a network. The error is a hint for the user.
    pub fn parse(text: &str) -> Result<IpNetwork, &'static str> {
        const FORM: &str =
            "write an address, as \"10.0.0.7\", or a network, as \"10.0.0.0/24\"; a host name is not allowed";
        let (address, prefix) = match text.split_once('/') {
            Some((address, prefix)) => (address, Some(prefix)),
            None => (text, None),
        };
        let address = address.parse::<IpAddr>().map_err(|_| FORM)?.to_canonical();
        let longest: u32 = if address.is_ipv4() { 32 } else { 128 };
        let prefix = match prefix {
            Some(prefix) if prefix.bytes().all(|digit| digit.is_ascii_digit()) => {
                prefix.parse::<u32>().map_err(|_| FORM)?
            }
            Some(_) => return Err(FORM),
            None => longest,
        };
        match prefix {
            0 => Err(
                "this network contains every address: write the addresses of the proxies, or a network that contains \
                 only the proxies",
            ),
            prefix if prefix > longest => {
                Err("an IPv4 network has at most 32 leading bits, an IPv6 network at most 128")
            }
            prefix => Ok(IpNetwork { address, prefix }),
        }
    }

    /// Returns whether an address belongs to the network. An IPv4 address that is written as IPv6 counts as IPv4.
    pub fn contains(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        address.is_ipv4() == self.address.is_ipv4() && self.leading(address) == self.leading(self.address)
    }

    /// Returns the first `prefix` bits of an address, which identify the network.
    fn leading(&self, address: IpAddr) -> u128 {
        let bits = match address {
            IpAddr::V4(address) => u128::from(address.to_bits()) << 96,
            IpAddr::V6(address) => address.to_bits(),
        };
        // The prefix has at least one bit, so the shift is shorter than the number.
        bits >> (128 - self.prefix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_contains_the_addresses_with_its_leading_bits_and_no_others() {
        for (network, address, contains) in [
            ("10.0.0.7", "10.0.0.7", true),
            ("10.0.0.7", "10.0.0.8", false),
            ("10.0.0.7", "::ffff:10.0.0.7", true),
            ("10.0.0.0/24", "10.0.0.255", true),
            ("10.0.0.0/24", "10.0.1.0", false),
            ("10.0.0.9/24", "10.0.0.1", true),
            ("128.0.0.0/1", "255.0.0.1", true),
            ("128.0.0.0/1", "127.0.0.1", false),
            ("::1", "::1", true),
            ("::1", "127.0.0.1", false),
            ("2001:db8::/48", "2001:db8:0:7::1", true),
            ("2001:db8::/48", "2001:db8:1::1", false),
            ("::ffff:10.0.0.0/8", "10.9.9.9", true),
        ] {
            let parsed = IpNetwork::parse(network).unwrap();
            assert_eq!(parsed.contains(address.parse().unwrap()), contains, "{network} {address}");
        }
    }

    #[test]
    fn a_text_that_is_no_network_has_a_hint() {
        for (text, hint) in [
            ("", "write an address"),
            ("proxy.plant.example", "a host name is not allowed"),
            ("10.0.0.0/", "write an address"),
            ("10.0.0.0/+8", "write an address"),
            ("10.0.0.0/999999999999", "write an address"),
            ("10.0.0.0/33", "at most 32"),
            ("::1/129", "at most 128"),
            ("0.0.0.0/0", "every address"),
            ("::/0", "every address"),
        ] {
            assert!(IpNetwork::parse(text).unwrap_err().contains(hint), "{text}");
        }
    }
}
