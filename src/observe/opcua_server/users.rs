//! Users of the server: logins with a password or a certificate, and permission for the method `measured`.
//!
//! Logins with a password are checked one after the other. The answer to a wrong password is delayed by a second.
//! Clients can therefore try at most one password a second, whatever the number of connections.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use ::opcua::crypto::{SecurityPolicy, Thumbprint, X509};
use ::opcua::server::authenticator::{AuthManager, DefaultAuthenticator, Password, UserToken};
use ::opcua::server::{ServerEndpoint, ServerUserToken};
use ::opcua::types::{Error, NodeId, StatusCode, UAString, UserTokenPolicy, UserTokenType};
use async_trait::async_trait;
use subtle::ConstantTimeEq;
use tokio::sync::Mutex;

use super::files::{Login, Secret};
use super::refusals::Refusals;

/// Delay of the answer to a wrong password.
const AFTER_WRONG: Duration = Duration::from_secs(1);
/// Maximum time for which a login waits for earlier logins.
const PATIENCE: Duration = Duration::from_secs(5);

/// Users that may log in.
pub(super) struct Users {
    passwords: BTreeMap<String, String>,
    /// Names of the users that may call the method `measured`.
    may_measure: BTreeSet<String>,
    /// Login policies of the library, which also compare the certificates of users.
    policies: DefaultAuthenticator,
    /// Lock that is held while a login is checked, so that no two logins are checked at the same time.
    turn: Mutex<()>,
    refusals: Arc<Refusals>,
}

impl Users {
    pub(super) fn new(logins: &[Login], refusals: Arc<Refusals>) -> Users {
        let passwords = logins.iter().filter_map(|login| match &login.secret {
            Secret::Password(password) => Some((login.name.clone(), password.clone())),
            Secret::Certificate(_) => None,
        });
        let may_measure = logins.iter().filter(|login| login.takes_measured);
        Users {
            passwords: passwords.collect(),
            may_measure: may_measure.map(|login| login.name.clone()).collect(),
            policies: DefaultAuthenticator::new(tokens(logins)),
            turn: Mutex::new(()),
            refusals,
        }
    }

    /// Returns whether any user may call the method `measured`.
    pub(super) fn take_measured(&self) -> bool {
        !self.may_measure.is_empty()
    }
}

/// Returns the users in the form that the library requires.
pub(super) fn tokens(logins: &[Login]) -> BTreeMap<String, ServerUserToken> {
    let token = |login: &Login| match &login.secret {
        // The library needs a password to offer this kind of login. It never compares this one.
        Secret::Password(_) => ServerUserToken::user_pass(login.name.clone(), String::new()),
        Secret::Certificate(cert) => ServerUserToken {
            user: login.name.clone(),
            x509: Some(String::new()),
            thumbprint: X509::from_der(cert).ok().map(|cert| cert.thumbprint()),
            ..ServerUserToken::default()
        },
    };
    logins.iter().map(|login| (login.name.clone(), token(login))).collect()
}

fn refused(why: &'static str) -> Error {
    Error::new(StatusCode::BadUserAccessDenied, why)
}

#[async_trait]
impl AuthManager for Users {
    async fn authenticate_anonymous_token(&self, endpoint: &ServerEndpoint) -> Result<(), Error> {
        self.policies.authenticate_anonymous_token(endpoint).await
    }

    async fn authenticate_username_identity_token(
        &self,
        _endpoint: &ServerEndpoint,
        username: &str,
        password: &Password,
    ) -> Result<UserToken, Error> {
        let Ok(_turn) = tokio::time::timeout(PATIENCE, self.turn.lock()).await else {
            return Err(refused("too many logins at a time"));
        };
        // An unknown user takes as long as a wrong password. The comparison takes constant time, so that response times
        // do not help to guess a password.
        let known = self.passwords.get(username).map_or("", String::as_str);
        let is_same: bool = password.get().as_bytes().ct_eq(known.as_bytes()).into();
        let is_right = is_same && self.passwords.contains_key(username);
        if is_right {
            return Ok(UserToken(username.to_owned()));
        }
        self.refusals.login(username);
        tokio::time::sleep(AFTER_WRONG).await;
        Err(refused("wrong user or password"))
    }

    async fn authenticate_x509_identity_token(
        &self,
        endpoint: &ServerEndpoint,
        signing_thumbprint: &Thumbprint,
    ) -> Result<UserToken, Error> {
        let known = self.policies.authenticate_x509_identity_token(endpoint, signing_thumbprint).await;
        known.inspect_err(|_| self.refusals.login(&signing_thumbprint.as_hex_string()))
    }

    fn is_user_executable(&self, token: &UserToken, method_id: &NodeId) -> bool {
        // Methods of the core namespace only concern the client's own subscriptions.
        method_id.namespace == 0 || self.may_measure.contains(&token.0)
    }

    fn user_token_policies(&self, endpoint: &ServerEndpoint) -> Vec<UserTokenPolicy> {
        let mut policies = self.policies.user_token_policies(endpoint);
        // Without a policy here, a client may send a password that is not encrypted on a channel that is only signed.
        // For a certificate, the library would require a signature with SHA-1.
        if endpoint.security_policy() != SecurityPolicy::None {
            let named = policies.iter_mut().filter(|policy| policy.token_type != UserTokenType::Anonymous);
            named.for_each(|policy| {
                policy.security_policy_uri = UAString::from(endpoint.security_policy().to_uri());
            });
        }
        policies
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::opcua::types::MessageSecurityMode;

    fn users() -> (Users, ServerEndpoint) {
        let login = |name: &str, takes_measured| Login {
            name: name.to_owned(),
            secret: Secret::Password(format!("{name}-and-more")),
            takes_measured,
        };
        let logins = [login("mes", false), login("probe", true)];
        let names: Vec<String> = logins.iter().map(|login| login.name.clone()).collect();
        let policy = (SecurityPolicy::Basic256Sha256, MessageSecurityMode::SignAndEncrypt);
        let endpoint = ServerEndpoint::new("/", policy.0, policy.1, &names);
        (Users::new(&logins, Arc::new(Refusals::default())), endpoint)
    }

    async fn login(users: &Users, endpoint: &ServerEndpoint, name: &str, password: &str) -> Option<String> {
        let password = Password::new(password.to_owned());
        users.authenticate_username_identity_token(endpoint, name, &password).await.ok().map(|token| token.0)
    }

    #[tokio::test(start_paused = true)]
    async fn a_right_password_logs_in_at_once_and_a_wrong_one_is_answered_after_a_second() {
        let (users, endpoint) = users();
        assert_eq!(login(&users, &endpoint, "mes", "mes-and-more").await.as_deref(), Some("mes"));
        for (name, password) in
            [("mes", "mes-and-mor"), ("mes", ""), ("nobody", ""), ("probe", "mes-and-more")]
        {
            let answered =
                tokio::time::timeout(AFTER_WRONG / 2, login(&users, &endpoint, name, password)).await;
            assert!(answered.is_err(), "{name} {password}");
            assert_eq!(login(&users, &endpoint, name, password).await, None, "{name} {password}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn however_many_try_at_a_time_one_password_a_second_is_checked() {
        let (users, endpoint) = users();
        let three = || async {
            tokio::join!(
                login(&users, &endpoint, "mes", "1"),
                login(&users, &endpoint, "mes", "2"),
                login(&users, &endpoint, "nobody", "3"),
            )
        };
        assert!(tokio::time::timeout(AFTER_WRONG * 5 / 2, three()).await.is_err());
        assert_eq!(users.refusals.take().0, 3);
        assert_eq!(three().await, (None, None, None));
        assert_eq!(users.refusals.take(), (3, "nobody".to_owned()));
    }

    #[test]
    fn only_a_user_with_the_permission_may_call_the_method() {
        let (users, _) = users();
        let method = NodeId::new(2, "axis.z.measured");
        let may = |name: &str| users.is_user_executable(&UserToken(name.to_owned()), &method);
        assert!(may("probe") && !may("mes") && !may("ANONYMOUS") && users.take_measured());
    }
}
