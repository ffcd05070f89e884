//! The disk's end of the queue: files of days, and what becomes of a disk that does not keep them.

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

use super::Job;
use super::events::EventsFile;
use super::keeping::{Keep, breaks, day, logs, superfluous};
use super::outputs::Tears;
use super::stamps::Stamped;
use crate::fieldbus::explain::explain_system;
use crate::gateway::disk::{append, make_directory};
use crate::gateway::log::outputs::{ENDING, HEADER};
use crate::gateway::store::{DiskCause, is_news};
use crate::observe::events::{Event, Journal};
use isotherm_core::quantity::{Moment, Shifted, time};
use isotherm_profile::duration_text;
use isotherm_profile::{Profile, regular};

/// How often it is looked for logs that need not be kept.
const TIDY_EVERY: Duration = Duration::from_hours(1);

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

/// A file of whole rows.
struct WholeRows {
    path: PathBuf,
    file: File,
    length: u64,
}

impl WholeRows {
    /// All of it or nothing: half a row of a disk that is full now would swallow the next.
    fn append(&mut self, row: &[u8]) -> std::io::Result<()> {
        self.file.write_all(row).inspect_err(|_| drop(self.file.set_len(self.length)))?;
        self.length += row.len() as u64;
        Ok(())
    }

    /// It is still what lies at its path.
    fn is_there(&self) -> bool {
        let place = |found: Metadata| (found.dev(), found.ino());
        let there = std::fs::metadata(&self.path).map(place).ok();
        there.is_some() && there == self.file.metadata().map(place).ok()
    }
}

/// The longest last row that is looked at.
const LAST_ROW: u64 = 65_536;

/// The time of a log's last row; `None` where that cannot be read.
pub(super) fn last_stamp(path: &Path) -> Option<Moment> {
    let mut file = regular::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(LAST_ROW))).ok()?;
    let rows = BufReader::new(file).split(b'\n').map_while(Result::ok);
    let last = rows.filter_map(|row| {
        let first = row.split(|byte| *byte == b',').next()?;
        time::parse(std::str::from_utf8(first).ok()?).ok()
    });
    last.last()
}

pub(super) struct StorageThread {
    directory: PathBuf,
    machine: String,
    log: DayFile,
    outputs: DayFile,
    keep: Keep,
    /// When it was last looked for logs that need not be kept.
    tidied: Option<Moment>,
    events: EventsFile,
    /// Somebody has said that there are events.
    is_woken: Arc<AtomicBool>,
    /// Rows of outputs that were made before so many were lost stand behind missing ones.
    whole_since: u64,
    failing: BTreeMap<&'static str, DiskCause>,
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
        let machine = profile.name.as_str();
        StorageThread {
            directory: directory.to_owned(),
            machine: machine.to_owned(),
            log: DayFile::new(directory, machine, ".csv", header),
            outputs: DayFile::new(directory, machine, ENDING, HEADER.to_owned()),
            keep: Keep { span: profile.history.keep, size: profile.history.max_size },
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

    pub(super) fn work(&mut self, jobs: &Receiver<Job>) {
        while let Ok(job) = jobs.recv() {
            self.take(job);
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
                self.look_for_logs(at);
                // That one was put on the disk says nothing where rows are not taken.
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
        // They go on waiting where the disk does not take them; the next job tries again.
        let done = self.events.write_all();
        if let Some(at) = at {
            self.report(at, "the events", done);
        }
    }

    /// Where one was removed, what comes next stands in a new one, and says from where it goes on.
    fn look_for_logs(&mut self, at: Moment) {
        if let Err(gone) = self.log.look() {
            self.torn.store(true, Ordering::Relaxed);
            self.report(at, "the log", Err(gone));
        }
        if let Err(gone) = self.outputs.look() {
            self.whole_since = self.tears.tear();
            self.report(at, "the log of the outputs", Err(gone));
        }
    }

    /// What stands behind missing rows can be replayed only from where its output begins anew: until then it is left out.
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

    /// Deletes what need not be kept, once an hour, and says so.
    fn tidy(&mut self, at: Moment, stamped: Stamped) {
        if self.tidied.is_some_and(|last| at.since(last) < TIDY_EVERY) {
            return;
        }
        self.tidied = Some(at);
        let logs = logs(&self.directory, &self.machine);
        let set = breaks(&self.directory, &logs);
        let found = superfluous(&logs, self.keep, day(at.shifted(stamped.shift)), &set);
        let why = [
            (found.too_old, format!("older than {}", duration_text(self.keep.span))),
            (found.too_large, format!("all logs together are larger than {} MB", self.keep.size / 1_000_000)),
        ];
        for (names, why) in why {
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

/// A log of which there is a file a day.
pub(super) struct DayFile {
    directory: PathBuf,
    machine: String,
    /// What stands behind the day in its name.
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

    /// Writes a row into the file of its day. After a failure a file is looked for anew.
    pub(super) fn write(&mut self, stamp: Moment, stamped: Stamped, row: &[u8]) -> std::io::Result<()> {
        let written = self.file_of(stamp, stamped).and_then(|file| file.append(row));
        if written.is_err() {
            self.file = None;
        }
        written
    }

    /// Looks whether somebody has removed the file, or its directory: then the next row begins another.
    fn look(&mut self) -> std::io::Result<()> {
        let Some(file) = self.file.take_if(|file| !file.is_there()) else { return Ok(()) };
        let text = format!("{} was removed", file.path.display());
        Err(std::io::Error::new(ErrorKind::NotFound, text))
    }

    /// What a power cut would take lies on the disk then.
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

    /// The day's file. One that was begun with other columns, or whose last row is later, is left as it is and a new one is
    /// begun beside it; so is one from before the clock was set.
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
        Err(std::io::Error::other("no free name for the log"))
    }
}
