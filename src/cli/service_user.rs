//! User of the service. A secret file that root creates must belong to this user, because nobody else may read it.

use std::os::unix::fs::chown;
use std::path::Path;

use crate::cli::print::say_beside;
use isotherm_profile::safe_file;

/// User that the package creates, as which the service runs.
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
    /// The user of the service, if the service reads the file. The creator decides that.
    PerhapsService,
}

/// Gives a new secret file to the user of the service, if root has created it next to the profiles of the service.
/// Elsewhere, prints the command for that.
pub(super) fn give(path: &Path) -> std::io::Result<()> {
    let is_root = rustix::process::geteuid().is_root();
    let users = safe_file::read_text(Path::new("/etc/passwd")).unwrap_or_default();
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let directory = directory.canonicalize().unwrap_or_default();
    match owner(is_root, &users, &directory) {
        Owner::Creator => {}
        Owner::Service(user, group) => {
            chown(path, Some(user), Some(group))?;
            say_beside!("{} belongs to {USER}, the user of the service", path.display());
        }
        Owner::PerhapsService => say_beside!(
            "only root may read it; if the service uses it: chown {USER}:{USER} {}",
            path.display()
        ),
    }
    Ok(())
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
