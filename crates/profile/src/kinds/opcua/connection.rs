//! Settings of an OPC UA connection: endpoint of the server, security, and the user as which the gateway logs in.
//!
//! The certificate, key and password files are read together with the profile, so that a missing file is
//! reported at its key. The module that opens the line checks their content.

use std::net::Ipv4Addr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::document::{Section, entries};
use crate::error::ProfileError;
use crate::host_port::host_and_port;
use crate::tables::KeyContext;
use crate::tables::bus::tls::{NamedFile, pair, password};

/// Default TCP port of OPC UA, as registered by the OPC Foundation.
pub(crate) const PORT: u16 = 4840;
pub(crate) const SCHEME: &str = "opc.tcp://";

/// Message security of an OPC UA connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "SecurityWord", description = "")]
pub enum Security {
    /// No security: anyone on the network can read and change the messages.
    None,
    /// Messages are signed.
    Sign,
    /// Messages are signed and encrypted.
    SignAndEncrypt,
}

/// User as which the gateway logs in, with a password or a certificate.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "OpcUaUser")]
pub(crate) struct RawUser {
    /// Name of the user on the server.
    name: Option<String>,
    /// File that contains only the password.
    password_file: Option<String>,
    /// File with the certificate of the user, in DER or PEM form.
    cert: Option<String>,
    /// File with the private key of the certificate, in PEM form.
    key: Option<String>,
}

/// Settings of the gateway's connection to an OPC UA server.
#[derive(Clone, Debug, PartialEq)]
pub struct OpcUa {
    /// Message security of the connection.
    pub security: Security,
    /// User as which the gateway logs in.
    pub user: User,
    /// Certificate and private key of the gateway. `None` if the connection has no message security.
    pub own: Option<(NamedFile, NamedFile)>,
    /// Certificates of the servers that the gateway trusts. Empty without message security.
    pub trusted: Vec<NamedFile>,
    /// Directory of the trusted certificates, as written in the profile.
    pub trusted_in: Option<String>,
    pub(super) type_at: ProfileError,
}

/// User as which the gateway logs in.
#[derive(Clone, Debug, PartialEq)]
pub enum User {
    /// The gateway logs in without a user name.
    Anonymous,
    /// User with a password.
    Named {
        /// Name of the user.
        name: String,
        /// File that contains the password. A newline at the end of the file is not part of the password.
        password: NamedFile,
    },
    /// User with a certificate.
    Certified {
        /// Certificate of the user.
        cert: NamedFile,
        /// Private key of the certificate.
        key: NamedFile,
    },
}

impl OpcUa {
    /// Creates settings without message security and with an anonymous user, for a server that is not in a profile.
    pub fn plain() -> OpcUa {
        OpcUa {
            security: Security::None,
            user: User::Anonymous,
            own: None,
            trusted: Vec::new(),
            trusted_in: None,
            type_at: ProfileError::about("", "", None),
        }
    }

    /// Creates an error that points to the key `type` of the line in the profile.
    pub fn wrong_type(&self, message: &str, help: &str) -> ProfileError {
        let (message, help) = (message.to_owned(), Some(help.to_owned()));
        ProfileError { message, help, ..self.type_at.clone() }
    }

    /// Returns the secret files: private keys and the file with the password.
    pub fn secrets(&self) -> impl Iterator<Item = &NamedFile> {
        let of_user = match &self.user {
            User::Anonymous => None,
            User::Named { password, .. } => Some(password),
            User::Certified { key, .. } => Some(key),
        };
        self.own.iter().map(|(_, key)| key).chain(of_user)
    }

    /// Returns the preview of the connection: message security, user, and trusted servers.
    pub(crate) fn preview(&self) -> Section {
        let security = match self.security {
            Security::None => "neither signed nor encrypted",
            Security::Sign => "signed, not encrypted",
            Security::SignAndEncrypt => "signed and encrypted",
        };
        let user = match &self.user {
            User::Anonymous => "the anonymous user".to_owned(),
            User::Named { name, .. } => format!("user {name}, by password"),
            User::Certified { cert, .. } => format!("the user of the certificate {}", cert.name),
        };
        let mut section = Section::default();
        section.line(format!("  messages are {security}; logs in as {user}"));
        let trusted: Vec<&str> = self.trusted.iter().map(|file| file.name.as_str()).collect();
        if let (Some((cert, _)), Some(directory)) = (&self.own, &self.trusted_in) {
            let known = if trusted.is_empty() { "none yet".to_owned() } else { trusted.join(", ") };
            section.line(format!(
                "  own certificate {}; trusts the certificates in {directory}: {known}",
                cert.name
            ));
        }
        entries!(section, security, user, shows = self.own.as_ref().map(|(cert, _)| &cert.name));
        entries!(section, trusts = trusted);
        section
    }
}

/// Parses the URL of a server, and adds the default port if the URL has no port.
///
/// # Errors
/// The text is not the URL of a server. The error is a message and a hint.
pub fn server_url(text: &str) -> Result<String, (String, String)> {
    let example = format!("\"{SCHEME}192.168.214.241:{PORT}\"");
    let Some(rest) = text.strip_prefix(SCHEME) else {
        let host = text.rsplit("://").next().unwrap_or_default().trim();
        let help = format!("write \"{SCHEME}{host}\": the gateway speaks OPC UA binary over TCP");
        return Err((format!("`{text}` is not the URL of an OPC UA server"), help));
    };
    if text.contains(char::is_whitespace) {
        let help = format!("a URL has no spaces: write this URL as {example}");
        return Err((format!("`{text}` contains a space"), help));
    }
    let (place, path) = rest.split_once('/').unwrap_or((rest, ""));
    if place.contains('@') {
        let help = "remove the part before `@`, and write `user`";
        return Err(("a URL in a profile must not contain a user name".to_owned(), help.to_owned()));
    }
    let path = if path.is_empty() { String::new() } else { format!("/{path}") };
    let found = host_and_port(place);
    if let Ok((host, port)) = found
        && is_host(host)
        && port != Some(0)
    {
        return Ok(format!("{SCHEME}{host}:{}{path}", port.unwrap_or(PORT)));
    }
    let help = found.err().and_then(|why| why.help(PORT, |place| format!("\"{SCHEME}{place}\"")));
    let help = help.unwrap_or_else(|| format!("write host and port, as {example}"));
    Err((format!("`{place}` is not a host and port"), help))
}

fn is_host(host: &str) -> bool {
    let is_of_a_name = |one: char| one.is_alphanumeric() || matches!(one, '-' | '.' | '_');
    let is_numbers = host.contains('.') && host.chars().all(|one| one.is_ascii_digit() || one == '.');
    host.starts_with('[')
        || (host.chars().all(is_of_a_name) && (!is_numbers || host.parse::<Ipv4Addr>().is_ok()))
}

impl RawUser {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<User> {
        let by_password = self.name.is_some() || self.password_file.is_some();
        if by_password && (self.cert.is_some() || self.key.is_some()) {
            let help = "keep `name` and `password_file`, or `cert` and `key`";
            at.wrong_key("a user has either a password or a certificate", help);
            return None;
        }
        if !by_password {
            let cert = (self.cert.as_ref(), "write the path of the user's certificate, in DER or PEM form");
            let key = (self.key.as_ref(), "write the path of the private key of `cert`, in PEM form");
            return pair(at, cert, key).map(|(cert, key)| User::Certified { cert, key });
        }
        at.key("name").missing(
            "`name` is missing: what is the gateway's user name on the server?",
            "write name = \"…\"",
        );
        let password = password(at, self.password_file.as_ref());
        Some(User::Named { name: self.name.clone()?, password: password? })
    }
}
