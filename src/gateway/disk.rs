//! Where the documents are kept that outlive the process, and how files are made there. A simulation takes the file
//! system's place.
//!
//! Directories have the mode 0750 and files 0640, whatever the umask: what stands in them moves a machine.

use std::fmt;
use std::fs::{DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use crate::fieldbus::explain::system;
use isotherm_profile::regular;

/// A document is no larger than this, in bytes.
const LARGEST: u64 = 16 * 1024 * 1024;
const DIRECTORY_MODE: u32 = 0o750;
const FILE_MODE: u32 = 0o640;
/// Who is neither the owner nor in its group may write.
const OTHERS_WRITE: u32 = 0o002;

/// A place for documents.
pub trait Disk: Send + Sync {
    /// What is kept there.
    ///
    /// # Errors
    /// There is nothing, or it cannot be read.
    fn read(&self, path: &Path) -> io::Result<Vec<u8>>;

    /// Puts a document there as a whole, in place of what was: it is on disk when this returns.
    ///
    /// # Errors
    /// It is not; what was there still is.
    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()>;

    /// Keeps it under a second name, whatever becomes of the first.
    ///
    /// # Errors
    /// There is nothing of that name, the second is taken, or there is no room.
    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()>;

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
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        regular::read(path, LARGEST)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()> {
        replace(path, document).map_err(|error| about(path, &error))
    }

    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()> {
        let kept = match std::fs::hard_link(path, aside) {
            Err(error) if !matches!(error.kind(), ErrorKind::NotFound | ErrorKind::AlreadyExists) => {
                // Not every file system has links.
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
    // One name for all of them: what a kill leaves behind is gone with the next.
    let new = path.with_added_extension("new");
    let _ = std::fs::remove_file(&new);
    let mut file = create(&new)?;
    file.write_all(document)?;
    file.sync_all()?;
    std::fs::rename(&new, path)?;
    File::open(directory)?.sync_all()
}

/// The same error, that says about what.
fn about(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {}", path.display(), system(error)))
}

/// Makes a directory, and those above it, where it is not there.
///
/// # Errors
/// It cannot be made.
pub fn make_directory(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    DirBuilder::new().recursive(true).mode(DIRECTORY_MODE).create(path)?;
    std::fs::set_permissions(path, Permissions::from_mode(DIRECTORY_MODE))
}

/// Makes a file that is not there.
///
/// # Errors
/// It is there, or it cannot be made.
pub(super) fn create(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().write(true).create_new(true).mode(FILE_MODE).open(path)?;
    file.set_permissions(Permissions::from_mode(FILE_MODE))?;
    Ok(file)
}

/// Opens a file to write at its end, and makes it where it is not there.
///
/// # Errors
/// It cannot be made, or what lies there is no regular file.
pub(super) fn append(path: &Path) -> io::Result<File> {
    match create(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            regular::open(path)?;
            OpenOptions::new().append(true).open(path)
        }
        made => made,
    }
}

/// Whether anybody may write to it.
///
/// # Errors
/// A sentence with the remedy: anybody may.
pub(super) fn refuse_what_others_may_write(path: &Path) -> Result<(), String> {
    match std::fs::metadata(path) {
        // What is neither is not opened at all.
        Ok(found)
            if (found.is_file() || found.is_dir()) && found.permissions().mode() & OTHERS_WRITE != 0 =>
        {
            Err(format!(
                "anybody may write to {0}, and what stands there moves the machine: look at it, then take that away with \
             `chmod o-w {0}`",
                path.display()
            ))
        }
        _ => Ok(()),
    }
}
