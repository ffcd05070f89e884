//! The way of a handover from one program to the next in the same process: a sealed memfd as standard input, and its digest in
//! the state directory.
//!
//! The process that starts the program chooses its standard input. So the program accepts a memfd only if nothing can change it (all
//! seals, this user), if this very process wrote it (process id, start time, boot), and if the state directory holds its digest.
//! The program removes the digest before it reads the memfd, so that no handover is used twice.

use std::fs::{File, Permissions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};
use rustix::io::Errno;
use serde::{Deserialize, Serialize};

use super::Handover;
use crate::fieldbus::explain::system;
use crate::gateway::disk::{Disk, Files};
use isotherm_profile::regular::without_numbers;
use isotherm_profile::sha256;

#[cfg(test)]
mod tests;

const NAME: &str = "isotherm-handover";
/// Standard input, and what the kernel shows there for a memfd of that name.
const STDIN: &str = "/proc/self/fd/0";
const LINK: &str = "/memfd:isotherm-handover (deleted)";
/// Only the owner reads it, and nobody writes.
const MODE: u32 = 0o400;
/// A handover has at most this many bytes.
const LARGEST: u64 = 16 * 1024 * 1024;

/// A process, with whatever program runs in it: all of this stays when one program replaces another.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Process {
    id: u32,
    /// Clock ticks from the start of the computer to the start of the process.
    started: u64,
    /// The kernel's name of this run of the computer.
    boot: String,
}

/// Content of the memfd.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document<H> {
    process: Process,
    handover: H,
}

impl Process {
    fn this() -> io::Result<Process> {
        let read = |path: &str| {
            let about = |error| io::Error::other(format!("{path} cannot be read: {}", system(&error)));
            std::fs::read_to_string(path).map_err(about)
        };
        let stat = read("/proc/self/stat")?;
        // The second field, the name, is in brackets and may hold any character. The start time is the 22nd.
        let started =
            stat.rsplit(')').next().and_then(|fields| fields.split_whitespace().nth(19)?.parse().ok());
        let started = started.ok_or_else(|| io::Error::other("/proc/self/stat shows no start time"))?;
        let boot = read("/proc/sys/kernel/random/boot_id")?.trim().to_owned();
        Ok(Process { id: std::process::id(), started, boot })
    }
}

/// Path of the digest of a machine's handover.
pub fn digest_path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.handover"))
}

impl Handover {
    /// Writes this into a sealed memfd for the next program in this process, and its digest to `path`.
    ///
    /// # Errors
    /// A sentence: the system makes no memfd, or the digest cannot be written.
    pub fn seal(&self, path: &Path) -> io::Result<File> {
        let document = serde_json::to_vec(&Document { process: Process::this()?, handover: self })?;
        let memory = memory(&document).map_err(|error| {
            let error = without_numbers(&error.to_string());
            io::Error::other(format!(
                "this system makes no sealed memfd ({error}): is memfd_create forbidden by a filter of system calls?"
            ))
        })?;
        Files.replace(path, sha256(&document).as_bytes())?;
        Ok(memory)
    }

    /// Whether this process can hand over to another program now.
    ///
    /// # Errors
    /// Those of [`Handover::seal`].
    pub(in crate::gateway) fn rehearse(path: &Path) -> io::Result<()> {
        // Under another name: a handover may be under way.
        let path = path.with_added_extension("rehearsal");
        let sealed = Handover::default().seal(&path);
        Files.forget(&path);
        sealed.map(drop)
    }

    /// Takes what the program before this one in the same process has handed over; `None` after an ordinary start. Standard input
    /// is empty afterwards if it was a handover.
    ///
    /// # Errors
    /// A clause: there is no handover although one was announced, or it is not accepted.
    pub fn receive(path: &Path) -> Result<Option<Handover>, String> {
        let digest = take_digest(path);
        if !std::fs::read_link(STDIN).is_ok_and(|link| link.as_os_str() == LINK) {
            let announced = "the program before this one announced a handover, and none has arrived";
            return digest?.map_or(Ok(None), |_| Err(announced.to_owned()));
        }
        let unreadable = |error: &io::Error| format!("the handover cannot be read: {}", system(error));
        let found = File::open(STDIN).map_err(|error| unreadable(&error)).and_then(|file| content(&file));
        let closed = File::open("/dev/null").and_then(|null| Ok(rustix::stdio::dup2_stdin(null)?));
        closed.map_err(|error| format!("the handover cannot be closed: {}", system(&error)))?;
        let process = Process::this().map_err(|error| unreadable(&error))?;
        accepted(&found?, digest?.as_deref(), &process).map(Some)
    }
}

/// A memfd of these bytes that nobody can change, as File of this process alone: a program that replaces this one, or a child,
/// has it only where it is given as standard input.
fn memory(bytes: &[u8]) -> io::Result<File> {
    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let memory = match memfd_create(NAME, flags | MemfdFlags::NOEXEC_SEAL) {
        // Linux before 6.3 does not know the last flag.
        Err(Errno::INVAL) => memfd_create(NAME, flags)?,
        made => made?,
    };
    let mut file = File::from(memory);
    file.write_all(bytes)?;
    file.set_permissions(Permissions::from_mode(MODE))?;
    fcntl_add_seals(&file, seals())?;
    Ok(file)
}

/// Seals by which neither content nor size changes any more.
fn seals() -> SealFlags {
    SealFlags::SEAL | SealFlags::SHRINK | SealFlags::GROW | SealFlags::WRITE
}

/// Reads the digest and removes it; `None` if there is none.
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

/// The bytes of a memfd that only this user has made and that nobody can change.
fn content(file: &File) -> Result<Vec<u8>, String> {
    let refused = |why: &str| Err(format!("the handover is not accepted: {why}"));
    let is_sealed = fcntl_get_seals(file.as_fd()).is_ok_and(|found| found.contains(seals()));
    let Ok(found) = file.metadata() else { return refused("it cannot be examined") };
    if !is_sealed {
        return refused("it is not sealed");
    }
    if found.uid() != rustix::process::geteuid().as_raw() {
        return refused("it belongs to another user");
    }
    if found.mode() & 0o7777 != MODE {
        return refused("others than its owner may open it");
    }
    if found.size() > LARGEST {
        return refused("it is too large");
    }
    let mut bytes = Vec::new();
    let mut reader = file;
    reader.read_to_end(&mut bytes).map_or_else(|_| refused("it cannot be read"), |_| Ok(bytes))
}

/// The handover in these bytes, if they have this digest and this process wrote them.
fn accepted(bytes: &[u8], digest: Option<&str>, process: &Process) -> Result<Handover, String> {
    let refused = |why: &str| Err(format!("the handover is not accepted: {why}"));
    match digest {
        None => return refused("the state directory holds no digest of it, or it was used before"),
        Some(digest) if digest != sha256(bytes) => {
            return refused("the digest in the state directory is of another one");
        }
        Some(_) => {}
    }
    match serde_json::from_slice::<Document<Handover>>(bytes) {
        Err(_) => refused("this version of the program does not know its form"),
        Ok(found) if found.process != *process => refused("another process wrote it"),
        Ok(found) => Ok(found.handover),
    }
}
