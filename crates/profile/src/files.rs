//! Reads the files that a profile names, from disk, from stored [`Sources`], or from memory.

use std::collections::BTreeSet;
use std::io::{Error, ErrorKind};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::file_kind::FileKind;
use crate::safe_file;
use crate::sources::{FileState, Sources, is_open_to_all, layer_name, names_in};

/// Source from which the files of one profile are read.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Files<'a> {
    /// Files on disk. The profile names them relative to its own directory.
    Beside(&'a Disk<'a>),
    /// Files of a profile that has been loaded before. Their content comes from [`Sources`], in which the loader stored
    /// everything that it read. The path is the directory of the profile.
    Kept(&'a Path, &'a Sources),
    /// Files in memory: names and contents.
    Inside(&'a [(&'a str, &'a [u8])]),
}

/// Whether the certificates and keys that a profile names must exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Certificates {
    /// The certificates and keys must exist. A missing file is an error.
    Needed,
    /// The certificates and keys may be missing, because they are created later.
    ToBeMade,
}

/// Directory of a profile, with a record of the files that were read from it.
#[derive(Debug)]
pub(crate) struct Disk<'a> {
    directory: &'a Path,
    certificates: Certificates,
    reads: Mutex<Reads>,
}

/// Record of the files that were read: their names, and optionally a copy of their content.
#[derive(Debug, Default)]
pub(crate) struct Reads {
    pub(crate) names: BTreeSet<String>,
    /// Copy of everything that was read, for loading the same profile again. `None` if no copy is made.
    pub(crate) sources: Option<Sources>,
}

impl<'a> Disk<'a> {
    pub(crate) fn new(directory: &'a Path, certificates: Certificates, sources: Option<Sources>) -> Disk<'a> {
        Disk { directory, certificates, reads: Mutex::new(Reads { names: BTreeSet::new(), sources }) }
    }

    pub(crate) fn into_reads(self) -> Reads {
        self.reads.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn reads(&self) -> MutexGuard<'_, Reads> {
        self.reads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads a file of at most `largest` bytes. If a copy of all sources is made, each file is read from disk only
    /// once.
    fn bytes(&self, name: &str, largest: u64) -> Result<Vec<u8>, String> {
        let mut reads = self.reads();
        reads.names.insert(name.to_owned());
        if let Some(sources) = reads.sources.as_ref().filter(|sources| sources.found(name).is_some()) {
            return sources.bytes(name);
        }
        let path = self.directory.join(name);
        let read = safe_file::read(&path, largest).map_err(|why| {
            format!("{} cannot be read: {}", path.display(), safe_file::without_numbers(&why.to_string()))
        });
        if let Some(sources) = &mut reads.sources {
            match &read {
                Ok(bytes) => sources.put_file(name, bytes, is_open_to_all(&path)),
                Err(why) => sources.put(name, FileState::Unreadable(why.clone()), &[]),
            }
        }
        read
    }

    fn layer(&self, path: &Path) -> std::io::Result<String> {
        let read = safe_file::read_text_of(path, safe_file::LARGEST_PROFILE);
        if let Some(sources) = &mut self.reads().sources {
            match &read {
                Ok(text) => sources.put_file(&layer_name(path), text.as_bytes(), false),
                Err(_) => sources.put(&layer_name(path), FileState::Absent, &[]),
            }
        }
        read
    }
}

impl Files<'_> {
    /// Reads the text of a profile or of the `.local.toml` file next to it.
    ///
    /// # Errors
    /// The file does not exist, cannot be read, is too large, or is not UTF-8.
    pub(crate) fn layer(&self, path: &Path) -> std::io::Result<String> {
        match self {
            Files::Beside(disk) => disk.layer(path),
            Files::Kept(_, sources) => {
                let bytes = sources.bytes(&layer_name(path)).map_err(|_| Error::from(ErrorKind::NotFound))?;
                String::from_utf8(bytes).map_err(|_| Error::from(ErrorKind::InvalidData))
            }
            Files::Inside(_) => Err(ErrorKind::NotFound.into()),
        }
    }

    /// Reads the text of an optional file. Returns `None` if it does not exist.
    ///
    /// # Errors
    /// The file exists, but cannot be read. The error is one sentence.
    pub(crate) fn text(&self, name: &str) -> Result<Option<String>, String> {
        if !self.is_there(name) {
            if let Files::Beside(disk) = self
                && let Some(sources) = &mut disk.reads().sources
            {
                sources.put(name, FileState::Absent, &[]);
            }
            return Ok(None);
        }
        let text = String::from_utf8(self.bytes(name, safe_file::LARGEST_PROFILE)?);
        text.map(Some).map_err(|_| format!("{} is not a text in UTF-8", self.path(name)))
    }

    fn is_there(&self, name: &str) -> bool {
        match self {
            Files::Beside(disk) => disk.directory.join(name).exists(),
            Files::Kept(_, sources) => sources.found(name).is_some_and(|found| *found != FileState::Absent),
            Files::Inside(files) => files.iter().any(|(known, _)| *known == name),
        }
    }

    /// Returns whether the file of this certificate or key does not exist yet, and this is allowed because the file is
    /// created later.
    pub(crate) fn is_to_be_made(&self, name: &str) -> bool {
        matches!(self, Files::Beside(disk) if disk.certificates == Certificates::ToBeMade)
            && !self.is_there(name)
    }

    /// Returns the path of a file for messages: the directory of the profile and `name`, or only `name` for files in
    /// memory.
    pub(crate) fn path(&self, name: &str) -> String {
        match self.directory() {
            Some(directory) => directory.join(name).display().to_string(),
            None => name.to_owned(),
        }
    }

    fn directory(&self) -> Option<&Path> {
        match self {
            Files::Beside(disk) => Some(disk.directory),
            Files::Kept(directory, _) => Some(directory),
            Files::Inside(_) => None,
        }
    }

    /// Returns whether any user of this computer may read or change the file.
    pub(crate) fn is_open_to_all(&self, name: &str) -> bool {
        let kept = if let Files::Kept(_, sources) = self { sources.found(name) } else { None };
        match kept {
            Some(FileState::File { open_to_all, .. }) => *open_to_all,
            _ => self.directory().is_some_and(|directory| is_open_to_all(&directory.join(name))),
        }
    }

    /// Returns the names of the files in a directory that end with `end`, each without this ending.
    pub(crate) fn names(&self, directory: &str, end: &str) -> Vec<String> {
        let list = format!("{directory}/*{end}");
        match self {
            Files::Beside(disk) => {
                let names = names_in(&disk.directory.join(directory), end);
                if let Some(sources) = &mut disk.reads().sources {
                    sources.put(&list, FileState::Names(names.clone()), &[]);
                }
                names
            }
            Files::Kept(_, sources) => match sources.found(&list) {
                Some(FileState::Names(names)) => names.clone(),
                _ => Vec::new(),
            },
            Files::Inside(files) => {
                let inside = |name: &str| name.strip_prefix(directory)?.strip_prefix('/').map(str::to_owned);
                let names = files.iter().filter_map(|(name, _)| inside(name));
                names.filter_map(|name| Some(name.strip_suffix(end)?.to_owned())).collect()
            }
        }
    }

    /// Recognises the kind of a file that could not be used, for example because it is too large. `None` if the kind is
    /// unknown, or if the files are not on disk.
    pub(crate) fn kind(&self, name: &str) -> Option<FileKind> {
        match self {
            Files::Beside(disk) => FileKind::of_file(&disk.directory.join(name)),
            Files::Kept(..) | Files::Inside(_) => None,
        }
    }

    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// The file does not exist, cannot be read, or is too large. The error is one sentence.
    pub(crate) fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.bytes(name, safe_file::LARGEST)
    }

    fn bytes(&self, name: &str, largest: u64) -> Result<Vec<u8>, String> {
        match self {
            Files::Beside(disk) => disk.bytes(name, largest),
            Files::Kept(_, sources) => sources.bytes(name),
            Files::Inside(files) => match files.iter().find(|(known, _)| *known == name) {
                Some((_, bytes)) => Ok(bytes.to_vec()),
                None => Err(format!("{name} is not among the files of this profile")),
            },
        }
    }
}
