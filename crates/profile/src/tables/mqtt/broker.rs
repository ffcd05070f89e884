//! Address of an MQTT broker in a profile.

use std::fmt;

use crate::host_port::{host_and_port, in_url, is_host};

/// Address of an MQTT broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrokerUrl {
    /// Whether the connection uses TLS (`mqtts`).
    pub tls: bool,
    /// Host name or IP address of the broker, without brackets.
    pub host: String,
    /// Port of the broker.
    pub port: u16,
}

impl fmt::Display for BrokerUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.tls { "mqtts" } else { "mqtt" };
        write!(f, "{scheme}://{}:{}", in_url(&self.host), self.port)
    }
}

const EXAMPLE: &str = "write the address as \"mqtts://broker.plant.example:8883\"";

impl BrokerUrl {
    /// Parses the address of a broker.
    ///
    /// # Errors
    /// The text is not the address of a broker. The message and the hint do not quote a user or password.
    pub(super) fn parse(text: &str) -> Result<BrokerUrl, (String, String)> {
        let wrong = |message: &str, help: &str| Err((message.to_owned(), help.to_owned()));
        let (scheme, place) = text.split_once("://").unwrap_or_default();
        let tls = match scheme {
            "mqtts" => true,
            "mqtt" => false,
            _ => return wrong("the address does not begin with mqtts:// or mqtt://", EXAMPLE),
        };
        if place.contains('@') {
            let help =
                "remove the part before `@`, and write `user = { name = \"…\", password_file = \"…\" }`";
            return wrong("the address of a broker must not have a user or a password", help);
        }
        let place = place.strip_suffix('/').unwrap_or(place);
        let usual = if tls { 8883 } else { 1883 };
        let found = host_and_port(place);
        let Some((host, port)) = found.as_ref().ok().filter(|(host, port)| is_host(host) && *port != Some(0))
        else {
            let help = found.err().and_then(|why| why.help(usual, |place| format!("\"{scheme}://{place}\"")));
            return wrong(
                &format!("`{place}` is not a host with a port"),
                help.as_deref().unwrap_or(EXAMPLE),
            );
        };
        let (host, port) = (host.trim_matches(['[', ']']), port.unwrap_or(usual));
        Ok(BrokerUrl { tls, host: host.to_owned(), port })
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
            ("mqtt://me:secret@broker", "must not have a user"),
            ("mqtt://:1883", "not a host with a port"),
            ("mqtt://broker:0", "not a host with a port"),
            ("mqtt://broker/path", "not a host with a port"),
            ("mqtt://::1", "not a host with a port"),
        ] {
            let (message, _) = BrokerUrl::parse(text).unwrap_err();
            assert!(message.contains(why) && !message.contains("secret"), "{text}: {message}");
        }
    }
}
