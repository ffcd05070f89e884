//! Refused logins since the last report. An attacker can cause any number of them, so they are counted, and one report a
//! minute contains their number.

use std::sync::{Mutex, MutexGuard, PoisonError};

use isotherm_profile::safe_file::cut;

/// Longest name in bytes that is reported. A client may send any name.
const LONGEST: usize = 60;

/// Number of refused logins, and the name of the last one.
#[derive(Debug, Default)]
pub(super) struct Refusals(Mutex<(u64, String)>);

impl Refusals {
    /// Counts a refused login.
    pub(super) fn login(&self, name: &str) {
        let mut found = self.lock();
        found.0 += 1;
        found.1 = cut(name, LONGEST).into_owned();
    }

    /// Returns the number of refused logins and the name of the last one, and begins to count again.
    pub(super) fn take(&self) -> (u64, String) {
        std::mem::take(&mut *self.lock())
    }

    /// Returns whether any login was refused since the last call of [`Refusals::take`].
    pub(super) fn any(&self) -> bool {
        self.lock().0 > 0
    }

    fn lock(&self) -> MutexGuard<'_, (u64, String)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
