//! Modbus/TCP Security: files with which the two ends of a line authenticate each other.
//!
//! These files are read together with the profile, so that a missing file is reported at its key. The module
//! that opens the line checks their content, because only that module has a TLS library. Each [`NamedFile`]
//! stores the position of its key in the profile, so that an error can be reported at this position.

use std::fmt;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::document::{Section, entries};
use crate::error::ProfileError;
use crate::tables::KeyContext;

/// Certificate files of Modbus/TCP Security, in PEM form.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Tls")]
pub(crate) struct RawTls {
    /// Certificate of the authority that signed the device's certificate, or the device's certificate itself.
    #[schemars(required)]
    ca: Option<String>,
    /// Certificate of the gateway.
    #[schemars(required)]
    cert: Option<String>,
    /// Private key of `cert`.
    #[schemars(required)]
    key: Option<String>,
    /// Name in the device's certificate. Default: host of `address`.
    name: Option<String>,
}

/// Port registered for Modbus/TCP Security by the Modbus Organization.
pub const TLS_PORT: u16 = 802;

/// Settings of Modbus/TCP Security (TLS with certificates for both ends) on a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Tls {
    /// File with the certificates that the gateway trusts on this line: of the device, or of the authority that signed
    /// its certificate.
    pub ca: NamedFile,
    /// Certificate of the gateway.
    pub cert: NamedFile,
    /// Private key of the certificate.
    pub key: NamedFile,
    /// Name that the certificate of the device must contain.
    pub name: String,
    /// Error without a message, at the position of the key `name`, or of the key `ca` if there is no `name`.
    /// [`Tls::wrong_name`] adds the message.
    name_at: ProfileError,
}

/// File that a key of the profile names.
#[derive(Clone, PartialEq)]
pub struct NamedFile {
    /// Path of the file, as written in the profile.
    pub name: String,
    /// Content of the file.
    pub bytes: Vec<u8>,
    named_at: Box<ProfileError>,
}

impl Tls {
    /// Returns the preview of a line with TLS: trusted certificates, and the certificate of the gateway.
    pub(super) fn preview(&self) -> Section {
        let (name, trusts, shows) = (&self.name, &self.ca.name, &self.cert.name);
        let mut section = Section::default();
        section.line(format!(
            "  trusts a certificate for {name} that is in {trusts}, or is signed by one in this file; own \
             certificate {shows}"
        ));
        entries!(section, name, trusts, shows);
        section
    }

    /// Creates an error because no certificate can contain the required name. The error is at the key `name`,
    /// or at `ca` if there is no `name`.
    pub fn wrong_name(&self) -> ProfileError {
        let message = format!("`{}` cannot be the name in a certificate", self.name);
        ProfileError { message, ..self.name_at.clone() }
    }
}

impl NamedFile {
    /// Reads the file that this key names. A missing certificate file counts as an empty file if the certificate may be
    /// created later.
    pub(crate) fn read(at: &KeyContext<'_>, name: &str, help: &str) -> Option<NamedFile> {
        let bytes = match at.report.files.is_to_be_made(name) {
            true => Vec::new(),
            false => at.file(name, help)?,
        };
        let named_at = Box::new(at.report.spans.at_value(&at.path, "", Some(help.to_owned())));
        Some(NamedFile { name: name.to_owned(), bytes, named_at })
    }

    /// Reads the certificates in a directory: the files that end with .der, .crt or .pem.
    pub(crate) fn read_all(at: &KeyContext<'_>, directory: &str, help: &str) -> Option<Vec<NamedFile>> {
        let mut found = Vec::new();
        for end in [".der", ".crt", ".pem"] {
            for name in at.report.files.names(directory, end) {
                found.push(NamedFile::read(at, &format!("{directory}/{name}{end}"), help)?);
            }
        }
        Some(found)
    }

    /// Creates an error about this file, at the position of its key in the profile. `why` is the mistake.
    pub fn invalid(&self, why: &str) -> ProfileError {
        ProfileError { message: format!("{}: {why}", self.name), ..(*self.named_at).clone() }
    }
}

/// Formats the file without its content, which may be secret.
impl fmt::Debug for NamedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("NamedFile").field(&self.name).finish()
    }
}

impl RawTls {
    /// Resolves the TLS settings of a line. `host` is the host in the `address` of the line.
    pub(crate) fn resolve(&self, at: &KeyContext<'_>, host: &str) -> Option<Tls> {
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let (name, key) = match &self.name {
            Some(name) => (name.as_str(), "name"),
            None => (host, "ca"),
        };
        let help = "write name = \"…\", a DNS name or an IP address that the device's certificate has";
        let name_at = at.report.spans.at_value(&at.key(key).path, "", Some(help.to_owned()));
        let help = "write the name of a PEM file next to the profile with the certificate of the device, or \
                    of the authority that signed it";
        let ca = file(at, "ca", self.ca.as_ref(), help);
        let (cert, key) = own_pair(at, self.cert.as_ref(), self.key.as_ref())?;
        Some(Tls { ca: ca?, cert, key, name: name.to_owned(), name_at })
    }
}

/// Reads the certificate and the private key of the gateway, which the keys `cert` and `key` name.
pub(in crate::tables) fn own_pair(
    at: &KeyContext<'_>,
    cert: Option<&String>,
    key: Option<&String>,
) -> Option<(NamedFile, NamedFile)> {
    let of_cert = "write the name of a PEM file next to the profile with the gateway's certificate, followed \
                   by the certificates of its authorities";
    let of_key =
        "write the name of a PEM file next to the profile with the private key of the certificate in `cert`";
    pair(at, (cert, of_cert), (key, of_key))
}

/// Reads the certificate and the private key that the keys `cert` and `key` name, each with its hint.
pub(crate) fn pair(
    at: &KeyContext<'_>,
    (cert, of_cert): (Option<&String>, &str),
    (key, of_key): (Option<&String>, &str),
) -> Option<(NamedFile, NamedFile)> {
    let (cert, read) = (file(at, "cert", cert, of_cert), file(at, "key", key, of_key));
    at.key("key").secret(key);
    cert.zip(read)
}

/// Reads the password file, whose name is the value of the key `password_file`.
pub(crate) fn password(at: &KeyContext<'_>, name: Option<&String>) -> Option<NamedFile> {
    let help = "write the name of a file that contains only the password, and that only the gateway can read";
    let password = file(at, "password_file", name, help);
    at.key("password_file").secret(name);
    password
}

/// Reads the file whose name is the value of a required key.
pub(in crate::tables) fn file(
    at: &KeyContext<'_>,
    key: &str,
    name: Option<&String>,
    help: &str,
) -> Option<NamedFile> {
    let at = at.key(key);
    at.missing(format!("`{key}` is missing"), help);
    NamedFile::read(&at, name?, help)
}
