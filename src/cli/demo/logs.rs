//! Where a demo keeps its logs for as long as it runs, so that its page has a past. State and ledger it forgets: it is
//! always its first day.

use std::io;
use std::path::{Path, PathBuf};

use crate::gateway::Disk;

/// A directory of its own, gone with it.
pub(super) struct Logs(PathBuf);

/// Before the number of the process that it belongs to.
const NAME: &str = "isotherm-demo-";

/// Those of demos that were killed go with the next one.
fn tidy(directory: &Path) {
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let process = name.to_str().and_then(|name| name.strip_prefix(NAME)?.parse::<u32>().ok());
        let is_over =
            |process: u32| process == std::process::id() || !Path::new(&format!("/proc/{process}")).exists();
        if process.is_some_and(is_over) {
            // One of another user is his.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

impl Logs {
    /// `None` where there is no room for one: a demo runs without it.
    pub(super) fn make() -> Option<Logs> {
        tidy(&std::env::temp_dir());
        let path = std::env::temp_dir().join(format!("{NAME}{}", std::process::id()));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_demo_left_goes_and_what_a_running_one_has_stays() {
        let home = tempfile::tempdir().unwrap();
        let made = |name: &str| {
            let path = home.path().join(name);
            std::fs::create_dir(&path).unwrap();
            std::fs::write(path.join("m-2026-01-05.csv"), "time").unwrap();
            path
        };
        // No process has a number as large as that; number 1 always runs.
        let [killed, running, other] =
            ["isotherm-demo-4294967295", "isotherm-demo-1", "isotherm-demo-x"].map(made);
        tidy(home.path());
        assert_eq!([killed, running, other].map(|path| path.exists()), [false, true, true]);
    }
}
