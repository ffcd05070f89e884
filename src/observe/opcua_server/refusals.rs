//! Refused clients and logins since the last report. An attacker can cause any number of them. Therefore logins are
//! only counted, and one report a minute contains their number. For clients, only a few certificates are kept.

use std::sync::{Mutex, MutexGuard, PoisonError};

use isotherm_profile::safe_file::cut;

/// Maximum length of a user name in a report, bytes. A client may send any name.
const LONGEST: usize = 60;
/// Maximum number of certificates that are kept until the next report.
const MOST_CLIENTS: usize = 10;

/// Refused clients and logins since the last report.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    /// Number of refused logins, and the user name of the last refused login.
    logins: Mutex<(u64, String)>,
    /// Certificates of the refused clients, which are not trusted.
    clients: Mutex<Vec<Vec<u8>>>,
}

impl Refusals {
    /// Counts a refused login, and stores its user name.
    pub(super) fn login(&self, name: &str) {
        let mut found = locked(&self.logins);
        found.0 += 1;
        found.1 = cut(name, LONGEST).into_owned();
    }

    /// Keeps the certificate of a client that is not trusted.
    pub(super) fn client(&self, certificate: Vec<u8>) {
        let mut clients = locked(&self.clients);
        if clients.len() < MOST_CLIENTS && !clients.contains(&certificate) {
            clients.push(certificate);
        }
    }

    /// Returns the certificates of clients that were refused since the last call.
    pub(super) fn take_clients(&self) -> Vec<Vec<u8>> {
        std::mem::take(&mut *locked(&self.clients))
    }

    /// Returns the number of refused logins, and the user name of the last refused login. The count begins again at
    /// zero.
    pub(super) fn take(&self) -> (u64, String) {
        std::mem::take(&mut *locked(&self.logins))
    }

    /// Returns whether any login was refused since the last call of [`Refusals::take`].
    pub(super) fn any(&self) -> bool {
        locked(&self.logins).0 > 0
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_refused_clients_a_few_are_kept_and_each_once() {
        let refusals = Refusals::default();
        for number in 0..100 {
            refusals.client(vec![number]);
            refusals.client(vec![number]);
        }
        let kept: Vec<Vec<u8>> = (0..10).map(|number| vec![number]).collect();
        assert_eq!(refusals.take_clients(), kept);
        refusals.client(vec![7]);
        assert_eq!(refusals.take_clients(), [vec![7]]);
    }
}
