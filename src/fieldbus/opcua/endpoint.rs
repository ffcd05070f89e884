//! Which of a server's endpoints is taken: of those as the profile wants them the strongest that both ends know.

use ::opcua::client::IdentityToken;
use ::opcua::crypto::SecurityPolicy;
use ::opcua::types::{EndpointDescription, MessageSecurityMode};
use isotherm_profile::Security;

use super::user_kind;

/// The policies that are spoken, the strongest first. Those with SHA-1 are broken, and not among them.
const POLICIES: [SecurityPolicy; 3] =
    [SecurityPolicy::Aes256Sha256RsaPss, SecurityPolicy::Aes128Sha256RsaOaep, SecurityPolicy::Basic256Sha256];

/// The endpoint with this security that lets this kind of user in. Signing alone is never taken where encryption is wanted.
pub(super) fn choose(
    endpoints: Vec<EndpointDescription>,
    security: Security,
    user: &IdentityToken,
) -> Option<EndpointDescription> {
    let fitting = endpoints.into_iter().filter(|endpoint| {
        security_of(endpoint) == Some(security)
            && is_binary(endpoint)
            && endpoint.find_policy(user_kind(user)).is_some()
    });
    let ranked = fitting.filter_map(|endpoint| Some((rank(&endpoint)?, endpoint)));
    ranked.min_by_key(|(rank, _)| *rank).map(|(_, endpoint)| endpoint)
}

/// The gateway can speak as this endpoint wants it.
pub(super) fn is_spoken(endpoint: &EndpointDescription) -> bool {
    is_binary(endpoint) && rank(endpoint).is_some()
}

/// What protects its messages.
pub(super) fn security_of(endpoint: &EndpointDescription) -> Option<Security> {
    match endpoint.security_mode {
        MessageSecurityMode::None => Some(Security::None),
        MessageSecurityMode::Sign => Some(Security::Sign),
        MessageSecurityMode::SignAndEncrypt => Some(Security::SignAndEncrypt),
        MessageSecurityMode::Invalid => None,
    }
}

/// Its place among those with its security, the strongest first; `None` where it is not spoken.
fn rank(endpoint: &EndpointDescription) -> Option<usize> {
    let policy = SecurityPolicy::from_uri(endpoint.security_policy_uri.as_ref());
    match security_of(endpoint)? {
        Security::None => (policy == SecurityPolicy::None).then_some(0),
        Security::Sign | Security::SignAndEncrypt => POLICIES.iter().position(|known| *known == policy),
    }
}

fn is_binary(endpoint: &EndpointDescription) -> bool {
    let profile = endpoint.transport_profile_uri.as_ref();
    profile.is_empty() || profile.ends_with("/uatcp-uasc-uabinary")
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::opcua::types::{UserTokenPolicy, UserTokenType};

    fn endpoint(
        mode: MessageSecurityMode,
        policy: SecurityPolicy,
        users: &[UserTokenType],
    ) -> EndpointDescription {
        let policies = users.iter().map(|kind| UserTokenPolicy { token_type: *kind, ..Default::default() });
        EndpointDescription {
            security_mode: mode,
            security_policy_uri: policy.to_uri().into(),
            user_identity_tokens: Some(policies.collect()),
            ..Default::default()
        }
    }

    #[test]
    fn the_strongest_policy_that_lets_this_user_in_is_taken_and_never_a_weaker_mode() {
        use MessageSecurityMode::{Sign, SignAndEncrypt};
        const ANYBODY: &[UserTokenType] = &[UserTokenType::Anonymous];
        let offered = || {
            vec![
                endpoint(MessageSecurityMode::None, SecurityPolicy::None, ANYBODY),
                endpoint(Sign, SecurityPolicy::Aes256Sha256RsaPss, ANYBODY),
                endpoint(SignAndEncrypt, SecurityPolicy::Basic256, ANYBODY),
                endpoint(SignAndEncrypt, SecurityPolicy::Basic256Sha256, ANYBODY),
                endpoint(SignAndEncrypt, SecurityPolicy::Aes128Sha256RsaOaep, ANYBODY),
                endpoint(SignAndEncrypt, SecurityPolicy::Aes256Sha256RsaPss, &[UserTokenType::UserName]),
            ]
        };
        let chosen = |security, user: &IdentityToken| {
            let found = choose(offered(), security, user)?;
            Some((found.security_mode, SecurityPolicy::from_uri(found.security_policy_uri.as_ref())))
        };
        let (nobody, somebody) =
            (IdentityToken::new_anonymous(), IdentityToken::new_user_name("isotherm", "secret"));
        let encrypted = |policy| Some((SignAndEncrypt, policy));
        assert_eq!(chosen(Security::SignAndEncrypt, &nobody), encrypted(SecurityPolicy::Aes128Sha256RsaOaep));
        assert_eq!(
            chosen(Security::SignAndEncrypt, &somebody),
            encrypted(SecurityPolicy::Aes256Sha256RsaPss)
        );
        assert_eq!(chosen(Security::Sign, &nobody), Some((Sign, SecurityPolicy::Aes256Sha256RsaPss)));
        assert_eq!(chosen(Security::None, &nobody), Some((MessageSecurityMode::None, SecurityPolicy::None)));
        assert_eq!(chosen(Security::Sign, &somebody), None);
    }
}
