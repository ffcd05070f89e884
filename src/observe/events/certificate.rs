//! Events about the certificates of an OPC UA bus, and of the OPC UA server of the gateway.

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
    /// End of its validity.
    #[serde(serialize_with = "in_text")]
    pub until: Moment,
    /// Whether the certificate has expired.
    pub is_over: bool,
}

/// Owner of a certificate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CertificateOwner {
    /// Certificate of the gateway.
    Gateway,
    /// Certificate of the user as which the gateway signs in to the server.
    User,
    /// Certificate of the server.
    Server,
    /// Certificate of the gateway's own OPC UA server.
    #[serde(rename = "opcua-server")]
    OwnServer,
    /// Certificate of a client of the gateway's own OPC UA server, or of its user.
    Client,
}

impl Expiry {
    /// Cause and remedy as a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        self.described().text()
    }

    fn explained(&self) -> Explained {
        let Expiry { bus: _, file, whose, until, is_over } = self;
        let until = until.to_string();
        let (day, time) = until.split_once('T').unwrap_or((&until, ""));
        let time: String = time.chars().take(5).collect();
        let expires = if *is_over { "expired" } else { "expires" };
        let (owner, remedy) = match whose {
            CertificateOwner::Gateway => (
                "gateway",
                "move the certificate and its key away, make both again (`isotherm opcua certificate \
                 PROFILE`), and trust the certificate at the server",
            ),
            CertificateOwner::User => {
                ("user", "make a new certificate, and give it this user's rights at the server")
            }
            CertificateOwner::Server => (
                "server",
                "renew the certificate at the server, then run `isotherm opcua trust PROFILE`; if the server \
                 already has another certificate, remove this file",
            ),
            CertificateOwner::OwnServer => (
                "OPC UA server",
                "move the certificate and its key away, make both again (`isotherm opcua certificate PROFILE \
                 --server`), and trust the certificate at each client",
            ),
            CertificateOwner::Client => {
                ("client", "renew the certificate at the client, and replace this file with it")
            }
        };
        Explained::new(
            format!("the {owner}'s certificate {file} {expires} on {day} at {time} UTC"),
            format!(
                "{remedy}; a running gateway loads the new certificate after `isotherm restart PROFILE \
                 --keep`"
            ),
        )
    }

    pub(super) fn described(&self) -> EventDescription {
        let kind = if self.is_over { EventKind::CertificateExpired } else { EventKind::CertificateExpires };
        let about = match self.whose {
            CertificateOwner::OwnServer | CertificateOwner::Client => "the OPC UA server".to_owned(),
            _ => format!("bus {}", self.bus),
        };
        caused(about, self.explained()).of(kind)
    }
}
