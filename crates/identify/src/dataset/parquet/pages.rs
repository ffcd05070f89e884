//! Checks of the pages (compressed blocks) of a Parquet column before they are decompressed. A small compressed page
//! can decompress to a huge one.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use parquet::basic::Compression;
use parquet::file::metadata::ColumnChunkMetaData;

use super::thrift;

/// Maximum decompressed size of a page, bytes. Most programs write pages of 1 MB. Some programs write each row group as
/// one larger page.
const LARGEST_PAGE: u64 = 48_000_000;
/// Maximum decompressed size of a dictionary page, bytes. In memory, the texts of a dictionary need several times this
/// size.
const LARGEST_DICTIONARY: u64 = 8_000_000;
/// Maximum size of a page header, bytes. A header contains only some integers, and the minimum and maximum value of the
/// page.
const LONGEST_HEAD: usize = 64 * 1024;
/// Number of bytes that are read from the file in one step.
const WINDOW: usize = 1 << 20;

/// Result of the check of the pages of one column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct CheckedPages {
    /// Whether texts of the column are delta-encoded (stored as differences). This reader does not support that.
    pub(super) has_deltas_of_texts: bool,
}

/// Header of a page: the fields with the page type and the sizes.
#[derive(Clone, Copy, Debug, Default)]
struct Head {
    kind: i64,
    unpacked: i64,
    packed: i64,
    values: i64,
    encoding: i64,
}

/// Page type of a dictionary page.
const DICTIONARY: i64 = 2;
/// Codes of the two encodings in which each text is stored as a difference from the previous text.
const DELTAS_OF_TEXTS: [i64; 2] = [6, 7];

/// Checks every page of one column in one row group.
///
/// # Errors
/// A page extends beyond the file or the column, or is larger than allowed.
pub(super) fn check_pages(
    file: &File,
    length: u64,
    chunk: &ColumnChunkMetaData,
) -> Result<CheckedPages, String> {
    let begin = chunk
        .dictionary_page_offset()
        .map_or(chunk.data_page_offset(), |dictionary| dictionary.min(chunk.data_page_offset()));
    let place = |number: i64| {
        u64::try_from(number).map_err(|_| {
            "the file states a negative position for this column: write the file again".to_owned()
        })
    };
    let (begin, size) = (place(begin)?, place(chunk.compressed_size())?);
    let end = begin.checked_add(size).filter(|end| *end <= length);
    let end =
        end.ok_or("this column continues after the end of the file: was the file copied completely?")?;
    if matches!(chunk.compression(), Compression::LZ4) {
        return Err(
            "this column is compressed with the LZ4 of Hadoop, which is not supported: write it with Snappy \
             or Zstd"
                .to_owned(),
        );
    }
    let mut window = Window { file, at: begin, end, bytes: Vec::new() };
    let mut looked = CheckedPages::default();
    while window.at < end {
        let head = window.head()?;
        head.check()?;
        looked.has_deltas_of_texts |= DELTAS_OF_TEXTS.contains(&head.encoding) && head.kind != DICTIONARY;
        let packed = place(head.packed)?;
        if window.at.checked_add(packed).is_none_or(|behind| behind > end) {
            return Err("a page continues after the end of this column: write the file again".to_owned());
        }
        if matches!(chunk.compression(), Compression::GZIP(_)) {
            let claimed = place(head.unpacked)?;
            let holds_more = window.unpacks_to_more(packed, claimed).map_err(|why| why.to_string())?;
            if holds_more {
                return Err(format!(
                    "a page contains more than the {claimed} bytes that its header gives: write the file \
                     again"
                ));
            }
        }
        window.skip(packed);
    }
    Ok(looked)
}

impl Head {
    fn of(bytes: &[u8]) -> Option<(Head, usize)> {
        let mut head = Head::default();
        let length = thrift::read(bytes, &mut |path, number| match path {
            [1] => head.kind = number,
            [2] => head.unpacked = number,
            [3] => head.packed = number,
            // The header of data page version 1, of a dictionary page, or of data page version 2.
            [5 | 7 | 8, 1] => head.values = number,
            [5 | 7, 2] | [8, 4] => head.encoding = number,
            _ => {}
        })?;
        Some((head, length))
    }

    fn check(&self) -> Result<(), String> {
        let is_dictionary = self.kind == DICTIONARY;
        let largest = if is_dictionary { LARGEST_DICTIONARY } else { LARGEST_PAGE };
        let what = if is_dictionary { "a dictionary" } else { "a page" };
        match (u64::try_from(self.unpacked), u64::try_from(self.packed), u64::try_from(self.values)) {
            (Ok(unpacked), Ok(_), Ok(values)) if unpacked <= largest => {
                // An entry of a dictionary takes at least one byte, in most cases four or eight.
                if is_dictionary && values > unpacked {
                    return Err(format!(
                        "the header of a dictionary of {unpacked} bytes states {values} entries, which do not \
                         fit into this size: write the file again"
                    ));
                }
                Ok(())
            }
            (Ok(unpacked), Ok(_), Ok(_)) => Err(format!(
                "{what} has {unpacked} bytes when it is decompressed, and at most {largest} are allowed: \
                 write smaller pages or row groups"
            )),
            _ => Err(format!("{what} has a negative length: write the file again")),
        }
    }
}

/// Part of the file that is in memory. The reader loads more bytes when they are needed.
struct Window<'f> {
    file: &'f File,
    /// Offset in the file of the first byte of `bytes`.
    at: u64,
    /// Offset in the file of the end of the column.
    end: u64,
    bytes: Vec<u8>,
}

impl Window<'_> {
    /// Reads the header of the next page, and moves to the data of that page.
    fn head(&mut self) -> Result<Head, String> {
        if self.bytes.len() < LONGEST_HEAD {
            self.fill().map_err(|why| why.to_string())?;
        }
        let shown = &self.bytes[..self.bytes.len().min(LONGEST_HEAD)];
        let (head, length) = Head::of(shown).ok_or("a page has no header, or a damaged header")?;
        self.skip(length as u64);
        Ok(head)
    }

    fn fill(&mut self) -> io::Result<()> {
        let mut file = self.file;
        file.seek(SeekFrom::Start(self.at))?;
        self.bytes.clear();
        let wanted = (self.end - self.at).min(WINDOW as u64);
        file.take(wanted).read_to_end(&mut self.bytes)?;
        Ok(())
    }

    fn skip(&mut self, count: u64) {
        self.at += count;
        match usize::try_from(count) {
            Ok(count) if count <= self.bytes.len() => drop(self.bytes.drain(..count)),
            _ => self.bytes.clear(),
        }
    }

    /// Returns whether the data at this offset decompress to more than `claimed` bytes. The decompressed data are
    /// discarded.
    fn unpacks_to_more(&self, packed: u64, claimed: u64) -> io::Result<bool> {
        let mut file = self.file;
        file.seek(SeekFrom::Start(self.at))?;
        let unpacked = flate2::read::MultiGzDecoder::new(file.take(packed));
        // If decompression fails, the reader reports it later.
        Ok(io::copy(&mut unpacked.take(claimed + 1), &mut io::sink()).is_ok_and(|count| count > claimed))
    }
}
