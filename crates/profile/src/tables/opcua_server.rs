//! `[opcua_server]`: OPC UA server of the gateway, for clients of the plant.
//!
//! The certificate, key and password files are read together with the profile, so that a missing file is
//! reported at its key. The module that runs the server checks their content, because only that module has an
//! OPC UA library.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bus::tls::{NamedFile, pair};
use super::{KeyContext, optional};
use crate::duration::Timespan;
use crate::error::ProfileError;
use crate::host_port::{host_and_port, is_loopback};
use crate::kinds::opcua::connection::{PORT, Security};
use user::{RawServerUser, ServerUser};

mod preview;
pub(crate) mod user;

/// Default period in which the values of the nodes are updated.
const EVERY: Duration = Duration::from_secs(1);
/// Shortest allowed period for updating the nodes. A shorter one would cost too much time, because the state is copied
/// for each update.
const SHORTEST: Duration = Duration::from_millis(100);
const LISTEN: &str = "write host and port, as \"0.0.0.0:4840\"; port 0 selects any free port";

/// OPC UA server of the gateway.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "OpcUaServer")]
pub(crate) struct RawOpcUaServer {
    /// Host and port on which the server listens. Default "127.0.0.1:4840". Port 0 selects any free port.
    listen: Option<String>,
    /// Minimum security of the messages that the server requires. "sign" also accepts encrypted messages.
    #[schemars(required)]
    security: Option<Security>,
    /// Certificate of the server, in DER or PEM form, with a URI in its subjectAltName. Required unless `security` is
    /// "none".
    cert: Option<String>,
    /// Private key of `cert`, in PEM form without a password.
    key: Option<String>,
    /// Directory with the certificates of the trusted clients, each in a file that ends in .der, .crt or .pem.
    trusted: Option<String>,
    /// Users that may log in: { name = "mes", password_file = "mes.password" }, or { name = "probe", cert =
    /// "probe.der" }.
    #[serde(default)]
    users: Vec<RawServerUser>,
    /// Whether clients may log in without a user, and read all nodes. Default false.
    anonymous: Option<bool>,
    /// Period in which the values of the nodes are updated, at least "100ms". Default "1s".
    every: Option<Timespan>,
}

/// Whether clients may log in without a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AnonymousClients {
    /// Clients without a user may read all nodes.
    Allowed,
    /// Clients without a user are refused.
    Refused,
}

/// Resolved settings of the gateway's own OPC UA server.
#[derive(Clone, Debug, PartialEq)]
pub struct OpcUaServer {
    /// Host and port on which the server listens. Port 0 selects any free port.
    pub listen: String,
    /// Minimum security of the messages that the server requires.
    pub security: Security,
    /// Certificate and key of the server. `None` without security.
    pub own: Option<(NamedFile, NamedFile)>,
    /// Certificates of the clients that the server trusts.
    pub trusted: Vec<NamedFile>,
    /// Directory of the trusted certificates, as written in the profile.
    pub trusted_in: Option<String>,
    /// Users that may log in.
    pub users: Vec<ServerUser>,
    /// Whether clients may log in without a user.
    pub anonymous: AnonymousClients,
    /// Period in which the values of the nodes are updated.
    pub every: Duration,
    table_at: ProfileError,
}

impl OpcUaServer {
    /// Creates an error that points to the table `[opcua_server]` in the profile.
    pub fn invalid(&self, message: &str, help: &str) -> ProfileError {
        let (message, help) = (message.to_owned(), Some(help.to_owned()));
        ProfileError { message, help, ..self.table_at.clone() }
    }

    /// Returns the secret files: the private key and the passwords.
    pub fn secrets(&self) -> impl Iterator<Item = &NamedFile> {
        self.own.iter().map(|(_, key)| key).chain(self.users.iter().filter_map(ServerUser::password))
    }
}

impl RawOpcUaServer {
    pub(super) fn resolve(&self, at: &KeyContext<'_>) -> Option<OpcUaServer> {
        let listen = self.listen(at);
        let secured = self.security.filter(|security| *security != Security::None);
        let (own, trusted) = match self.security {
            Some(Security::None) => {
                let help = "remove this key, or write security = \"sign-and-encrypt\"";
                at.not_applicable(&["cert", "key", "trusted"], "a secured server", help);
                (Some(None), Some(Vec::new()))
            }
            Some(Security::Sign | Security::SignAndEncrypt) => (self.own(at).map(Some), self.trusted(at)),
            // The schema check reports the missing key.
            None => (None, None),
        };
        let users = user::resolve(&at.key("users"), &self.users, secured.is_some());
        let anonymous = match self.anonymous {
            Some(true) => AnonymousClients::Allowed,
            _ => AnonymousClients::Refused,
        };
        if self.users.is_empty() && anonymous == AnonymousClients::Refused {
            let help = "write `users`, or write anonymous = true so that each trusted client may read";
            at.wrong_key("no client may log in", help);
        }
        if let Some(listen) = &listen {
            self.doubts(at, listen, anonymous);
        }
        let every = at.key("every").duration(self.every).unwrap_or(EVERY);
        if every < SHORTEST {
            let help = "write \"100ms\" or longer: faster changes are in the logs";
            at.key("every").invalid("the gateway does not update the nodes this often", help);
        }
        Some(OpcUaServer {
            listen: listen?,
            security: self.security?,
            own: own?,
            trusted: trusted?,
            trusted_in: secured.and(self.trusted.clone()),
            users: users?,
            anonymous,
            every,
            table_at: at.report.spans.at_key(&at.path, "", None),
        })
    }

    fn listen(&self, at: &KeyContext<'_>) -> Option<String> {
        let listen = self.listen.clone().unwrap_or_else(|| format!("127.0.0.1:{PORT}"));
        let place = host_and_port(&listen);
        if let Ok((_, Some(_))) = place {
            return Some(listen);
        }
        let help = place.err().and_then(|why| why.help(PORT, str::to_owned));
        let help = help.unwrap_or_else(|| LISTEN.to_owned());
        at.key("listen").reject(format!("`{listen}` is not a host with a port"), help)
    }

    fn own(&self, at: &KeyContext<'_>) -> Option<(NamedFile, NamedFile)> {
        let of_cert = "write the name of the file with the server's certificate, in DER or PEM form; \
                       `isotherm opcua certificate PROFILE --server` creates this file";
        let of_key = "write the name of the file with the private key of `cert`, in PEM form; `isotherm \
                      opcua certificate PROFILE --server` creates both files";
        pair(at, (self.cert.as_ref(), of_cert), (self.key.as_ref(), of_key))
    }

    /// Reads the certificates of trusted clients in the directory that the key `trusted` names.
    fn trusted(&self, at: &KeyContext<'_>) -> Option<Vec<NamedFile>> {
        let at = at.key("trusted");
        let help = "write the name of a directory with the certificates of the trusted clients, one in each \
                    file, with the ending .der, .crt or .pem";
        at.missing("`trusted` is missing: which clients are accepted?", help);
        let found = NamedFile::read_all(&at, self.trusted.as_ref()?, help)?;
        if found.is_empty() {
            let message =
                format!("there is no certificate in {}: no client is trusted", self.trusted.as_ref()?);
            at.warn(message, "copy the certificate of each client into this directory");
        }
        Some(found)
    }

    /// Warns about a server without encryption that other computers can reach.
    fn doubts(&self, at: &KeyContext<'_>, listen: &str, anonymous: AnonymousClients) {
        let host = host_and_port(listen).map_or("", |(host, _)| host);
        if self.security != Some(Security::None) || is_loopback(host) {
            return;
        }
        let help = "write \"sign-and-encrypt\", `cert`, `key` and `trusted`";
        if self.users.iter().any(RawServerUser::has_password) {
            let message = "nothing is encrypted: every computer on the network can read the passwords, and log \
                           in with them";
            at.key("security").warn(message, help);
        } else if anonymous == AnonymousClients::Allowed {
            let message = "every computer on the network can read all values";
            at.key("security").warn(message, help);
        }
    }
}

/// Resolves the table `[opcua_server]`. Returns `None` if the profile does not have it, or if it has an error.
pub(super) fn resolve(at: &KeyContext<'_>, raw: Option<&RawOpcUaServer>) -> Option<OpcUaServer> {
    optional(raw, |raw| raw.resolve(at)).flatten()
}
