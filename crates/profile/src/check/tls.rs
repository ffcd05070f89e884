//! The security of a line: its files are read here, so that one that is missing is reported at its key.

use super::Check;
use crate::place::child;
use crate::raw::RawTls;
use crate::tls::{PemFile, Tls};

impl Check<'_> {
    /// The security of a line to this host.
    pub(super) fn tls(&mut self, path: &str, raw: &RawTls, host: &str) -> Option<Tls> {
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let (name, key) = match &raw.name {
            Some(name) => (name.as_str(), "name"),
            None => (host, "ca"),
        };
        let help = "write name = \"…\", a DNS name or an IP address that the device's certificate has";
        let name_at = self.places.at_value(&child(path, key), "", Some(help.to_owned()));
        let ca = self.pem(path, "ca", raw.ca.as_deref());
        let cert = self.pem(path, "cert", raw.cert.as_deref());
        let key = self.pem(path, "key", raw.key.as_deref());
        Some(Tls { ca: ca?, cert: cert?, key: key?, name: name.to_owned(), name_at })
    }

    fn pem(&mut self, path: &str, key: &str, name: Option<&str>) -> Option<PemFile> {
        let at = child(path, key);
        let Some(name) = name else {
            let message = format!("`{key}` is missing: Modbus/TCP Security needs it");
            self.missing(path, key, message, help_for(key));
            return None;
        };
        match self.files.read(name) {
            Ok(bytes) => {
                let named_at = self.places.at_value(&at, "", Some(help_for(key).to_owned()));
                Some(PemFile { name: name.to_owned(), bytes, named_at })
            }
            Err(why) => {
                self.wrong(&at, why, help_for(key));
                None
            }
        }
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
