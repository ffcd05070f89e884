//! Reader of CSV logs that are compressed with gzip.

use std::io::{self, ErrorKind, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::table::Table;
use super::{BadLog, Split, Uses, csv, files};

/// Maximum size of a decompressed log, bytes. The log is read in parts, so this limits the reading time, not the
/// memory.
const LARGEST: u64 = 4_000_000_000;

/// Reads a compressed CSV log. Error messages contain line numbers.
pub(super) fn read(file: &Path, split: &Split, uses: Uses<'_>) -> Result<Table, BadLog> {
    csv::from_text(file, open(file)?, split, uses)
}

/// Opens a log that is compressed with gzip, and returns a reader of the decompressed bytes. Returns an error for a
/// compressed Parquet file or workbook.
pub(super) fn open(file: &Path) -> Result<Box<dyn Read>, BadLog> {
    let inner = file.file_stem().map(Path::new).and_then(Path::extension);
    if let Some(ending) = inner.filter(|ending| ["parquet", "xlsx"].iter().any(|known| ending == known)) {
        let why = format!("this is a compressed .{} file: decompress it with gunzip", ending.display());
        return Err(BadLog(vec![format!("{}: {why}", file.display())]));
    }
    Ok(Box::new(Limited { input: MultiGzDecoder::new(files::open(file)?), left: LARGEST }))
}

/// Reader that returns an error if its input is longer than a maximum number of bytes.
struct Limited<R> {
    input: R,
    left: u64,
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.input.read(out)?;
        self.left = self.left.checked_sub(count as u64).ok_or_else(|| {
            let limit = LARGEST / 1_000_000_000;
            io::Error::new(
                ErrorKind::FileTooLarge,
                format!("the log is larger than {limit} GB when it is decompressed: split it"),
            )
        })?;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::super::every_column;
    use super::*;

    fn written(name: &str, log: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(name);
        let mut encoder = GzEncoder::new(std::fs::File::create(&path).unwrap(), Compression::default());
        encoder.write_all(log).unwrap();
        encoder.finish().unwrap();
        (directory, path)
    }

    #[test]
    fn a_compressed_log_is_read_as_the_log() {
        let (_directory, path) = written("day.csv.gz", b"Zeit;bed\n0;20,5\n60;21\n");
        let found = read(&path, &Split::default(), &every_column).unwrap();
        assert_eq!(found.numbers("bed"), Some(&vec![20.5, 21.0].into()));
        let dataset = super::super::Dataset::read(&[path], &Split::default(), &|_| None, &every_column);
        assert_eq!(dataset.unwrap().runs[0].name, "day");
    }

    #[test]
    fn a_damaged_or_an_endless_log_is_refused() {
        let log: Vec<u8> =
            (0..5000u32).flat_map(|row| format!("{},{}\n", row, row % 97).into_bytes()).collect();
        let (_directory, path) = written("day.csv.gz", &[b"time,bed\n".as_slice(), &log].concat());
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(read(&path, &Split::default(), &every_column).is_err());
        let mut endless = Limited { input: io::repeat(b'\n'), left: 9 };
        assert_eq!(io::copy(&mut endless, &mut io::sink()).unwrap_err().kind(), ErrorKind::FileTooLarge);
        let (_directory, path) = written("day.parquet.gz", b"PAR1");
        let said = read(&path, &Split::default(), &every_column).unwrap_err().to_string();
        assert!(said.contains("gunzip"), "{said}");
    }
}
