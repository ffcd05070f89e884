//! Choice of an endpoint: the strongest endpoint that the server and the gateway support and the profile allows.

use ::opcua::client::IdentityToken;
use ::opcua::crypto::SecurityPolicy;
use ::opcua::types::{EndpointDescription, MessageSecurityMode, UserTokenPolicy, UserTokenType};
use isotherm_profile::Security;

use super::user_kind;

/// Supported security policies, the strongest first. Policies with SHA-1 are broken, and therefore not supported.
const POLICIES: [SecurityPolicy; 3] =
    [SecurityPolicy::Aes256Sha256RsaPss, SecurityPolicy::Aes128Sha256RsaOaep, SecurityPolicy::Basic256Sha256];

/// Returns the strongest endpoint with this security that accepts this kind of user. The result contains only its
/// strongest login method. Returns `None` if no endpoint fits.
pub(super) fn choose(
    endpoints: Vec<EndpointDescription>,
    security: Security,
    user: &IdentityToken,
) -> Option<EndpointDescription> {
    let fitting = endpoints
        .into_iter()
        .filter(|endpoint| security_of(endpoint) == Some(security) && is_binary(endpoint));
    let ranked = fitting.filter_map(|endpoint| {
        let (hidden, token) = token(&endpoint, user)?;
        let rank = (rank(&endpoint)?, hidden);
        Some((rank, EndpointDescription { user_identity_tokens: Some(vec![token]), ..endpoint }))
    });
    ranked.min_by_key(|(rank, _)| *rank).map(|(_, endpoint)| endpoint)
}

/// Returns the rank of the strongest login method for this user at the endpoint (0 is the strongest), and the
/// method; `None` if the endpoint has no usable method for this user. If the method names no security policy,
/// the policy of the endpoint applies (OPC UA Part 4, UserTokenPolicy). The library would use no security in
/// this case.
fn token(endpoint: &EndpointDescription, user: &IdentityToken) -> Option<(usize, UserTokenPolicy)> {
    let kind = user_kind(user);
    let offered = endpoint.user_identity_tokens.iter().flatten().filter(|token| token.token_type == kind);
    let ranked = offered.filter_map(|token| {
        let own = &token.security_policy_uri;
        let uri = if own.is_empty() { &endpoint.security_policy_uri } else { own };
        let policy = SecurityPolicy::from_uri(uri.as_ref());
        let strength = match kind {
            UserTokenType::Anonymous => 0,
            // Without encryption only if the channel encrypts it, or the profile requires no security.
            UserTokenType::UserName
                if policy == SecurityPolicy::None && security_of(endpoint) != Some(Security::Sign) =>
            {
                POLICIES.len()
            }
            // Secrets are encrypted with the server's certificate.
            _ if endpoint.server_certificate.as_ref().is_empty() => return None,
            _ => POLICIES.iter().position(|known| *known == policy)?,
        };
        Some((strength, UserTokenPolicy { security_policy_uri: uri.clone(), ..token.clone() }))
    });
    ranked.min_by_key(|(strength, _)| *strength)
}

/// Returns whether the signed list of endpoints leads to the same choice of endpoint. The first list was requested
/// without protection, so an attacker may have removed stronger endpoints from it. A signed list without a fitting
/// endpoint is accepted.
pub(super) fn is_confirmed(
    chosen: &EndpointDescription,
    signed: Vec<EndpointDescription>,
    security: Security,
    user: &IdentityToken,
) -> bool {
    let signed = signed.into_iter().map(|endpoint| EndpointDescription {
        server_certificate: chosen.server_certificate.clone(),
        ..endpoint
    });
    let way = |endpoint: &EndpointDescription| {
        let token = endpoint.user_identity_tokens.iter().flatten().next();
        (endpoint.security_policy_uri.clone(), token.map(|token| token.security_policy_uri.clone()))
    };
    choose(signed.collect(), security, user).is_none_or(|again| way(&again) == way(chosen))
}

/// Returns whether the gateway supports the protocol and the security policy of this endpoint.
pub(super) fn is_spoken(endpoint: &EndpointDescription) -> bool {
    is_binary(endpoint) && rank(endpoint).is_some()
}

/// Returns how the endpoint protects messages; `None` for a mode that OPC UA does not define.
pub(super) fn security_of(endpoint: &EndpointDescription) -> Option<Security> {
    match endpoint.security_mode {
        MessageSecurityMode::None => Some(Security::None),
        MessageSecurityMode::Sign => Some(Security::Sign),
        MessageSecurityMode::SignAndEncrypt => Some(Security::SignAndEncrypt),
        MessageSecurityMode::Invalid => None,
    }
}

/// Returns the rank of the endpoint among the endpoints with the same security; 0 is the strongest. Returns `None` if
/// its policy is not supported.
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

    fn endpoint(
        mode: MessageSecurityMode,
        policy: SecurityPolicy,
        users: &[UserTokenType],
    ) -> EndpointDescription {
        let policies = users.iter().map(|kind| UserTokenPolicy { token_type: *kind, ..Default::default() });
        EndpointDescription {
            security_mode: mode,
            security_policy_uri: policy.to_uri().into(),
            server_certificate: vec![1, 2, 3].into(),
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

    /// Returns an endpoint with the strongest policy, and these policies to log in with a password.
    fn with_password(mode: MessageSecurityMode, tokens: &[&str]) -> EndpointDescription {
        let policy = if mode == MessageSecurityMode::None { SecurityPolicy::None } else { POLICIES[0] };
        let ways = tokens.iter().map(|uri| UserTokenPolicy {
            token_type: UserTokenType::UserName,
            security_policy_uri: (*uri).into(),
            ..Default::default()
        });
        EndpointDescription { user_identity_tokens: Some(ways.collect()), ..endpoint(mode, policy, &[]) }
    }

    #[test]
    fn a_password_goes_by_the_strongest_way_there_is_and_in_clear_only_where_that_is_wanted_or_hidden() {
        use MessageSecurityMode::{None as Plain, Sign, SignAndEncrypt};
        let somebody = IdentityToken::new_user_name("isotherm", "secret");
        let [best, middle, last] = POLICIES.map(|policy| policy.to_uri());
        let (clear, broken) = (SecurityPolicy::None.to_uri(), SecurityPolicy::Basic128Rsa15.to_uri());
        let way = |mode, tokens: &[&str]| {
            let offered = with_password(mode, tokens);
            let security = security_of(&offered)?;
            let chosen = choose(vec![offered], security, &somebody)?.user_identity_tokens?;
            Some(chosen.first()?.security_policy_uri.to_string())
        };
        let is = |uri: &str| Some(uri.to_owned());
        assert_eq!(way(SignAndEncrypt, &[clear, last, "urn:of-tomorrow", middle, broken]), is(middle));
        assert_eq!(way(SignAndEncrypt, &[""]), is(best), "left out is the endpoint's");
        assert_eq!(way(SignAndEncrypt, &[clear]), is(clear), "the channel hides it");
        assert_eq!(way(SignAndEncrypt, &[broken]), None);
        assert_eq!(way(Sign, &[clear]), None, "nothing would hide it");
        assert_eq!(way(Sign, &[broken]), None);
        assert_eq!(way(Plain, &[""]), is(clear), "as the profile wants it");
        assert_eq!(way(Plain, &[clear, last]), is(last));
        let bare =
            EndpointDescription { server_certificate: Default::default(), ..with_password(Plain, &[last]) };
        assert!(choose(vec![bare], Security::None, &somebody).is_none(), "by which certificate?");
    }

    #[test]
    fn what_somebody_between_has_left_out_of_an_offer_is_noticed() {
        use MessageSecurityMode::Sign;
        let somebody = IdentityToken::new_user_name("isotherm", "secret");
        let [best, _, last] = POLICIES.map(|policy| policy.to_uri());
        let chosen = choose(vec![with_password(Sign, &[last])], Security::Sign, &somebody).unwrap();
        let is_confirmed = |signed| is_confirmed(&chosen, signed, Security::Sign, &somebody);
        assert!(is_confirmed(vec![with_password(Sign, &[last])]));
        assert!(is_confirmed(Vec::new()), "it says nothing");
        assert!(!is_confirmed(vec![with_password(Sign, &[last, best])]));
    }
}
