//! The files that a profile names: beside it, kept from an earlier loading, or, for one that is part of the program, in the program.

use std::collections::BTreeSet;
use std::io::{Error, ErrorKind};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::regular;
use crate::sources::{Found, Sources, is_open_to_all, layer_name, names_in};

/// The files of one profile.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Files<'a> {
    /// On disk.
    Beside(&'a Disk<'a>),
    /// Relative to this directory, as they were when these sources were kept.
    Kept(&'a Path, &'a Sources),
    /// By name.
    Inside(&'a [(&'a str, &'a [u8])]),
}

/// Certificates and keys that a profile names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Certificates {
    /// They must be there.
    Needed,
    /// Those that are not there are still to be made.
    ToBeMade,
}

/// The directory of a profile.
#[derive(Debug)]
pub(crate) struct Disk<'a> {
    directory: &'a Path,
    certificates: Certificates,
    reads: Mutex<Reads>,
}

/// What was read of it.
#[derive(Debug, Default)]
pub(crate) struct Reads {
    pub(crate) names: BTreeSet<String>,
    /// Where the answers are kept, if they are.
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

    /// A file is read once where its answer is kept.
    fn bytes(&self, name: &str, largest: u64) -> Result<Vec<u8>, String> {
        let mut reads = self.reads();
        reads.names.insert(name.to_owned());
        if let Some(sources) = reads.sources.as_ref().filter(|sources| sources.found(name).is_some()) {
            return sources.bytes(name);
        }
        let path = self.directory.join(name);
        let read = regular::read(&path, largest).map_err(|why| {
            format!("{} cannot be read: {}", path.display(), regular::without_numbers(&why.to_string()))
        });
        if let Some(sources) = &mut reads.sources {
            match &read {
                Ok(bytes) => sources.put_file(name, bytes, is_open_to_all(&path)),
                Err(why) => sources.put(name, Found::Unreadable(why.clone()), &[]),
            }
        }
        read
    }

    fn layer(&self, path: &Path) -> std::io::Result<String> {
        let read = regular::read_text_of(path, regular::LARGEST_PROFILE);
        if let Some(sources) = &mut self.reads().sources {
            match &read {
                Ok(text) => sources.put_file(&layer_name(path), text.as_bytes(), false),
                Err(_) => sources.put(&layer_name(path), Found::Absent, &[]),
            }
        }
        read
    }
}

impl Files<'_> {
    /// The text of a layer.
    ///
    /// # Errors
    /// As reading a file.
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

    /// The text of a file that need not be there.
    ///
    /// # Errors
    /// A sentence: it is there and cannot be read.
    pub(crate) fn text(&self, name: &str) -> Result<Option<String>, String> {
        if !self.is_there(name) {
            if let Files::Beside(disk) = self
                && let Some(sources) = &mut disk.reads().sources
            {
                sources.put(name, Found::Absent, &[]);
            }
            return Ok(None);
        }
        let text = String::from_utf8(self.bytes(name, regular::LARGEST_PROFILE)?);
        text.map(Some).map_err(|_| format!("{} is no text in UTF-8", self.path(name)))
    }

    fn is_there(&self, name: &str) -> bool {
        match self {
            Files::Beside(disk) => disk.directory.join(name).exists(),
            Files::Kept(_, sources) => sources.found(name).is_some_and(|found| *found != Found::Absent),
            Files::Inside(files) => files.iter().any(|(known, _)| *known == name),
        }
    }

    /// Whether this certificate, or key, is still to be made.
    pub(crate) fn is_to_be_made(&self, name: &str) -> bool {
        matches!(self, Files::Beside(disk) if disk.certificates == Certificates::ToBeMade)
            && !self.is_there(name)
    }

    /// As errors name a file.
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

    /// Whether anybody on this computer may read or change it.
    pub(crate) fn is_open_to_all(&self, name: &str) -> bool {
        let kept = if let Files::Kept(_, sources) = self { sources.found(name) } else { None };
        match kept {
            Some(Found::File { open_to_all, .. }) => *open_to_all,
            _ => self.directory().is_some_and(|directory| is_open_to_all(&directory.join(name))),
        }
    }

    /// The names in a directory that end so, without that end.
    pub(crate) fn names(&self, directory: &str, end: &str) -> Vec<String> {
        let list = format!("{directory}/*{end}");
        match self {
            Files::Beside(disk) => {
                let names = names_in(&disk.directory.join(directory), end);
                if let Some(sources) = &mut disk.reads().sources {
                    sources.put(&list, Found::Names(names.clone()), &[]);
                }
                names
            }
            Files::Kept(_, sources) => match sources.found(&list) {
                Some(Found::Names(names)) => names.clone(),
                _ => Vec::new(),
            },
            Files::Inside(files) => {
                let inside = |name: &str| name.strip_prefix(directory)?.strip_prefix('/').map(str::to_owned);
                let names = files.iter().filter_map(|(name, _)| inside(name));
                names.filter_map(|name| Some(name.strip_suffix(end)?.to_owned())).collect()
            }
        }
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// A sentence: not there, not readable, too large.
    pub(crate) fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.bytes(name, regular::LARGEST)
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
