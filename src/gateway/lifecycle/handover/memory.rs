//! Kernel memory (memfd) that passes data from one program to the next in the same process, or from a child process to
//! its parent. Sealed memory cannot be changed.

use std::fs::{File, Permissions};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;

use rustix::fs::{MemfdFlags, SealFlags, fcntl_add_seals, fcntl_get_seals, memfd_create};
use rustix::io::Errno;

/// Permissions of a memfd: only the owner may open it, and only for reading.
pub(super) const MODE: u32 = 0o400;

/// Creates an empty memfd with this name. It is closed when another program starts, unless that program receives it as
/// a standard stream.
pub(super) fn create(name: &str) -> io::Result<File> {
    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let memory = match memfd_create(name, flags | MemfdFlags::NOEXEC_SEAL) {
        // Linux before 6.3 does not accept the last flag.
        Err(Errno::INVAL) => memfd_create(name, flags)?,
        made => made?,
    };
    let file = File::from(memory);
    file.set_permissions(Permissions::from_mode(MODE))?;
    Ok(file)
}

/// Seals a memfd, if it is not sealed yet: the kernel then rejects every change of its content and size.
pub(super) fn seal(memory: &File) -> io::Result<()> {
    if is_sealed(memory) { Ok(()) } else { Ok(fcntl_add_seals(memory, seals())?) }
}

fn is_sealed(memory: &File) -> bool {
    fcntl_get_seals(memory.as_fd()).is_ok_and(|found| found.contains(seals()))
}

pub(super) fn seals() -> SealFlags {
    SealFlags::SEAL | SealFlags::SHRINK | SealFlags::GROW | SealFlags::WRITE
}

/// Returns whether a standard stream of this process (0 for input, 1 for output) is a memfd of this name.
pub(super) fn is_stream(stream: u32, name: &str) -> bool {
    let link = std::fs::read_link(format!("/proc/self/fd/{stream}"));
    link.is_ok_and(|link| link == Path::new(&format!("/memfd:{name} (deleted)")))
}

/// Returns the size of a memfd that is sealed against changes and belongs to this user.
///
/// # Errors
/// The memfd is not sealed, belongs to another user, or has other permissions than [`MODE`]. The error is the
/// reason, as a part of a sentence.
pub(super) fn size_of_sealed(memory: &File) -> Result<u64, &'static str> {
    let Ok(found) = memory.metadata() else { return Err("the handover cannot be examined") };
    match () {
        () if !is_sealed(memory) => Err("the memory of the handover is not sealed against changes"),
        () if found.uid() != rustix::process::geteuid().as_raw() => Err("another user owns the handover"),
        () if found.mode() & 0o7777 != MODE => Err("other users may open the handover"),
        () => Ok(found.size()),
    }
}
