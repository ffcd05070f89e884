//! The security of a line: its files are read here, so that what is wrong with them is told at their keys.

use std::sync::Arc;

use tokio_rustls::rustls::pki_types::ServerName;

use super::Check;
use crate::profile::place::child;
use crate::profile::raw::RawTls;
use crate::profile::tls::{Tls, TlsFile, client};

impl Check<'_> {
    /// The security of a line to this host.
    pub(super) fn tls(&mut self, path: &str, raw: &RawTls, host: &str) -> Option<Tls> {
        let name = self.certified_name(path, raw, host);
        let ca = self.pem(path, "ca", raw.ca.as_deref());
        let cert = self.pem(path, "cert", raw.cert.as_deref());
        let key = self.pem(path, "key", raw.key.as_deref());
        match client(&ca?, &cert?, &key?) {
            Ok(client) => {
                let (ca, cert) = (raw.ca.clone()?, raw.cert.clone()?);
                Some(Tls { ca, cert, name: name?, client: Arc::new(client) })
            }
            Err(wrong) => {
                for file in wrong {
                    let (key, name, why) = match file {
                        TlsFile::Ca(why) => ("ca", &raw.ca, why),
                        TlsFile::Cert(why) => ("cert", &raw.cert, why),
                        TlsFile::Key(why) => ("key", &raw.key, why),
                    };
                    let name = name.as_deref().unwrap_or_default();
                    self.wrong(&child(path, key), format!("{name}: {why}"), help_for(key));
                }
                None
            }
        }
    }

    /// The bytes of one of its files.
    fn pem(&mut self, path: &str, key: &str, name: Option<&str>) -> Option<Vec<u8>> {
        let at = child(path, key);
        let Some(name) = name else {
            let message = format!("`{key}` is missing: Modbus/TCP Security needs it");
            self.missing(path, key, message, help_for(key));
            return None;
        };
        match self.files.read(name) {
            Ok(bytes) => Some(bytes),
            Err(why) => {
                self.wrong(&at, why, help_for(key));
                None
            }
        }
    }

    fn certified_name(&mut self, path: &str, raw: &RawTls, host: &str) -> Option<ServerName<'static>> {
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let (wanted, key) = match &raw.name {
            Some(name) => (name.as_str(), "name"),
            None => (host, "ca"),
        };
        let name = ServerName::try_from(wanted.to_owned()).ok();
        if name.is_none() {
            let message = format!("no certificate can be for the name `{wanted}`");
            let help = "write name = \"…\", a DNS name or an IP address that the device's certificate has";
            self.wrong(&child(path, key), message, help);
        }
        name
    }
}

fn help_for(key: &str) -> &'static str {
    match key {
        "ca" => {
            "name a PEM file beside the profile with the certificate of the authority that signed the device's, or \
             with the device's own"
        }
        "cert" => {
            "name a PEM file beside the profile with the gateway's certificate, those that lead to its authority after it"
        }
        _ => "name a PEM file beside the profile with the private key of the certificate in `cert`",
    }
}
