//! `isotherm backup`: saves the files of a machine in one file. `isotherm restore` writes them back.

use std::collections::BTreeSet;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Component, Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};

use super::loading::load_quietly;
use super::new_file::cannot_be_written;
use super::running;
use super::values::key_and_value;
use crate::cli::print::{say, say_beside};
use crate::clock::Clock;
use crate::gateway;
use crate::gateway::backup::products::{self, Limits};
use isotherm_core::quantity::time;
use isotherm_profile::{Profile, counted, safe_file, sha256};

mod rotate;

/// Largest size of a backup in bytes. Backup and restore keep the archive in memory, and reject a larger one.
pub(super) const LARGEST: u64 = 128 * 1024 * 1024;
/// Version of the archive format for backups with learned data (results of `isotherm learn`).
pub(super) const FORM: u32 = 2;
/// Version of the archive format for backups without [`PRODUCTS`]. Earlier versions of isotherm can read this format.
const FORM_WITHOUT_PRODUCTS: u32 = 1;
pub(super) const MANIFEST: &str = "manifest.json";
/// Directory of the archive for the profile and its files. [`STATE`] is the directory for the state files, and
/// [`PRODUCTS`] the one for the learned data.
pub(super) const PROFILE: &str = "profile";
pub(super) const STATE: &str = "state";
pub(super) const PRODUCTS: &str = "products";
/// Limits for the files of learned data in a backup. With at most this number of files, the manifest is small enough
/// for `restore`.
const LEARNED: Limits = Limits { files: 3000, bytes: 64 * 1024 * 1024 };
/// Largest total size of the manifest and of all file headers in the archive, in bytes.
const HEADS: u64 = 8 * 1024 * 1024;
/// File mode of an archive with secrets, and of the files in it that contain tokens and keys.
pub(super) const SECRET_MODE: u32 = 0o600;
pub(super) const MODE: u32 = 0o640;
/// File mode of profile files without secrets. Any user may read them, because the gateway runs as another user.
pub(super) const PROFILE_MODE: u32 = 0o644;

/// Writes the files of a machine into one tar archive: the profile and its .local.toml, the files that they name, and
/// the saved state. The state includes the data that was learned from touches (probe measurements). The named files are
/// models, device templates, DBC files and certificates. The archive lists the SHA-256 of each file. The gateway may
/// run during the backup.
///
/// Logs and events are not included: copy them from the state directory. Settings that were made with --set or by the
/// environment are not included either.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm backup my-machine.toml my-machine.tar\n  isotherm backup my-machine.toml my-machine.tar --secrets\n  \
                  isotherm backup my-machine.toml --rotate /mnt/backup --copies 14     every night"
)]
pub(super) struct Arguments {
    /// The machine's profile
    #[arg(value_name = "PROFILE")]
    profile: PathBuf,
    /// The file to write; an existing file is not overwritten
    #[arg(value_name = "FILE", required_unless_present = "rotate")]
    file: Option<PathBuf>,
    /// Writes the backup to this directory, with machine and time in the file name, and removes older backups of this
    /// machine
    #[arg(long, value_name = "DIR", conflicts_with = "file")]
    rotate: Option<PathBuf>,
    /// Number of backups of this machine that --rotate keeps
    #[arg(long, value_name = "N", default_value_t = 14, requires = "rotate", value_parser = clap::value_parser!(u32).range(1..))]
    copies: u32,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,
    /// Includes tokens, passwords and private keys; only the owner of the archive may then read it (mode 0600)
    #[arg(long)]
    secrets: bool,
    /// The state directory with which the gateway was started
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
}

/// Manifest: the first file of the archive. After it, the archive contains exactly the files of the list `files`, in
/// the order of that list.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    pub(super) form: u32,
    pub(super) program: String,
    pub(super) machine: String,
    pub(super) time: String,
    pub(super) secrets: bool,
    /// File name of the profile in the archive.
    pub(super) profile: String,
    /// Value of `directory` in `[history]` of the profile; `None` if the profile does not state it.
    pub(super) state_directory: Option<PathBuf>,
    pub(super) files: Vec<Entry>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    pub(super) path: String,
    pub(super) mode: u32,
    pub(super) bytes: u64,
    pub(super) sha256: String,
}

impl Arguments {
    /// Prints a note about a backup to stderr. With `--rotate`, prints the note to stdout instead, because cron may
    /// send everything on stderr by mail.
    fn note(&self, text: &str) -> std::io::Result<()> {
        match self.rotate {
            Some(_) => say!("{text}"),
            None => {
                say_beside!("{text}");
                Ok(())
            }
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile: path, .. } = arguments;
    arguments.rotate.as_deref().map_or(Ok(()), rotate::check)?;
    let loaded = load_quietly(path, &arguments.set, false)?;
    let name = path.file_name().filter(|_| path.is_file()).and_then(|name| name.to_str());
    let name = name.with_context(|| {
        format!(
            "{} is part of the program and needs no backup: give the path of the profile that the gateway \
             runs",
            path.display()
        )
    })?;
    let profile = &loaded.profile;
    let beside = path.parent().unwrap_or(Path::new(""));
    let directory = running::directory(arguments.state.as_deref(), profile)?;
    let secrets = secrets(profile, beside);
    let mut names: BTreeSet<String> = loaded.files.iter().cloned().collect();
    names.extend(certificate(profile, beside));
    names.extend(secrets.iter().cloned());
    let mut files = Vec::new();
    for name in &names {
        let shown = beside.join(name);
        if secrets.contains(name) && !arguments.secrets {
            arguments.note(&format!(
                "left out, because it is secret: {} (--secrets includes such files)",
                shown.display()
            ))?;
        } else if !is_below(Path::new(name)) {
            arguments.note(&format!(
                "left out, because it is outside the profile's directory: {}; copy this file yourself",
                shown.display()
            ))?;
        } else {
            let bytes = safe_file::read(&shown, LARGEST)
                .with_context(|| format!("{} cannot be read", shown.display()))?;
            let mode = if secrets.contains(name) { SECRET_MODE } else { PROFILE_MODE };
            files.push((format!("{PROFILE}/{name}"), mode, bytes));
        }
    }
    let kept = gateway::backup::take(&directory, &profile.name).map_err(anyhow::Error::msg)?;
    if kept.is_none() {
        say_beside!(
            "there is no saved state of {} in {}: the backup contains no saved state",
            profile.name,
            directory.display()
        );
    }
    let has_state = kept.is_some();
    files.extend(kept.into_iter().map(|(name, bytes)| (format!("{STATE}/{name}"), MODE, bytes)));
    let learned = learned(arguments, &directory, &profile.name, &files)?;
    let learned_files = learned.len();
    files.extend(learned);
    let mut now = Vec::new();
    time::write(&mut now, Clock::wall().time_of_day());
    let manifest = Manifest {
        form: if learned_files > 0 { FORM } else { FORM_WITHOUT_PRODUCTS },
        program: env!("CARGO_PKG_VERSION").to_owned(),
        machine: profile.name.clone(),
        time: String::from_utf8(now)?,
        secrets: arguments.secrets && files.iter().any(|(_, mode, _)| *mode == SECRET_MODE),
        profile: name.to_owned(),
        state_directory: profile.history.directory.clone(),
        files: files.iter().map(entry).collect(),
    };
    let archive = archive(&manifest, &files)?;
    let size = archive.len() as u64;
    anyhow::ensure!(
        size <= LARGEST,
        "the backup would be larger than {} MB, and `isotherm restore` would reject it",
        LARGEST >> 20
    );
    let mode = if manifest.secrets { SECRET_MODE } else { MODE };
    let file = match &arguments.rotate {
        Some(directory) => rotate::path(directory, &profile.name, &manifest.time),
        None => (arguments.file.clone())
            .context("give the path of the FILE to write, or a directory with --rotate")?,
    };
    let written = match &arguments.rotate {
        Some(directory) => {
            // First, because incomplete files could fill the disk.
            match rotate::remove_incomplete(directory, &profile.name) {
                Ok(removed) => removed
                    .iter()
                    .try_for_each(|part| say!("incomplete backup removed: {}", part.display()))?,
                Err(why) => say_beside!("{why:#}"),
            }
            rotate::write(&file, &archive, mode)
        }
        None => write_new(&file, &archive, mode, None),
    };
    written.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists if arguments.rotate.is_none() && file.is_dir() => {
            anyhow::anyhow!(
                "{0} is a directory: give the path of a file in it, or write --rotate {0}",
                file.display()
            )
        }
        ErrorKind::AlreadyExists if arguments.rotate.is_none() => {
            anyhow::anyhow!("{} exists already: give another name", file.display())
        }
        _ => cannot_be_written(&file, &error),
    })?;
    for (axis, preference) in gateway::preferences_in(&directory, profile) {
        if let Some(model) = preference.preferred().name() {
            arguments.note(&format!(
                "axis {axis} follows the learned model {model}, which the backup contains with the saved state"
            ))?;
        }
    }
    let secret = if manifest.secrets { ", including secret files" } else { "" };
    let learned = match learned_files {
        0 => String::new(),
        count => format!(", {count} of them with learned data"),
    };
    say!("{} contains {} files of machine {}{learned}{secret}", file.display(), files.len(), profile.name)?;
    match arguments.rotate {
        Some(_) if has_state => {
            let copies = usize::try_from(arguments.copies).unwrap_or(usize::MAX);
            for old in rotate::remove_old(&file, &profile.name, copies)? {
                say!("removed: {}", old.display())?;
            }
        }
        // Otherwise, after a wrong --state, backups without state would replace those that have it.
        Some(_) => say_beside!("no older backup is removed, because the new backup contains no saved state"),
        None => {}
    }
    Ok(())
}

/// Returns the files of learned data, and reports unusable files and files above the size limit. `others` are the other
/// files of the backup.
fn learned(
    arguments: &Arguments,
    directory: &Path,
    machine: &str,
    others: &[(String, u32, Vec<u8>)],
) -> anyhow::Result<Vec<(String, u32, Vec<u8>)>> {
    let used: u64 = others.iter().map(|(_, _, bytes)| bytes.len() as u64).sum();
    let bytes = LEARNED.bytes.min(LARGEST.saturating_sub(used + HEADS));
    let taken =
        products::take(directory, machine, Limits { bytes, ..LEARNED }).map_err(anyhow::Error::msg)?;
    for why in &taken.unusable {
        say_beside!("{why}");
    }
    if taken.older > 0 {
        arguments.note(&format!(
            "left out, because the backup would be too large: learned data of the oldest {}. The newest runs of all \
             axes are included",
            counted(taken.older, "run")
        ))?;
    }
    let learned = taken.files.into_iter();
    Ok(learned.map(|(name, bytes)| (format!("{PRODUCTS}/{name}"), MODE, bytes)).collect())
}

fn entry((path, mode, bytes): &(String, u32, Vec<u8>)) -> Entry {
    Entry { path: path.clone(), mode: *mode, bytes: bytes.len() as u64, sha256: sha256(bytes) }
}

fn archive(manifest: &Manifest, files: &[(String, u32, Vec<u8>)]) -> anyhow::Result<Vec<u8>> {
    let mut archive = tar::Builder::new(Vec::new());
    let manifest = serde_json::to_vec_pretty(manifest)?;
    let first = (MANIFEST, MODE, manifest.as_slice());
    let rest = files.iter().map(|(path, mode, bytes)| (path.as_str(), *mode, bytes.as_slice()));
    for (path, mode, bytes) in std::iter::once(first).chain(rest) {
        let mut header = tar::Header::new_ustar();
        header
            .set_path(path)
            .with_context(|| format!("the file name {path} is too long for a tar archive: shorten it"))?;
        header.set_size(bytes.len() as u64);
        header.set_mode(mode);
        header.set_cksum();
        archive.append(&header, bytes)?;
    }
    Ok(archive.into_inner()?)
}

/// Returns the names of the files with tokens, passwords and private keys, as the profile names them.
fn secrets(profile: &Profile, beside: &Path) -> BTreeSet<String> {
    let web = profile.web.as_ref();
    let tokens = web
        .into_iter()
        .flat_map(|web| [&web.token_file, &web.viewer_token_file, &web.scrape_token_file])
        .flatten();
    let key = web.and_then(|web| web.tls.as_ref()).map(|tls| &tls.key);
    let posted = profile.notify.iter().filter_map(|notify| notify.token_file.as_ref());
    let mut secrets: BTreeSet<String> =
        tokens.chain(key).chain(posted).map(|path| name_in(path, beside)).collect();
    secrets.extend(profile.mqtt.iter().flat_map(|mqtt| mqtt.secrets()).map(|file| file.name.clone()));
    let server = profile.opcua_server.iter();
    secrets.extend(server.flat_map(|server| server.secrets()).map(|file| file.name.clone()));
    for bus in &profile.buses {
        secrets.extend(bus.tls.as_ref().map(|tls| tls.key.name.clone()));
        secrets.extend(bus.opcua.iter().flat_map(|opcua| opcua.secrets()).map(|file| file.name.clone()));
    }
    secrets
}

/// Returns the path of the web page's certificate file; `None` if the web page has no TLS. The loader of the profile
/// does not read this file.
fn certificate(profile: &Profile, beside: &Path) -> Option<String> {
    let tls = profile.web.as_ref()?.tls.as_ref()?;
    Some(name_in(&tls.cert, beside))
}

fn name_in(path: &Path, beside: &Path) -> String {
    path.strip_prefix(beside).unwrap_or(path).display().to_string()
}

/// Returns whether a relative path stays below the directory to which it is joined.
pub(super) fn is_below(path: &Path) -> bool {
    path.components().next().is_some() && path.components().all(|part| matches!(part, Component::Normal(_)))
}

/// Writes a new file and waits until it is on disk. If an owner is given, the file belongs to this user and group. An
/// existing file is an error. After any other error, the file is removed.
pub(super) fn write_new(
    path: &Path,
    bytes: &[u8],
    mode: u32,
    owner: Option<(u32, u32)>,
) -> std::io::Result<()> {
    let mut file = std::fs::OpenOptions::new().write(true).create_new(true).mode(mode).open(path)?;
    let mut fill = || {
        file.set_permissions(std::fs::Permissions::from_mode(mode))?;
        if let Some((user, group)) = owner {
            std::os::unix::fs::fchown(&file, Some(user), Some(group))?;
        }
        file.write_all(bytes)?;
        file.sync_all()
    };
    fill().inspect_err(|_| {
        let _ = std::fs::remove_file(path);
    })
}
