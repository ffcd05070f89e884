//! Thread that writes logs and events to one file for each day, and reports when the disk does not store them.

use std::collections::BTreeMap;
use std::fs::{File, Metadata};
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use jiff::civil::Date;

use super::events::EventsFile;
use super::outputs::RowLosses;
use super::retention::{day, expired};
use super::stamps::Stamped;
use super::{Job, QueuedJob};
use crate::fieldbus::explain::explain_system;
use crate::gateway::store::disk::{append, make_directory};
use crate::gateway::store::documents::{DiskCause, is_news};
use crate::gateway::store::log::outputs::{ENDING, HEADER};
use crate::observe::events::{Event, Journal};
use isotherm_core::quantity::{Moment, Shifted, time};
use isotherm_profile::{History, Profile, safe_file};

/// Interval of the checks for logs to delete.
const TIDY_EVERY: Duration = Duration::from_hours(1);
/// Time for which the thread collects jobs, if jobs arrive faster than it can process them.
const COLLECTED_FOR: Duration = Duration::from_millis(10);

/// Returns whether a log has this header and ends with a complete row. A row cannot be appended after an incomplete
/// row, which a power cut may leave.
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

/// Log file that contains only complete rows.
struct WholeRows {
    path: PathBuf,
    file: File,
    length: u64,
}

impl WholeRows {
    /// Appends a complete row to the log, or nothing if the disk is full. A part of a row would make the next row
    /// invalid.
    fn append(&mut self, row: &[u8]) -> std::io::Result<()> {
        self.file.write_all(row).inspect_err(|_| drop(self.file.set_len(self.length)))?;
        self.length += row.len() as u64;
        Ok(())
    }

    /// Returns whether the open file is still at `path`. Returns `false` after the file was deleted or replaced.
    fn is_there(&self) -> bool {
        let place = |found: Metadata| (found.dev(), found.ino());
        let there = std::fs::metadata(&self.path).map(place).ok();
        there.is_some() && there == self.file.metadata().map(place).ok()
    }
}

/// Number of bytes at the end of a log file in which the last row with a time is searched.
const LAST_ROW: u64 = 65_536;

/// Returns the time of the last row of a log. `None` if the row cannot be read.
pub(super) fn last_stamp(path: &Path) -> Option<Moment> {
    let mut file = safe_file::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(LAST_ROW))).ok()?;
    let rows = BufReader::new(file).split(b'\n').map_while(Result::ok);
    let last = rows.filter_map(|row| {
        let first = row.split(|byte| *byte == b',').next()?;
        time::parse(std::str::from_utf8(first).ok()?).ok()
    });
    last.last()
}

/// State of the thread that writes logs and events to disk.
pub(super) struct StorageThread {
    directory: PathBuf,
    machine: String,
    log: DayFile,
    outputs: DayFile,
    history: History,
    /// Time of the last check for logs to delete.
    tidied: Option<Moment>,
    events: EventsFile,
    /// Whether the queue already contains a job that writes new events.
    is_woken: Arc<AtomicBool>,
    /// Number of the last loss of output-log rows. Rows from before this loss are not written, because rows that a
    /// replay needs are missing.
    whole_since: u64,
    failing: BTreeMap<&'static str, DiskCause>,
    torn: Arc<AtomicBool>,
    tears: Arc<RowLosses>,
    journal: Arc<Journal>,
}

impl StorageThread {
    pub(super) fn new(
        profile: &Profile,
        directory: &Path,
        header: String,
        (torn, tears): (Arc<AtomicBool>, Arc<RowLosses>),
        journal: Arc<Journal>,
    ) -> StorageThread {
        let machine = profile.name.as_str();
        StorageThread {
            directory: directory.to_owned(),
            machine: machine.to_owned(),
            log: DayFile::new(directory, machine, ".csv", header),
            outputs: DayFile::new(directory, machine, ENDING, HEADER.to_owned()),
            history: profile.history.clone(),
            tidied: None,
            events: EventsFile::new(directory, machine, journal.clone()),
            is_woken: Arc::default(),
            whole_since: 0,
            failing: BTreeMap::new(),
            torn,
            tears,
            journal,
        }
    }

    pub(super) fn work(&mut self, jobs: &Receiver<QueuedJob>) {
        while let Ok(job) = jobs.recv() {
            self.take(*job);
            let Ok(next) = jobs.try_recv() else { continue };
            self.take(*next);
            // Otherwise each further row would wake this thread, at the expense of the line that sends it.
            std::thread::sleep(COLLECTED_FOR);
            jobs.try_iter().for_each(|job| self.take(*job));
        }
        let _ = self.events.write_all();
    }

    pub(super) fn is_woken(&self) -> Arc<AtomicBool> {
        self.is_woken.clone()
    }

    pub(super) fn take(&mut self, job: Job) {
        self.is_woken.store(false, Ordering::Relaxed);
        let at = match job {
            Job::Row { at, stamped, row } => {
                let done = self.log.write(at.shifted(stamped.shift), stamped, &row);
                if done.is_err() {
                    self.torn.store(true, Ordering::Relaxed);
                }
                self.report(at, "the log", done);
                self.tidy(at, stamped);
                Some(at)
            }
            Job::OutputRow { at, stamped, row, tear } => {
                self.tears.has_left_the_queue();
                self.write_output((at, stamped), &row, tear);
                self.tidy(at, stamped);
                Some(at)
            }
            Job::Sync { at } => {
                self.find_logs(at);
                // A successful sync shows nothing if rows are not written.
                for (what, done) in
                    [("the log", self.log.sync()), ("the log of the outputs", self.outputs.sync())]
                {
                    if done.is_err() {
                        self.report(at, what, done);
                    }
                }
                Some(at)
            }
            Job::Events => None,
        };
        // Events that the disk does not store keep waiting. The next job tries again.
        let done = self.events.write_all();
        if let Some(at) = at {
            self.report(at, "the events", done);
        }
    }

    /// Checks whether a log file was removed. If so, the next row begins a new file, and contains the state from
    /// which a replay continues.
    fn find_logs(&mut self, at: Moment) {
        if let Err(gone) = self.log.check() {
            self.torn.store(true, Ordering::Relaxed);
            self.report(at, "the log", Err(gone));
        }
        if let Err(gone) = self.outputs.check() {
            self.whole_since = self.tears.tear();
            self.report(at, "the log of the outputs", Err(gone));
        }
    }

    /// Writes a row of the output log. After a loss, rows are not written until a row contains the state from which a
    /// replay can continue.
    fn write_output(&mut self, (at, stamped): (Moment, Stamped), row: &[u8], tear: u64) {
        if tear < self.whole_since {
            return;
        }
        let done = self.outputs.write(at.shifted(stamped.shift), stamped, row);
        if done.is_err() {
            self.whole_since = self.tears.tear();
        }
        self.report(at, "the log of the outputs", done);
    }

    /// Deletes logs that are too old or whose total size is too large, and reports this. Checks at most once an hour.
    fn tidy(&mut self, at: Moment, stamped: Stamped) {
        if self.tidied.is_some_and(|last| at.since(last) < TIDY_EVERY) {
            return;
        }
        self.tidied = Some(at);
        let today = day(at.shifted(stamped.shift));
        for (names, why) in expired(&self.directory, &self.machine, &self.history, today) {
            let gone =
                names.into_iter().filter(|name| std::fs::remove_file(self.directory.join(name)).is_ok());
            let names: Vec<String> = gone.collect();
            if !names.is_empty() {
                self.journal.report(at, &Event::LogsDeleted { names, why });
            }
        }
    }

    fn report(&mut self, at: Moment, what: &'static str, done: std::io::Result<()>) {
        match done {
            Ok(()) => {
                if self.failing.remove(what).is_some() {
                    self.journal.report(at, &Event::KeptAgain { what: what.to_owned() });
                }
            }
            Err(error) => {
                if is_news(self.failing.entry(what).or_default(), &error) {
                    let directory = self.directory.display();
                    let why = explain_system(&error).within(|cause| format!("{directory}: {cause}"));
                    self.journal.report(at, &Event::NotKept { what: what.to_owned(), why });
                }
            }
        }
    }
}

/// Log with one file for each day.
pub(super) struct DayFile {
    directory: PathBuf,
    machine: String,
    /// End of the file name, after the date.
    ending: &'static str,
    header: String,
    of: Option<(Date, Stamped)>,
    file: Option<WholeRows>,
}

impl DayFile {
    pub(super) fn new(directory: &Path, machine: &str, ending: &'static str, header: String) -> DayFile {
        let (directory, machine) = (directory.to_owned(), machine.to_owned());
        DayFile { directory, machine, ending, header, of: None, file: None }
    }

    /// Writes a row to the file of its day. After a failure, the next row opens the file again.
    pub(super) fn write(&mut self, stamp: Moment, stamped: Stamped, row: &[u8]) -> std::io::Result<()> {
        let written = self.file_of(stamp, stamped).and_then(|file| file.append(row));
        if written.is_err() {
            self.file = None;
        }
        written
    }

    /// Checks whether the log file of the day, or its directory, was removed. If so, the next row begins a new file.
    fn check(&mut self) -> std::io::Result<()> {
        let Some(file) = self.file.take_if(|file| !file.is_there()) else { return Ok(()) };
        let text = format!("{} was removed", file.path.display());
        Err(std::io::Error::new(ErrorKind::NotFound, text))
    }

    /// Synchronises the written log rows to disk, so that they remain after a power cut.
    fn sync(&self) -> std::io::Result<()> {
        self.file.as_ref().map_or(Ok(()), |rows| rows.file.sync_data())
    }

    fn file_of(&mut self, stamp: Moment, stamped: Stamped) -> std::io::Result<&mut WholeRows> {
        let of = (day(stamp), stamped);
        let file = match self.file.take().filter(|_| self.of == Some(of)) {
            Some(file) => file,
            None => {
                let is_set = self.of.map_or(stamped.file > 0, |(_, before)| before != stamped);
                let opened = self.open(stamp, is_set)?;
                self.of = Some(of);
                opened
            }
        };
        Ok(self.file.insert(file))
    }

    /// Opens the log file of the day. Begins a new file if the existing file has other columns, or if its last row is
    /// later than `stamp`. Also begins a new file if the rows are from before the clock was set.
    fn open(&self, stamp: Moment, is_set: bool) -> std::io::Result<WholeRows> {
        let day = day(stamp);
        make_directory(&self.directory)?;
        for part in 1.. {
            let suffix = if part == 1 { String::new() } else { format!(".{part}") };
            let path = self.directory.join(format!("{}-{day}{suffix}{}", self.machine, self.ending));
            let file = append(&path)?;
            let mut rows = WholeRows { length: file.metadata()?.len(), file, path };
            if rows.length == 0 {
                rows.append(self.header.as_bytes())?;
                return Ok(rows);
            }
            let is_earlier = || last_stamp(&rows.path).is_none_or(|last| last <= stamp);
            if !is_set && continues(&rows.path, self.header.as_bytes())? && is_earlier() {
                return Ok(rows);
            }
        }
        Err(std::io::Error::other("no free name for the log: move old logs away"))
    }
}
