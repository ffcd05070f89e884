//! Transport of a handover from one program to the next in the same process. The new program receives a sealed memfd
//! (kernel memory that can no longer be changed) as standard input. The state directory contains the digest of the
//! handover.
//!
//! ```text
//! content of the memfd                                                       receiving program
//! sources of the checked profile, document (JSON), its length (8 bytes)    loads the profile from the sources
//! document                                                                 older version, reads the profile from disk
//! ```
//!
//! Any process can start the program with any standard input. The program therefore accepts a memfd only
//! under these conditions:
//!
//! - The memfd cannot be changed: all seals of the kernel are set, and the memfd belongs to this user.
//! - The memfd was written by this process (same process id, start time and boot).
//! - The state directory contains the digest of the document. The document contains the digest of the
//!   sources.
//!
//! The program removes the digest before it arms an axis, so that no handover is used twice.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Handover;
use super::memory;
use super::profile::{KeptProfile, LARGEST as LARGEST_SOURCES, SourcesSeal};
use crate::fieldbus::explain::system;
use crate::gateway::store::disk::{Disk, Files, create};
use isotherm_profile::safe_file::without_numbers;
use isotherm_profile::{SOURCES_MARK, sha256, sha256_of};

#[cfg(test)]
mod tests;

const NAME: &str = "isotherm-handover";
/// Maximum size of the document of a handover, in bytes.
const LARGEST: u64 = 16 * 1024 * 1024;
/// Size of the number at the end of the memfd, in bytes. The number is the length of the document.
const TRAILER: u64 = 8;

/// Identity of a process. The identity stays the same when a process replaces its program by another one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Process {
    id: u32,
    /// Clock ticks from the start of the computer to the start of the process.
    started: u64,
    /// Boot id of the kernel, which changes with each start of the computer.
    boot: String,
}

/// Content of a handover that is stored as JSON.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document<H> {
    process: Process,
    handover: H,
    /// Length and digest of the profile's sources. `None` if the receiving program has an older version,
    /// which reads the profile from disk.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sources: Option<SourcesSeal>,
}

impl Process {
    fn this() -> io::Result<Process> {
        let read = |path: &str| {
            let about = |error| io::Error::other(format!("{path} cannot be read: {}", system(&error)));
            std::fs::read_to_string(path).map_err(about)
        };
        let stat = read("/proc/self/stat")?;
        // The second field, the name, is in parentheses and may contain any character. The start time is field 22.
        let started =
            stat.rsplit(')').next().and_then(|fields| fields.split_whitespace().nth(19)?.parse().ok());
        let started = started.ok_or_else(|| io::Error::other("/proc/self/stat shows no start time"))?;
        let boot = read("/proc/sys/kernel/random/boot_id")?.trim().to_owned();
        Ok(Process { id: std::process::id(), started, boot })
    }
}

/// Returns the path of the file with the digest of a machine's handover.
pub fn digest_path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.handover"))
}

/// Memory for a handover. The memory already contains the sources of the profile, because copying many megabytes
/// takes time. It is sealed (protected against changes) when the handover is complete.
#[derive(Debug)]
pub struct Prepared {
    memory: File,
    sources: Option<SourcesSeal>,
}

impl Prepared {
    /// Creates the memory of a handover, and copies the profile to it if the receiving program can load a profile from
    /// a handover.
    ///
    /// # Errors
    /// The system cannot create a memfd. The error is a sentence.
    pub fn with(profile: Option<&KeptProfile>) -> io::Result<Prepared> {
        let prepare = || {
            let memory = memory::create(NAME)?;
            profile.map_or(Ok(()), |profile| profile.copy_to(&memory))?;
            Ok(Prepared { memory, sources: profile.map(|profile| profile.seal.clone()) })
        };
        prepare().map_err(no_memory)
    }

    /// Returns whether the memory contains a profile.
    pub fn has_profile(&self) -> bool {
        self.sources.is_some()
    }
}

/// Converts the error of a failed memfd to a message for the operator.
fn no_memory(error: io::Error) -> io::Error {
    let error = without_numbers(&error.to_string());
    io::Error::other(format!(
        "this system cannot create a sealed memfd ({error}): check whether a filter of system calls forbids \
         memfd_create"
    ))
}

impl Handover {
    /// Writes the handover to prepared memory, seals the memory against changes, and writes the digest to `path`. The
    /// function does not wait until the digest is on disk, because the digest is not needed after the end of the
    /// process.
    ///
    /// # Errors
    /// The system cannot seal the memory, or the digest cannot be written. The error is a sentence.
    pub fn seal(&self, prepared: Prepared, path: &Path) -> io::Result<File> {
        let Prepared { mut memory, sources } = prepared;
        let has_sources = sources.is_some();
        let document = serde_json::to_vec(&Document { process: Process::this()?, handover: self, sources })?;
        let mut write = || {
            memory.write_all(&document)?;
            if has_sources {
                memory.write_all(&(document.len() as u64).to_le_bytes())?;
            }
            memory::seal(&memory)
        };
        write().map_err(no_memory)?;
        let announce = || {
            let new = path.with_added_extension("new");
            let _ = std::fs::remove_file(&new);
            create(&new)?.write_all(sha256(&document).as_bytes())?;
            std::fs::rename(&new, path)
        };
        announce().map_err(|error| {
            io::Error::new(error.kind(), format!("{}: {}", path.display(), system(&error)))
        })?;
        Ok(memory)
    }

    /// Checks that this process can hand over to another program now. For this, the function makes a handover without
    /// axes.
    ///
    /// # Errors
    /// Those of [`Handover::seal`], or the disk does not store the digest.
    pub(in crate::gateway) fn rehearse(path: &Path) -> io::Result<()> {
        // Another name is used, because a handover may be under way.
        let path = path.with_added_extension("rehearsal");
        let sealed = Handover::default().seal(Prepared::with(None)?, &path);
        // A disk that hangs must be detected before the handover.
        let kept = sealed.and_then(|_| Files.replace(&path, b""));
        Files.forget(&path);
        kept
    }
}

/// Handover that this program has received as standard input, if any. The digest in the state directory is not
/// checked yet.
#[derive(Debug)]
pub struct Arrival {
    /// Received handover, or the reason why it is rejected. `None` if standard input contains no handover, as after
    /// an ordinary start.
    found: Option<Result<ReceivedHandover, String>>,
}

/// Handover that an earlier program in this process has made.
#[derive(Debug)]
struct ReceivedHandover {
    /// SHA-256 of the document.
    digest: String,
    handover: Handover,
    profile: Option<KeptProfile>,
}

impl Arrival {
    /// Takes the handover of the previous program in the same process from standard input. Standard input is empty
    /// afterwards.
    pub fn take() -> Arrival {
        if !memory::is_stream(0, NAME) {
            return Arrival { found: None };
        }
        let unreadable = |error: &io::Error| format!("the handover cannot be read: {}", system(error));
        let opened = File::open("/proc/self/fd/0").map_err(|error| unreadable(&error));
        let closed = File::open("/dev/null").and_then(|null| Ok(rustix::stdio::dup2_stdin(null)?));
        let closed = closed.map_err(|error| format!("the handover cannot be closed: {}", system(&error)));
        let process = Process::this().map_err(|error| unreadable(&error));
        let found = closed.and_then(|()| ReceivedHandover::read(&opened?, &process?));
        Arrival { found: Some(found) }
    }

    /// Returns the checked profile, if the handover contains one. The machine name in the profile determines the
    /// [path](digest_path) of the digest.
    pub fn profile(&self) -> Option<&KeptProfile> {
        self.found.as_ref()?.as_ref().ok()?.profile.as_ref()
    }

    /// Returns whether the file at `path` contains the digest of this handover. The file is not removed.
    pub fn is_announced(&self, path: &Path) -> bool {
        let digest = Files.read(path).unwrap_or_default();
        matches!(&self.found, Some(Ok(found)) if found.digest.as_bytes() == digest)
    }

    /// Accepts the handover if its digest is at `path`, and removes the digest. Returns `None` after an ordinary start.
    ///
    /// # Errors
    /// The digest exists but no handover was received, or the handover is rejected. The error is a part of a
    /// sentence.
    pub fn accept(self, path: &Path) -> Result<Option<Handover>, String> {
        let digest = take_digest(path);
        let Some(found) = self.found else {
            let announced = "the previous program announced a handover, but this program has received none";
            return digest?.map_or(Ok(None), |_| Err(announced.to_owned()));
        };
        let (found, digest) = (found?, digest?);
        match digest {
            None => Err(refused(
                "the state directory has no digest of the handover, or the handover was used before",
            )),
            Some(digest) if digest != found.digest => {
                Err(refused("the digest in the state directory belongs to another handover"))
            }
            Some(_) => Ok(Some(found.handover)),
        }
    }
}

impl ReceivedHandover {
    /// Reads and checks a handover in a sealed memfd (memory that can no longer be changed). The error is a part of a
    /// sentence.
    fn read(memory: &File, process: &Process) -> Result<ReceivedHandover, String> {
        let size = memory::size_of_sealed(memory).map_err(refused)?;
        let (bytes, place) = document(memory, size)?;
        let unknown = || refused("this version of the program cannot read the format of the handover");
        let document: Document<Handover> = serde_json::from_slice(&bytes).map_err(|_| unknown())?;
        if document.process != *process {
            return Err(refused("another process wrote the handover"));
        }
        let profile = match document.sources {
            None if place > 0 => return Err(unknown()),
            None => None,
            Some(seal) => {
                let unreadable = |_| refused("the handover cannot be read");
                (&mut &*memory).seek(SeekFrom::Start(0)).map_err(unreadable)?;
                let sha256 = sha256_of(memory.take(place)).map_err(unreadable)?;
                if (place, sha256) != (seal.length, seal.sha256.clone()) {
                    return Err(refused("the profile in the handover was changed"));
                }
                Some(KeptProfile::of_handover(memory, seal).map_err(unreadable)?)
            }
        };
        Ok(ReceivedHandover { digest: sha256(&bytes), handover: document.handover, profile })
    }
}

fn refused(why: &str) -> String {
    format!("the handover is not accepted: {why}")
}

/// Reads the document from a memfd of `size` bytes. Returns the document and its offset.
fn document(memory: &File, size: u64) -> Result<(Vec<u8>, u64), String> {
    let read = |place: u64, length: u64| {
        let mut bytes = vec![0; usize::try_from(length).unwrap_or_default()];
        memory.read_exact_at(&mut bytes, place).map_err(|_| refused("the handover cannot be read"))?;
        Ok::<_, String>(bytes)
    };
    let mark = SOURCES_MARK.len() as u64;
    let (place, length) = if size > mark && read(0, mark)? == SOURCES_MARK.as_bytes() {
        let trailer = read(size.saturating_sub(TRAILER), TRAILER.min(size))?;
        let length = u64::from_le_bytes(trailer.try_into().unwrap_or_default());
        let place = size.checked_sub(TRAILER).and_then(|end| end.checked_sub(length));
        (place.ok_or_else(|| refused("the handover is incomplete"))?, length)
    } else {
        (0, size)
    };
    if length > LARGEST || place > LARGEST_SOURCES {
        return Err(refused("the handover is too large"));
    }
    Ok((read(place, length)?, place))
}

/// Reads the digest and removes its file. Returns `None` if the file does not exist.
fn take_digest(path: &Path) -> Result<Option<String>, String> {
    let about =
        |what: &str, error: &io::Error| format!("{} cannot be {what}: {}", path.display(), system(error));
    let digest = match Files.read(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        read => read.map_err(|error| about("read", &error))?,
    };
    std::fs::remove_file(path).map_err(|error| about("removed", &error))?;
    Ok(Some(String::from_utf8_lossy(&digest).into_owned()))
}
