//! Events on disk: one JSON document a line, a file a day beside the logs, `NAME-2026-01-31.events.jsonl`.
//!
//! Every line is sealed: `n` counts the lines of the file, `after` is the seal of the line before it (of the first: that of
//! the file's name), `seal` the checksum of all of the line before it. So whoever reads finds lines that were changed, cut
//! or taken out, and files that stand in the place of another's. That is reported, and the rest is read.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Entry;
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::regular::{self, without_numbers};

/// What stands behind the day in the name of a file.
const ENDING: &str = ".events.jsonl";
const SEAL: &str = ",\"seal\":\"";
/// A file of a day is not longer, what happens then is counted; nobody reads more of one.
pub const LARGEST: usize = 16 << 20;
/// So much of the ends of so many files is read for the last events.
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

/// The end of a file: what its next line goes on from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    count: u64,
    seal: String,
    /// The file ends in the middle of a line.
    is_cut: bool,
    length: usize,
}

/// What is found on disk.
#[derive(Clone, Debug, PartialEq)]
pub enum Found {
    /// An event.
    Event(Entry),
    /// What is wrong, as a sentence with the name of the file.
    Damage(String),
}

/// The day of an event, as it stands in the name of its file.
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

/// The file of a day.
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

    /// How long the file is, in bytes.
    pub fn length(&self) -> usize {
        self.length
    }

    /// The line of an event behind this end, and the end behind it. Half a line is ended first.
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

/// Reads a file of a day; its end is what a next line goes on from.
///
/// # Errors
/// It is there and cannot be read, or is no file.
pub fn read(path: &Path, mut found: impl FnMut(Found)) -> std::io::Result<End> {
    let mut end = End::of_nothing(path);
    let mut text = Vec::new();
    match regular::open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(end),
        Err(error) => return Err(error),
        Ok(file) => file.take(2 * LARGEST as u64).read_to_end(&mut text)?,
    };
    end.length = text.len();
    end.is_cut = text.last().is_some_and(|byte| *byte != b'\n');
    let damage = |line: usize, what: &str| Found::Damage(format!("{}, line {line}: {what}", path.display()));
    for (place, line) in text.split(|byte| *byte == b'\n').enumerate().filter(|(_, line)| !line.is_empty()) {
        let place = place + 1;
        let Some((line, seal)) = std::str::from_utf8(line).ok().and_then(sealed) else {
            found(damage(place, "no event: cut, or overwritten"));
            continue;
        };
        if line.n != end.count + 1 {
            found(damage(
                place,
                &format!("after event {} comes event {}: lines are missing", end.count, line.n),
            ));
        } else if line.after != end.seal {
            found(damage(place, "it does not belong behind what stands before it"));
        }
        match seal {
            Ok(seal) => end.seal = seal,
            Err(seal) => {
                found(damage(place, "it was changed: its checksum does not fit"));
                end.seal = seal;
            }
        }
        end.count = line.n;
        found(Found::Event(line.entry));
    }
    Ok(end)
}

/// A line and its seal; where that does not fit, as an error.
fn sealed(text: &str) -> Option<(Line, Result<String, String>)> {
    let line = serde_json::from_str(text).ok()?;
    let (sealed, seal) = text.rsplit_once(SEAL)?;
    let seal = seal.strip_suffix("\"}")?.to_owned();
    Some((line, if checksum(sealed) == seal { Ok(seal) } else { Err(seal) }))
}

/// The days of which there are files of this machine, oldest first.
///
/// # Errors
/// The directory cannot be read.
pub fn days(directory: &Path, machine: &str) -> std::io::Result<Vec<String>> {
    let mut days: Vec<String> =
        files(directory)?.into_iter().filter(|(of, _)| of == machine).map(|(_, day)| day).collect();
    days.sort_unstable();
    Ok(days)
}

/// Machine and day of each file.
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

/// The machines of which there are events in this directory.
///
/// # Errors
/// The directory cannot be read.
pub fn machines(directory: &Path) -> std::io::Result<Vec<String>> {
    let mut machines: Vec<String> = files(directory)?.into_iter().map(|(machine, _)| machine).collect();
    machines.sort_unstable();
    machines.dedup();
    Ok(machines)
}

/// The moment that `12h` or `2026-01-31T18:00:00Z` means.
///
/// # Errors
/// A sentence that says how to write it.
pub fn begin(text: &str, now: Moment) -> Result<Moment, String> {
    if let Ok(span) = humantime::parse_duration(text) {
        return Ok(now.before(span));
    }
    time::parse(text).map_err(|_| {
        format!("`{text}` is no time: write a span, as 12h, or a moment, as 2026-01-31T18:00:00Z")
    })
}

/// What happened since this moment, oldest first. Of the days behind that in which no more is wanted nothing is read.
///
/// # Errors
/// The directory cannot be read.
pub fn since(
    directory: &Path,
    machine: &str,
    since: Moment,
    mut found: impl FnMut(Found) -> bool,
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
        let mut goes_on = true;
        let read = read(&path, |one| match &one {
            Found::Event(entry) if time::parse(&entry.at).is_ok_and(|at| at < since) => {}
            _ => goes_on = found(one),
        });
        if let Err(error) = read {
            goes_on = found(Found::Damage(format!(
                "{} cannot be read: {}",
                path.display(),
                without_numbers(&error.to_string())
            )));
        }
        if !goes_on {
            break;
        }
    }
    Ok(())
}

/// The last events, oldest first, at most so many, from the ends of the last files.
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

/// The events at the end of a file.
fn tail(path: &Path) -> std::io::Result<Vec<Entry>> {
    let mut file = regular::open(path)?;
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
