//! The pages of a column, looked at before they are unpacked: a small page may say that it is a huge one, and mean it.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use parquet::basic::Compression;
use parquet::file::metadata::ColumnChunkMetaData;

use super::thrift;

/// What a page may hold unpacked. Writers make pages of 1 MB; some make one of a whole row group.
const LARGEST_PAGE: u64 = 48_000_000;
/// The same of a dictionary, whose texts take several times their length.
const LARGEST_DICTIONARY: u64 = 8_000_000;
/// The head of a page: some numbers, and its smallest and largest value.
const LONGEST_HEAD: usize = 64 * 1024;
/// So much is read at a time.
const WINDOW: usize = 1 << 20;

/// What is said of the pages of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Looked {
    /// Texts are packed against each other, which is not read here.
    pub(super) has_deltas_of_texts: bool,
}

/// The head of one page, as far as it says how large it is.
#[derive(Clone, Copy, Debug, Default)]
struct Head {
    kind: i64,
    unpacked: i64,
    packed: i64,
    values: i64,
    encoding: i64,
}

/// The kind of a dictionary's page.
const DICTIONARY: i64 = 2;
/// The two encodings of texts as what they have beyond the one before.
const DELTAS_OF_TEXTS: [i64; 2] = [6, 7];

/// Looks at every page of one column in one row group.
///
/// # Errors
/// A sentence: they do not lie in the file, or one is larger than it may be.
pub(super) fn look(file: &File, length: u64, chunk: &ColumnChunkMetaData) -> Result<Looked, String> {
    let begin = chunk
        .dictionary_page_offset()
        .map_or(chunk.data_page_offset(), |dictionary| dictionary.min(chunk.data_page_offset()));
    let place = |number: i64| u64::try_from(number).map_err(|_| "it lies at a negative place".to_owned());
    let (begin, size) = (place(begin)?, place(chunk.compressed_size())?);
    let end = begin.checked_add(size).filter(|end| *end <= length);
    let end = end.ok_or("it goes on behind the end of the file: was it copied whole?")?;
    if matches!(chunk.compression(), Compression::LZ4) {
        return Err(
            "it is packed with the LZ4 of Hadoop, which is not read: write it with Snappy or Zstd".to_owned()
        );
    }
    let mut window = Window { file, at: begin, end, bytes: Vec::new() };
    let mut looked = Looked::default();
    while window.at < end {
        let head = window.head()?;
        head.check()?;
        looked.has_deltas_of_texts |= DELTAS_OF_TEXTS.contains(&head.encoding) && head.kind != DICTIONARY;
        let packed = place(head.packed)?;
        if window.at.checked_add(packed).is_none_or(|behind| behind > end) {
            return Err("a page goes on behind its column".to_owned());
        }
        if matches!(chunk.compression(), Compression::GZIP(_)) {
            let claimed = place(head.unpacked)?;
            let holds_more = window.unpacks_to_more(packed, claimed).map_err(|why| why.to_string())?;
            if holds_more {
                return Err(format!("a page holds more than the {claimed} bytes that it says it has"));
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
            // Version 1, dictionary, version 2.
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
                // An entry of a dictionary takes a byte at least, mostly four or eight.
                if is_dictionary && values > unpacked {
                    return Err(format!(
                        "a dictionary of {unpacked} bytes says that it has {values} entries"
                    ));
                }
                Ok(())
            }
            (Ok(unpacked), Ok(_), Ok(_)) => Err(format!(
                "{what} takes {unpacked} bytes when it is unpacked, and at most {largest} are: write smaller pages or row \
                 groups"
            )),
            _ => Err(format!("{what} has a negative length")),
        }
    }
}

/// A part of the file, read on as it is needed.
struct Window<'f> {
    file: &'f File,
    /// Where its first byte lies.
    at: u64,
    /// Where the column ends.
    end: u64,
    bytes: Vec<u8>,
}

impl Window<'_> {
    /// The next head, which is taken.
    fn head(&mut self) -> Result<Head, String> {
        if self.bytes.len() < LONGEST_HEAD {
            self.fill().map_err(|why| why.to_string())?;
        }
        let shown = &self.bytes[..self.bytes.len().min(LONGEST_HEAD)];
        let (head, length) = Head::of(shown).ok_or("a page has no head, or one that is damaged")?;
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

    /// Unpacks what lies here, and keeps none of it.
    fn unpacks_to_more(&self, packed: u64, claimed: u64) -> io::Result<bool> {
        let mut file = self.file;
        file.seek(SeekFrom::Start(self.at))?;
        let unpacked = flate2::read::MultiGzDecoder::new(file.take(packed));
        // What cannot be unpacked is told by the reader.
        Ok(io::copy(&mut unpacked.take(claimed + 1), &mut io::sink()).is_ok_and(|count| count > claimed))
    }
}
