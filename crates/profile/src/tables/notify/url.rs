//! Address of a web server in a profile. Path and query may be secret, so they are never shown.

use std::fmt;

use crate::host_port::{NoPlace, host_and_port, in_url, is_host};

/// Maximum length of an address in bytes. A longer one is probably a copying mistake.
const LONGEST: usize = 2000;
/// Placeholder in an address for a token that is in a separate file.
const TOKEN: &str = "{token}";

/// Parsed address for http or https.
#[derive(Clone, PartialEq, Eq)]
pub struct Url {
    /// Whether the scheme is https.
    pub tls: bool,
    /// Name or address of the server, without brackets.
    pub host: String,
    /// Port of the server.
    pub port: u16,
    /// Path and query of a request, with the placeholder of the token.
    target: String,
}

/// Formats only scheme, host and port. Path and query may be secret.
impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", if self.tls { "https" } else { "http" }, self.authority())
    }
}

impl fmt::Debug for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// Message and hint for an invalid address. They do not contain the address, because a part of the
/// address may be secret.
type Wrong = (String, &'static str);

const WRITE: &str = "write the address as \"https://alarms.plant.example/isotherm\"";

impl Url {
    /// Parses an address.
    ///
    /// # Errors
    /// The text is not a valid address. The error is a message and a hint.
    pub fn parse(text: &str) -> Result<Url, Wrong> {
        let wrong = |message: &str, help| Err((message.to_owned(), help));
        let (scheme, rest) = text.split_once("://").unwrap_or_default();
        let tls = match scheme.to_ascii_lowercase().as_str() {
            "https" => true,
            "http" => false,
            _ => return wrong("the address does not begin with https:// or http://", WRITE),
        };
        if text.len() > LONGEST {
            return Err((
                format!("the address has {} characters; at most {LONGEST} are allowed", text.len()),
                WRITE,
            ));
        }
        let end = rest.find(['/', '?', '#']).unwrap_or(rest.len());
        let (authority, target) = rest.split_at(end);
        if !is_of_an_address(authority) || !target.split(TOKEN).all(is_of_an_address) {
            return wrong(
                "the address has characters that are not allowed",
                "write these characters as % and two digits (a space is %20). Write a host name with special \
                 letters in its xn-- form. Write `{token}` once, in the place of the token",
            );
        }
        if target.matches(TOKEN).count() > 1 {
            return wrong("the address contains the token more than once", "write `{token}` once");
        }
        if authority.contains('@') {
            return wrong(
                "a URL in a profile must not have a user or a password",
                "remove the part before `@`, and write a token into the file of `token_file`",
            );
        }
        if target.contains('#') {
            return wrong("the address has a part after `#`, which is never sent", "remove this part");
        }
        let found = host_and_port(authority);
        let Some((host, port)) = found.as_ref().ok().filter(|(host, port)| is_host(host) && *port != Some(0))
        else {
            let help = match found {
                Err(NoPlace::PortTooLarge { .. }) => "the port is above 65535: write one from 1 to 65535",
                Err(NoPlace::Unbracketed { .. }) => {
                    "an IPv6 address needs brackets: write it as \"https://[::1]:8443/isotherm\""
                }
                _ => WRITE,
            };
            return wrong("the address has no host, or an invalid port", help);
        };
        let (host, port) = (host.trim_matches(['[', ']']), port.unwrap_or_else(|| usual(tls)));
        let slash = if target.starts_with('/') { "" } else { "/" };
        Ok(Url { tls, host: host.to_owned(), port, target: format!("{slash}{target}") })
    }

    /// Returns whether the address contains the placeholder of a token.
    pub fn has_token(&self) -> bool {
        self.target.contains(TOKEN)
    }

    /// Returns path and query of a request. `None` if the token has characters that an address cannot contain.
    pub fn target(&self, token: Option<&str>) -> Option<String> {
        let token = token.unwrap_or_default();
        (is_of_an_address(token) && !token.contains('#')).then(|| self.target.replacen(TOKEN, token, 1))
    }

    /// Returns host and port of a request. The default port of the scheme is omitted.
    pub fn authority(&self) -> String {
        let host = in_url(&self.host);
        if self.port == usual(self.tls) { host } else { format!("{host}:{}", self.port) }
    }
}

fn is_of_an_address(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_graphic() && !b"\"<>\\^`{|}".contains(&byte))
}

fn usual(tls: bool) -> u16 {
    if tls { 443 } else { 80 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_taken_apart_and_shown_without_what_may_be_secret() {
        for (text, shown, authority, target) in [
            ("https://a.example/b?c=d", "https://a.example", "a.example", "/b?c=d"),
            ("HTTP://a.example", "http://a.example", "a.example", "/"),
            ("http://10.0.0.7:8080/x", "http://10.0.0.7:8080", "10.0.0.7:8080", "/x"),
            ("https://[::1]:8443?k", "https://[::1]:8443", "[::1]:8443", "/?k"),
            ("https://a:443/", "https://a", "a", "/"),
        ] {
            let url = Url::parse(text).unwrap();
            assert_eq!(
                (url.to_string(), url.authority(), url.target(None)),
                (shown.into(), authority.into(), Some(target.into()))
            );
            assert_eq!((format!("{url:?}"), url.has_token()), (shown.into(), false));
        }
    }

    #[test]
    fn a_token_stands_where_the_address_has_its_place_and_only_one_that_an_address_can_have() {
        let url = Url::parse("https://hooks.example/in/{token}/x?y").unwrap();
        assert!(url.has_token());
        for (token, target) in [
            ("T0/B1/z%20?k=v", Some("/in/T0/B1/z%20?k=v/x?y")),
            ("a b", None),
            ("a\r\nX:", None),
            ("a#b", None),
            ("{token}", None),
        ] {
            assert_eq!(url.target(Some(token)).as_deref(), target, "{token}");
        }
    }

    #[test]
    fn what_is_no_address_is_refused_and_nothing_of_it_is_quoted() {
        for (text, why) in [
            ("alarms.secret.example", "does not begin with"),
            ("ftp://secret/", "does not begin with"),
            ("https://user:secret@host/", "must not have a user"),
            ("https:///secret", "no host"),
            ("https://host:0/secret", "an invalid port"),
            ("https://host:99999/secret", "an invalid port"),
            ("https://[::secret]/", "no host"),
            ("https://host/secret#x", "after `#`"),
            ("https://host/se cret", "characters that are not allowed"),
            ("https://hüst/secret", "characters that are not allowed"),
            ("https://host/secret\r\nX: y", "characters that are not allowed"),
            ("https://host/{secret}", "characters that are not allowed"),
            ("https://{token}/secret", "characters that are not allowed"),
            ("https://host/{token}/secret/{token}", "more than once"),
        ] {
            let (message, help) = Url::parse(text).unwrap_err();
            assert!(message.contains(why) && !message.contains("secret"), "{text}: {message}");
            assert!(!help.contains("secret"), "{help}");
        }
        assert!(Url::parse(&format!("https://a/{}", "x".repeat(2000))).unwrap_err().0.contains("2010"));
    }
}
