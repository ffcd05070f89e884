//! Event files: one file `NAME-2026-01-31.events.jsonl` for each day, with one JSON document on each line.
//! The files are in the directory of the logs.
//!
//! Every line has a seal, which is its checksum. `n` is the number of the line in the file. `after` is the
//! seal of the previous line. In the first line, `after` is the checksum of the file's name. `seal` is the
//! checksum of the rest of the line. A reader thus detects lines that were changed, cut or removed, and
//! replaced files. It reports the damage, and reads the other lines.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::journal::Entry;
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::safe_file::{self, without_numbers};

/// End of a file name, after the day.
const ENDING: &str = ".events.jsonl";
const SEAL: &str = ",\"seal\":\"";
/// Maximum size of the file of one day, in bytes. Later events of that day are counted, but not written. A reader reads
/// at most twice this size.
pub const LARGEST: usize = 16 << 20;
/// Number of bytes that are read from the end of a file to find the last events. At most [`DAYS_BACK`] files are read.
const TAIL: u64 = 256 << 10;
const DAYS_BACK: usize = 7;
/// CRC-32 as in Ethernet and gzip (ITU-T V.42).
const CHECKSUM: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

#[derive(Serialize, Deserialize)]
struct Line {
    n: u64,
    after: String,
    #[serde(flatten)]
    entry: Entry,
}

/// State at the end of an event file, from which the next line is made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    count: u64,
    seal: String,
    /// Whether the file ends in the middle of a line.
    is_cut: bool,
    length: usize,
}

/// Event or damage that was found in an event file.
#[derive(Clone, Debug, PartialEq)]
pub enum FileItem {
    /// Event that was read from the file.
    Event(Entry),
    /// Damage, as a sentence with the name of the file.
    Damage(String),
}

/// Returns the day of an event, as in the name of its file, for example `2026-01-31`.
pub fn day(entry: &Entry) -> &str {
    entry.at.get(..10).filter(|day| is_day(day)).unwrap_or("1970-01-01")
}

fn is_day(text: &str) -> bool {
    let is_right = |(place, byte): (usize, u8)| match place {
        4 | 7 => byte == b'-',
        _ => byte.is_ascii_digit(),
    };
    text.len() == 10 && text.bytes().enumerate().all(is_right)
}

/// Returns the path of the event file of a day.
pub fn path(directory: &Path, machine: &str, day: &str) -> PathBuf {
    directory.join(format!("{machine}-{day}{ENDING}"))
}

fn checksum(text: &str) -> String {
    format!("{:08x}", CHECKSUM.checksum(text.as_bytes()))
}

impl End {
    fn of_nothing(path: &Path) -> End {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        End { count: 0, seal: checksum(&name), is_cut: false, length: 0 }
    }

    /// Returns the length of the file in bytes.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Formats the next line of the file. Returns the text of the line, and the state at the new end of the file. If
    /// the file ends in the middle of a line, the text begins with a line break.
    pub fn line(&self, entry: &Entry) -> (String, End) {
        let (count, after) = (self.count + 1, self.seal.clone());
        // Numbers and texts always have a JSON form.
        let line = serde_json::to_string(&Line { n: count, after, entry: entry.clone() }).unwrap_or_default();
        let line = line.strip_suffix('}').unwrap_or(&line);
        let seal = checksum(line);
        let begin = if self.is_cut { "\n" } else { "" };
        let text = format!("{begin}{line}{SEAL}{seal}\"}}\n");
        let length = self.length + text.len();
        (text, End { count, seal, is_cut: false, length })
    }
}

/// Reads the file of a day, and passes each event and each damage to `found`. Returns the state at the end of the file,
/// from which the next line is made.
///
/// # Errors
/// The file exists and cannot be read, or is not a regular file.
pub fn read(path: &Path, mut found: impl FnMut(FileItem)) -> std::io::Result<End> {
    let mut end = End::of_nothing(path);
    let mut text = Vec::new();
    match safe_file::open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(end),
        Err(error) => return Err(error),
        Ok(file) => file.take(2 * LARGEST as u64).read_to_end(&mut text)?,
    };
    end.length = text.len();
    end.is_cut = text.last().is_some_and(|byte| *byte != b'\n');
    let damage =
        |line: usize, what: &str| FileItem::Damage(format!("{}, line {line}: {what}", path.display()));
    for (place, line) in text.split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty()) {
        let place = place + 1;
        let Some((line, seal)) = std::str::from_utf8(line).ok().and_then(sealed) else {
            found(damage(place, "not an event: the line is cut or overwritten"));
            continue;
        };
        if line.n != end.count + 1 {
            found(damage(
                place,
                &format!("after event {} comes event {}: lines are missing", end.count, line.n),
            ));
        } else if line.after != end.seal {
            found(damage(place, "this line does not match the previous line: lines were changed or moved"));
        }
        match seal {
            Ok(seal) => end.seal = seal,
            Err(seal) => {
                found(damage(place, "the line was changed: its checksum is wrong"));
                end.seal = seal;
            }
        }
        end.count = line.n;
        found(FileItem::Event(line.entry));
    }
    Ok(end)
}

/// Parses a line of the event file; `None` if the line is not an event. Returns the content of the line and its seal
/// (checksum). The seal is `Err` if it is not the checksum of the line.
fn sealed(text: &str) -> Option<(Line, Result<String, String>)> {
    let line = serde_json::from_str(text).ok()?;
    let (sealed, seal) = text.rsplit_once(SEAL)?;
    let seal = seal.strip_suffix("\"}")?.to_owned();
    Some((line, if checksum(sealed) == seal { Ok(seal) } else { Err(seal) }))
}

/// Returns the days for which this machine has event files, oldest first.
///
/// # Errors
/// The directory cannot be read.
pub fn days(directory: &Path, machine: &str) -> std::io::Result<Vec<String>> {
    let mut days: Vec<String> =
        files(directory)?.into_iter().filter(|(of, _)| of == machine).map(|(_, day)| day).collect();
    days.sort_unstable();
    Ok(days)
}

/// Returns the machine and the day of each event file in the directory.
fn files(directory: &Path) -> std::io::Result<Vec<(String, String)>> {
    let mut files = Vec::new();
    for file in std::fs::read_dir(directory)? {
        let name = file?.file_name();
        let Some(stem) = name.to_str().and_then(|name| name.strip_suffix(ENDING)) else { continue };
        let place = stem.len().saturating_sub(10);
        let Some((machine, day)) = stem.split_at_checked(place).filter(|(_, day)| is_day(day)) else {
            continue;
        };
        if let Some(machine) = machine.strip_suffix('-') {
            files.push((machine.to_owned(), day.to_owned()));
        }
    }
    Ok(files)
}

/// Returns the names of the machines that have event files in this directory.
///
/// # Errors
/// The directory cannot be read.
pub fn machines(directory: &Path) -> std::io::Result<Vec<String>> {
    let mut machines: Vec<String> = files(directory)?.into_iter().map(|(machine, _)| machine).collect();
    machines.sort_unstable();
    machines.dedup();
    Ok(machines)
}

/// Parses the start of a time range: a duration before `now`, for example `12h`, or a time, for example
/// `2026-01-31T18:00:00Z`.
///
/// # Errors
/// The text is not a duration and not a time. The error is a sentence that describes the format.
pub fn begin(text: &str, now: Moment) -> Result<Moment, String> {
    if let Ok(span) = humantime::parse_duration(text) {
        return Ok(now.before(span));
    }
    time::parse(text).map_err(|_| {
        format!("`{text}` is not a time: write a duration such as 12h or a time such as 2026-01-31T18:00:00Z")
    })
}

/// Reads the events since the time `since`, oldest first, until `found` returns `false`. Files of later days are then
/// not read.
///
/// # Errors
/// The directory cannot be read.
pub fn since(
    directory: &Path,
    machine: &str,
    since: Moment,
    mut found: impl FnMut(FileItem) -> bool,
) -> std::io::Result<()> {
    let mut is_wanted = true;
    let mut found = |one| {
        is_wanted = is_wanted && found(one);
        is_wanted
    };
    let first = since.to_string();
    let first = first.get(..10).unwrap_or_default();
    for day in days(directory, machine)?.iter().filter(|day| day.as_str() >= first) {
        let path = path(directory, machine, day);
        let mut continues = true;
        let read = read(&path, |one| match &one {
            FileItem::Event(entry) if time::parse(&entry.at).is_ok_and(|at| at < since) => {}
            _ => continues = found(one),
        });
        if let Err(error) = read {
            continues = found(FileItem::Damage(format!(
                "{} cannot be read: {}",
                path.display(),
                without_numbers(&error.to_string())
            )));
        }
        if !continues {
            break;
        }
    }
    Ok(())
}

/// Returns the last events, at most `most`, oldest first. Only the ends of the last files are read.
pub fn last(directory: &Path, machine: &str, most: usize) -> Vec<Entry> {
    let mut last = Vec::new();
    for day in days(directory, machine).unwrap_or_default().iter().rev().take(DAYS_BACK) {
        let mut entries = tail(&path(directory, machine, day)).unwrap_or_default();
        entries.extend(last);
        last = entries;
        if last.len() >= most {
            break;
        }
    }
    last.split_off(last.len().saturating_sub(most))
}

/// Reads the events in the last [`TAIL`] bytes of a file. Incomplete lines are left out.
fn tail(path: &Path) -> std::io::Result<Vec<Entry>> {
    let mut file = safe_file::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut text = Vec::new();
    file.take(TAIL).read_to_end(&mut text)?;
    let lines = text.split(|byte| *byte == b'\n');
    let lines = lines.filter_map(|line| sealed(std::str::from_utf8(line).ok()?));
    Ok(lines.map(|(line, _)| line.entry).collect())
}

#[cfg(test)]
mod tests;
