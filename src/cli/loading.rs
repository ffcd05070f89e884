//! Loads the profile that a verb names, and prints its errors.

use std::path::{Path, PathBuf};

use clap::Args;

use super::print::{print_json, say_beside};
#[cfg(any(feature = "identify", feature = "place"))]
use super::progress;
use super::values::key_and_value;
use super::{broker, machines};
use crate::fieldbus::kinds::opcua::check as opcua_check;
use crate::fieldbus::tls;
use crate::gateway::how_to_find_a_model;
use isotherm_profile::{Axis, Errors, FileKind, Loaded, Profile};

/// Profile, and keys that are overridden on the command line.
#[derive(Args, Clone, Debug)]
pub(super) struct ProfileArguments {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    pub(super) path: PathBuf,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    pub(super) set: Vec<(String, String)>,
}

/// Error: the profile is wrong. All its errors have already been printed.
#[derive(Debug, thiserror::Error)]
#[error("the profile is wrong")]
pub(super) struct WrongProfile;

/// Loads a profile. If it has errors, prints all of them and returns an error.
pub(super) fn load(arguments: &ProfileArguments, json: bool) -> anyhow::Result<Profile> {
    load_with(&arguments.path, &arguments.set, json)
}

pub(super) fn load_with(path: &Path, set: &[(String, String)], json: bool) -> anyhow::Result<Profile> {
    Ok(load_quietly(path, set, json)?.profile)
}

/// Prints the warnings of a profile, and returns the profile. Only the verbs `check` and `run` do this.
pub(super) fn warned(loaded: Loaded) -> Profile {
    for warning in &loaded.warnings {
        say_beside!("warning: {warning}");
    }
    loaded.profile
}

/// Loads a profile in which at least one axis has a model. A profile without a model can be used to record, to identify
/// and to check the sign of an axis.
pub(super) fn load_modelled(arguments: &ProfileArguments, json: bool) -> anyhow::Result<Loaded> {
    let path = &arguments.path;
    let loaded = load_quietly(path, &arguments.set, json)?;
    let axes = &loaded.profile.axes;
    let unmodelled: Vec<&str> = axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    if axes.is_empty() || axes.iter().any(Axis::has_model) {
        return Ok(loaded);
    }
    anyhow::bail!(
        "{}: axis {} has no model, so Cz cannot be calculated; {}",
        path.display(),
        unmodelled.join(", "),
        how_to_find_a_model(&loaded.profile, 0)
    )
}

/// Loads a profile. Prints its errors, but not its warnings.
pub(super) fn load_quietly(path: &Path, set: &[(String, String)], json: bool) -> anyhow::Result<Loaded> {
    let environment = isotherm_profile::environment();
    load_by(path, json, || match shipped(path) {
        Some((path, text)) => isotherm_profile::parse_with(&path, text, &machines::FILES, set, &environment),
        None => isotherm_profile::load(path, set, &environment),
    })
}

/// Returns path and text of a shipped profile; `None` if a file with this name exists, or no shipped profile has this
/// name.
pub(super) fn shipped(path: &Path) -> Option<(PathBuf, &'static str)> {
    path.to_str().filter(|_| !path.exists()).and_then(machines::text)
}

/// Loads a profile with `load`, and makes the checks that the profile reader cannot make: TLS files, OPC UA and MQTT.
pub(super) fn load_by(
    path: &Path,
    json: bool,
    load: impl FnOnce() -> Result<Loaded, Errors>,
) -> anyhow::Result<Loaded> {
    // A file that a profile names may be large, so that the check takes long.
    #[cfg(any(feature = "identify", feature = "place"))]
    let checking = progress::Progress::begin("checking the profile");
    let loaded = load();
    let loaded = loaded.and_then(|loaded| tls::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.and_then(|loaded| opcua_check::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.and_then(|loaded| broker::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.map_err(|mut errors| {
        if let (Some(meant), [error]) = (machines::meant(path), errors.0.as_mut_slice())
            && error.help.as_deref().is_none_or(|help| !help.starts_with("did you mean"))
        {
            error.help = Some(format!("did you mean the shipped machine `{meant}`?"));
        }
        errors
    });
    // The errors begin on a line of their own.
    #[cfg(any(feature = "identify", feature = "place"))]
    drop(checking);
    reported(loaded, json)
}

/// Returns the loaded profile. If loading failed, prints all errors and returns an error.
pub(super) fn reported(loaded: Result<Loaded, Errors>, json: bool) -> anyhow::Result<Loaded> {
    loaded.or_else(|errors| {
        if json {
            print_json(&errors)?;
        } else {
            say_beside!("{errors}");
        }
        Err(WrongProfile.into())
    })
}

/// Returns the error for a file that cannot be read as the kind `wanted`. The error names the actual kind of the file
/// if that kind is known. Otherwise the error is `why`.
pub(super) fn of_other_kind(path: &Path, wanted: FileKind, why: impl Into<anyhow::Error>) -> anyhow::Error {
    FileKind::mistake(path, wanted).map_or_else(|| why.into(), anyhow::Error::msg)
}
