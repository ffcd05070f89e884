//! Profile that a gateway runs. Its source files are read from disk and also stored in memory. If this program has
//! replaced another program in the same process, the previous program hands the source files over. This program has
//! already checked these files before it replaced the previous program.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::loading::{ProfileArguments, load_by, load_quietly, shipped};
use super::machines;
use crate::gateway::{KeptProfile, memory_for_profile};
use crate::observe::events::Event;
use crate::observe::status::{GatewayApi, ProfileChanges};
use isotherm_profile::{Errors, Loaded, Sources, environment};

/// Interval at which the source files are compared with those on disk.
const COMPARED_EVERY: Duration = Duration::from_secs(5);

/// Profile that the gateway runs, with the contents of its source files.
pub(super) struct RunProfile {
    pub(super) loaded: Loaded,
    /// Source files in sealed memory, which the kernel protects against changes; `None` if the system has no such
    /// memory.
    pub(super) kept: Option<KeptProfile>,
}

impl RunProfile {
    /// Reads a profile from disk, and keeps its source files in memory.
    pub(super) fn from_disk(arguments: &ProfileArguments) -> anyhow::Result<RunProfile> {
        let (loaded, sources) = read(arguments, memory_for_profile())?;
        // Without sources, a restart is not possible, and reports the reason then.
        let kept = sources.and_then(|sources| KeptProfile::seal(sources.finish().ok()?.0).ok());
        Ok(RunProfile { loaded, kept })
    }

    /// Loads a profile that was handed over. Returns `None` if its source files have the format of another version.
    pub(super) fn handed_over(
        arguments: &ProfileArguments,
        kept: &KeptProfile,
    ) -> anyhow::Result<Option<RunProfile>> {
        let path = &arguments.path;
        let sources = match kept.sources() {
            Ok(sources) => sources,
            Err(why) => {
                tracing::warn!(
                    "the profile that was handed over is not used ({why}): {} is read from disk",
                    path.display()
                );
                return Ok(None);
            }
        };
        let loaded = load_by(path, false, || match machines::text(&path.to_string_lossy()) {
            Some((path, text)) if !sources.has_file(&arguments.path) => parse_shipped(&path, text, &sources),
            _ => isotherm_profile::load_from(path, &sources),
        })?;
        Ok(Some(RunProfile { loaded, kept: Some(kept.clone()) }))
    }
}

/// Reports source files that have changed on disk since the profile was loaded. It uses a separate thread, because a
/// file may be on a network drive that does not answer.
pub(super) fn report_differences(
    kept: Option<&KeptProfile>,
    arguments: &ProfileArguments,
    source: &Arc<dyn GatewayApi>,
) {
    let Some(sources) = kept.and_then(|kept| kept.sources().ok()) else { return };
    let (source, arguments) = (source.clone(), arguments.clone());
    let compare = move || {
        let files = sources.differences(&arguments.path, &environment(), &arguments.set);
        if !files.is_empty() {
            let profile = arguments.path.display().to_string();
            source.report(&Event::ProfileDiffers { profile, files });
        }
    };
    // Without a thread, nothing is reported, and the gateway still runs.
    let _ = std::thread::Builder::new().name("profile".to_owned()).spawn(compare);
}

/// Compares the source files with those on disk for as long as the gateway runs. Returns the names of the files that
/// differ, which a separate thread updates.
pub(super) fn watched(kept: Option<&KeptProfile>, arguments: &ProfileArguments) -> Arc<ProfileChanges> {
    let changes = Arc::<ProfileChanges>::default();
    let Some(sources) = kept.and_then(|kept| kept.sources().ok()) else { return changes };
    let (shown, arguments) = (Arc::downgrade(&changes), arguments.clone());
    let compare = move || {
        let mut before = None;
        while let Some(changes) = shown.upgrade() {
            let stamps = sources.stamps(&arguments.path);
            // Reading large files again and again would take time from the lines.
            if before.as_ref() != Some(&stamps) {
                changes.note(sources.differences(&arguments.path, &environment(), &arguments.set));
                before = Some(stamps);
            }
            drop(changes);
            std::thread::sleep(COMPARED_EVERY);
        }
    };
    // Without a thread, no change is shown, and the gateway still runs.
    let _ = std::thread::Builder::new().name("profile-files".to_owned()).spawn(compare);
    changes
}

/// Reads a profile from disk, and stores its source files in `file`. Also returns the stored source files;
/// `None` without `file`.
pub(super) fn read(
    arguments: &ProfileArguments,
    file: Option<File>,
) -> anyhow::Result<(Loaded, Option<Sources>)> {
    let ProfileArguments { path, set } = arguments;
    let Some(file) = file else { return Ok((load_quietly(path, set, false)?, None)) };
    let mut sources = Some(Sources::create(file, &environment(), set));
    let load = || -> Result<Loaded, Errors> {
        let Some(mut kept) = sources.take() else { return isotherm_profile::load(path, set, &environment()) };
        if let Some((shown, text)) = shipped(path) {
            kept.put_absent(path);
            let loaded = parse_shipped(&shown, text, &kept);
            sources = Some(kept);
            return loaded;
        }
        let (loaded, kept) = isotherm_profile::load_and_keep(path, kept)?;
        sources = Some(kept);
        Ok(loaded)
    };
    let loaded = load_by(path, false, load)?;
    Ok((loaded, sources))
}

fn parse_shipped(path: &Path, text: &str, sources: &Sources) -> Result<Loaded, Errors> {
    isotherm_profile::parse_with(path, text, &machines::FILES, sources.settings(), sources.environment())
}
