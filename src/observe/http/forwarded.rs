//! Report of a trusted proxy about a request: the address of the client, and the address of the page in its browser.
//!
//! A proxy sends `Forwarded` (RFC 7239), or `X-Forwarded-For`, `X-Forwarded-Proto` and `X-Forwarded-Host`. Each proxy
//! adds an entry at the end. Entries are read backwards from the last entry to the first address that is no trusted
//! proxy. Earlier entries come from a client, which can send any text, and are ignored.

use std::net::IpAddr;

use axum::http::HeaderMap;
use isotherm_profile::IpNetwork;

/// Maximum length of the host name, and of the path of the page on a proxy, in bytes. A longer text is ignored.
const LONGEST: usize = 255;

/// Scheme of the page's address in the browser: HTTP or HTTPS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scheme {
    Http,
    Https,
}

/// Report of the trusted proxies about a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Forwarded {
    /// Address of the client. If no proxy reports it, this is the address of the proxy that sent the request.
    pub(super) client: IpAddr,
    /// Scheme in the browser; `None` if it is not reported.
    pub(super) scheme: Option<Scheme>,
    /// Host and port in the browser; `None` if they are not reported.
    pub(super) host: Option<String>,
    /// Path of the page on the proxy, without a slash at its end. Empty at the top of the proxy.
    pub(super) prefix: String,
}

/// Reason to reject a request, because a client may have forged the report of a proxy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UnusableReport {
    /// `Forwarded` and `X-Forwarded-…` differ. The proxy sets one of these headers, and forwards the other header as
    /// the client has sent it.
    Differs,
    /// A quote in `Forwarded` is not closed. The entry of the proxy would be a part of the client's text.
    OpenQuote,
}

/// Values from one kind of header: `Forwarded` or `X-Forwarded-…`. A value that is not reported is `None`.
#[derive(Debug, Default)]
struct Report {
    client: Option<IpAddr>,
    scheme: Option<Scheme>,
    host: Option<String>,
}

impl Forwarded {
    /// Reads the report about a request that has arrived from the trusted proxy `peer`.
    pub(super) fn read(
        headers: &HeaderMap,
        peer: IpAddr,
        trusted: &[IpNetwork],
    ) -> Result<Forwarded, UnusableReport> {
        let (standard, usual) = (standard(headers, trusted)?, usual(headers, trusted));
        Ok(Forwarded {
            client: one_of(standard.client, usual.client)?.unwrap_or(peer),
            scheme: one_of(standard.scheme, usual.scheme)?,
            host: one_of(standard.host, usual.host)?,
            prefix: prefix(headers).unwrap_or_default().to_owned(),
        })
    }
}

/// Returns the value that the two kinds of headers report. A value from one kind is sufficient. `None` if no
/// header reports a value; an error if the two values differ.
fn one_of<T: PartialEq>(one: Option<T>, other: Option<T>) -> Result<Option<T>, UnusableReport> {
    match (one, other) {
        (Some(one), Some(other)) if one != other => Err(UnusableReport::Differs),
        (one, other) => Ok(one.or(other)),
    }
}

/// Reads the report in the standard header, for example `Forwarded: for=192.0.2.7;proto=https;host=gw7, for=10.0.0.7`.
fn standard(headers: &HeaderMap, trusted: &[IpNetwork]) -> Result<Report, UnusableReport> {
    let text = joined(headers, "forwarded");
    // A proxy closes its own quotes, so an odd number means that the client has left one open.
    if text.matches('"').count() % 2 == 1 {
        return Err(UnusableReport::OpenQuote);
    }
    let elements: Vec<&str> = split(&text, ',').filter(|element| !element.trim().is_empty()).collect();
    let nodes: Vec<Option<IpAddr>> =
        elements.iter().map(|element| address(parameter(element, "for")?)).collect();
    let (client, count) = walk(&nodes, trusted);
    let Some(element) = elements.len().checked_sub(count).and_then(|place| elements.get(place)) else {
        return Ok(Report::default());
    };
    Ok(Report {
        client,
        scheme: parameter(element, "proto").and_then(scheme),
        host: parameter(element, "host").filter(|value| is_host(value)).map(str::to_owned),
    })
}

/// Returns the value of a parameter in an element of `Forwarded`, without its quotes; `None` if the element
/// does not have the parameter.
fn parameter<'a>(element: &'a str, name: &str) -> Option<&'a str> {
    let mut pairs = split(element, ';').filter_map(|pair| pair.split_once('='));
    let (_, value) = pairs.find(|(known, _)| known.trim().eq_ignore_ascii_case(name))?;
    Some(value.trim().trim_matches('"'))
}

/// Reads the report in the headers `X-Forwarded-For`, `X-Forwarded-Proto` and `X-Forwarded-Host`.
fn usual(headers: &HeaderMap, trusted: &[IpNetwork]) -> Report {
    let texts =
        ["x-forwarded-for", "x-forwarded-proto", "x-forwarded-host"].map(|name| joined(headers, name));
    let [nodes, schemes, hosts] = texts.each_ref().map(|text| entries(text));
    let nodes: Vec<Option<IpAddr>> = nodes.into_iter().map(address).collect();
    let (client, count) = walk(&nodes, trusted);
    // Many proxies replace these two, so that they have fewer entries.
    let of_the_same_proxy = |values: &[&str]| {
        values.get(values.len().saturating_sub(count.max(1))).map(|value| (*value).to_owned())
    };
    Report {
        client,
        scheme: of_the_same_proxy(&schemes).and_then(|word| scheme(&word)),
        host: of_the_same_proxy(&hosts).filter(|host| is_host(host)),
    }
}

/// Returns the address of the client, and the number of entries from trusted proxies. The address is `None` if the last
/// proxy does not report the client.
fn walk(nodes: &[Option<IpAddr>], trusted: &[IpNetwork]) -> (Option<IpAddr>, usize) {
    let (mut client, mut count) = (None, 0);
    for node in nodes.iter().rev() {
        count += 1;
        let Some(address) = *node else { break };
        client = Some(address);
        if !trusted.iter().any(|network| network.contains(address)) {
            break;
        }
    }
    (client, count)
}

/// Returns the lines of a header as one line. Bytes that are not text are replaced. A client can therefore not use such
/// a byte to hide the entry that a proxy has added.
fn joined(headers: &HeaderMap, name: &str) -> String {
    let lines = headers.get_all(name).into_iter().map(|line| String::from_utf8_lossy(line.as_bytes()));
    lines.collect::<Vec<_>>().join(", ")
}

/// Returns the entries of a header whose values are separated by commas.
fn entries(text: &str) -> Vec<&str> {
    text.split(',').map(str::trim).filter(|entry| !entry.is_empty()).collect()
}

/// Splits a text at each separator that is not within quotes.
fn split(text: &str, separator: char) -> impl Iterator<Item = &str> {
    let mut is_quoted = false;
    text.split(move |one| {
        is_quoted ^= one == '"';
        one == separator && !is_quoted
    })
}

/// Returns the address in an entry, which may have a port. `None` for `unknown` and for a hidden name.
fn address(node: &str) -> Option<IpAddr> {
    let bare = match node.strip_prefix('[') {
        Some(rest) => rest.split(']').next()?,
        None if node.matches(':').count() == 1 => node.split(':').next()?,
        None => node,
    };
    bare.parse::<IpAddr>().ok().map(|address| address.to_canonical())
}

fn scheme(word: &str) -> Option<Scheme> {
    match word {
        word if word.eq_ignore_ascii_case("https") => Some(Scheme::Https),
        word if word.eq_ignore_ascii_case("http") => Some(Scheme::Http),
        _ => None,
    }
}

fn is_host(text: &str) -> bool {
    let is_letter = |one: char| one.is_ascii_alphanumeric() || "-._:[]".contains(one);
    !text.is_empty() && text.len() <= LONGEST && text.chars().all(is_letter)
}

/// Returns the path of the page on the proxy, without the slash at its end. `None` if the proxy reports no
/// valid path. The session cookie is valid only below this path.
fn prefix(headers: &HeaderMap) -> Option<&str> {
    let mut lines = headers.get_all("x-forwarded-prefix").into_iter();
    let path = lines.next()?.to_str().ok()?.trim().trim_end_matches('/');
    let is_letter = |one: char| one.is_ascii_alphanumeric() || "-._~/".contains(one);
    let is_path = path.starts_with('/') && !path.contains("//") && path.chars().all(is_letter);
    (lines.next().is_none() && is_path && path.len() <= LONGEST).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;
    use proptest::prelude::*;

    const PEER: &str = "127.0.0.1";

    fn headers(lines: &[(&str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in lines {
            let name: axum::http::HeaderName = name.parse().unwrap();
            headers.append(name, HeaderValue::from_bytes(value.as_bytes()).unwrap());
        }
        headers
    }

    fn read(lines: &[(&str, &str)]) -> Result<Forwarded, UnusableReport> {
        let trusted = ["127.0.0.1", "10.0.0.0/24"].map(|text| IpNetwork::parse(text).unwrap());
        Forwarded::read(&headers(lines), PEER.parse().unwrap(), &trusted)
    }

    #[test]
    fn the_client_is_the_last_address_that_is_no_trusted_proxy() {
        for (name, value, client) in [
            ("x-forwarded-for", "192.0.2.7", "192.0.2.7"),
            ("x-forwarded-for", "192.0.2.7, 10.0.0.7", "192.0.2.7"),
            // A client can send any entries before its own address.
            ("x-forwarded-for", "127.0.0.1, 192.0.2.66, 192.0.2.7, 10.0.0.7", "192.0.2.7"),
            ("x-forwarded-for", "10.0.0.8, 10.0.0.7", "10.0.0.8"),
            ("x-forwarded-for", "192.0.2.7:4711", "192.0.2.7"),
            ("x-forwarded-for", "2001:db8::7", "2001:db8::7"),
            ("x-forwarded-for", "[2001:db8::7]:4711", "2001:db8::7"),
            ("x-forwarded-for", "::ffff:192.0.2.7", "192.0.2.7"),
            ("x-forwarded-for", "192.0.2.7, unknown", PEER),
            ("x-forwarded-for", "192.0.2.7, unknown, 10.0.0.7", "10.0.0.7"),
            ("x-forwarded-for", "", PEER),
            // A client can send bytes that are no text in the line to which the proxy adds its address.
            ("x-forwarded-for", "é, 192.0.2.7", "192.0.2.7"),
            ("forwarded", "for=é, for=192.0.2.7", "192.0.2.7"),
            ("x-real-ip", "192.0.2.7", PEER),
            ("forwarded", "for=192.0.2.7;proto=https", "192.0.2.7"),
            ("forwarded", "For=\"[2001:db8::7]:4711\"", "2001:db8::7"),
            ("forwarded", "for=192.0.2.66, for=192.0.2.7;by=10.0.0.7, for=10.0.0.7", "192.0.2.7"),
            ("forwarded", "for=_hidden", PEER),
            ("forwarded", "for=192.0.2.66;by=\",\", for=192.0.2.7, ", "192.0.2.7"),
        ] {
            let report = read(&[(name, value)]).unwrap();
            assert_eq!(report.client, client.parse::<IpAddr>().unwrap(), "{name}: {value}");
        }
    }

    #[test]
    fn scheme_and_host_are_those_that_the_outermost_trusted_proxy_reports() {
        let https = |host: &str| (Some(Scheme::Https), Some(host.to_owned()));
        for (lines, expected) in [
            (
                &[
                    ("x-forwarded-for", "192.0.2.7"),
                    ("x-forwarded-proto", "https"),
                    ("x-forwarded-host", "gw7:8443"),
                ][..],
                https("gw7:8443"),
            ),
            (&[("x-forwarded-proto", "HTTPS"), ("x-forwarded-host", "gw7")], https("gw7")),
            (
                &[
                    ("x-forwarded-for", "192.0.2.66, 192.0.2.7, 10.0.0.7"),
                    ("x-forwarded-proto", "http, https, http"),
                    ("x-forwarded-host", "evil, gw7, inner"),
                ],
                https("gw7"),
            ),
            (
                &[
                    ("x-forwarded-for", "192.0.2.7, 10.0.0.7"),
                    ("x-forwarded-proto", "https"),
                    ("x-forwarded-host", "gw7"),
                ],
                https("gw7"),
            ),
            (
                &[(
                    "forwarded",
                    "for=192.0.2.66;proto=http;host=evil, for=192.0.2.7;proto=https;host=\"gw7\", for=10.0.0.7;proto=http;host=inner",
                )],
                https("gw7"),
            ),
            (&[("x-forwarded-proto", "ftp"), ("x-forwarded-host", "gw 7/")], (None, None)),
            (&[], (None, None)),
        ] {
            let report = read(lines).unwrap();
            assert_eq!((report.scheme, report.host), expected, "{lines:?}");
        }
    }

    #[test]
    fn what_one_form_says_and_the_other_contradicts_is_refused() {
        let usual = ("x-forwarded-for", "192.0.2.7");
        assert_eq!(read(&[usual, ("forwarded", "for=127.0.0.1")]), Err(UnusableReport::Differs));
        assert_eq!(
            read(&[usual, ("x-forwarded-proto", "https"), ("forwarded", "for=192.0.2.7;proto=http")]),
            Err(UnusableReport::Differs)
        );
        assert_eq!(
            read(&[("x-forwarded-host", "gw7"), ("forwarded", "for=192.0.2.7;host=gw8")]),
            Err(UnusableReport::Differs)
        );
        let both = read(&[usual, ("forwarded", "for=192.0.2.7;proto=https")]).unwrap();
        assert_eq!((both.client.to_string(), both.scheme), ("192.0.2.7".to_owned(), Some(Scheme::Https)));
    }

    /// The entry that the proxy adds would be a part of the client's text. The server would then accept the
    /// address that the client has sent.
    #[test]
    fn a_quote_that_a_client_leaves_open_is_refused() {
        let proxy = ", for=192.0.2.7;proto=https";
        for forged in ["for=\"192.0.2.66", "for=192.0.2.66;by=\"", "for=192.0.2.66;by=\"\\\"\""] {
            let line = format!("{forged}{proxy}");
            assert_eq!(read(&[("forwarded", line.as_str())]), Err(UnusableReport::OpenQuote), "{line}");
            let apart = [("forwarded", forged), ("forwarded", "for=\"[2001:db8::7]:4711\"")];
            assert_eq!(read(&apart), Err(UnusableReport::OpenQuote), "{forged}");
        }
    }

    #[test]
    fn a_path_on_the_proxy_has_no_slash_at_its_end_and_nothing_that_ends_an_attribute() {
        for (written, path) in [
            ("/grinder-3", "/grinder-3"),
            ("/shop/grinder-3/", "/shop/grinder-3"),
            ("/", ""),
            ("grinder-3", ""),
            ("//evil", ""),
            ("/a; Domain=evil", ""),
            ("/a,/b", ""),
        ] {
            assert_eq!(read(&[("x-forwarded-prefix", written)]).unwrap().prefix, path, "{written}");
        }
        assert_eq!(read(&[("x-forwarded-prefix", "/a"), ("x-forwarded-prefix", "/b")]).unwrap().prefix, "");
        assert_eq!(read(&[("x-forwarded-prefix", &format!("/{}", "x".repeat(LONGEST)))]).unwrap().prefix, "");
    }

    proptest! {
        /// Entries that a client sends before the entry of the proxy change nothing.
        #[test]
        fn no_client_can_name_another_address(forged in "[0-9a-f:., \\[\\]\"=;unkow]{0,60}") {
            let honest = read(&[("x-forwarded-for", "192.0.2.7")]).unwrap();
            let line = format!("{forged}, 192.0.2.7");
            prop_assert_eq!(read(&[("x-forwarded-for", line.as_str())]).map(|report| report.client), Ok(honest.client));
            for proxy in ["for=192.0.2.7", "For=\"192.0.2.7:4711\";proto=https"] {
                let line = format!("{forged}, {proxy}");
                if let Ok(report) = read(&[("forwarded", line.as_str())]) {
                    prop_assert_eq!(report.client, honest.client, "{}", line);
                }
            }
        }
    }
}
