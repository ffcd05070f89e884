//! Loads a profile: converts its layers (texts) into a [`Profile`], or returns all errors in these layers.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Deserialize;
use serde_json::{Map, Value};
use toml::Spanned;
use toml::de::DeValue;

use crate::error::{Errors, Findings, ProfileError, allowed, nearest_or_longer};
use crate::file_kind::FileKind;
use crate::files::{Certificates, Disk, Files, Reads};
use crate::kinds::KINDS;
use crate::overridden_keys::Above;
use crate::protected_keys::{self, Refusal};
use crate::safe_file::without_numbers;
use crate::schema_check::{SchemaCheck, resolved, types};
use crate::schemas::Schemas;
use crate::source_map::{SourceMap, child};
use crate::sources::Sources;
use crate::tables::RawProfile;
use crate::tables::output::stated;
use crate::tables::signal::unit::Scaling;
use crate::{Profile, merge, template};

/// Prefix of environment variables that set keys of the profile.
const PREFIX: &str = "ISOTHERM__";
/// Prefix of environment variables that are, or look like, settings of this program.
const FAMILY: &str = "ISOTHERM_";
/// Environment variable that sets the log level. It begins with `ISOTHERM_`, but does not set a key of the profile.
const LOG: &str = "ISOTHERM_LOG";
/// Ending of the name of a local file, which overrides keys of the profile next to it.
const LOCAL: &str = ".local.toml";
/// Name endings of the files next to a profile that are not profiles themselves.
const BESIDE: [&str; 2] = [LOCAL, ".plant.toml"];
/// Largest number of environment variables that one warning lists.
const NAMED: usize = 5;
/// Size in bytes. A profile of at least this size is loaded in a separate thread, whose memory is then returned to the
/// system.
const LARGE: usize = 100_000;
/// Address space in bytes that is freed at the end of a thread's heap. Freeing this much makes glibc return
/// the free memory of the thread. The size is twice the largest block that is freed after a profile with a
/// thousand devices was loaded.
const MOST_END: usize = 40_000_000;
/// Size in bytes of an allocated block. A block of this size is small enough for glibc to take it from the heap.
const PIECE: usize = 100 * 1024;

/// Names with values: settings of the command line, or environment variables.
pub(crate) type Pairs = [(String, String)];

/// Valid profile with its warnings.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The profile, ready for use.
    pub profile: Profile,
    /// Warnings about the profile. They do not prevent the gateway from running.
    pub warnings: Vec<ProfileError>,
    /// Files that were read, as the profile names them: layers, models, templates, certificates.
    pub files: Vec<String>,
}

/// Loads a profile with all its layers: the file, `<stem>.local.toml` next to it, `environment`, and `settings`
/// (`--set`).
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn load(path: &Path, settings: &Pairs, environment: &Pairs) -> Result<Loaded, Errors> {
    Ok(read(path, settings, environment, Certificates::Needed, None)?.0)
}

/// Loads a profile before the certificates of its OPC UA lines are created. A missing certificate or key counts as an
/// empty file.
///
/// # Errors
/// All other mistakes in the profile, each with its position.
pub fn load_before_certificates(
    path: &Path,
    settings: &Pairs,
    environment: &Pairs,
) -> Result<Loaded, Errors> {
    Ok(read(path, settings, environment, Certificates::ToBeMade, None)?.0)
}

/// Loads a profile with the environment and options in `sources`, and stores all files that it reads in `sources`.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn load_and_keep(path: &Path, sources: Sources) -> Result<(Loaded, Sources), Errors> {
    let (settings, environment) = (sources.settings().to_vec(), sources.environment().to_vec());
    let (loaded, sources) = read(path, &settings, &environment, Certificates::Needed, Some(sources))?;
    let lost = || Errors(vec![ProfileError::about("the sources", "were not kept", None)]);
    Ok((loaded, sources.ok_or_else(lost)?))
}

/// Loads a profile from stored sources. The file system is not used.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn load_from(path: &Path, sources: &Sources) -> Result<Loaded, Errors> {
    let directory = path.parent().unwrap_or(Path::new(""));
    read_layers(path, sources.settings(), sources.environment(), &Files::Kept(directory, sources))
}

fn read(
    path: &Path,
    settings: &Pairs,
    environment: &Pairs,
    certificates: Certificates,
    sources: Option<Sources>,
) -> Result<(Loaded, Option<Sources>), Errors> {
    let disk = Disk::new(path.parent().unwrap_or(Path::new("")), certificates, sources);
    let mut loaded = read_layers(path, settings, environment, &Files::Beside(&disk))?;
    let Reads { names, sources } = disk.into_reads();
    loaded.files.extend(names);
    Ok((loaded, sources))
}

fn read_layers(
    path: &Path,
    settings: &Pairs,
    environment: &Pairs,
    files: &Files<'_>,
) -> Result<Loaded, Errors> {
    let text = files.layer(path).map_err(|why| {
        // A log may be too large for a profile, and a workbook is no text.
        let other = matches!(why.kind(), ErrorKind::InvalidData | ErrorKind::FileTooLarge);
        let kind = (other && matches!(files, Files::Beside(_))).then(|| FileKind::of_file(path)).flatten();
        misplaced(path, kind).unwrap_or_else(|| Errors(vec![not_read(path, &why)]))
    })?;
    let layers = with_local(path, text, files)?;
    let mut loaded = layered(&layers, files, settings, environment)?;
    let names = layers.iter().filter_map(|(path, _)| path.file_name());
    loaded.files = names.map(|name| name.to_string_lossy().into_owned()).collect();
    Ok(loaded)
}

/// Returns the layers that are files: the profile with this text, and the local file next to it.
fn with_local(path: &Path, text: String, files: &Files<'_>) -> Result<Vec<(PathBuf, String)>, Errors> {
    let mut layers = vec![(path.to_owned(), text)];
    let local = local_beside(path);
    match files.layer(&local) {
        Ok(text) => layers.push((local, text)),
        Err(why) if why.kind() == ErrorKind::NotFound => {}
        Err(why) => return Err(Errors(vec![unreadable(&local.display().to_string(), &why)])),
    }
    Ok(layers)
}

/// Loads a profile from a text, for example one that is part of the program. Such a profile cannot refer to files.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn parse(name: &Path, text: &str, settings: &Pairs, environment: &Pairs) -> Result<Loaded, Errors> {
    parse_with(name, text, &[], settings, environment)
}

/// Loads a profile from a text, and the files that it names from memory. `files` contains matrices, networks and
/// envelopes by name.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn parse_with(
    name: &Path,
    text: &str,
    files: &[(&str, &[u8])],
    settings: &Pairs,
    environment: &Pairs,
) -> Result<Loaded, Errors> {
    layered(&[(name.to_owned(), text.to_owned())], &Files::Inside(files), settings, environment)
}

/// Loads a profile from a text that is not saved yet. Names of files in this text are relative to the
/// directory of `path`. The other layers (local file, environment, `--set`) are not read.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn parse_beside(path: &Path, text: &str) -> Result<Loaded, Errors> {
    let disk = Disk::new(path.parent().unwrap_or(Path::new("")), Certificates::Needed, None);
    layered(&[(path.to_owned(), text.to_owned())], &Files::Beside(&disk), &[], &[])
}

/// Loads a profile as [`load`] does, but with a text that is not saved yet in place of the file. The local file and
/// `environment` apply.
///
/// # Errors
/// All mistakes in the profile, each with its position.
pub fn load_edited(path: &Path, text: &str, environment: &Pairs) -> Result<Loaded, Errors> {
    let disk = Disk::new(path.parent().unwrap_or(Path::new("")), Certificates::Needed, None);
    let files = Files::Beside(&disk);
    layered(&with_local(path, text.to_owned(), &files)?, &files, &[], environment)
}

/// Returns the environment variables that begin with `ISOTHERM_`: those that set keys of a profile, and others that may
/// be misspelled.
pub fn environment() -> Vec<(String, String)> {
    let text = |os: std::ffi::OsString| os.to_string_lossy().into_owned();
    let mut variables: Vec<_> = std::env::vars_os()
        .map(|(name, value)| (text(name), text(value)))
        .filter(|(name, _)| name.starts_with(FAMILY))
        .collect();
    variables.sort();
    variables
}

fn is_ours(name: &str) -> bool {
    name.starts_with(PREFIX)
}

/// Returns a warning about environment variables that begin with `ISOTHERM_` but are not settings of this
/// program. An orchestrator sets such variables for a service named isotherm, or an operator forgot an
/// underscore. `None` if there are no such variables.
fn strangers(environment: &Pairs) -> Option<ProfileError> {
    let names = environment.iter().map(|(name, _)| name.as_str());
    let names: Vec<&str> =
        names.filter(|name| name.starts_with(FAMILY) && !is_ours(name) && *name != LOG).collect();
    let more = match names.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let listed = names.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    let help = format!(
        "a variable for a key of the profile has two underscores between the names, as \
         {PREFIX}BUS__CELL__ADDRESS; {LOG} sets the log level"
    );
    let message =
        format!("these variables are ignored, because they are not settings of isotherm: {listed}{more}");
    (!names.is_empty()).then(|| ProfileError::about("environment", message, Some(help)))
}

/// Paths that mean the standard input. A profile cannot be read from it.
const STANDARD_INPUT: [&str; 4] = ["-", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"];

/// Returns the error for a profile that cannot be read because of the I/O error `why`.
fn not_read(path: &Path, why: &std::io::Error) -> ProfileError {
    let name = path.display().to_string();
    let (message, help) = match () {
        () if STANDARD_INPUT.contains(&name.as_str()) => (
            "a profile is not read from standard input",
            "write the profile to a file, and give the path of this file",
        ),
        () if path.is_dir() => (
            "this is a directory, not a profile",
            "give the path of a profile in it, as DIRECTORY/my-machine.toml",
        ),
        () if why.kind() == ErrorKind::NotFound => {
            let message = format!("the profile cannot be read: {}", without_numbers(&why.to_string()));
            return ProfileError::about(name, message, Some(meant_file(path)));
        }
        () => return unreadable(&name, why),
    };
    ProfileError::about(name, message, Some(help.to_owned()))
}

/// Returns the hint for a profile that does not exist: the profile in its directory that was probably meant.
fn meant_file(path: &Path) -> String {
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = directory.read_dir() else {
        return format!("check that the directory {} exists and can be read", directory.display());
    };
    let is_profile = |name: &String| name.ends_with(".toml") && !BESIDE.iter().any(|end| name.ends_with(end));
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let names: Vec<String> = names.filter(is_profile).collect();
    let words: Vec<&str> = names.iter().map(String::as_str).collect();
    let wanted = path.file_name().unwrap_or_default().to_string_lossy();
    match nearest_or_longer(&wanted, &words) {
        Some(near) => format!("did you mean `{}`?", path.with_file_name(near).display()),
        None => "give the path of a profile; `isotherm init` writes a first profile".to_owned(),
    }
}

fn unreadable(name: &str, why: &std::io::Error) -> ProfileError {
    let help = match why.kind() {
        ErrorKind::InvalidData => "a profile is a TOML file in UTF-8",
        ErrorKind::FileTooLarge => "check that this file is a profile",
        _ => "check that the path is a file, and that this user has permission to read it",
    };
    ProfileError::about(
        name,
        format!("the profile cannot be read: {}", without_numbers(&why.to_string())),
        Some(help.to_owned()),
    )
}

/// Returns the error about a file of another kind that was given instead of a profile. `None` if the file may be a
/// profile.
fn misplaced(path: &Path, kind: Option<FileKind>) -> Option<Errors> {
    let other = kind?.instead_of(FileKind::Profile)?;
    Some(Errors(vec![other.error(path.display().to_string())]))
}

/// Returns one error that replaces all other errors if the first layer is empty, a local file, or another kind of file.
/// All keys of such a file would be missing or unknown. `None` if the file may be a profile.
fn other_file(layers: &[(PathBuf, String)], errors: &Errors) -> Option<Errors> {
    let (path, text) = layers.first()?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_content = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
    if !text.lines().any(is_content) {
        let help = "`isotherm init NAME.toml` writes a first profile";
        let error =
            ProfileError::about(path.display().to_string(), "the file is empty", Some(help.to_owned()));
        return Some(Errors(vec![error]));
    }
    let lacks_machine = errors.0.iter().any(|error| error.key == "machine");
    if let Some(stem) = name.strip_suffix(LOCAL).filter(|_| lacks_machine) {
        let message = "this is the local file of a profile, not the profile";
        let help = format!(
            "give the profile: {stem}.toml; the gateway also reads the local file next to the profile"
        );
        return Some(Errors(vec![ProfileError::about(path.display().to_string(), message, Some(help))]));
    }
    misplaced(path, FileKind::of(text.as_bytes()))
}

fn local_beside(path: &Path) -> PathBuf {
    path.with_extension("local.toml")
}

/// Loads the layers. The first profile of a process, and each large profile, is loaded in a separate thread
/// with its own heap, because loading needs many times the memory of the result. The allocator of glibc
/// returns free memory only if no block in use lies above it. Therefore the result is copied out of the heap
/// of the thread. The schemas of the first profile are not kept, because a gateway loads only one profile.
fn layered(
    layers: &[(PathBuf, String)],
    files: &Files<'_>,
    settings: &Pairs,
    environment: &Pairs,
) -> Result<Loaded, Errors> {
    static IS_FIRST: AtomicBool = AtomicBool::new(true);
    let read = |schemas: &Schemas| {
        let read = merged_and_checked(layers, (files, schemas), settings, environment);
        read.map_err(|errors| other_file(layers, &errors).unwrap_or(errors))
    };
    let is_large = layers.iter().map(|(_, text)| text.len()).sum::<usize>() >= LARGE;
    if !IS_FIRST.swap(false, Ordering::Relaxed) && !is_large {
        return read(Schemas::kept());
    }
    std::thread::scope(|scope| {
        let read = || read(&Schemas::new());
        let Ok(loading) = std::thread::Builder::new().spawn_scoped(scope, read) else { return read() };
        let loaded = loading.join().unwrap_or_else(|panicked| std::panic::resume_unwind(panicked));
        let kept = loaded.clone();
        let _ = scope.spawn(|| drop(loaded)).join();
        // The memory of a thread is above everything allocated before.
        scope.spawn(move || free_the_end(if is_large { MOST_END } else { PIECE }));
        kept
    })
}

/// Makes glibc return the free memory at the end of a thread's heap. glibc returns this memory if it is at least twice
/// as large as the largest block ever freed: see malloc(3), `M_TRIM_THRESHOLD`. A large profile is freed in large
/// blocks. This function reserves `space` bytes of address space without touching them, so it uses no memory.
fn free_the_end(space: usize) {
    let end: Vec<Vec<u8>> = (0..space / PIECE).map(|_| Vec::with_capacity(PIECE)).collect();
    drop(std::hint::black_box(end));
}

fn merged_and_checked(
    layers: &[(PathBuf, String)],
    (files, schemas): (&Files<'_>, &Schemas),
    settings: &Pairs,
    environment: &Pairs,
) -> Result<Loaded, Errors> {
    let mut loader = Loader {
        schemas,
        spans: SourceMap::default(),
        errors: Findings::default(),
        layers: Vec::new(),
        refused: Vec::new(),
        files: 0,
        broken: false,
    };
    for (path, text) in layers {
        loader.file(path, text);
    }
    let ours = || environment.iter().filter(|(name, _)| is_ours(name));
    // Merged files, which contain the names that a variable or flag may use.
    let below = if settings.is_empty() && ours().next().is_none() {
        Value::Null
    } else {
        merge_all(&loader.layers, &mut loader.errors)
    };
    for (name, value) in ours() {
        let path = name.strip_prefix(PREFIX).unwrap_or_default().to_lowercase();
        let parts: Vec<&str> = path.split("__").collect();
        loader.setting(&format!("environment {name}"), &parts, value, &below, true);
    }
    for (key, value) in settings {
        let parts: Vec<&str> = key.split('.').collect();
        loader.setting(&format!("--set {key}"), &parts, value, &below, false);
    }
    let path = layers.first().map(|(path, _)| path.clone()).unwrap_or_default();
    let mut loaded = loader.finish(path, files)?;
    loaded.warnings.extend(strangers(environment));
    Ok(loaded)
}

struct Loader<'a> {
    schemas: &'a Schemas,
    spans: SourceMap,
    errors: Findings,
    /// Parsed layers. The first layer is the profile, unless the profile cannot be parsed.
    layers: Vec<Value>,
    /// Keys that layers above the profile set against the rules of these keys.
    refused: Vec<Refusal>,
    /// Number of layers that are files.
    files: usize,
    /// Whether a file is not valid TOML. Its content is then unknown, so no key is reported as missing.
    broken: bool,
}

impl Loader<'_> {
    fn walk(&mut self, layer: usize) -> SchemaCheck<'_> {
        let beside = Scaling::default();
        SchemaCheck {
            schema: &self.schemas.profile,
            layer,
            spans: &mut self.spans,
            errors: &mut self.errors,
            beside,
        }
    }

    fn file(&mut self, path: &Path, text: &str) {
        let layer = self.spans.add_layer(&path.display().to_string(), Some(text));
        let (table, is_whole) = self.walk(layer).parsed(text);
        if is_whole {
            let schema = &self.schemas.profile;
            let right = self.walk(layer).table(schema, "", table);
            self.files += 1;
            self.layer(right);
        } else {
            self.broken = true;
        }
    }

    /// Adds a layer. Its values replace the values of the layers that were added before.
    fn layer(&mut self, layer: Value) {
        if let Some(profile) = self.layers.first().filter(|_| !self.broken) {
            self.refused.extend(protected_keys::refused(&self.schemas.profile, profile, &layer, &self.spans));
        }
        self.layers.push(layer);
    }

    /// Adds one value from the environment or the command line as a layer. `parts` is the path of its key, `below`
    /// contains the merged files. With `any_case`, the case of letters in `parts` is ignored.
    fn setting(&mut self, name: &str, parts: &[&str], text: &str, below: &Value, any_case: bool) {
        let layer = self.spans.add_layer(name, None);
        let (keys, schema) = match find(&self.schemas.profile, below, parts, any_case) {
            Ok(found) => found,
            // If a file is not valid TOML, the existing names are unknown.
            Err(_) if self.broken => return,
            Err((message, help)) => {
                let error = ProfileError::about(name, message, Some(help));
                return self.errors.push(ProfileError { key: parts.join("."), ..error });
            }
        };
        let path = keys.iter().fold(String::new(), |path, key| child(&path, key));
        self.spans.record(layer, &path, 0..0, 0..0);
        let value = scalar(&types(&self.schemas.profile, schema), text);
        let table = keys.iter().rev().skip(1).rev().try_fold(below, |value, key| value.get(key));
        let mut walk = self.walk(layer);
        walk.beside = table.map(Scaling::of).unwrap_or_default();
        if let Some(value) = walk.value(schema, &path, value) {
            let nest = |inner, key: &String| Value::Object(Map::from_iter([(key.clone(), inner)]));
            self.layer(keys.iter().rev().fold(value, nest));
        }
    }

    fn finish(mut self, path: PathBuf, files: &Files<'_>) -> Result<Loaded, Errors> {
        let mut layers = std::mem::take(&mut self.layers);
        let (mut merged, mut overridden) = (Value::Null, Vec::new());
        // The profile without its layers, if there are layers above it.
        let mut own = None;
        if layers.len() > 1 {
            merged = merge_all(&layers, &mut self.errors);
            let files = self.files.saturating_sub(1);
            let (profile, above) = (&layers[0], &layers[1..]);
            let (allowed, spans) = (protected_keys::allowed(profile), &self.spans);
            overridden = Above { profile, layers: above, allowed, files, merged: &merged, spans }.list();
            own = Some(layers.swap_remove(0));
        } else if let Some(only) = layers.pop() {
            // A copy of a large machine would need too much memory.
            merged = only;
        }
        let (mut profile, mut warnings) = (None, Findings::default());
        if !self.broken {
            let templates =
                template::fill(&mut merged, (files, self.schemas), &mut self.spans, &mut self.errors);
            if let Some(own) = &own {
                let refused = std::mem::take(&mut self.refused);
                let refused = protected_keys::that_count(refused, own, &merged);
                refused.into_iter().for_each(|error| self.errors.push(error));
            }
            let schema = &self.schemas.profile;
            self.walk(0).missing(schema, "", &merged);
            self.spans.mark_right("", &merged);
            // Consumed, so that a large machine is not in memory twice.
            match RawProfile::deserialize(merged) {
                Ok(raw) => {
                    let checked = raw.check(&self.spans, path, (files, schema), &templates, &KINDS);
                    self.errors.append(checked.errors);
                    (profile, warnings) = (checked.profile, checked.warnings);
                }
                Err(why) => self.errors.push(ProfileError::about("the layers", why.to_string(), None)),
            }
        }
        if let Some(mut profile) = profile.filter(|_| self.errors.is_empty()) {
            profile.overridden = overridden;
            own.iter().for_each(|own| stated::by(own, &mut profile));
            return Ok(Loaded { profile, warnings: warnings.listed(&self.spans), files: Vec::new() });
        }
        if self.errors.is_empty() {
            let message = "the profile cannot be resolved, but no key is wrong";
            self.errors.push(ProfileError::about("the layers", message, None));
        }
        Err(Errors(self.errors.listed(&self.spans)))
    }
}

/// Merges the layers, later ones over earlier ones. If merging fails, reports an error and returns null.
fn merge_all(layers: &[Value], errors: &mut Findings) -> Value {
    merge::merged(layers).unwrap_or_else(|why| {
        errors.push(ProfileError::about("the layers", why.to_string(), None));
        Value::Null
    })
}

/// Finds the schema of the key at a path. Returns the path as the profile spells it, with the schema. Every
/// named table of the path must exist in a file. The error is a message and a hint.
fn find<'a>(
    root: &'a Value,
    below: &Value,
    parts: &[&str],
    any_case: bool,
) -> Result<(Vec<String>, &'a Value), (String, String)> {
    let mut schema = root;
    let mut here = Some(below);
    let mut keys: Vec<String> = Vec::new();
    for part in parts {
        let inner = resolved(root, schema);
        let names: Vec<&str> =
            here.and_then(Value::as_object).into_iter().flat_map(Map::keys).map(String::as_str).collect();
        let known = inner.get("properties").and_then(Value::as_object);
        let free = inner.get("additionalProperties").filter(|free| free.is_object());
        let (key, next) = if let Some(known) = known {
            let next = known.get(*part).ok_or_else(|| {
                let place =
                    if keys.is_empty() { "the profile".to_owned() } else { format!("`{}`", keys.join(".")) };
                (format!("unknown key `{part}` in {place}"), allowed(part, known.keys().map(String::as_str)))
            })?;
            ((*part).to_owned(), next)
        } else if let Some(free) = free {
            let name = names.iter().find(|name| *name == part || (any_case && same_name(name, part)));
            let name = name.ok_or_else(|| {
                (
                    format!("there is no {} named `{part}`", keys.join(".")),
                    allowed(part, names.iter().copied()),
                )
            })?;
            ((*name).to_owned(), free)
        } else {
            let remedy = "a list is replaced as a whole: write the whole list, as [1.0, 2.0], or put it \
                          into the .local.toml file";
            return Err((format!("`{}` has no keys of its own", keys.join(".")), remedy.to_owned()));
        };
        here = here.and_then(|here| here.get(&key));
        keys.push(key);
        schema = next;
    }
    Ok((keys, schema))
}

/// Returns whether a part of an environment variable means this name. Case is ignored, and a hyphen equals an
/// underscore, because variables are written in capitals without hyphens.
fn same_name(name: &str, part: &str) -> bool {
    name.to_lowercase().replace('-', "_") == part.replace('-', "_")
}

/// Parses a value from the environment or the command line as TOML. Returns the text unchanged if the schema requires a
/// text, or if the text is not valid TOML.
fn scalar<'t>(types: &[&str], text: &'t str) -> Spanned<DeValue<'t>> {
    let literal = || Spanned::new(0..0, DeValue::String(text.into()));
    if types == ["string"] {
        return literal();
    }
    DeValue::parse(text.trim()).unwrap_or_else(|_| literal())
}
