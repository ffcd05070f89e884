//! The disk's end of the queue: files of days, and what becomes of a disk that does not keep them.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use super::outputs::Tears;
use super::{A_DAY, Job};
use crate::gateway::disk::Files;
use crate::gateway::log::outputs::{ENDING, HEADER};
use crate::gateway::memory::Memory;
use crate::observe::events::{Event, Journal};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

/// Whether a log has this header and ends with a whole row: one that a power cut left half-written would swallow the
/// next.
fn continues(path: &Path, header: &[u8]) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let mut begins = vec![0; header.len()];
    if file.metadata()?.len() < u64::try_from(header.len()).unwrap_or(u64::MAX) {
        return Ok(false);
    }
    file.read_exact(&mut begins)?;
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    Ok(begins == header && last == *b"\n")
}

pub(super) struct StorageThread {
    directory: PathBuf,
    state: PathBuf,
    log: DayFile,
    outputs: DayFile,
    /// Rows of outputs that were made before so many were lost stand behind missing ones.
    whole_since: u64,
    failing: BTreeMap<&'static str, ()>,
    torn: Arc<AtomicBool>,
    tears: Arc<Tears>,
    journal: Arc<Journal>,
}

impl StorageThread {
    pub(super) fn new(
        profile: &Profile,
        directory: &Path,
        header: String,
        (torn, tears): (Arc<AtomicBool>, Arc<Tears>),
        journal: Arc<Journal>,
    ) -> StorageThread {
        let (machine, keep) = (profile.name.as_str(), profile.history.keep);
        StorageThread {
            directory: directory.to_owned(),
            state: Memory::path(directory, profile),
            log: DayFile::new(directory, machine, ".csv", header, keep),
            outputs: DayFile::new(directory, machine, ENDING, HEADER.to_owned(), keep),
            whole_since: 0,
            failing: BTreeMap::new(),
            torn,
            tears,
            journal,
        }
    }

    pub(super) fn work(&mut self, jobs: &Receiver<Job>) {
        while let Ok(job) = jobs.recv() {
            self.take(job);
        }
    }

    pub(super) fn take(&mut self, job: Job) {
        match job {
            Job::Row(at, row) => {
                let done = self.log.write(at, &row);
                if done.is_err() {
                    self.torn.store(true, Ordering::Relaxed);
                }
                self.report(at, "the log", done);
            }
            Job::OutputRow { at, row, tear } => {
                self.tears.has_left_the_queue();
                self.write_output(at, &row, tear);
            }
            Job::State(memory) => {
                let done = memory.save(&Files, &self.state);
                self.report(memory.at, "the state", done);
            }
        }
    }

    /// What stands behind missing rows can be replayed only from where its output begins anew: until then it is left out.
    fn write_output(&mut self, at: Moment, row: &[u8], tear: u64) {
        if tear < self.whole_since {
            return;
        }
        let done = self.outputs.write(at, row);
        if done.is_err() {
            self.whole_since = self.tears.tear();
        }
        self.report(at, "the log of the outputs", done);
    }
    fn report(&mut self, at: Moment, what: &'static str, done: std::io::Result<()>) {
        match done {
            Ok(()) => {
                if self.failing.remove(what).is_some() {
                    self.journal.report(at, &Event::KeptAgain { what: what.to_owned() });
                }
            }
            Err(error) => {
                if self.failing.insert(what, ()).is_none() {
                    let why = format!("{}: {error}", self.directory.display());
                    self.journal.report(at, &Event::NotKept { what: what.to_owned(), why });
                }
            }
        }
    }
}

/// A log of which there is a file a day.
pub(super) struct DayFile {
    directory: PathBuf,
    machine: String,
    /// What stands behind the day in its name.
    ending: &'static str,
    header: String,
    keep: Duration,
    day: u64,
    file: Option<File>,
}

impl DayFile {
    pub(super) fn new(
        directory: &Path,
        machine: &str,
        ending: &'static str,
        header: String,
        keep: Duration,
    ) -> DayFile {
        let (directory, machine) = (directory.to_owned(), machine.to_owned());
        DayFile { directory, machine, ending, header, keep, day: 0, file: None }
    }

    /// Writes a row into the file of its day. After a failure a file is looked for anew: half of a row may stand there.
    pub(super) fn write(&mut self, at: Moment, row: &[u8]) -> std::io::Result<()> {
        let written = self.file_of(at).and_then(|file| file.write_all(row));
        if written.is_err() {
            self.file = None;
        }
        written
    }

    fn file_of(&mut self, at: Moment) -> std::io::Result<&mut File> {
        let day = at.as_nanos() / A_DAY;
        let file = match self.file.take().filter(|_| day == self.day) {
            Some(file) => file,
            None => {
                let file = self.open(&date(at))?;
                self.day = day;
                self.discard_old(at);
                file
            }
        };
        Ok(self.file.insert(file))
    }

    /// The day's file. One that was begun with other columns is left as it is and a new one is begun beside it.
    fn open(&self, day: &str) -> std::io::Result<File> {
        std::fs::create_dir_all(&self.directory)?;
        for part in 1.. {
            let suffix = if part == 1 { String::new() } else { format!(".{part}") };
            let path = self.directory.join(format!("{}-{day}{suffix}{}", self.machine, self.ending));
            let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
            if file.metadata()?.len() == 0 {
                file.write_all(self.header.as_bytes())?;
                return Ok(file);
            }
            if continues(&path, self.header.as_bytes())? {
                return Ok(file);
            }
        }
        Err(std::io::Error::other("no free name for the log"))
    }

    /// Every log of this machine that is older than it is kept, of whatever kind.
    fn discard_old(&self, now: Moment) {
        let oldest = Moment::from_nanos(
            now.as_nanos().saturating_sub(u64::try_from(self.keep.as_nanos()).unwrap_or(u64::MAX)),
        );
        let oldest = date(oldest);
        let Ok(entries) = std::fs::read_dir(&self.directory) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let day = name.to_str().and_then(|name| name.strip_prefix(&format!("{}-", self.machine)));
            let day = day.filter(|rest| rest.ends_with(".csv")).and_then(|rest| rest.get(..10));
            if day.is_some_and(|day| day.as_bytes()[4] == b'-' && day < oldest.as_str()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

fn date(at: Moment) -> String {
    at.to_string().chars().take(10).collect()
}
