//! Where the files that a profile names are: beside it, or, for one that is part of the program, in the program.

use std::collections::BTreeSet;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::regular;

/// Those who are neither the owner nor in its group may read, or write.
const OF_OTHERS: u32 = 0o006;

/// The files of one profile.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Files<'a> {
    /// Relative to this directory; and the names of those that were read.
    Beside(&'a Path, &'a Mutex<BTreeSet<String>>),
    /// The same where certificates may not have been made yet.
    Growing(&'a Path, &'a Mutex<BTreeSet<String>>),
    /// By name.
    Inside(&'a [(&'a str, &'a [u8])]),
}

impl Files<'_> {
    /// The text of a file that need not be there.
    ///
    /// # Errors
    /// A sentence: it is there and cannot be read.
    pub(crate) fn text(&self, name: &str) -> Result<Option<String>, String> {
        if !self.is_there(name) {
            return Ok(None);
        }
        let text = String::from_utf8(self.bytes(name, regular::LARGEST_PROFILE)?);
        text.map(Some).map_err(|_| format!("{} is no text in UTF-8", self.path(name)))
    }

    fn is_there(&self, name: &str) -> bool {
        match self {
            Files::Beside(directory, _) | Files::Growing(directory, _) => directory.join(name).exists(),
            Files::Inside(files) => files.iter().any(|(known, _)| *known == name),
        }
    }

    /// Whether this certificate, or key, is still to be made.
    pub(crate) fn is_to_be_made(&self, name: &str) -> bool {
        matches!(self, Files::Growing(..)) && !self.is_there(name)
    }

    /// As errors name a file.
    pub(crate) fn path(&self, name: &str) -> String {
        match self {
            Files::Beside(directory, _) | Files::Growing(directory, _) => {
                directory.join(name).display().to_string()
            }
            Files::Inside(_) => name.to_owned(),
        }
    }

    /// Whether anybody on this computer may read or change it.
    pub(crate) fn is_open_to_all(&self, name: &str) -> bool {
        let (Files::Beside(directory, _) | Files::Growing(directory, _)) = self else { return false };
        let found = directory.join(name).metadata();
        found.is_ok_and(|found| found.permissions().mode() & OF_OTHERS != 0)
    }

    /// The names in a directory that end so, without that end.
    pub(crate) fn names(&self, directory: &str, end: &str) -> Vec<String> {
        let names: Vec<String> = match self {
            Files::Beside(beside, _) | Files::Growing(beside, _) => {
                let entries = std::fs::read_dir(beside.join(directory)).into_iter().flatten().flatten();
                entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
            }
            Files::Inside(files) => {
                let inside = |name: &str| name.strip_prefix(directory)?.strip_prefix('/').map(str::to_owned);
                files.iter().filter_map(|(name, _)| inside(name)).collect()
            }
        };
        names.iter().filter_map(|name| name.strip_suffix(end)).map(str::to_owned).collect()
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// A sentence: not there, not readable, too large.
    pub(crate) fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.bytes(name, regular::LARGEST)
    }

    fn bytes(&self, name: &str, largest: u64) -> Result<Vec<u8>, String> {
        match self {
            Files::Beside(directory, read) | Files::Growing(directory, read) => {
                read.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned());
                let path = directory.join(name);
                regular::read(&path, largest).map_err(|why| {
                    format!(
                        "{} cannot be read: {}",
                        path.display(),
                        regular::without_numbers(&why.to_string())
                    )
                })
            }
            Files::Inside(files) => match files.iter().find(|(known, _)| *known == name) {
                Some((_, bytes)) => Ok(bytes.to_vec()),
                None => Err(format!("{name} is not among the files of this profile")),
            },
        }
    }
}
