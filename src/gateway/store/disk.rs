//! File system for documents that must survive the process. Simulations and tests replace the file system.
//!
//! Directories have the permissions 0750 and files 0640, independently of the umask. Other users may not write them,
//! because their content can move a machine.

use std::fmt;
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use crate::fieldbus::explain::system;
use isotherm_profile::safe_file;

/// Maximum size of a document, in bytes.
const LARGEST: u64 = 16 * 1024 * 1024;
const DIRECTORY_MODE: u32 = 0o750;
const FILE_MODE: u32 = 0o640;
/// Permission bit for writing by other users: not the owner of a file, and not in its group.
const OTHERS_WRITE: u32 = 0o002;

/// File system for documents. Tests replace it by a file system that fails.
pub trait Disk: Send + Sync {
    /// Returns the content of a document.
    ///
    /// # Errors
    /// The document does not exist, or it cannot be read.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// Replaces a document as a whole. The document is on disk when the function returns.
    ///
    /// # Errors
    /// The new document could not be stored. The previous document is still on disk.
    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()>;

    /// Gives a document a second name (hard link). When the first name is replaced, the document still exists under
    /// the second name.
    ///
    /// # Errors
    /// The document does not exist, the second name is in use, or there is no space.
    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()>;

    /// Renames a document.
    ///
    /// # Errors
    /// The document does not exist.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Removes a document that is no longer needed.
    fn forget(&self, path: &Path);

    /// Returns whether a document exists.
    fn has(&self, path: &Path) -> bool;
}

impl fmt::Debug for dyn Disk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Disk")
    }
}

/// File system of this computer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Files;

impl Disk for Files {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        safe_file::read(path, LARGEST)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()> {
        replace(path, document).map_err(|error| about(path, &error))
    }

    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()> {
        let kept = match std::fs::hard_link(path, aside) {
            Err(error) if !matches!(error.kind(), ErrorKind::NotFound | ErrorKind::AlreadyExists) => {
                // Some file systems have no links.
                self.read(path).and_then(|bytes| create(aside)?.write_all(&bytes))
            }
            done => done,
        };
        kept.map_err(|error| about(aside, &error))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn forget(&self, path: &Path) {
        let _ = std::fs::remove_file(path);
    }

    fn has(&self, path: &Path) -> bool {
        path.symlink_metadata().is_ok()
    }
}

fn replace(path: &Path, document: &[u8]) -> io::Result<()> {
    let directory = path.parent().unwrap_or(Path::new("."));
    make_directory(directory)?;
    // All attempts use one name: the next attempt removes the file that a kill has left behind.
    let new = path.with_added_extension("new");
    let _ = std::fs::remove_file(&new);
    let mut file = create(&new)?;
    file.write_all(document)?;
    file.sync_all()?;
    std::fs::rename(&new, path)?;
    File::open(directory)?.sync_all()
}

/// Adds the path to the message of an error.
fn about(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {}", path.display(), system(error)))
}

/// Creates a directory and its missing parents.
///
/// # Errors
/// The directory cannot be created.
pub fn make_directory(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    DirBuilder::new().recursive(true).mode(DIRECTORY_MODE).create(path)?;
    std::fs::set_permissions(path, Permissions::from_mode(DIRECTORY_MODE))
}

/// Creates a new file.
///
/// # Errors
/// The file exists, or it cannot be created.
pub(in crate::gateway) fn create(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(path)?;
    file.set_permissions(Permissions::from_mode(FILE_MODE))?;
    Ok(file)
}

/// Opens a file for appending. Creates the file if it is missing.
///
/// # Errors
/// The file cannot be created, or the path is not a regular file.
pub(super) fn append(path: &Path) -> io::Result<File> {
    match create(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            safe_file::open(path)?;
            OpenOptions::new().append(true).open(path)
        }
        made => made,
    }
}

/// Checks that other users may not write to a file or directory. A file that does not exist passes.
///
/// # Errors
/// Every user may write to the file or directory. The error is a sentence with the remedy.
pub(super) fn refuse_what_others_may_write(path: &Path) -> Result<(), String> {
    match std::fs::metadata(path) {
        // Paths of other kinds are never opened.
        Ok(found)
            if (found.is_file() || found.is_dir()) && found.permissions().mode() & OTHERS_WRITE != 0 =>
        {
            Err(format!(
                "every user may write to {0}, and its content moves the machine: check the content, then \
                 remove this permission with `chmod o-w {0}`",
                path.display()
            ))
        }
        _ => Ok(()),
    }
}
