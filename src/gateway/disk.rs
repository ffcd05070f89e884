//! Where the documents are kept that outlive the process. A simulation takes the file system's place.

use std::fmt;
use std::io::{self, Write};
use std::path::Path;

/// A place for documents.
pub trait Disk: Send + Sync {
    /// What is kept there.
    ///
    /// # Errors
    /// There is nothing, or it cannot be read.
    fn read(&self, path: &Path) -> io::Result<String>;

    /// Puts a document there as a whole, in place of what was: it is on disk when this returns.
    ///
    /// # Errors
    /// It is not; what was there still is.
    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()>;

    /// Keeps a second one of it.
    ///
    /// # Errors
    /// There is none, or no room.
    fn copy(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Gives it another name.
    ///
    /// # Errors
    /// There is nothing of that name.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// It need not be kept any longer.
    fn forget(&self, path: &Path);

    /// Something is kept there.
    fn has(&self, path: &Path) -> bool;
}

impl fmt::Debug for dyn Disk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Disk")
    }
}

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Files;

impl Disk for Files {
    fn read(&self, path: &Path) -> io::Result<String> {
        std::fs::read_to_string(path)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()> {
        if let Some(directory) = path.parent() {
            std::fs::create_dir_all(directory)?;
        }
        let mut file = atomic_write_file::AtomicWriteFile::open(path)?;
        file.write_all(document)?;
        file.commit()
    }

    fn copy(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::copy(from, to).map(|_| ())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn forget(&self, path: &Path) {
        let _ = std::fs::remove_file(path);
    }

    fn has(&self, path: &Path) -> bool {
        path.exists()
    }
}
