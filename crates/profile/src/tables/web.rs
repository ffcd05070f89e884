//! `[web]`: page, API, metrics.

use std::net::IpAddr;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Deserialize;

use super::{At, host_of};

/// Page, API and metrics.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Web")]
pub(crate) struct RawWeb {
    /// Host and port. Default "127.0.0.1:8080"; port 0 takes any free one.
    listen: Option<String>,
    /// A file with the token that clients must send; required as soon as it listens beyond loopback.
    token_file: Option<String>,
    /// The page's certificate and its key: it is served over https alone then. Read again when they change.
    tls: Option<RawWebTls>,
    /// With `true` the page is served beyond loopback without `tls`: for a network on which nobody else listens.
    plain: Option<bool>,
    /// The language of the page. Default: the first that the browser wants and the page speaks, else English.
    language: Option<Language>,
}

/// What the page shows of itself, as PEM files beside the profile.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "WebTls")]
struct RawWebTls {
    /// Its certificate, for the name by which browsers call it, those that lead to its authority after it.
    #[schemars(required)]
    cert: Option<String>,
    /// The private key of that certificate.
    #[schemars(required)]
    key: Option<String>,
}

/// A language that the page speaks.
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
    /// Chinese, in simplified characters.
    Zh,
}

impl Language {
    /// As the profile, HTML and browsers write it.
    pub fn code(self) -> &'static str {
        match self {
            Language::En => "en",
            Language::De => "de",
            Language::Ja => "ja",
            Language::Zh => "zh",
        }
    }
}

/// Page, API, metrics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Web {
    /// Host and port; port 0 takes any free one.
    pub listen: String,
    /// A file with the token that is asked for; required beyond loopback.
    pub token_file: Option<PathBuf>,
    /// By what it is served over https; `None`: over http.
    pub tls: Option<WebTls>,
    /// Over http beyond loopback, too.
    pub plain: bool,
    /// The language of the page; `None`: the browser's.
    pub language: Option<Language>,
}

/// The files that the page's certificate and its key are in. They are read when it is served, and again when they change.
#[derive(Clone, Debug, PartialEq)]
pub struct WebTls {
    /// The certificate.
    pub cert: PathBuf,
    /// Its private key.
    pub key: PathBuf,
}

/// What to do about a page that listens beyond loopback in plain text.
pub const PLAIN: &str = "whoever listens on that network reads the token: give `tls = { cert = …, key = … }` in [web], or \
    write `plain = true` there, where nobody else is on it";

impl RawWeb {
    pub(super) fn resolve(&self, at: &At<'_>) -> Web {
        let listen = self.listen.clone().unwrap_or_else(|| "127.0.0.1:8080".to_owned());
        let has_token = at.key("token_file").is_written();
        match host_of(&listen) {
            None => {
                let help = "write host and port, as \"127.0.0.1:8080\"; port 0 takes any free one";
                at.key("listen").wrong(format!("`{listen}` is no host and port"), help);
            }
            Some(host) if !is_loopback(host) && !has_token => {
                let help =
                    "listen on 127.0.0.1, or give `token_file`, a file with the token that clients must send";
                at.key("listen").wrong(format!("`{listen}` is open to the network without a token"), help);
            }
            Some(host) if !is_loopback(host) && !at.key("tls").is_written() => self.without_tls(at, &listen),
            Some(_) => {}
        }
        Web {
            listen,
            token_file: self.token_file.clone().map(PathBuf::from),
            tls: self.tls.as_ref().and_then(|tls| tls.resolve(&at.key("tls"))),
            plain: self.plain.unwrap_or(false),
            language: self.language,
        }
    }

    fn without_tls(&self, at: &At<'_>, listen: &str) {
        let what = format!("`{listen}` is open to the network in plain text");
        match self.plain {
            Some(true) => at.key("plain").warn(format!("{what}, as this says"), PLAIN),
            _ => at.key("listen").wrong(what, PLAIN),
        }
    }
}

impl RawWebTls {
    fn resolve(&self, at: &At<'_>) -> Option<WebTls> {
        let file = |key: &str, name: Option<&String>, what: &str| {
            if name.is_none() {
                let help = format!(
                    "name a PEM file beside the profile with {what} (docs/page.md says how to make it)"
                );
                at.key(key).missing(format!("`{key}` is missing: https needs it"), help);
            }
            name.map(|name| PathBuf::from(at.check.files.path(name)))
        };
        at.key("key").secret(self.key.as_ref());
        let cert = file("cert", self.cert.as_ref(), "the page's certificate");
        let key = file("key", self.key.as_ref(), "the private key of the certificate in `cert`");
        Some(WebTls { cert: cert?, key: key? })
    }
}

fn is_loopback(host: &str) -> bool {
    let plain = host.trim_start_matches('[').trim_end_matches(']');
    plain == "localhost" || plain.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}
