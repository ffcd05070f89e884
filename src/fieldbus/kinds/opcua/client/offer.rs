//! Endpoints that a server lists without a login.

use std::time::Duration;

use ::opcua::types::{EndpointDescription, UserTokenType};
use isotherm_profile::Security;
use serde::Serialize;

use super::certificate::Certificate;
use super::endpoint::{is_spoken, security_of};
use super::{OPENING, offered};
use crate::fieldbus::error::Fault;

/// Endpoint of a server: a URL with one security mode and one security policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Offer {
    /// URL of the endpoint, as the server reports it.
    pub url: String,
    /// Matching value of the key `security` in a profile; `None` if OPC UA does not define the security mode of this
    /// endpoint.
    pub security: Option<Security>,
    /// Security policy, for example `Basic256Sha256`.
    pub policy: String,
    /// Whether the gateway supports the protocol and the security policy of the endpoint.
    pub is_spoken: bool,
    /// Kinds of users that the endpoint accepts: `anonymous`, `password`, `certificate`.
    pub users: Vec<&'static str>,
    /// Certificate of the server; `None` if the endpoint has no readable certificate.
    pub certificate: Option<Certificate>,
}

/// Queries the endpoints of the server at this URL.
///
/// # Errors
/// The reason why the server did not answer.
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
