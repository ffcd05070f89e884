//! Settings of OPC UA lines in the tables `[bus.*]` of the profile: URL of the server, security, and user.

use super::connection::{OpcUa, PORT, SCHEME, Security, User, server_url};
use crate::tables::KeyContext;
use crate::tables::bus::RawBus;
use crate::tables::bus::tls::{NamedFile, pair};

/// Returns the URL of the server of an opcua line, with its port. Returns `None` if the URL is missing or invalid.
pub(super) fn address(raw: &RawBus, at: &KeyContext<'_>) -> Option<String> {
    let at = at.key("address");
    let help = format!("write the URL of the server, as \"{SCHEME}192.168.214.241:{PORT}\"");
    at.missing("`address` is missing: what is the URL of the server?", help);
    server_url(raw.address.as_ref()?).map_err(|(message, help)| at.invalid(message, help)).ok()
}

/// Resolves the OPC UA settings of a line: message security, user, and certificates. Returns `None` if they have an
/// error.
pub(super) fn resolve(raw: &RawBus, at: &KeyContext<'_>) -> Option<OpcUa> {
    let help = "write \"sign-and-encrypt\" or \"sign\"; write \"none\" only if this machine alone uses \
                the network";
    at.key("security").missing("`security` is missing: are messages signed and encrypted?", help);
    let user = raw.user.as_ref().map_or(Some(User::Anonymous), |user| user.resolve(&at.key("user")));
    let security = raw.security?;
    let type_at = at.report.spans.at_value(&at.key("type").path, "", None);
    if security == Security::None {
        let help = "remove this key, or write security = \"sign-and-encrypt\"";
        at.not_applicable(&["cert", "key", "trusted"], "a secured line", help);
        if let Some(User::Named { .. }) = user {
            let message = "nothing is encrypted: every computer on the network can read the password, and \
                           change the messages of this user";
            at.key("security").warn(message, "write \"sign-and-encrypt\", if the server supports it");
        }
        return Some(OpcUa { user: user?, type_at, ..OpcUa::plain() });
    }
    let of_cert = "write the path of the gateway's own certificate, in DER or PEM form; `isotherm opcua \
                certificate PROFILE` creates this file";
    let of_key = "write the path of the private key of `cert`, in PEM form; `isotherm opcua certificate PROFILE` \
                creates both files";
    let own = pair(at, (raw.cert.as_ref(), of_cert), (raw.key.as_ref(), of_key));
    let trusted = trusted(at, raw.trusted.as_ref());
    let (own, trusted, trusted_in) = (Some(own?), trusted?, raw.trusted.clone());
    Some(OpcUa { security, user: user?, own, trusted, trusted_in, type_at })
}

/// Reads the trusted certificates in the named directory. Warns if the directory contains no certificate.
fn trusted(at: &KeyContext<'_>, directory: Option<&String>) -> Option<Vec<NamedFile>> {
    let at = at.key("trusted");
    let help = "write the path of a directory with the certificates of the trusted servers, one in each file, \
                with the ending .der, .crt or .pem";
    let fill = format!("{help}; `isotherm opcua trust PROFILE` creates this directory with the certificates");
    at.missing("`trusted` is missing: which certificates are accepted?", fill);
    let directory = directory?;
    let found = NamedFile::read_all(&at, directory, help)?;
    if found.is_empty() {
        let help = format!("{help}; `isotherm opcua trust PROFILE` fetches a certificate");
        at.warn(format!("there is no certificate in {directory}: no server is trusted"), help);
    }
    Some(found)
}
