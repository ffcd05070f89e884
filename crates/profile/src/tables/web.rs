//! `[web]`: settings of the web page, the API and the metrics.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Deserialize;

use super::KeyContext;
use crate::host_port::{host_and_port, is_loopback};
use crate::ip_network::IpNetwork;

/// Web page, API and metrics.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Web")]
pub(crate) struct RawWeb {
    /// Host and port. Default "127.0.0.1:8080". Port 0 selects any free port.
    listen: Option<String>,
    /// File next to the profile with the operator's token, for viewing and for commands. At least 16 characters, not
    /// readable by others; `isotherm token` creates one. If `listen` is reachable from other computers, this file or
    /// `viewer_token_file` is required. A changed file is read again.
    token_file: Option<String>,
    /// Certificate and key of the web page, which is then only served over https. Changed files are read again.
    tls: Option<RawWebTls>,
    /// Whether the web page may be served to other computers without `tls`. Only for a network on which nobody else can
    /// listen. Default false.
    plain: Option<bool>,
    /// File with the token for viewing only: web page, API, metrics. Without this file, viewing needs no token on this
    /// computer, and the operator's token from other computers.
    viewer_token_file: Option<String>,
    /// File with the token of a collector such as Prometheus. It gives access to /metrics only.
    scrape_token_file: Option<String>,
    /// Clients that may send commands through web page and API. "token": holders of the operator's token (default).
    /// "local": also every user of this computer.
    commands: Option<Commands>,
    /// Names under which the web page may be opened without a token, in addition to localhost and its addresses.
    #[serde(default)]
    hosts: Vec<String>,
    /// Addresses or networks of proxies in front of the web page, as "10.0.0.7" or "10.0.0.0/24". The headers
    /// `Forwarded` and `X-Forwarded-…` are used only from these addresses. Requests from these addresses always need a
    /// token.
    #[serde(default)]
    trusted_proxies: Vec<String>,
    /// Language of the web page. Default: the first language that the browser prefers and the web page has, otherwise
    /// English.
    language: Option<Language>,
}

/// Certificate of the web page, as PEM files next to the profile.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "WebTls")]
struct RawWebTls {
    /// Certificate for the name that browsers use, followed by the intermediate certificates up to its authority.
    #[schemars(required)]
    cert: Option<String>,
    /// Private key of the certificate.
    #[schemars(required)]
    key: Option<String>,
}

/// Who may send commands over HTTP.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "CommandsWord", description = "")]
pub enum Commands {
    /// Holders of the operator's token.
    #[default]
    Token,
    /// Also every user of this computer.
    Local,
}

/// Language of the web page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "LanguageWord", description = "")]
pub enum Language {
    /// English.
    En,
    /// German.
    De,
    /// Japanese.
    Ja,
    /// Simplified Chinese.
    Zh,
}

impl Language {
    /// Returns the language code in profiles, in HTML and in browsers: `en`, `de`, `ja` or `zh`.
    pub fn code(self) -> &'static str {
        match self {
            Language::En => "en",
            Language::De => "de",
            Language::Ja => "ja",
            Language::Zh => "zh",
        }
    }
}

/// Settings of the web page, the API and the metrics, which one server provides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Web {
    /// Host and port. Port 0 selects any free port.
    pub listen: String,
    /// File with the operator's token. `None` if the profile names none.
    pub token_file: Option<PathBuf>,
    /// Certificate and key for https. `None` for http.
    pub tls: Option<WebTls>,
    /// Whether http without encryption is allowed for other computers.
    pub plain: bool,
    /// File with the token for viewing only. `None` if the profile names none.
    pub viewer_token_file: Option<PathBuf>,
    /// File with the token for reading the metrics only. `None` if the profile names none.
    pub scrape_token_file: Option<PathBuf>,
    /// Who may send commands.
    pub commands: Commands,
    /// Host names under which the web page may be opened without a token, in addition to localhost and its addresses.
    pub hosts: Vec<String>,
    /// Proxies in front of the web page. They report the client of a request, and the address of the page in the
    /// client's browser.
    pub trusted_proxies: Vec<IpNetwork>,
    /// Language of the web page. `None` for the browser's language.
    pub language: Option<Language>,
}

impl Web {
    /// Returns whether the profile names at least one token file. Without a token, clients on other computers have no
    /// access.
    pub fn has_token(&self) -> bool {
        let files = [&self.token_file, &self.viewer_token_file, &self.scrape_token_file];
        files.into_iter().any(Option::is_some)
    }
}

/// Files with the web page's certificate and key. They are read when the web page is served, and again when they
/// change.
#[derive(Clone, Debug, PartialEq)]
pub struct WebTls {
    /// Certificate of the web page.
    pub cert: PathBuf,
    /// Private key of the certificate.
    pub key: PathBuf,
}

/// Default port of the web page.
const USUAL: u16 = 8080;
const LISTEN: &str = "write host and port, as \"127.0.0.1:8080\"; port 0 selects any free port";

/// Hint for a web page that other computers can open without encryption.
pub const PLAIN: &str = "every computer on this network can read the token: write \
                         `tls = { cert = …, key = … }` in [web]. Write `plain = true` in [web] only if no \
                         other computer is on the network";

impl RawWeb {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Web {
        let listen = self.listen.clone().unwrap_or_else(|| format!("127.0.0.1:{USUAL}"));
        let tokens = ["token_file", "viewer_token_file", "scrape_token_file"];
        let has_token = tokens.iter().any(|key| !at.key(key).is_left_out());
        let place = host_and_port(&listen);
        match place.as_ref().ok().and_then(|(host, port)| port.map(|_| *host)) {
            None => {
                let help = place.err().and_then(|why| why.help(USUAL, str::to_owned));
                let help = help.unwrap_or_else(|| LISTEN.to_owned());
                at.key("listen").invalid(format!("`{listen}` is not a host with a port"), help);
            }
            Some(host) if !is_loopback(host) && !has_token => {
                let help =
                    "listen on 127.0.0.1, or give `token_file`, a file with the token that clients must send";
                at.key("listen").invalid(format!("`{listen}` is open to the network without a token"), help);
            }
            Some(host) if !is_loopback(host) && at.key("tls").is_left_out() => self.without_tls(at, &listen),
            Some(_) => {}
        }
        self.check_tokens(at);
        let file =
            |name: &Option<String>| name.as_ref().map(|name| PathBuf::from(at.report.files.path(name)));
        for (place, host) in self.hosts.iter().enumerate() {
            if !is_name(host) {
                let help = "write the name alone, as \"gw7.plant.example\": no scheme, no port, no path";
                at.key("hosts").item(place).invalid(format!("`{host}` is not a host name"), help);
            }
        }
        Web {
            listen,
            token_file: file(&self.token_file),
            viewer_token_file: file(&self.viewer_token_file),
            scrape_token_file: file(&self.scrape_token_file),
            commands: self.commands.unwrap_or_default(),
            hosts: self.hosts.clone(),
            trusted_proxies: self.proxies(at, has_token),
            tls: self.tls.as_ref().and_then(|tls| tls.resolve(&at.key("tls"))),
            plain: self.plain.unwrap_or(false),
            language: self.language,
        }
    }

    fn proxies(&self, at: &KeyContext<'_>, has_token: bool) -> Vec<IpNetwork> {
        let at = at.key("trusted_proxies");
        if !self.trusted_proxies.is_empty() && !has_token {
            let help = "give `token_file`, a file with the token that clients must send";
            at.invalid("`trusted_proxies` has no effect without a token: only this computer may view", help);
        }
        let mut proxies = Vec::new();
        for (place, text) in self.trusted_proxies.iter().enumerate() {
            match IpNetwork::parse(text) {
                Ok(network) => proxies.push(network),
                Err(help) => {
                    at.item(place).invalid(format!("`{text}` is not an IP address or a network"), help)
                }
            }
        }
        proxies
    }

    fn without_tls(&self, at: &KeyContext<'_>, listen: &str) {
        let what = format!("`{listen}` is open to the network in plain text");
        match self.plain {
            Some(true) => at.key("plain").warn(format!("{what}, because of `plain`"), PLAIN),
            _ => at.key("listen").invalid(what, PLAIN),
        }
    }

    fn check_tokens(&self, at: &KeyContext<'_>) {
        if self.token_file.is_some() && self.token_file == self.viewer_token_file {
            let help = "use two files: otherwise every viewer could give commands";
            at.key("viewer_token_file").invalid("this is the operator's token file", help);
        }
        for (other, whose) in [(&self.token_file, "operator's"), (&self.viewer_token_file, "viewer's")] {
            if self.scrape_token_file.is_some() && self.scrape_token_file == *other {
                let help = "use two files: a collector should only read /metrics";
                at.key("scrape_token_file").invalid(format!("this is the {whose} token file"), help);
            }
        }
        if self.commands == Some(Commands::Local) {
            let help = "remove `commands`, and write `token_file` (`isotherm token --out FILE` creates the \
                        file). A request through `ssh -L`, socat, or a proxy that adds no forwarding header \
                        looks as if it came from this computer";
            at.key("commands")
                .warn("every user of this computer can arm the axes through the web page", help);
        }
    }
}

impl RawWebTls {
    fn resolve(&self, at: &KeyContext<'_>) -> Option<WebTls> {
        let file = |key: &str, name: Option<&String>, what: &str| {
            let help = format!(
                "write the name of a PEM file next to the profile with {what} (docs/page.md says how to make \
                 it)"
            );
            at.key(key).missing(format!("`{key}` is missing: https needs it"), help);
            name.map(|name| PathBuf::from(at.report.files.path(name)))
        };
        at.key("key").secret(self.key.as_ref());
        let cert = file("cert", self.cert.as_ref(), "the web page's certificate");
        let key = file("key", self.key.as_ref(), "the private key of the certificate in `cert`");
        Some(WebTls { cert: cert?, key: key? })
    }
}

fn is_name(host: &str) -> bool {
    let is_letter = |letter: char| letter.is_ascii_alphanumeric() || "-._".contains(letter);
    !host.is_empty() && host.len() <= 253 && host.chars().all(is_letter)
}
