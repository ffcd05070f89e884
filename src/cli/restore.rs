//! `isotherm restore`: restores a machine from the file that `isotherm backup` wrote. The file may have been
//! manipulated. The verb therefore checks the whole file before it writes anything.

use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};

use super::backup::{
    Entry, FORM, LARGEST, MANIFEST, MODE, Manifest, PRODUCTS, PROFILE, PROFILE_MODE, SECRET_MODE, STATE,
    is_below, write_new,
};
use super::run::known_directory;
use super::service_user;
use crate::cli::print::say;
use crate::gateway;
use crate::gateway::backup::products;
use crate::gateway::control::{self, Presence};
use crate::gateway::{candidates, make_directory};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::{counted, one_line, safe_file, sha256};

/// Largest size of a manifest in bytes. [`MOST_FILES`] is the largest number of files in it.
const LARGEST_MANIFEST: u64 = 1024 * 1024;
const MOST_FILES: usize = 4096;

/// Restores a backup: the profile and its files to a directory, the saved state and the learned data to the state
/// directory.
///
/// The verb checks everything before it writes anything. It does not replace newer files. It does nothing while the
/// gateway of the machine runs. The backup does not contain register values that were written later. Every axis is
/// therefore off until an operator arms it.
///
/// If root restores secret files below /etc/isotherm, they belong to the user of the service.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Example:\n  isotherm restore my-machine.tar --to /etc/isotherm --state /var/lib/isotherm"
)]
pub(super) struct Arguments {
    /// The backup that `isotherm backup` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The directory of the profile and its files
    #[arg(long, value_name = "DIR", default_value = ".")]
    to: PathBuf,
    /// The directory for the saved state [default: the platform's state directory]
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
}

/// File of the backup that is to be written, with its destination.
struct Planned {
    path: PathBuf,
    mode: u32,
    bytes: Vec<u8>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let shown = arguments.file.display();
    let bytes =
        safe_file::read(&arguments.file, LARGEST).with_context(|| format!("{shown} cannot be read"))?;
    let (manifest, files) = read(&bytes).with_context(|| format!("{shown} is not restored"))?;
    let Manifest { machine, .. } = &manifest;
    if let (None, Some(directory)) = (&arguments.state, &manifest.state_directory) {
        let directory = one_line(&directory.display().to_string()).into_owned();
        bail!(
            "the profile keeps its state in {directory}: add --state {directory} if this directory is right \
             on this computer"
        );
    }
    let directory = known_directory(arguments.state.as_deref());
    refuse_while_running(&directory, machine)?;
    let taken = manifest.time.as_str();
    let at = time::parse(taken).map_err(anyhow::Error::msg)?;
    let mut planned = Vec::new();
    let mut kept = Vec::new();
    let learned_in = candidates::products(Path::new(""), machine);
    let mut learned = 0;
    for (entry, bytes) in manifest.files.iter().zip(files) {
        match entry.path.split_once('/') {
            Some((STATE, name)) => kept.push((name.to_owned(), bytes)),
            Some((PRODUCTS, name)) => {
                let name = learned_in.join(name);
                learned += 1;
                if is_to_be_written((&directory, "--state"), &name, &bytes, at)? {
                    planned.push(Planned { path: directory.join(&name), mode: MODE, bytes });
                }
            }
            Some((_, name)) => {
                let path = arguments.to.join(name);
                if is_to_be_written((&arguments.to, "--to"), Path::new(name), &bytes, at)? {
                    planned.push(Planned { path, mode: entry.mode, bytes });
                }
            }
            None => {}
        }
    }
    let kept = gateway::backup::put_back(&directory, machine, &kept).map_err(anyhow::Error::msg)?;
    planned.extend(kept.into_iter().map(|(name, bytes)| Planned {
        path: directory.join(name),
        mode: MODE,
        bytes,
    }));
    let shown = arguments.to.display();
    std::fs::create_dir_all(&arguments.to).with_context(|| format!("{shown} cannot be created"))?;
    make_directory(&directory).with_context(|| format!("{} cannot be created", directory.display()))?;
    if learned > 0 {
        let place = directory.join(&learned_in);
        make_below(&directory, &place).with_context(|| format!("{} cannot be created", place.display()))?;
    }
    for file in &planned {
        put(file).with_context(|| format!("{} cannot be written", file.path.display()))?;
    }
    let profile = arguments.to.join(&manifest.profile);
    let profile = profile.display();
    let learned = match learned {
        0 => String::new(),
        count => format!(", learned from touches: {}", counted(count, "file")),
    };
    say!(
        "{machine} is restored as it was at {taken}: files written: {}{learned}, state in {}. Register \
         values that were written after the backup are not known. Every axis is off until an operator arms \
         it.\nNext: isotherm check {profile}",
        planned.len(),
        directory.display()
    )?;
    secrets_of_root(&planned).try_for_each(service_user::give)
}

/// Returns the secret files that were written and belong to root, because their directories belong to root.
fn secrets_of_root(written: &[Planned]) -> impl Iterator<Item = &Path> {
    let secrets = written.iter().filter(|file| file.mode == SECRET_MODE).map(|file| file.path.as_path());
    secrets.filter(|path| path.symlink_metadata().is_ok_and(|found| found.uid() == 0))
}

/// Returns the manifest of an archive, and the bytes of each file in it.
fn read(bytes: &[u8]) -> anyhow::Result<(Manifest, Vec<Vec<u8>>)> {
    let mut archive = tar::Archive::new(bytes);
    // With `raw`, entries that only describe the next one (a long name, a size, holes) stay visible, and are rejected.
    let mut entries = archive.entries().context("this file is not a backup")?.raw(true);
    let first = entries.next().context("the file is empty")?;
    let text = plain(first, MANIFEST, LARGEST_MANIFEST).context("this file is not a backup of isotherm")?;
    let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| {
        anyhow::anyhow!("this program cannot read {MANIFEST} in the backup: {}", one_line(&error.to_string()))
    })?;
    ensure!(
        (1..=FORM).contains(&manifest.form),
        "the backup has format version {}, but this program reads versions up to {FORM}: restore the backup with \
         the version of isotherm that wrote it",
        manifest.form
    );
    check(&manifest)?;
    let mut files = Vec::new();
    for Entry { path, bytes, sha256: sealed, .. } in &manifest.files {
        let next = entries
            .next()
            .with_context(|| format!("the backup ends before {path}: copy the backup again"))?;
        let found = plain(next, path, LARGEST)?;
        ensure!(
            found.len() as u64 == *bytes && sha256(&found) == *sealed,
            "{path} was changed, or damaged, since the backup was made: its SHA-256 is wrong; restore \
             another backup"
        );
        files.push(found);
    }
    ensure!(entries.next().is_none(), "the backup contains more files than its manifest lists");
    Ok((manifest, files))
}

/// Reads an entry of the archive that must be a regular file with this name.
fn plain(entry: std::io::Result<tar::Entry<'_, &[u8]>>, name: &str, largest: u64) -> anyhow::Result<Vec<u8>> {
    // The original error would quote the content, which may be secret.
    let entry = entry.map_err(|_| anyhow::anyhow!("the file is damaged, or is not a tar archive"))?;
    ensure!(
        entry.header().entry_type() == tar::EntryType::Regular && *entry.path_bytes() == *name.as_bytes(),
        "the next entry must be the file {name}, but it is a link, a device or another file"
    );
    ensure!(entry.size() <= largest, "{name} is larger than {} MB", largest >> 20);
    let size = entry.size();
    let mut bytes = Vec::new();
    entry.take(size).read_to_end(&mut bytes)?;
    ensure!(bytes.len() as u64 == size, "the backup ends within {name}: copy the backup again");
    Ok(bytes)
}

/// Checks a manifest: no path leads outside its directory, no file has a mode that a backup does not use, and none
/// occurs twice.
fn check(manifest: &Manifest) -> anyhow::Result<()> {
    ensure!(manifest.files.len() <= MOST_FILES, "the manifest lists more than {MOST_FILES} files");
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    let machine = &manifest.machine;
    ensure!(!machine.is_empty() && machine.bytes().all(is_plain), "the manifest has no valid machine name");
    let mut known = std::collections::BTreeSet::new();
    for Entry { path, mode, .. } in &manifest.files {
        let shown = one_line(path);
        let (room, name) = path.split_once('/').unwrap_or_default();
        let is_clean = !path.chars().any(char::is_control) && !path.contains("//") && !path.contains("/./");
        ensure!(
            [PROFILE, STATE, PRODUCTS].contains(&room)
                && is_clean
                && is_below(Path::new(name))
                && !name.ends_with('/'),
            "file {shown} of the backup would be outside the directories of profile and state"
        );
        ensure!(room != PRODUCTS || products::is_name(name), "{shown} is not a file of learned data");
        ensure!(room != STATE || !name.contains('/'), "{shown} is not a file of a state directory");
        ensure!(
            [SECRET_MODE, MODE, PROFILE_MODE].contains(mode),
            "file {shown} of the backup has a file mode that no backup uses"
        );
        ensure!(known.insert(path), "the backup contains {shown} twice");
    }
    let profile = format!("{PROFILE}/{}", manifest.profile);
    ensure!(
        known.contains(&profile),
        "the backup does not contain the profile {}",
        one_line(&manifest.profile)
    );
    Ok(())
}

fn refuse_while_running(directory: &Path, machine: &str) -> anyhow::Result<()> {
    let own = control::path(directory, machine);
    let is_there = control::presence(&own) != Presence::Absent || !control::listening(machine).is_empty();
    ensure!(
        !is_there,
        "the gateway of {machine} runs on this computer: stop it before its files are replaced"
    );
    Ok(())
}

/// Returns whether the file must be written: `false` if it exists with the same content. A newer file, or a
/// link in its path, is an error. `option` is the command-line option that names the directory `to`, for
/// error messages.
fn is_to_be_written(
    (to, option): (&Path, &str),
    name: &Path,
    bytes: &[u8],
    taken: Moment,
) -> anyhow::Result<bool> {
    let mut path = to.to_owned();
    for part in name.components() {
        path.push(part);
        let is_link = path.symlink_metadata().is_ok_and(|found| found.is_symlink());
        ensure!(
            !is_link,
            "{} is a link, and a restore does not write through a link: remove the link",
            path.display()
        );
    }
    let Ok(found) = path.metadata() else { return Ok(true) };
    if safe_file::read(&path, LARGEST)
        .with_context(|| format!("{} exists and cannot be replaced", path.display()))?
        == bytes
    {
        return Ok(false);
    }
    let since_the_epoch = found.modified()?.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    ensure!(
        Moment::default().after(since_the_epoch) <= taken,
        "{} is newer than the backup: restore into another directory ({option} DIR), or move the newer file away",
        path.display()
    );
    Ok(true)
}

/// Creates the directory of the learned data, in the state directory. If the program runs as root, the new directory
/// gets the owner of the state directory, because the gateway writes to both.
fn make_below(directory: &Path, place: &Path) -> std::io::Result<()> {
    if place.is_dir() {
        return Ok(());
    }
    make_directory(place)?;
    if rustix::process::geteuid().is_root() {
        let owner = directory.metadata()?;
        std::os::unix::fs::chown(place, Some(owner.uid()), Some(owner.gid()))?;
    }
    Ok(())
}

/// Writes a complete file, and replaces an existing one. If the program runs as root, the file gets the owner of its
/// directory.
fn put(file: &Planned) -> anyhow::Result<()> {
    let directory = file.path.parent().filter(|directory| !directory.as_os_str().is_empty());
    let directory = directory.unwrap_or(Path::new("."));
    std::fs::create_dir_all(directory)?;
    let new = file.path.with_added_extension("restored");
    let _ = std::fs::remove_file(&new);
    let owner = directory.metadata()?;
    let owner = rustix::process::geteuid().is_root().then(|| (owner.uid(), owner.gid()));
    write_new(&new, &file.bytes, file.mode, owner)?;
    Ok(std::fs::rename(&new, &file.path)?)
}

#[cfg(test)]
mod tests;
