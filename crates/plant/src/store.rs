//! What could not be told, on disk until it can be: records, oldest first, bounded in bytes.
//!
//! ```text
//! DIRECTORY/00000000000000000000.records     records 0, 1, 2 …: header, then length, checksum and bytes of each
//! DIRECTORY/00000000000000000210.records     from 210 on; only the last file grows, and none is written to after a restart
//! DIRECTORY/told                             all before this number were told
//! ```
//!
//! **Killed at any instant**, every record that [`push`](Store::push) has taken is there again, in order and unchanged; half of
//! one is none. Records that were told and not yet marked by [`drop_first`](Store::drop_first) come again, no others. After a
//! power cut the same holds for what [`sync`](Store::sync) was called for.
//!
//! **Full**: the oldest file goes as a whole, and its records that were not told are counted.
//!
//! Records are numbered, and the number is part of the checksum: bytes at another place, of another file or of an earlier life
//! are no record. What a damaged file has lost is counted, as far as the files after it show how much it was.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

mod number;
mod segment;
#[cfg(test)]
mod tests;
mod topics;

pub use number::NumberFile;
pub use topics::TopicsFile;

use self::segment::{FRAME, HEADER, LONGEST, Segment};
use crate::seam::Record;

const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// As the other files of the state directory have it.
const MODE: u32 = 0o640;
/// A file ends when it is so long, or a sixteenth of what all may take.
const LONGEST_FILE: u64 = 1024 * 1024;
const FILES: u64 = 16;

/// Records on disk.
#[derive(Debug)]
pub struct Store {
    directory: PathBuf,
    most_bytes: u64,
    longest_file: u64,
    /// Oldest first; the last one grows while `writer` is there.
    segments: VecDeque<Segment>,
    writer: Option<File>,
    /// The disk may not know yet that the last file is there.
    is_new: bool,
    /// The number of the first record that was not told.
    told: u64,
    /// The number of the next record.
    next: u64,
    told_file: NumberFile,
    dropped: u64,
    disk: Disk,
}

/// More news than these nobody has asked for.
const MOST_NEWS: usize = 16;

#[derive(Debug, Default)]
struct Disk {
    fails: bool,
    lost: u64,
    news: VecDeque<DiskNews>,
}

/// What is said of the disk, once each time that it changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DiskNews {
    /// Records cannot be written, for this reason.
    Fails(String),
    /// They can again; so many were lost meanwhile.
    Works {
        /// Records.
        lost: u64,
    },
}

impl Store {
    /// The records in this directory, which is made where it is not there. All files together take no more than `most_bytes`.
    ///
    /// # Errors
    /// The directory cannot be made or read.
    pub fn open(directory: impl AsRef<Path>, most_bytes: u64) -> io::Result<Store> {
        Store::in_files_of(directory.as_ref(), most_bytes, LONGEST_FILE.min(most_bytes / FILES))
    }

    fn in_files_of(directory: &Path, most_bytes: u64, longest_file: u64) -> io::Result<Store> {
        let directory = directory.to_owned();
        fs::create_dir_all(&directory)?;
        let told_file = NumberFile::at(directory.join("told"));
        let marked = told_file.read()?;
        let mut segments = VecDeque::new();
        for first in segment::numbers(&directory)? {
            match Segment::open(&directory, first)? {
                Some(segment) => segments.push_back(segment),
                None => fs::remove_file(Segment { first, count: 0, bytes: 0 }.path(&directory))?,
            }
        }
        let mut store = Store {
            directory,
            most_bytes,
            longest_file,
            segments,
            writer: None,
            is_new: false,
            told: marked.unwrap_or(0),
            next: 0,
            told_file,
            dropped: 0,
            disk: Disk::default(),
        };
        if marked.is_none() {
            store.told = store.segments.front().map_or(0, |segment| segment.first);
        }
        store.next = store.segments.back().map_or(0, Segment::end).max(store.told);
        store.dropped = store.missing();
        store.forget_told()?;
        // It may be smaller than it was.
        store.make_room(0)?;
        Ok(store)
    }

    /// How many records are between what was told and what is there.
    fn missing(&self) -> u64 {
        let mut expected = self.told;
        let mut missing = 0;
        for segment in self.segments.iter().filter(|segment| segment.end() > self.told) {
            missing += segment.first.saturating_sub(expected);
            expected = segment.end();
        }
        missing
    }

    /// Adds a record behind the others. Where it has no room, the oldest go.
    ///
    /// # Errors
    /// The disk does not take it, or it is longer than all records may be together. It is lost, and [`news`](Store::news) says
    /// so once.
    pub fn push(&mut self, record: &Record) -> io::Result<()> {
        let bytes = FRAME + u64::try_from(record.0.len()).unwrap_or(u64::MAX - FRAME);
        if record.0.len() > LONGEST || Segment::on_disk(HEADER + bytes) > self.most_bytes {
            self.dropped += 1;
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "longer than a record may be"));
        }
        let added = self.add(record, bytes);
        if added.is_err() {
            self.give_up_file();
        }
        self.disk.hear(&added);
        added
    }

    fn add(&mut self, record: &Record, bytes: u64) -> io::Result<()> {
        let has_room = self.segments.back().is_some_and(|last| last.bytes + bytes <= self.longest_file);
        if self.writer.is_some() && !has_room {
            self.sync()?;
            self.writer = None;
        }
        self.make_room(bytes)?;
        let file = match &mut self.writer {
            Some(file) => file,
            none => {
                let (segment, file) = Segment::create(&self.directory, self.next)?;
                self.segments.push_back(segment);
                self.is_new = true;
                none.insert(file)
            }
        };
        let Some(last) = self.segments.back_mut() else { return Err(io::Error::other("no file")) };
        last.push(file, record)?;
        self.next += 1;
        Ok(())
    }

    /// Whatever stands behind its last record, this file is not added to again.
    fn give_up_file(&mut self) {
        let Some(last) = self.segments.back_mut() else { return };
        let path = last.path(&self.directory);
        if self.writer.take().is_some() || last.count == 0 {
            last.bytes = fs::metadata(&path).map_or(last.bytes, |found| found.len());
        }
        if last.count == 0 {
            self.segments.pop_back();
            // Where it stays, the next start removes it.
            let _ = fs::remove_file(path);
        }
    }

    /// Removes the oldest files until so many bytes more have room.
    fn make_room(&mut self, bytes: u64) -> io::Result<()> {
        let mut lost_some = false;
        while self.after(bytes) > self.most_bytes {
            let Some(oldest) = self.segments.front() else { break };
            remove(&oldest.path(&self.directory))?;
            let untold = oldest.end().saturating_sub(oldest.first.max(self.told));
            self.told = self.told.max(oldest.end());
            self.dropped += untold;
            lost_some = true;
            self.segments.pop_front();
            if self.segments.is_empty() {
                self.writer = None;
            }
        }
        if lost_some { self.told_file.write(self.told) } else { Ok(()) }
    }

    /// What all files take with so many bytes more.
    fn after(&self, bytes: u64) -> u64 {
        let sizes = self.segments.iter().map(|segment| segment.bytes);
        let grows = self.writer.is_some();
        let last = self.segments.len().saturating_sub(1);
        let grown = sizes.enumerate().map(|(at, size)| if grows && at == last { size + bytes } else { size });
        let taken: u64 = grown.map(Segment::on_disk).sum();
        if grows || bytes == 0 { taken } else { taken + Segment::on_disk(HEADER + bytes) }
    }

    /// Up to so many of the oldest records, which stay. What turns out to be damaged is left out and counted.
    ///
    /// # Errors
    /// The disk does not give them.
    pub fn first(&mut self, most: usize) -> io::Result<Vec<Record>> {
        let most = u64::try_from(most).unwrap_or(u64::MAX);
        loop {
            self.forget_told()?;
            let Some(segment) = self.segments.front().filter(|_| most > 0) else { return Ok(Vec::new()) };
            let from = self.told.max(segment.first);
            let found = segment.records(&self.directory, from, most)?;
            self.told = from;
            let count = u64::try_from(found.len()).unwrap_or(u64::MAX);
            if count < most.min(segment.end() - from) {
                self.drop_damaged(from + count)?;
            }
            if !found.is_empty() {
                return Ok(found);
            }
        }
    }

    /// From this number on, the oldest file is not readable any more.
    fn drop_damaged(&mut self, from: u64) -> io::Result<()> {
        let is_growing = self.segments.len() == 1;
        let Some(oldest) = self.segments.front_mut() else { return Ok(()) };
        self.dropped += oldest.end() - from;
        oldest.count = from - oldest.first;
        if is_growing {
            self.writer = None;
        }
        self.forget_told()
    }

    /// The oldest records were told: so many of them go.
    ///
    /// # Errors
    /// The disk does not take the mark. They do not come again before a restart; after one, those whose file is still there.
    pub fn drop_first(&mut self, count: usize) -> io::Result<()> {
        let mut left = u64::try_from(count).unwrap_or(u64::MAX);
        for segment in &self.segments {
            let from = self.told.max(segment.first);
            let taken = left.min(segment.end().saturating_sub(from));
            if taken > 0 {
                self.told = from + taken;
            }
            left -= taken;
        }
        // Marked first: what is gone without a mark would count as lost.
        let marked = self.told_file.write(self.told);
        let marked = self.forget_told().and(marked);
        if let Err(error) = &marked {
            self.disk.fail(error);
        }
        marked
    }

    /// Removes the files of which all was told.
    fn forget_told(&mut self) -> io::Result<()> {
        while let Some(oldest) = self.segments.front()
            && oldest.end() <= self.told.max(oldest.first)
        {
            let path = oldest.path(&self.directory);
            self.segments.pop_front();
            if self.segments.is_empty() {
                self.writer = None;
            }
            remove(&path)?;
        }
        Ok(())
    }

    /// Waits until the disk itself has everything.
    ///
    /// # Errors
    /// It has not.
    pub fn sync(&mut self) -> io::Result<()> {
        let Some(file) = &self.writer else { return Ok(()) };
        file.sync_data()?;
        if std::mem::take(&mut self.is_new) {
            File::open(&self.directory)?.sync_all()?;
        }
        Ok(())
    }

    /// How many records wait.
    pub fn len(&self) -> u64 {
        let waiting = |segment: &Segment| segment.end().saturating_sub(segment.first.max(self.told));
        self.segments.iter().map(waiting).sum()
    }

    /// None waits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What the files take of the disk.
    pub fn bytes(&self) -> u64 {
        self.after(0)
    }

    /// How many records had no room, or were damaged, since this was asked last.
    pub fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    /// What there is to say of the disk: once when it begins to fail, once when it is over.
    pub fn news(&mut self) -> Option<DiskNews> {
        self.disk.news.pop_front()
    }
}

/// Removes a file, or finds that it is gone.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

/// A file that this user writes, and his group reads.
fn create(path: &Path) -> io::Result<File> {
    fs::OpenOptions::new().write(true).create(true).truncate(true).mode(MODE).open(path)
}

impl Disk {
    fn hear(&mut self, added: &io::Result<()>) {
        match added {
            Ok(()) if self.fails => {
                self.fails = false;
                let lost = std::mem::take(&mut self.lost);
                self.tell(DiskNews::Works { lost });
            }
            Ok(()) => {}
            Err(error) => {
                self.lost += 1;
                self.fail(error);
            }
        }
    }

    fn fail(&mut self, error: &io::Error) {
        if !self.fails {
            self.fails = true;
            self.tell(DiskNews::Fails(error.to_string()));
        }
    }

    fn tell(&mut self, news: DiskNews) {
        if self.news.len() < MOST_NEWS {
            self.news.push_back(news);
        }
    }
}
