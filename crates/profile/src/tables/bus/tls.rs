//! Modbus/TCP Security: the files by which the two ends of a line know each other.
//!
//! They are read with the profile, so that one that is missing is reported at its key. What is in them is judged by
//! whoever opens the line, who has TLS; each file knows where in the profile it is named, so that its fault is reported
//! there.

use std::fmt;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::document::Section;
use crate::error::ProfileError;
use crate::tables::At;

/// Certificate files of Modbus/TCP Security, in PEM form.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Tls")]
pub(crate) struct RawTls {
    /// Who signs the device's certificate, or that very certificate.
    #[schemars(required)]
    ca: Option<String>,
    /// The gateway's certificate.
    #[schemars(required)]
    cert: Option<String>,
    /// The gateway's private key.
    #[schemars(required)]
    key: Option<String>,
    /// The name in the device's certificate. Default: the host of `address`.
    name: Option<String>,
}

/// The port that the Modbus Organization has for it.
pub const TLS_PORT: u16 = 802;

/// The security of a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Tls {
    /// The certificates that are trusted.
    pub ca: PemFile,
    /// The gateway's certificate.
    pub cert: PemFile,
    /// Its private key.
    pub key: PemFile,
    /// The name that the device's certificate must have.
    pub name: String,
    /// Where that name comes from.
    name_at: ProfileError,
}

/// One of the files.
#[derive(Clone, PartialEq)]
pub struct PemFile {
    /// Its name, as written.
    pub name: String,
    /// What is in it.
    pub bytes: Vec<u8>,
    named_at: ProfileError,
}

impl Tls {
    /// Whom a secured line trusts, and what it shows.
    pub(super) fn preview(&self) -> Section {
        let (name, trusts, shows) = (&self.name, &self.ca.name, &self.cert.name);
        let mut section = Section::default();
        section.line(format!(
            "  trusts a certificate for {name} signed by one in {trusts}, or one in there; shows {shows}"
        ));
        section.entry("name", name);
        section.entry("trusts", trusts);
        section.entry("shows", shows);
        section
    }

    /// The error that the name can be nobody's.
    pub fn wrong_name(&self) -> ProfileError {
        let message = format!("no certificate can be for the name `{}`", self.name);
        ProfileError { message, ..self.name_at.clone() }
    }
}

impl PemFile {
    /// The error that this is wrong with the file.
    pub fn wrong(&self, why: &str) -> ProfileError {
        ProfileError { message: format!("{}: {why}", self.name), ..self.named_at.clone() }
    }
}

/// Without its content: one of them is a secret.
impl fmt::Debug for PemFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("PemFile").field(&self.name).finish()
    }
}

impl RawTls {
    /// The security of a line to this host.
    pub(super) fn resolve(&self, at: &At<'_>, host: &str) -> Option<Tls> {
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let (name, key) = match &self.name {
            Some(name) => (name.as_str(), "name"),
            None => (host, "ca"),
        };
        let help = "write name = \"…\", a DNS name or an IP address that the device's certificate has";
        let name_at = at.check.spans.at_value(&at.key(key).path, "", Some(help.to_owned()));
        let ca = pem(
            at,
            "ca",
            self.ca.as_ref(),
            "name a PEM file beside the profile with the certificate of the authority that signed the device's, or \
             with the device's own",
        );
        let cert = pem(
            at,
            "cert",
            self.cert.as_ref(),
            "name a PEM file beside the profile with the gateway's certificate, those that lead to its authority after it",
        );
        let key = pem(
            at,
            "key",
            self.key.as_ref(),
            "name a PEM file beside the profile with the private key of the certificate in `cert`",
        );
        at.key("key").secret(self.key.as_ref());
        Some(Tls { ca: ca?, cert: cert?, key: key?, name: name.to_owned(), name_at })
    }
}

fn pem(at: &At<'_>, key: &str, name: Option<&String>, help: &str) -> Option<PemFile> {
    let at = at.key(key);
    let Some(name) = name else {
        at.missing(format!("`{key}` is missing: Modbus/TCP Security needs it"), help);
        return None;
    };
    pem_file(&at, name, help)
}

/// The file that this key names.
pub(in crate::tables) fn pem_file(at: &At<'_>, name: &str, help: &str) -> Option<PemFile> {
    let bytes = at.file(name, help)?;
    let named_at = at.check.spans.at_value(&at.path, "", Some(help.to_owned()));
    Some(PemFile { name: name.to_owned(), bytes, named_at })
}
