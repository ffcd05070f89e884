//! Store of records on disk until they can be published, oldest first. Its size is limited.
//!
//! ```text
//! DIRECTORY/00000000000000000000.records     records 0, 1, 2 …: header, then length, checksum and bytes of each
//! DIRECTORY/00000000000000000210.records     from 210 on; only the last file grows, until the next restart
//! DIRECTORY/told                             all records before this number were published
//! ```
//!
//! **After a kill**, every record that [`push`](Store::push) has accepted is available, in order and
//! unchanged. A partly written record is discarded. [`first`](Store::first) returns published records again
//! if [`drop_first`](Store::drop_first) has not marked them yet. It does not return marked records. After a
//! power failure, this holds only for records that were appended before the last call of
//! [`sync`](Store::sync).
//!
//! **A full store** removes its whole oldest file. The records in it that were not published are counted as lost.
//!
//! Records are numbered, and the checksum includes the number. Therefore bytes at another position, of another file, or
//! of an earlier store are not accepted as a record. Records in a damaged file are counted as lost. The first record
//! number of the next file shows how many records were lost.

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
use crate::interface::Record;

const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// Permissions of the files: the owner can write, the group can read.
const MODE: u32 = 0o640;
/// Maximum size of a file in bytes. In a small store, the maximum is a sixteenth of the size of the store.
const LONGEST_FILE: u64 = 1024 * 1024;
const FILES: u64 = 16;

/// Store of records on disk, until they are published.
#[derive(Debug)]
pub struct Store {
    directory: PathBuf,
    most_bytes: u64,
    longest_file: u64,
    /// Files of records, oldest first. The last file grows as long as `writer` exists.
    segments: VecDeque<Segment>,
    writer: Option<File>,
    /// Whether the directory entry of the last file is not yet synchronised to disk.
    is_new: bool,
    /// Number of the first record that is not yet marked as published.
    published: u64,
    /// Number of the next record that will be appended.
    next: u64,
    published_file: NumberFile,
    dropped: u64,
    disk: Disk,
}

/// Maximum number of reports in `news` that the gateway has not read yet. Further reports are discarded.
const MOST_NEWS: usize = 16;

#[derive(Debug, Default)]
struct Disk {
    fails: bool,
    lost: u64,
    news: VecDeque<DiskNews>,
}

/// Report that writing to the disk fails, or works again. The gateway reads it by [`Store::news`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DiskNews {
    /// Records cannot be written; contains the reason.
    Fails(String),
    /// Records can be written again.
    Works {
        /// Number of records that were lost while writing failed.
        lost: u64,
    },
}

impl Store {
    /// Opens the store in this directory, which is created if necessary. All files together take at most `most_bytes`.
    ///
    /// # Errors
    /// The directory cannot be created or read.
    pub fn open(directory: impl AsRef<Path>, most_bytes: u64) -> io::Result<Store> {
        Store::in_files_of(directory.as_ref(), most_bytes, LONGEST_FILE.min(most_bytes / FILES))
    }

    fn in_files_of(directory: &Path, most_bytes: u64, longest_file: u64) -> io::Result<Store> {
        let directory = directory.to_owned();
        fs::create_dir_all(&directory)?;
        let published_file = NumberFile::at(directory.join("told"));
        let marked = published_file.read()?;
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
            published: marked.unwrap_or(0),
            next: 0,
            published_file,
            dropped: 0,
            disk: Disk::default(),
        };
        if marked.is_none() {
            store.published = store.segments.front().map_or(0, |segment| segment.first);
        }
        store.next = store.segments.back().map_or(0, Segment::end).max(store.published);
        store.dropped = store.missing();
        store.forget_published()?;
        // The limit may be smaller than before.
        store.make_room(0)?;
        Ok(store)
    }

    /// Returns the number of unpublished records that are in no file, because a file is damaged or missing.
    fn missing(&self) -> u64 {
        let mut expected = self.published;
        let mut missing = 0;
        for segment in self.segments.iter().filter(|segment| segment.end() > self.published) {
            missing += segment.first.saturating_sub(expected);
            expected = segment.end();
        }
        missing
    }

    /// Appends a record. If the store is full, removes its oldest file.
    ///
    /// # Errors
    /// - The record cannot be written. It is lost, and [`news`](Store::news) reports the failure once.
    /// - The record is longer than allowed. [`dropped`](Store::dropped) counts it.
    pub fn push(&mut self, record: &Record) -> io::Result<()> {
        let bytes = FRAME + u64::try_from(record.0.len()).unwrap_or(u64::MAX - FRAME);
        if record.0.len() > LONGEST || Segment::on_disk(HEADER + bytes) > self.most_bytes {
            self.dropped += 1;
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "the record is longer than allowed"));
        }
        let added = self.add(record, bytes);
        if added.is_err() {
            self.give_up_file();
        }
        self.disk.receive(&added);
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

    /// Closes the last file, which may end with an incomplete record. The next record begins a new file.
    fn give_up_file(&mut self) {
        let Some(last) = self.segments.back_mut() else { return };
        let path = last.path(&self.directory);
        if self.writer.take().is_some() || last.count == 0 {
            last.bytes = fs::metadata(&path).map_or(last.bytes, |found| found.len());
        }
        if last.count == 0 {
            self.segments.pop_back();
            // If this fails, the next start removes the file.
            let _ = fs::remove_file(path);
        }
    }

    /// Removes the oldest files until `bytes` more bytes fit within the limit of the store.
    fn make_room(&mut self, bytes: u64) -> io::Result<()> {
        let mut lost_some = false;
        while self.after(bytes) > self.most_bytes {
            let Some(oldest) = self.segments.front() else { break };
            remove(&oldest.path(&self.directory))?;
            let unreported = oldest.end().saturating_sub(oldest.first.max(self.published));
            self.published = self.published.max(oldest.end());
            self.dropped += unreported;
            lost_some = true;
            self.segments.pop_front();
            if self.segments.is_empty() {
                self.writer = None;
            }
        }
        if lost_some { self.published_file.write(self.published) } else { Ok(()) }
    }

    /// Returns the size that all files would have on disk if `bytes` more bytes were appended, in bytes.
    fn after(&self, bytes: u64) -> u64 {
        let sizes = self.segments.iter().map(|segment| segment.bytes);
        let grows = self.writer.is_some();
        let last = self.segments.len().saturating_sub(1);
        let grown = sizes.enumerate().map(|(at, size)| if grows && at == last { size + bytes } else { size });
        let taken: u64 = grown.map(Segment::on_disk).sum();
        if grows || bytes == 0 { taken } else { taken + Segment::on_disk(HEADER + bytes) }
    }

    /// Returns at most `most` of the oldest records, without removing them. Damaged records are left out and counted.
    ///
    /// # Errors
    /// The records cannot be read.
    pub fn first(&mut self, most: usize) -> io::Result<Vec<Record>> {
        let most = u64::try_from(most).unwrap_or(u64::MAX);
        loop {
            self.forget_published()?;
            let Some(segment) = self.segments.front().filter(|_| most > 0) else { return Ok(Vec::new()) };
            let from = self.published.max(segment.first);
            let found = segment.records(&self.directory, from, most)?;
            self.published = from;
            let count = u64::try_from(found.len()).unwrap_or(u64::MAX);
            if count < most.min(segment.end() - from) {
                self.drop_damaged(from + count)?;
            }
            if !found.is_empty() {
                return Ok(found);
            }
        }
    }

    /// Marks the oldest file as unreadable from the record number `from` on, and counts the lost records.
    fn drop_damaged(&mut self, from: u64) -> io::Result<()> {
        let is_growing = self.segments.len() == 1;
        let Some(oldest) = self.segments.front_mut() else { return Ok(()) };
        self.dropped += oldest.end() - from;
        oldest.count = from - oldest.first;
        if is_growing {
            self.writer = None;
        }
        self.forget_published()
    }

    /// Marks the `count` oldest records as published, and removes the files in which all records are marked.
    ///
    /// # Errors
    /// The mark cannot be written, or a file cannot be removed. The records are not returned again before a
    /// restart. After a restart, records whose mark was not written are returned again if their file still
    /// exists.
    pub fn drop_first(&mut self, count: usize) -> io::Result<()> {
        let mut left = u64::try_from(count).unwrap_or(u64::MAX);
        for segment in &self.segments {
            let from = self.published.max(segment.first);
            let taken = left.min(segment.end().saturating_sub(from));
            if taken > 0 {
                self.published = from + taken;
            }
            left -= taken;
        }
        // The mark is written first: records that are removed without a mark would count as lost.
        let marked = self.published_file.write(self.published);
        let marked = self.forget_published().and(marked);
        if let Err(error) = &marked {
            self.disk.fail(error);
        }
        marked
    }

    /// Removes the files in which all records were published.
    fn forget_published(&mut self) -> io::Result<()> {
        while let Some(oldest) = self.segments.front()
            && oldest.end() <= self.published.max(oldest.first)
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

    /// Waits until all appended records are on disk.
    ///
    /// # Errors
    /// The disk reports an error: records may not be on it.
    pub fn sync(&mut self) -> io::Result<()> {
        let Some(file) = &self.writer else { return Ok(()) };
        file.sync_data()?;
        if std::mem::take(&mut self.is_new) {
            File::open(&self.directory)?.sync_all()?;
        }
        Ok(())
    }

    /// Returns the number of records that are not marked as published.
    pub fn len(&self) -> u64 {
        let waiting = |segment: &Segment| segment.end().saturating_sub(segment.first.max(self.published));
        self.segments.iter().map(waiting).sum()
    }

    /// Returns whether all records are marked as published.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the size of the files on disk, in bytes.
    pub fn bytes(&self) -> u64 {
        self.after(0)
    }

    /// Returns the number of records that were lost since the last call: removed from a full store, too long, or
    /// damaged.
    pub fn dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    /// Returns the next report about the disk: writing begins to fail, or works again. `None` if there is no new
    /// report.
    pub fn news(&mut self) -> Option<DiskNews> {
        self.disk.news.pop_front()
    }
}

/// Removes a file. A file that does not exist is no error.
fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

/// Creates a file that its owner can write and the group can read.
fn create(path: &Path) -> io::Result<File> {
    fs::OpenOptions::new().write(true).create(true).truncate(true).mode(MODE).open(path)
}

impl Disk {
    fn receive(&mut self, added: &io::Result<()>) {
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
