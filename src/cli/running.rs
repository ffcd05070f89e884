//! Which gateway of this computer is meant: the one with the state directory that is named, or that the profile and the
//! platform say; else the only one of this machine that runs with another.

use std::path::{Path, PathBuf};

use super::run::known_directory;
use crate::cli::say::say_beside;
use crate::gateway::control;
use isotherm_profile::Profile;

/// What the kernel writes at a socket that accepts connections.
const ACCEPTS: u32 = 0x1_0000;

/// The command socket of the gateway that runs a profile. Where none runs, the one that it would have.
///
/// # Errors
/// It may be one of several.
pub(super) fn socket(state: Option<&Path>, profile: &Profile) -> anyhow::Result<PathBuf> {
    let named = state.or(profile.history.directory.as_deref());
    let usual = control::path(&known_directory(named), &profile.name);
    if state.is_some() || control::answers(&usual) {
        return Ok(usual);
    }
    let all = std::fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let mut others = listening(&all, &profile.name);
    others.retain(|socket| control::answers(socket));
    let directory =
        |socket: &PathBuf| socket.parent().map(|path| path.display().to_string()).unwrap_or_default();
    match others.as_slice() {
        [] => Ok(usual),
        [one] => {
            say_beside!("the gateway of {} that runs with --state {}:", profile.name, directory(one));
            Ok(one.clone())
        }
        several => {
            let states: Vec<String> =
                several.iter().map(|one| format!("--state {}", directory(one))).collect();
            anyhow::bail!(
                "several gateways of {} run on this computer; say which: {}",
                profile.name,
                states.join(" or ")
            )
        }
    }
}

/// The state directory of the gateway that runs a profile, or that one would have.
///
/// # Errors
/// As [`socket`].
pub(super) fn directory(state: Option<&Path>, profile: &Profile) -> anyhow::Result<PathBuf> {
    Ok(socket(state, profile)?.parent().map(Path::to_owned).unwrap_or_default())
}

/// The command socket of the only gateway that runs with a state directory.
///
/// # Errors
/// There is none, or several.
pub(super) fn only(state: Option<&Path>) -> anyhow::Result<PathBuf> {
    let directory = known_directory(state);
    let entries = std::fs::read_dir(&directory).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut sockets: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|end| end == "sock")).collect();
    sockets.sort();
    let shown = directory.display();
    match sockets.as_slice() {
        [] => anyhow::bail!(
            "no gateway runs with the state directory {shown}; name another with --state, or a profile"
        ),
        [one] => Ok(one.clone()),
        several => {
            let name = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let names: Vec<String> = several.iter().map(name).collect();
            anyhow::bail!("several gateways run with {shown}: {}; name the profile of one", names.join(", "))
        }
    }
}

/// The paths of the sockets that listen and are named as this machine's, in the kernel's list: `address: references protocol
/// flags type state inode path`.
fn listening(list: &str, machine: &str) -> Vec<PathBuf> {
    let name = control::path(Path::new(""), machine);
    let socket = |line: &str| {
        let mut fields = line.splitn(8, ' ');
        let flags = u32::from_str_radix(fields.nth(3)?, 16).ok()?;
        // The inode is padded with blanks.
        let path = Path::new(&line[line.find(" /")? + 1..]);
        (flags & ACCEPTS != 0 && path.file_name() == Some(name.as_os_str())).then(|| path.to_owned())
    };
    let mut found: Vec<PathBuf> = list.lines().skip(1).filter_map(socket).collect();
    found.sort();
    found.dedup();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sockets_of_a_machine_that_listen_are_found_in_the_kernel_s_list() {
        let list = "Num       RefCount Protocol Flags    Type St Inode Path\n\
                    00000000c5ab98bd: 00000003 00000000 00000000 0001 03 4371428\n\
                    0000000092c9f7d1: 00000002 00000000 00010000 0001 01    21 /srv/a b/press.sock\n\
                    0000000092c9f7d2: 00000003 00000000 00000000 0001 03 4371 /srv/a b/press.sock\n\
                    0000000092c9f7d3: 00000002 00000000 00010000 0001 01 437100 /srv/other/press-7.sock\n\
                    0000000092c9f7d4: 00000002 00000000 00010000 0001 01 437101 @/abstract/press.sock\n\
                    0000000092c9f7d5: 00000002 00000000 00010000 0001 01 437102 press.sock\n\
                    0000000092c9f7d6: 00000002 00000000 00010000 0001 01 437103 /run/press.sock\n";
        assert_eq!(
            listening(list, "press"),
            [PathBuf::from("/run/press.sock"), PathBuf::from("/srv/a b/press.sock")]
        );
        assert!(listening("", "press").is_empty());
    }
}
