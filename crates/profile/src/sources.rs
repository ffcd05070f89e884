//! Sources of a profile: everything that the loader reads from the file system, environment and command line.
//! All sources are stored in one file. The same profile can then be loaded again after its sources have
//! changed.
//!
//! ```text
//! isotherm-sources 1
//! {"environment":[["ISOTHERM__BUS__CELL__ADDRESS","10.0.0.7:502"]],"settings":[]}
//! {"name":"mill.toml","found":{"file":{"bytes":812,"open_to_all":true}}}
//! 812 bytes, then the next line
//! {"name":"mill.local.toml","found":"absent"}
//! ```

use std::collections::BTreeMap;
use std::fs::{File, Metadata};
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::os::unix::fs::{FileExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::safe_file;

/// First word of every sources file, independent of the version of its format.
pub const SOURCES_MARK: &str = "isotherm-sources ";
/// First line of a file in the format of this version.
const FORM: &str = "isotherm-sources 1\n";
/// Longest line of a sources file, in bytes. Long lines are those that list the names in a directory.
const LONGEST_LINE: u64 = 16 * 1024 * 1024;
/// Permission bits by which all users may read or write a file.
const OF_OTHERS: u32 = 0o006;

/// Layers of the profile that are not files: environment variables and options `--set`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Layers {
    environment: Vec<(String, String)>,
    settings: Vec<(String, String)>,
}

/// State of a file or a directory when the loader read it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum FileState {
    Absent,
    /// The file cannot be read. The text is the error.
    Unreadable(String),
    /// Length of the file, and whether any user may read or change it.
    File {
        bytes: u64,
        open_to_all: bool,
    },
    /// Names in a directory that have a certain ending. The names are stored without the ending.
    Names(Vec<String>),
}

#[derive(Serialize, Deserialize)]
struct Record {
    name: String,
    found: FileState,
}

/// Values by which a change of a file or directory is detected: modification time, device and inode, size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileStamp {
    modified: (i64, i64),
    place: (u64, u64),
    size: u64,
}

impl FileStamp {
    fn of(found: &Metadata) -> FileStamp {
        FileStamp {
            modified: (found.mtime(), found.mtime_nsec()),
            place: (found.dev(), found.ino()),
            size: found.size(),
        }
    }
}

/// Sources of one profile: everything that the loader read from files, environment and command line. The
/// content of these files is in the field `file`.
#[derive(Debug)]
pub struct Sources {
    file: File,
    /// Byte position in `file` after the last record.
    end: u64,
    layers: Layers,
    /// States of the files, by name relative to the directory of the profile. The number is the position of the file's
    /// content in `file`.
    known: BTreeMap<String, (FileState, u64)>,
    /// First write error. [`Sources::finish`] returns this error, because the sources are then incomplete.
    failed: Option<Error>,
}

impl Sources {
    /// Creates sources in an empty file. The loader adds the records.
    pub fn create(file: File, environment: &[(String, String)], settings: &[(String, String)]) -> Sources {
        let layers = Layers { environment: environment.to_vec(), settings: settings.to_vec() };
        let mut sources = Sources { file, end: 0, layers, known: BTreeMap::new(), failed: None };
        sources.write(FORM.as_bytes());
        let line = serde_json::to_string(&sources.layers).map(|line| line + "\n");
        sources.write(line.unwrap_or_default().as_bytes());
        sources
    }

    /// Opens the sources in the first `length` bytes of a file.
    ///
    /// # Errors
    /// The file cannot be read, or has the format of another version.
    pub fn open(file: File, length: u64) -> Result<Sources> {
        let invalid =
            || Error::new(ErrorKind::InvalidData, "the file has the format of another program version");
        let mut reader = BufReader::new(&file);
        reader.seek(SeekFrom::Start(0))?;
        let mut end = 0;
        let line = |reader: &mut BufReader<&File>, end: &mut u64| {
            let mut line = String::new();
            let read = reader.take(LONGEST_LINE.min(length - *end)).read_line(&mut line)? as u64;
            *end += read;
            Ok::<_, Error>(line)
        };
        if line(&mut reader, &mut end)? != FORM {
            return Err(invalid());
        }
        let layers = serde_json::from_str(&line(&mut reader, &mut end)?).map_err(|_| invalid())?;
        let mut known = BTreeMap::new();
        while end < length {
            let Record { name, found } =
                serde_json::from_str(&line(&mut reader, &mut end)?).map_err(|_| invalid())?;
            let place = end;
            if let FileState::File { bytes, .. } = found {
                end = end.checked_add(bytes).filter(|end| *end <= length).ok_or_else(invalid)?;
                reader.seek(SeekFrom::Start(end))?;
            }
            known.insert(name, (found, place));
        }
        Ok(Sources { file, end, layers, known, failed: None })
    }

    /// Returns the file with the complete sources, and its length in bytes.
    ///
    /// # Errors
    /// The first failed write.
    pub fn finish(self) -> Result<(File, u64)> {
        self.failed.map_or(Ok((self.file, self.end)), Err)
    }

    /// Returns the environment variables that set keys of the profile.
    pub fn environment(&self) -> &[(String, String)] {
        &self.layers.environment
    }

    /// Returns the options `--set` of the command line that set keys of the profile.
    pub fn settings(&self) -> &[(String, String)] {
        &self.layers.settings
    }

    /// Returns whether the profile at this path was read from a file. If it was not, the profile is part of the
    /// program.
    pub fn has_file(&self, path: &Path) -> bool {
        matches!(self.found(&layer_name(path)), Some(FileState::File { .. }))
    }

    /// Records that the file at this path does not exist, because the profile is part of the program.
    pub fn put_absent(&mut self, path: &Path) {
        self.put(&layer_name(path), FileState::Absent, &[]);
    }

    /// Returns a stamp of each file on disk. If two calls return equal stamps, no file has changed between the calls.
    /// `path` is the path of the profile.
    pub fn stamps(&self, path: &Path) -> Vec<Option<FileStamp>> {
        let directory = path.parent().unwrap_or(Path::new(""));
        let stamp = |name: &String| {
            // The names in a directory change together with the directory.
            let place = name.rsplit_once("/*").map_or(name.as_str(), |(folder, _)| folder);
            std::fs::metadata(directory.join(place)).ok().map(|found| FileStamp::of(&found))
        };
        self.known.keys().map(stamp).collect()
    }

    /// Returns the names of the files, environment variables and `--set` options whose content or value now differs
    /// from these sources. `path` is the path of the profile.
    pub fn differences(
        &self,
        path: &Path,
        environment: &[(String, String)],
        settings: &[(String, String)],
    ) -> Vec<String> {
        let directory = path.parent().unwrap_or(Path::new(""));
        let differs = |(name, (found, _)): (&String, &(FileState, u64))| {
            let now = safe_file::read(&directory.join(name), safe_file::LARGEST);
            let is_same = match found {
                FileState::Absent => now.is_err_and(|why| why.kind() == ErrorKind::NotFound),
                FileState::Unreadable(_) => now.is_err(),
                FileState::File { .. } => {
                    now.is_ok_and(|now| self.bytes(name).is_ok_and(|bytes| bytes == now))
                }
                FileState::Names(names) => {
                    let (folder, end) = name.rsplit_once("/*").unwrap_or_default();
                    names_in(&directory.join(folder), end) == *names
                }
            };
            (!is_same).then(|| name.clone())
        };
        let mut different: Vec<String> = self.known.iter().filter_map(differs).collect();
        let mut layer = |before: &[(String, String)], now: &[(String, String)], words: &str| {
            let changed = before.iter().filter(|one| !now.contains(one));
            let new = now.iter().filter(|one| !before.iter().any(|(name, _)| *name == one.0));
            different.extend(changed.chain(new).map(|(name, _)| format!("{words} {name}")));
        };
        layer(self.environment(), environment, "environment");
        layer(self.settings(), settings, "--set");
        different
    }

    pub(crate) fn found(&self, name: &str) -> Option<&FileState> {
        self.known.get(name).map(|(found, _)| found)
    }

    /// Returns the bytes of a stored file, or a sentence with the reason why they are not available.
    pub(crate) fn bytes(&self, name: &str) -> std::result::Result<Vec<u8>, String> {
        match self.known.get(name) {
            Some((FileState::File { bytes, .. }, place)) => {
                let length = usize::try_from(*bytes).unwrap_or(usize::MAX);
                let mut found = vec![0; length];
                let read = self.file.read_exact_at(&mut found, *place);
                read.map(|()| found).map_err(|why| format!("{name} cannot be read: {why}"))
            }
            Some((FileState::Unreadable(why), _)) => Err(why.clone()),
            _ => Err(format!("{name} is not among the files of this profile")),
        }
    }

    pub(crate) fn put_file(&mut self, name: &str, bytes: &[u8], open_to_all: bool) {
        self.put(name, FileState::File { bytes: bytes.len() as u64, open_to_all }, bytes);
    }

    /// Records the state of a file, with its bytes. Only the first record of each name is stored.
    pub(crate) fn put(&mut self, name: &str, found: FileState, bytes: &[u8]) {
        if self.known.contains_key(name) {
            return;
        }
        let record = Record { name: name.to_owned(), found };
        let line = serde_json::to_string(&record).map(|line| line + "\n");
        self.write(line.unwrap_or_default().as_bytes());
        let place = self.end;
        self.write(bytes);
        self.known.insert(record.name, (record.found, place));
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Err(why) = self.file.write_all_at(bytes, self.end) {
            self.failed.get_or_insert(why);
        }
        self.end += bytes.len() as u64;
    }
}

/// Returns the name of a layer that is a file: its file name without the directory.
pub(crate) fn layer_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Returns the names in a directory that end with `end`, sorted and without this ending. Empty if the directory cannot
/// be read.
pub(crate) fn names_in(directory: &Path, end: &str) -> Vec<String> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter_map(|name| Some(name.strip_suffix(end)?.to_owned())).collect();
    names.sort();
    names
}

/// Returns whether any user of this computer may read or change a file.
pub(crate) fn is_open_to_all(path: &PathBuf) -> bool {
    std::fs::metadata(path).is_ok_and(|found| found.permissions().mode() & OF_OTHERS != 0)
}
