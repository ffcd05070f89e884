//! What a server offers, as it tells whoever asks, without a login.

use std::time::Duration;

use ::opcua::types::{EndpointDescription, UserTokenType};
use isotherm_profile::Security;
use serde::Serialize;

use super::certificate::Certificate;
use super::endpoint::{is_spoken, security_of};
use super::{OPENING, offered};
use crate::fieldbus::error::Fault;

/// One of a server's endpoints.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Offer {
    /// Where, as the server says.
    pub url: String,
    /// `security` of a profile that wants it; `None` where it is none that OPC UA has.
    pub security: Option<Security>,
    /// How it is secured: `Basic256Sha256`.
    pub policy: String,
    /// Whether the gateway can do that.
    pub is_spoken: bool,
    /// Whom it lets in: `anonymous`, `password`, `certificate`.
    pub users: Vec<&'static str>,
    /// The certificate that it shows.
    pub certificate: Option<Certificate>,
}

/// What the server at this URL offers.
///
/// # Errors
/// Why there is no answer.
pub async fn offers(url: &str, timeout: Duration) -> Result<Vec<Offer>, Fault> {
    let asked = tokio::time::timeout(timeout + OPENING, offered(url, timeout)).await;
    Ok(asked.unwrap_or(Err(Fault::Timeout))?.iter().map(offer).collect())
}

fn offer(endpoint: &EndpointDescription) -> Offer {
    let uri = endpoint.security_policy_uri.as_ref();
    let policy = uri.rsplit('#').next().unwrap_or(uri).to_owned();
    let tokens = endpoint.user_identity_tokens.iter().flatten();
    let mut users: Vec<&str> = tokens.map(|token| user(token.token_type)).collect();
    users.sort_unstable();
    users.dedup();
    Offer {
        url: endpoint.endpoint_url.to_string(),
        security: security_of(endpoint),
        policy,
        is_spoken: is_spoken(endpoint),
        users,
        certificate: Certificate::read(endpoint.server_certificate.as_ref()),
    }
}

fn user(kind: UserTokenType) -> &'static str {
    match kind {
        UserTokenType::Anonymous => "anonymous",
        UserTokenType::UserName => "password",
        UserTokenType::Certificate => "certificate",
        UserTokenType::IssuedToken => "issued token",
    }
}
