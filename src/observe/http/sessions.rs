//! Sessions of browsers that have signed in. A random number in a cookie identifies a session; the cookie does not
//! contain the token.
//!
//! A session ends after twelve hours, after an hour without use, by sign-out, and when its token changes. The functions
//! do not read a clock. Their argument `now` is the time since the start of the computer.

use std::collections::HashMap;
use std::time::Duration;

use super::tokens::Role;

const LONGEST: Duration = Duration::from_secs(12 * 3600);
/// Maximum time without use, after which a session ends.
const IDLE: Duration = Duration::from_secs(3600);
/// Maximum number of open sessions of each role. If more sessions are open, the session that was unused for the longest
/// time ends.
const MOST: usize = 64;

/// Identifier of a session: a random number, which the cookie contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct SessionKey(u128);

impl SessionKey {
    /// Makes a session identifier from 128 random bits.
    pub(super) fn of(random: [u8; 16]) -> SessionKey {
        SessionKey(u128::from_be_bytes(random))
    }

    /// Formats the session identifier for the cookie.
    pub(super) fn text(self) -> String {
        format!("{:032x}", self.0)
    }

    pub(super) fn parse(text: &str) -> Option<SessionKey> {
        let is_key = text.len() == 32 && text.bytes().all(|letter| letter.is_ascii_hexdigit());
        u128::from_str_radix(text, 16).ok().filter(|_| is_key).map(SessionKey)
    }
}

#[derive(Debug)]
struct Session {
    role: Role,
    /// Version of the token with which the session began.
    version: u64,
    begun: Duration,
    used: Duration,
}

/// Open sessions. The key is the identifier of the session.
#[derive(Debug, Default)]
pub(super) struct Sessions(HashMap<SessionKey, Session>);

impl Sessions {
    /// Begins a session with a token of this role and version.
    pub(super) fn begin(&mut self, key: SessionKey, (role, version): (Role, u64), now: Duration) {
        self.0.retain(|_, session| session.is_open(now));
        let same = self.0.iter().filter(|(_, session)| session.role == role);
        if same.clone().count() >= MOST
            && let Some(idle) = same.min_by_key(|(_, session)| session.used).map(|(key, _)| *key)
        {
            self.0.remove(&idle);
        }
        self.0.insert(key, Session { role, version, begun: now, used: now });
    }

    /// Returns the role of a session and the version of its token. If `uses` returns `true` for the role, the request
    /// counts as use of the session. `None` if no such session is open.
    pub(super) fn role_of(
        &mut self,
        key: SessionKey,
        now: Duration,
        uses: impl Fn(Role) -> bool,
    ) -> Option<(Role, u64)> {
        let session = self.0.get_mut(&key).filter(|session| session.is_open(now))?;
        if uses(session.role) {
            session.used = now;
        }
        Some((session.role, session.version))
    }

    /// Ends a session. Its cookie is invalid from now on.
    pub(super) fn end(&mut self, key: SessionKey) {
        self.0.remove(&key);
    }
}

impl Session {
    fn is_open(&self, now: Duration) -> bool {
        now < self.begun + LONGEST && now < self.used + IDLE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPERATOR: (Role, u64) = (Role::Operator, 3);

    fn minute(minute: u64) -> Duration {
        Duration::from_secs(60 * minute)
    }

    fn key(number: u128) -> SessionKey {
        SessionKey(number)
    }

    #[test]
    fn a_visit_ends_after_twelve_hours_and_after_one_without_use() {
        for (used, now, open) in [
            (&[][..], 59, true),
            (&[], 60, false),
            (&[50], 109, true),
            (&[50], 110, false),
            (&[50, 100, 150, 200, 250, 300, 350, 400, 450, 500, 550, 600, 650, 700], 719, true),
            (&[50, 100, 150, 200, 250, 300, 350, 400, 450, 500, 550, 600, 650, 700], 720, false),
            // Use does not renew a session that is over.
            (&[61], 62, false),
        ] {
            let mut sessions = Sessions::default();
            sessions.begin(key(7), OPERATOR, minute(0));
            for at in used {
                let _ = sessions.role_of(key(7), minute(*at), |_| true);
            }
            let found = sessions.role_of(key(7), minute(now), |_| false);
            assert_eq!(found, open.then_some(OPERATOR), "{used:?} {now}");
        }
    }

    #[test]
    fn to_look_at_a_visit_is_not_to_use_it() {
        let mut sessions = Sessions::default();
        sessions.begin(key(7), OPERATOR, minute(0));
        assert!(sessions.role_of(key(7), minute(50), |role| role == Role::Viewer).is_some());
        assert_eq!(sessions.role_of(key(7), minute(70), |_| true), None);
    }

    #[test]
    fn who_goes_is_gone_and_nobody_else() {
        let mut sessions = Sessions::default();
        sessions.begin(key(7), OPERATOR, minute(0));
        sessions.begin(key(8), OPERATOR, minute(0));
        sessions.end(key(7));
        assert_eq!(sessions.role_of(key(7), minute(1), |_| true), None);
        assert_eq!(sessions.role_of(key(8), minute(1), |_| true), Some(OPERATOR));
    }

    #[test]
    fn of_too_many_the_one_that_was_not_used_for_longest_ends_and_no_role_takes_the_other_s_room() {
        let mut sessions = Sessions::default();
        sessions.begin(key(0), (Role::Viewer, 0), minute(0));
        (1..=64).for_each(|number| sessions.begin(key(number), OPERATOR, minute(0)));
        assert!(sessions.role_of(key(1), minute(1), |_| true).is_some());
        (65..=127).for_each(|number| sessions.begin(key(number), OPERATOR, minute(2)));
        let open =
            |sessions: &mut Sessions, number| sessions.role_of(key(number), minute(3), |_| false).is_some();
        assert!(open(&mut sessions, 0) && open(&mut sessions, 1) && open(&mut sessions, 127));
        assert!((2..=64).all(|number| !open(&mut sessions, number)));
        assert_eq!(sessions.0.len(), 65);
    }

    #[test]
    fn a_key_is_thirty_two_hexadecimal_digits_and_nothing_else() {
        let key = SessionKey::of(*b"0123456789abcdef");
        assert_eq!(SessionKey::parse(&key.text()), Some(key));
        for text in ["", "30", "+0303132333435363738396162636465", "3031323334353637383961626364656g"] {
            assert_eq!(SessionKey::parse(text), None, "{text}");
        }
    }
}
