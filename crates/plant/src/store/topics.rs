//! File that stores the MQTT topics on which the broker may have retained messages. A change replaces the whole file.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use super::{CHECKSUM, create};

/// Maximum size of the file, in bytes. A larger file was not written by isotherm.
const LARGEST: u64 = 4 << 20;

/// Topic names that are stored for the next run of the gateway, which clears the topics that it no longer uses. After a
/// kill, the file contains either the old or the new topics.
#[derive(Clone, Debug)]
pub struct TopicsFile {
    path: PathBuf,
}

impl TopicsFile {
    /// Creates a handle for the topics in this file. The file is not opened.
    pub fn at(path: impl Into<PathBuf>) -> TopicsFile {
        TopicsFile { path: path.into() }
    }

    /// Reads the topics. Returns an empty set if the file is missing or invalid.
    ///
    /// # Errors
    /// The file exists and cannot be read.
    pub fn read(&self) -> io::Result<BTreeSet<String>> {
        let bytes = match fs::metadata(&self.path) {
            Ok(about) if about.is_file() && about.len() <= LARGEST => fs::read(&self.path)?,
            Ok(_) => return Ok(BTreeSet::new()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
            Err(error) => return Err(error),
        };
        Ok(topics(&bytes).unwrap_or_default())
    }

    /// Replaces the topics in the file. After a power failure, the file may contain the old topics, or be invalid.
    ///
    /// # Errors
    /// The disk cannot be written. The file still contains the old topics.
    pub fn write<'t>(&self, topics: impl IntoIterator<Item = &'t String>) -> io::Result<()> {
        let fresh = self.path.with_extension("new");
        let lines: String = topics.into_iter().flat_map(|topic| [topic.as_str(), "\n"]).collect();
        let checksum = CHECKSUM.checksum(lines.as_bytes()).to_le_bytes();
        create(&fresh)?.write_all(&[&checksum[..], lines.as_bytes()].concat())?;
        fs::rename(&fresh, &self.path)
    }
}

fn topics(bytes: &[u8]) -> Option<BTreeSet<String>> {
    let (checksum, lines) = bytes.split_first_chunk::<4>()?;
    let is_whole = CHECKSUM.checksum(lines).to_le_bytes() == *checksum;
    let lines = std::str::from_utf8(lines).ok().filter(|_| is_whole)?;
    Some(lines.lines().map(str::to_owned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_outlive_the_program_and_what_is_damaged_is_none() {
        let directory = tempfile::tempdir().unwrap();
        let file = TopicsFile::at(directory.path().join("topics"));
        assert_eq!(file.read().unwrap(), BTreeSet::new());
        let topics = BTreeSet::from(["g/press/axis/z".to_owned(), "g/press/signal/bed 1".to_owned()]);
        file.write(&topics).unwrap();
        file.write(&topics).unwrap();
        assert_eq!(file.read().unwrap(), topics);
        let mut bytes = fs::read(&file.path).unwrap();
        bytes[6] ^= 1;
        fs::write(&file.path, &bytes).unwrap();
        assert_eq!(file.read().unwrap(), BTreeSet::new());
    }
}
