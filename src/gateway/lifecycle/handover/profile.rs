//! Profile of a handover: the [sources](Sources) of the profile (every file that the loader read), as the new
//! program has checked them. The memory of the sources is sealed against changes.
//!
//! The gateway starts the new program for a check, with an empty memfd as standard output. The checking program
//! writes the sources to the memfd, if the new program can load its profile from a handover. The new program receives
//! the same bytes when it takes over. The gateway does not interpret the sources, so only the new program must know
//! their format. A program of an older version writes nothing, and reads its profile from disk when it takes over.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::memory;
use isotherm_profile::{SOURCES_MARK, Sources, sha256_of};

/// Name of the memfd (kernel memory) to which a checking program writes the sources of its profile.
const ANSWER: &str = "isotherm-checked";
/// Name of the memfd (kernel memory) with the sources of the running profile.
const OWN: &str = "isotherm-profile";
/// Maximum size of the sources of one profile, in bytes.
pub(super) const LARGEST: u64 = 256 * 1024 * 1024;

/// Length and SHA-256 digest of the sources of a profile.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SourcesSeal {
    pub(super) length: u64,
    pub(super) sha256: String,
}

/// Sources of one profile (every file that its loader read) in memory that is sealed against changes. Another program
/// can load the same profile from them.
#[derive(Clone, Debug)]
pub struct KeptProfile {
    memory: Arc<File>,
    pub(super) seal: SourcesSeal,
}

/// Creates empty memory for the sources of the profile that this program loads. Returns `None` if the system cannot
/// create such memory. Then `restart --keep` is not possible.
pub fn memory_for_profile() -> Option<File> {
    memory::create(OWN).ok()
}

/// Returns the file to which a checking program writes the sources of its profile. `None` if its standard output is
/// not a memfd that a gateway has created.
pub fn answer_of_check() -> Option<File> {
    if !memory::is_stream(1, ANSWER) {
        return None;
    }
    let file = File::from(std::io::stdout().as_fd().try_clone_to_owned().ok()?);
    // A script that wraps this program may have printed something.
    file.set_len(0).ok()?;
    Some(file)
}

impl KeptProfile {
    /// Seals memory that contains the sources of a profile, so that nothing can change them.
    ///
    /// # Errors
    /// The system cannot seal the memory.
    pub fn seal(memory: File) -> io::Result<KeptProfile> {
        memory::seal(&memory)?;
        let length = memory.metadata()?.size();
        (&memory).seek(SeekFrom::Start(0))?;
        let seal = SourcesSeal { length, sha256: sha256_of(&memory)? };
        Ok(KeptProfile { memory: Arc::new(memory), seal })
    }

    /// Creates the memory that a checking program receives as standard output.
    ///
    /// # Errors
    /// The system cannot create the memory.
    pub(in crate::gateway) fn offer() -> io::Result<File> {
        memory::create(ANSWER)
    }

    /// Seals `memory` against changes. A checking program has written the sources to it. Returns `None` if the memory
    /// is empty, because the checking program has an older version.
    ///
    /// # Errors
    /// The sources are too large, or the system cannot seal them. The error is a part of a sentence.
    pub(in crate::gateway) fn answered(memory: File) -> Result<Option<KeptProfile>, String> {
        let length = memory.metadata().map_err(|error| error.to_string())?.size();
        if length > LARGEST {
            return Err(format!(
                "the files of the profile have {} MB in total, and no more than {} MB can be handed over",
                length >> 20,
                LARGEST >> 20
            ));
        }
        let mut mark = [0; SOURCES_MARK.len()];
        if memory.read_exact_at(&mut mark, 0).is_err() || mark != SOURCES_MARK.as_bytes() {
            return Ok(None);
        }
        KeptProfile::seal(memory).map(Some).map_err(|error| error.to_string())
    }

    /// Copies the sources from an accepted handover to separate memory, and seals that memory against changes. The
    /// sources are at the beginning of the handover.
    pub(super) fn of_handover(handover: &File, seal: SourcesSeal) -> io::Result<KeptProfile> {
        let own = memory::create(OWN)?;
        copy(handover, &seal, &own)?;
        memory::seal(&own)?;
        Ok(KeptProfile { memory: Arc::new(own), seal })
    }

    /// Returns the sources. The caller can load the profile from them.
    ///
    /// # Errors
    /// The sources have the format of another version.
    pub fn sources(&self) -> io::Result<Sources> {
        Sources::open(self.memory.try_clone()?, self.seal.length)
    }

    /// Copies the sources to the beginning of another file.
    pub(super) fn copy_to(&self, file: &File) -> io::Result<()> {
        copy(&self.memory, &self.seal, file)
    }
}

fn copy(from: &File, seal: &SourcesSeal, to: &File) -> io::Result<()> {
    let (mut at, mut part) = (0, vec![0; 1 << 20]);
    let mut to = to;
    while at < seal.length {
        let length = from.read_at(&mut part, at)?;
        let length = length.min(usize::try_from(seal.length - at).unwrap_or(usize::MAX));
        if length == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        to.write_all(&part[..length])?;
        at += length as u64;
    }
    Ok(())
}
