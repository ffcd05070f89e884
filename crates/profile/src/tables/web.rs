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
    /// The language of the page. Default: the first that the browser wants and the page speaks, else English.
    language: Option<Language>,
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
    /// The language of the page; `None`: the browser's.
    pub language: Option<Language>,
}

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
            Some(_) => {}
        }
        Web { listen, token_file: self.token_file.clone().map(PathBuf::from), language: self.language }
    }
}

fn is_loopback(host: &str) -> bool {
    let plain = host.trim_start_matches('[').trim_end_matches(']');
    plain == "localhost" || plain.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}
