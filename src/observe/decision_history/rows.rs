//! Rows of one decision log from a given time on. A binary search finds the first row, so that the file need not be
//! read from its start.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

use csv::{ByteRecord, ReaderBuilder};

use isotherm_core::quantity::{Moment, time};
use isotherm_profile::safe_file;

/// Size, in bytes, of the part of the file at which the binary search stops. The rows of this part are then read in
/// order.
const NEAR: u64 = 64 * 1024;

/// Row of a decision log: the texts of its cells. The first cell is the time.
pub(super) struct Row(ByteRecord);

impl Row {
    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn at(&self) -> Option<Moment> {
        moment(self.0.get(0)?)
    }

    /// Parses the numbers in the cells with the indices `places` into `values`. A cell without a number gives `None`.
    pub(super) fn numbers(&self, places: &[Option<usize>], values: &mut [Option<f64>]) {
        for (place, value) in places.iter().zip(values) {
            let cell = place.and_then(|place| self.0.get(place));
            let number = cell.and_then(|cell| std::str::from_utf8(cell).ok()?.parse().ok());
            *value = number.filter(|number: &f64| number.is_finite());
        }
    }

    /// Appends the time and the cells with the indices `places` to `out`, as one line of CSV.
    pub(super) fn write(&self, places: &[Option<usize>], out: &mut Vec<u8>) {
        out.extend_from_slice(self.0.get(0).unwrap_or_default());
        for place in places {
            out.push(b',');
            out.extend_from_slice(place.and_then(|place| self.0.get(place)).unwrap_or_default());
        }
        out.push(b'\n');
    }
}

fn moment(cell: &[u8]) -> Option<Moment> {
    time::parse(std::str::from_utf8(cell).ok()?).ok()
}

/// Returns the names of the columns, and the rows from the time `from` on. Some earlier rows may come first. `None` if
/// the log cannot be read.
pub(super) fn rows(log: &Path, from: Moment) -> Option<(Vec<String>, impl Iterator<Item = Row>)> {
    let mut file = BufReader::new(safe_file::open(log).ok()?);
    let mut header = Vec::new();
    file.read_until(b'\n', &mut header).ok()?;
    let mut reader = ReaderBuilder::new().has_headers(false).from_reader(header.as_slice());
    let names = reader.byte_records().next()?.ok()?;
    let names = names.iter().map(|name| String::from_utf8_lossy(name).into_owned()).collect();
    let begin = begin(&mut file, header.len() as u64, from).ok()?;
    file.seek(SeekFrom::Start(begin)).ok()?;
    let rows = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(file);
    // A damaged row ends the rows.
    Some((names, rows.into_byte_records().map_while(Result::ok).map(Row)))
}

/// Returns a file position before which all rows are earlier than `from`. The rows must be ordered by time, with one
/// row on each text line.
fn begin(file: &mut BufReader<File>, first: u64, from: Moment) -> std::io::Result<u64> {
    let (mut low, mut high) = (first, file.get_ref().metadata()?.len());
    let mut line = Vec::new();
    while high.saturating_sub(low) > NEAR {
        let middle = low + (high - low) / 2;
        file.seek(SeekFrom::Start(middle))?;
        line.clear();
        let skipped = file.read_until(b'\n', &mut line)? as u64;
        line.clear();
        file.read_until(b'\n', &mut line)?;
        let at = line.split(|byte| *byte == b',').next().and_then(moment);
        match at {
            Some(at) if at < from && middle + skipped < high => low = middle + skipped,
            _ => high = middle,
        }
    }
    Ok(low)
}
