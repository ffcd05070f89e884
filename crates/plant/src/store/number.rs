//! File that stores one number, such as the death number of a Sparkplug node. A change replaces the whole file.

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use super::{CHECKSUM, create};

/// Number that is stored for the next run of the gateway. After a kill, the file contains either the old or the new
/// number.
#[derive(Clone, Debug)]
pub struct NumberFile {
    path: PathBuf,
}

impl NumberFile {
    /// Creates a handle for the number in this file. The file is not opened.
    pub fn at(path: impl Into<PathBuf>) -> NumberFile {
        NumberFile { path: path.into() }
    }

    /// Reads the number; `None` if the file is missing or invalid.
    ///
    /// # Errors
    /// The file exists and cannot be read.
    pub fn read(&self) -> io::Result<Option<u64>> {
        match fs::read(&self.path) {
            Ok(bytes) => Ok(number(&bytes)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Replaces the number in the file. After a power failure, the file may contain the old number, or be invalid.
    ///
    /// # Errors
    /// The disk cannot be written. The file still contains the old number.
    pub fn write(&self, number: u64) -> io::Result<()> {
        let fresh = self.path.with_extension("new");
        let number = number.to_le_bytes();
        let checksum = CHECKSUM.checksum(&number).to_le_bytes();
        let mut file = create(&fresh)?;
        file.write_all(&[&number[..], &checksum[..]].concat())?;
        fs::rename(&fresh, &self.path)
    }

    /// Removes the file, so that the next run finds no number.
    ///
    /// # Errors
    /// The file exists and cannot be removed.
    pub fn clear(&self) -> io::Result<()> {
        match fs::remove_file(&self.path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }
}

fn number(bytes: &[u8]) -> Option<u64> {
    let (number, checksum) = bytes.split_first_chunk::<8>()?;
    let is_whole = CHECKSUM.checksum(number).to_le_bytes() == checksum;
    is_whole.then(|| u64::from_le_bytes(*number))
}
