//! User of the service. A secret file that root creates must belong to this user, because nobody else may read it.

use std::fs::OpenOptions;
use std::io::{Error, ErrorKind, Result};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, fchown};
use std::path::Path;

use anyhow::Context;
use rustix::fs::OFlags;

use crate::cli::print::say_beside;
use isotherm_profile::safe_file;

/// Name of the user that the package creates. The service runs as this user.
const USER: &str = "isotherm";
/// Directory of the profiles that the service runs.
const PROFILES: &str = "/etc/isotherm";

/// Owner that a new secret file needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    /// The user who creates the file.
    Creator,
    /// The user of the service, with this user and group number.
    Service(u32, u32),
    /// The user of the service, if the service reads the file. Only the person who creates the file can know that.
    PerhapsService,
}

/// Gives a new secret file to the user of the service, if root has created it next to the profiles of the
/// service. If root has created the file in another directory, prints the command that changes the owner.
///
/// # Errors
/// The owner cannot be changed. The message contains the command that changes it.
pub(super) fn give(path: &Path) -> anyhow::Result<()> {
    let is_root = rustix::process::geteuid().is_root();
    let users = safe_file::read_text(Path::new("/etc/passwd")).unwrap_or_default();
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let directory = directory.canonicalize().unwrap_or_default();
    match owner(is_root, &users, &directory) {
        Owner::Creator => {}
        Owner::Service(user, group) => {
            let shown = path.display();
            give_to(path, (user, group)).with_context(|| {
                format!(
                    "{shown} belongs to root, and the service cannot read it: chown {USER}:{USER} {shown}"
                )
            })?;
            say_beside!("{} belongs to {USER}, the user of the service", path.display());
        }
        Owner::PerhapsService => say_beside!(
            "only root may read {0}; if the service uses it: chown {USER}:{USER} {0}",
            path.display()
        ),
    }
    Ok(())
}

/// Gives a file to this user and group. A symbolic link, or a file with several hard links, is an error. Otherwise a
/// user who may write to the directory could become the owner of any file of root.
fn give_to(path: &Path, (user, group): (u32, u32)) -> Result<()> {
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    let found = file.metadata()?;
    if !found.is_file() || found.nlink() != 1 {
        return Err(Error::new(ErrorKind::InvalidInput, "another program has replaced the file"));
    }
    fchown(&file, Some(user), Some(group))
}

fn owner(is_root: bool, users: &str, directory: &Path) -> Owner {
    let service = users.lines().find_map(|line| {
        let mut fields = line.strip_prefix(USER)?.strip_prefix(':')?.split(':').skip(1);
        Some((fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
    });
    match service {
        Some((user, group)) if is_root && directory.starts_with(PROFILES) => Owner::Service(user, group),
        Some(_) if is_root => Owner::PerhapsService,
        _ => Owner::Creator,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neither_a_link_nor_a_file_with_a_second_name_is_given_away() {
        let home = tempfile::tempdir().unwrap();
        let [token, other, link, second] =
            ["token", "other", "link", "second"].map(|name| home.path().join(name));
        for file in [&token, &other] {
            std::fs::write(file, "secret").unwrap();
        }
        std::os::unix::fs::symlink(&other, &link).unwrap();
        std::fs::hard_link(&other, &second).unwrap();
        let own = std::fs::metadata(&token).unwrap();
        let given = |path: &Path| give_to(path, (own.uid(), own.gid()));
        given(&token).unwrap();
        for path in [&link, &second, &other, &home.path().to_owned()] {
            assert!(given(path).is_err(), "{}", path.display());
        }
    }

    #[test]
    fn what_root_creates_for_the_service_belongs_to_the_service() {
        let with =
            "root:x:0:0::/root:/bin/sh\nisotherm-old:x:7:7:::\nisotherm:x:998:997::/:/usr/sbin/nologin\n";
        let without = "root:x:0:0::/root:/bin/sh\nisotherm-old:x:7:7:::\n";
        for (is_root, users, directory, expected) in [
            (true, with, "/etc/isotherm", Owner::Service(998, 997)),
            (true, with, "/etc/isotherm/trusted", Owner::Service(998, 997)),
            (true, with, "/etc/isotherm-old", Owner::PerhapsService),
            (true, with, "/home/maria", Owner::PerhapsService),
            (true, without, "/etc/isotherm", Owner::Creator),
            (true, "isotherm:x:broken", "/etc/isotherm", Owner::Creator),
            (false, with, "/etc/isotherm", Owner::Creator),
        ] {
            assert_eq!(owner(is_root, users, Path::new(directory)), expected, "{is_root} {directory}");
        }
    }
}
