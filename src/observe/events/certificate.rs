//! Events about certificates that are not valid yet, expire soon, or have expired. The certificates belong to
//! an OPC UA bus, or to the OPC UA server of the gateway.

use isotherm_core::quantity::Moment;
use serde::Serialize;

use super::data::in_text;
use super::description::{EventDescription, caused};
use isotherm_core::events::EventKind;
use isotherm_core::explained::Explained;

/// Certificate that has expired or expires soon.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Expiry {
    /// Bus that uses the certificate; `opcua_server` for the OPC UA server of the gateway.
    pub bus: String,
    /// File name of the certificate, as in the profile.
    pub file: String,
    /// Owner of the certificate.
    pub whose: CertificateOwner,
    /// End of the validity of the certificate.
    #[serde(serialize_with = "in_text")]
    pub until: Moment,
    /// Whether the certificate has expired.
    pub is_over: bool,
}

/// Certificate that is not valid yet.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct EarlyCertificate {
    /// Bus that uses the certificate; `opcua_server` for the OPC UA server of the gateway.
    pub bus: String,
    /// File name of the certificate, as in the profile.
    pub file: String,
    /// Owner of the certificate.
    pub whose: CertificateOwner,
    /// Start of the validity of the certificate.
    #[serde(serialize_with = "in_text")]
    pub from: Moment,
}

/// Owner of a certificate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CertificateOwner {
    /// Certificate of the gateway.
    Gateway,
    /// User certificate with which the gateway signs in to the server.
    User,
    /// Certificate of the server.
    Server,
    /// Certificate of the gateway's own OPC UA server.
    #[serde(rename = "opcua-server")]
    OwnServer,
    /// Certificate of a client of the gateway's own OPC UA server, or of the user of this client.
    Client,
}

impl CertificateOwner {
    /// Returns the word for the owner in messages, for example `gateway`.
    const fn word(self) -> &'static str {
        match self {
            CertificateOwner::Gateway => "gateway",
            CertificateOwner::User => "user",
            CertificateOwner::Server => "server",
            CertificateOwner::OwnServer => "OPC UA server",
            CertificateOwner::Client => "client",
        }
    }

    /// Returns the name of the bus or of the server that uses a certificate of this owner, for messages.
    fn user(self, bus: &str) -> String {
        match self {
            CertificateOwner::OwnServer | CertificateOwner::Client => "the OPC UA server".to_owned(),
            CertificateOwner::Gateway | CertificateOwner::User | CertificateOwner::Server => {
                format!("bus {bus}")
            }
        }
    }
}

/// Formats a time as day and time of day, to the minute.
fn day_and_time(moment: Moment) -> String {
    let text = moment.to_string();
    let (day, time) = text.split_once('T').unwrap_or((&text, ""));
    let time: String = time.chars().take(5).collect();
    format!("{day} at {time} UTC")
}

impl EarlyCertificate {
    /// Returns the text of the event: the start of the validity, and the remedy.
    #[must_use]
    pub fn sentence(&self) -> String {
        self.described().text()
    }

    pub(super) fn described(&self) -> EventDescription {
        let EarlyCertificate { bus, file, whose, from } = self;
        let cause =
            format!("the {}'s certificate {file} is not valid before {}", whose.word(), day_and_time(*from));
        caused(whose.user(bus), cause).of(EventKind::CertificateNotYetValid)
    }
}

impl Expiry {
    /// Returns the text of the event: the end of the validity, and how to renew the certificate.
    #[must_use]
    pub fn sentence(&self) -> String {
        self.described().text()
    }

    fn explained(&self) -> Explained {
        let Expiry { bus: _, file, whose, until, is_over } = self;
        let expires = if *is_over { "expired" } else { "expires" };
        let remedy = match whose {
            CertificateOwner::Gateway => {
                "move the certificate and its key to another directory, create both again (`isotherm opcua \
                 certificate PROFILE`), and trust the new certificate at the server"
            }
            CertificateOwner::User => "make a new certificate, and give it this user's rights at the server",
            CertificateOwner::Server => {
                "renew the certificate at the server, then run `isotherm opcua trust PROFILE`; if the server \
                 already has another certificate, remove this file"
            }
            CertificateOwner::OwnServer => {
                "move the certificate and its key to another directory, create both again (`isotherm opcua \
                 certificate PROFILE --server`), and trust the new certificate at each client"
            }
            CertificateOwner::Client => "renew the certificate at the client, and copy it over this file",
        };
        Explained::new(
            format!("the {}'s certificate {file} {expires} on {}", whose.word(), day_and_time(*until)),
            format!(
                "{remedy}; a running gateway loads the new certificate after `isotherm restart PROFILE \
                 --keep`"
            ),
        )
    }

    pub(super) fn described(&self) -> EventDescription {
        let kind = if self.is_over { EventKind::CertificateExpired } else { EventKind::CertificateExpires };
        caused(self.whose.user(&self.bus), self.explained()).of(kind)
    }
}
