//! Files of records in a store: a header, then one record after the other. Records are only appended, and
//! never changed.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use super::CHECKSUM;
use crate::interface::Record;

/// Size of the header in bytes: magic bytes, number of the first record, and a checksum of both.
pub(super) const HEADER: u64 = 20;
const MAGIC: [u8; 8] = *b"plant-01";

/// Size in bytes of the prefix of each record: the length of the record, and a checksum of its number and content.
pub(super) const FRAME: u64 = 8;

/// Maximum length of a record in bytes.
pub(super) const LONGEST: usize = 1024 * 1024;

const EXTENSION: &str = "records";

/// File of a record store: its first record number, its number of records, and its length.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Segment {
    /// Number of the first record in this file of the store.
    pub(super) first: u64,
    /// Number of valid records in this file of the store.
    pub(super) count: u64,
    /// Length in bytes, including invalid data after the last record.
    pub(super) bytes: u64,
}

impl Segment {
    /// Returns the record number that follows the last record of the file.
    pub(super) fn end(&self) -> u64 {
        self.first.saturating_add(self.count)
    }

    pub(super) fn path(&self, directory: &Path) -> PathBuf {
        directory.join(format!("{:020}.{EXTENSION}", self.first))
    }

    /// Returns the space that a file takes on a disk with blocks of 4 KiB, in bytes.
    pub(super) fn on_disk(bytes: u64) -> u64 {
        bytes.next_multiple_of(4096)
    }

    /// Creates a file whose first record will have the number `first`.
    pub(super) fn create(directory: &Path, first: u64) -> io::Result<(Segment, File)> {
        let segment = Segment { first, count: 0, bytes: HEADER };
        let mut file = super::create(&segment.path(directory))?;
        let mut header = MAGIC.to_vec();
        header.extend(first.to_le_bytes());
        header.extend(CHECKSUM.checksum(&header).to_le_bytes());
        file.write_all(&header)?;
        Ok((segment, file))
    }

    /// Appends a record with its length and checksum to the file.
    pub(super) fn push(&mut self, file: &mut File, record: &Record) -> io::Result<()> {
        let length = u32::try_from(record.0.len()).map_err(io::Error::other)?;
        let mut frame = length.to_le_bytes().to_vec();
        frame.extend(checksum(self.end(), &record.0).to_le_bytes());
        frame.extend(&record.0);
        file.write_all(&frame)?;
        self.count += 1;
        self.bytes += FRAME + u64::from(length);
        Ok(())
    }

    /// Opens the file whose first record has the number `first`. Returns `None` if it contains no valid record.
    pub(super) fn open(directory: &Path, first: u64) -> io::Result<Option<Segment>> {
        let mut segment = Segment { first, count: 0, bytes: 0 };
        let mut file = File::open(segment.path(directory))?;
        segment.bytes = file.metadata()?.len();
        if !has_header(&mut file, first)? {
            return Ok(None);
        }
        let mut reader = io::BufReader::new(file);
        while read_record(&mut reader, segment.end())?.is_some() {
            segment.count += 1;
        }
        Ok((segment.count > 0).then_some(segment))
    }

    /// Returns up to `most` records, starting with the number `from`. If fewer records are returned than the file
    /// should contain, the rest of the file is damaged.
    pub(super) fn records(&self, directory: &Path, from: u64, most: u64) -> io::Result<Vec<Record>> {
        let mut found = Vec::new();
        let mut file = match File::open(self.path(directory)) {
            // The file may have been deleted by hand.
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(found),
            opened => opened?,
        };
        if !has_header(&mut file, self.first)? {
            return Ok(found);
        }
        let mut reader = io::BufReader::new(file);
        for number in self.first..self.end().min(from.saturating_add(most)) {
            if number < from {
                skip_record(&mut reader)?;
                continue;
            }
            let Some(record) = read_record(&mut reader, number)? else { break };
            found.push(record);
        }
        Ok(found)
    }
}

/// Returns the first record numbers of the files in a directory, in ascending order.
pub(super) fn numbers(directory: &Path) -> io::Result<Vec<u64>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(directory)? {
        let name = entry?.file_name();
        let number = name.to_str().and_then(|name| name.strip_suffix(EXTENSION)?.strip_suffix('.'));
        found
            .extend(number.filter(|number| number.len() == 20).and_then(|number| number.parse::<u64>().ok()));
    }
    found.sort_unstable();
    Ok(found)
}

fn has_header(file: &mut File, first: u64) -> io::Result<bool> {
    let mut header = [0; 20];
    if !fill(file, &mut header)? {
        return Ok(false);
    }
    let (named, checksum) = header.split_at(16);
    let is_whole = CHECKSUM.checksum(named).to_le_bytes() == checksum;
    Ok(is_whole && named == [MAGIC, first.to_le_bytes()].concat())
}

/// Reads the next record. Returns `None` if the record is incomplete, or if its checksum does not match its number and
/// content.
fn read_record(reader: &mut impl Read, number: u64) -> io::Result<Option<Record>> {
    let Some((length, expected)) = read_frame(reader)? else { return Ok(None) };
    let mut bytes = vec![0; length];
    let is_whole = fill(reader, &mut bytes)? && checksum(number, &bytes) == expected;
    Ok(is_whole.then_some(Record(bytes)))
}

fn skip_record(reader: &mut io::BufReader<File>) -> io::Result<()> {
    if let Some((length, _)) = read_frame(reader)? {
        reader.seek_relative(i64::try_from(length).map_err(io::Error::other)?)?;
    }
    Ok(())
}

/// Reads the length and the checksum of the next record. Returns `None` at the end of the file, or if the length is
/// invalid.
fn read_frame(reader: &mut impl Read) -> io::Result<Option<(usize, u32)>> {
    let mut frame = [0; 8];
    if !fill(reader, &mut frame)? {
        return Ok(None);
    }
    let [a, b, c, d, e, f, g, h] = frame;
    let length = usize::try_from(u32::from_le_bytes([a, b, c, d])).unwrap_or(usize::MAX);
    Ok((length <= LONGEST).then_some((length, u32::from_le_bytes([e, f, g, h]))))
}

/// Fills `bytes` from the reader. Returns `false` if the file ends before `bytes` is full.
fn fill(reader: &mut impl Read, bytes: &mut [u8]) -> io::Result<bool> {
    match reader.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

/// Returns the checksum of a record and its number, which makes a record at another position invalid.
fn checksum(number: u64, bytes: &[u8]) -> u32 {
    let mut digest = CHECKSUM.digest();
    digest.update(&number.to_le_bytes());
    digest.update(bytes);
    digest.finalize()
}
