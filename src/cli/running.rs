//! Selection of a running gateway on this computer. The state directory selects the gateway: named by an option, by the
//! profile, or by the platform. If no gateway runs with this directory, the only running gateway of the machine is
//! selected.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::run::known_directory;
use crate::cli::print::say_beside;
use crate::gateway;
use crate::gateway::control::{self, Presence};
use isotherm_profile::Profile;

/// Returns the command socket of the gateway that runs a profile. If no gateway runs, returns the path that the socket
/// would have.
///
/// # Errors
/// Several gateways of the machine run, and none has the expected state directory.
pub(super) fn socket(state: Option<&Path>, profile: &Profile) -> anyhow::Result<PathBuf> {
    if let Some(warning) = other_directory(state, profile) {
        say_beside!("warning: {warning}");
    }
    of_machine(state, profile.history.directory.as_deref(), &profile.name)
}

/// Returns a warning if the relative path `state` probably names the wrong state directory. The named
/// directory then has no saved state and no running gateway of this machine, but another known directory has.
/// The user may have given the command in another working directory than before. `None` if there is no such
/// suspicion.
pub(super) fn other_directory(state: Option<&Path>, profile: &Profile) -> Option<String> {
    let named = state.filter(|named| named.is_relative())?;
    let (machine, here) = (&profile.name, std::path::absolute(named).ok()?);
    let is_of_machine = |directory: &Path| {
        let socket = control::path(directory, machine);
        gateway::backup::is_in(directory, machine) || control::presence(&socket) != Presence::Absent
    };
    if is_of_machine(&here) {
        return None;
    }
    let beside = profile.path.parent().map(|directory| directory.join(named));
    let usual = [known_directory(profile.history.directory.as_deref()), known_directory(None)];
    let running = control::listening(machine);
    let running = running.iter().filter_map(|socket| socket.parent().map(Path::to_owned));
    let mut others = beside.into_iter().chain(usual).chain(running);
    let other = others.find(|directory| is_of_machine(directory))?;
    Some(format!(
        "--state {} is {}, which has no state of {machine}. {} has one: if you mean that directory, \
         give its absolute path",
        named.display(),
        here.display(),
        other.display()
    ))
}

/// Returns the command socket of the machine with this name. `directory` is the state directory in its profile.
///
/// # Errors
/// Same as for [`socket`].
pub(super) fn of_machine(
    state: Option<&Path>,
    directory: Option<&Path>,
    machine: &str,
) -> anyhow::Result<PathBuf> {
    let usual = control::path(&known_directory(state.or(directory)), machine);
    if state.is_some() || control::presence(&usual) != Presence::Absent {
        return Ok(usual);
    }
    let found = control::listening(machine);
    let mut others = found.clone();
    others.retain(|socket| control::presence(socket) == Presence::Answers);
    if others.is_empty() {
        // A connection to this socket reports its user.
        let of_another_user = |socket: &PathBuf| control::presence(socket) == Presence::Forbidden;
        return Ok(found.into_iter().find(of_another_user).unwrap_or(usual));
    }
    let directory =
        |socket: &PathBuf| socket.parent().map(|path| path.display().to_string()).unwrap_or_default();
    match others.as_slice() {
        [one] => {
            say_beside!("the gateway of {} that runs with --state {}:", machine, directory(one));
            Ok(one.clone())
        }
        several => {
            let states: Vec<String> =
                several.iter().map(|one| format!("--state {}", directory(one))).collect();
            anyhow::bail!(
                "several gateways of {} run on this computer; say which: {}",
                machine,
                states.join(" or ")
            )
        }
    }
}

/// Returns the state directory of the gateway that runs a profile. If no gateway runs, returns the directory that it
/// would use.
///
/// # Errors
/// Same as for [`socket`].
pub(super) fn directory(state: Option<&Path>, profile: &Profile) -> anyhow::Result<PathBuf> {
    Ok(socket(state, profile)?.parent().map(Path::to_owned).unwrap_or_default())
}

/// Returns the command socket of the only gateway that runs with a state directory.
///
/// # Errors
/// No gateway, or more than one, runs with this state directory.
pub(super) fn only(state: Option<&Path>) -> anyhow::Result<PathBuf> {
    let (sockets, directory) = (all(state)?, known_directory(state));
    let shown = directory.display();
    match sockets.as_slice() {
        [] => anyhow::bail!(
            "no gateway runs with the state directory {shown}; give another directory with --state, or a \
             profile"
        ),
        [one] => Ok(one.clone()),
        several => {
            let name = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let names: Vec<String> = several.iter().map(name).collect();
            anyhow::bail!(
                "several gateways run with {shown}: {}; give the profile of one machine",
                names.join(", ")
            )
        }
    }
}

/// Returns the command sockets in a state directory.
///
/// # Errors
/// This user may not read the directory.
pub(super) fn all(state: Option<&Path>) -> anyhow::Result<Vec<PathBuf>> {
    let directory = known_directory(state);
    let read = std::fs::read_dir(&directory);
    if read.as_ref().is_err_and(|error| error.kind() == ErrorKind::PermissionDenied) {
        anyhow::bail!("{}", control::forbidden(&directory));
    }
    let entries = read.into_iter().flatten().flatten().map(|entry| entry.path());
    let mut sockets: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|end| end == "sock")).collect();
    sockets.sort();
    Ok(sockets)
}
