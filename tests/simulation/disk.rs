//! In-memory disk, which may be full, and exists longer than a gateway.

use std::collections::HashMap;
use std::io::{ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use isotherm::gateway::Disk;

#[derive(Clone, Default)]
pub(crate) struct MemoryDisk {
    files: Arc<Mutex<HashMap<PathBuf, Vec<u8>>>>,
    pub(crate) is_full: Arc<AtomicBool>,
    /// Whether the gateway was killed; its writes then fail.
    pub(crate) is_dead: Arc<AtomicBool>,
}

impl MemoryDisk {
    fn files(&self) -> MutexGuard<'_, HashMap<PathBuf, Vec<u8>>> {
        self.files.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn room(&self) -> Result<()> {
        let is_full = self.is_full.load(Ordering::Relaxed) || self.is_dead.load(Ordering::Relaxed);
        if is_full { Err(ErrorKind::StorageFull.into()) } else { Ok(()) }
    }

    fn find(&self, path: &Path) -> Result<Vec<u8>> {
        self.files().get(path).cloned().ok_or_else(|| ErrorKind::NotFound.into())
    }
}

impl Disk for MemoryDisk {
    fn read(&self, path: &Path) -> Result<Vec<u8>> {
        self.find(path)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> Result<()> {
        self.room()?;
        self.files().insert(path.to_owned(), document.to_owned());
        Ok(())
    }

    fn keep(&self, path: &Path, aside: &Path) -> Result<()> {
        let document = self.find(path)?;
        self.replace(aside, &document)
    }

    fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        let mut files = self.files();
        let document = files.remove(from).ok_or(ErrorKind::NotFound)?;
        files.insert(to.to_owned(), document);
        Ok(())
    }

    fn forget(&self, path: &Path) {
        self.files().remove(path);
    }

    fn has(&self, path: &Path) -> bool {
        self.files().contains_key(path)
    }
}
