//! Where a demo keeps its logs for as long as it runs, so that its page has a past. State and ledger it forgets: it is
//! always its first day.

use std::io;
use std::path::{Path, PathBuf};

use crate::gateway::Disk;

/// A directory of its own, gone with it.
pub(super) struct Logs(PathBuf);

impl Logs {
    /// `None` where there is no room for one: a demo runs without it.
    pub(super) fn make() -> Option<Logs> {
        let path = std::env::temp_dir().join(format!("isotherm-demo-{}", std::process::id()));
        std::fs::create_dir(&path).ok().map(|()| Logs(path))
    }

    pub(super) fn path(&self) -> PathBuf {
        self.0.clone()
    }
}

impl Drop for Logs {
    fn drop(&mut self) {
        // What cannot be removed is the system's to tidy.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Keeps nothing.
pub(super) struct Forgetful;

impl Disk for Forgetful {
    fn read(&self, _: &Path) -> io::Result<Vec<u8>> {
        Err(io::ErrorKind::NotFound.into())
    }

    fn replace(&self, _: &Path, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn keep(&self, _: &Path, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn rename(&self, _: &Path, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn forget(&self, _: &Path) {}

    fn has(&self, _: &Path) -> bool {
        false
    }
}
