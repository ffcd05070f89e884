//! Temporary logs of a demo, so that its web page has a history. A demo stores no saved state and no register ledger
//! (record of written values), so each demo starts without them.

use std::io;
use std::path::{Path, PathBuf};

use crate::gateway::Disk;

/// Temporary directory of a demo's logs. Dropping it removes the directory.
pub(super) struct Logs(PathBuf);

/// Start of the directory's name. The process id of the demo follows.
const NAME: &str = "isotherm-demo-";

/// Removes the log directories of demos that were killed.
fn tidy(directory: &Path) {
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let process = name.to_str().and_then(|name| name.strip_prefix(NAME)?.parse::<u32>().ok());
        let is_over =
            |process: u32| process == std::process::id() || !Path::new(&format!("/proc/{process}")).exists();
        if process.is_some_and(is_over) {
            // Removal of another user's directory fails.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

impl Logs {
    /// Creates the directory. Returns `None` if that fails, because a demo also runs without logs.
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
        // If this fails, the next demo or the system removes the directory.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Storage that discards the saved state and the register ledger (record of written values).
pub(super) struct NullDisk;

impl Disk for NullDisk {
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
        // No process has as large an id as the first; the process with id 1 always runs.
        let [killed, running, other] =
            ["isotherm-demo-4294967295", "isotherm-demo-1", "isotherm-demo-x"].map(made);
        tidy(home.path());
        assert_eq!([killed, running, other].map(|path| path.exists()), [false, true, true]);
    }
}
