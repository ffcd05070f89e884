//! One number in a file of its own, replaced as a whole.

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use super::{CHECKSUM, create};

/// A number that outlives the program. Killed at any instant, the file has the number before or the number after.
#[derive(Clone, Debug)]
pub struct NumberFile {
    path: PathBuf,
}

impl NumberFile {
    /// The number in this file.
    pub fn at(path: impl Into<PathBuf>) -> NumberFile {
        NumberFile { path: path.into() }
    }

    /// The number; `None` where there is no file, or none of this form.
    ///
    /// # Errors
    /// There is a file that cannot be read.
    pub fn read(&self) -> io::Result<Option<u64>> {
        match fs::read(&self.path) {
            Ok(bytes) => Ok(number(&bytes)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Replaces the number. A power cut may bring the old one back, or none; a kill does not.
    ///
    /// # Errors
    /// The old one is there still.
    pub fn write(&self, number: u64) -> io::Result<()> {
        let fresh = self.path.with_extension("new");
        let number = number.to_le_bytes();
        let checksum = CHECKSUM.checksum(&number).to_le_bytes();
        let mut file = create(&fresh)?;
        file.write_all(&[&number[..], &checksum[..]].concat())?;
        fs::rename(&fresh, &self.path)
    }
}

fn number(bytes: &[u8]) -> Option<u64> {
    let (number, checksum) = bytes.split_first_chunk::<8>()?;
    let is_whole = CHECKSUM.checksum(number).to_le_bytes() == checksum;
    is_whole.then(|| u64::from_le_bytes(*number))
}
