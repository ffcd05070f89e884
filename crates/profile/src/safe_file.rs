//! Opens files that a user names. The program never blocks on a pipe without a writer, an endless device file, or a
//! directory.

use std::borrow::Cow;
use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, BufRead, BufReader, Chain, Cursor, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use rustix::fs::OFlags;

/// Largest size of a file that a profile names (a network, matrix or DBC file), in bytes.
pub const LARGEST: u64 = 16 * 1024 * 1024;

/// Largest size of a profile or template, in bytes: enough for 5,000 devices with eight signals and an axis each.
///
/// The check of a key needs fifty times the length of the key in memory, because the TOML reader keeps 48
/// bytes for each token. Under systemd, the memory limit is 1 GB. During a restart, a gateway and its
/// successor share this memory.
pub const LARGEST_PROFILE: u64 = 8 * 1024 * 1024;

/// Opens a regular file for reading. Links are followed.
///
/// # Errors
/// Errors of [`File::open`], and an error if the path is not a regular file. The message does not contain the path.
pub fn open(path: &Path) -> io::Result<File> {
    // Checked before, because opening a device may have an effect.
    regular(&std::fs::metadata(path)?)?;
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    regular(&file.metadata()?)?;
    Ok(file)
}

/// Reads the bytes of a regular file.
///
/// # Errors
/// Errors of [`open`], and an error if the file is larger than `largest` bytes.
pub fn read(path: &Path, largest: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(largest + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > largest {
        let text = format!("the file is larger than {} MB: give the path of another file", largest >> 20);
        return Err(io::Error::new(ErrorKind::FileTooLarge, text));
    }
    Ok(bytes)
}

/// Reads the text of a regular file of at most [`LARGEST`] bytes, in UTF-8.
///
/// # Errors
/// Errors of [`read`], and an error if the file is not valid UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    read_text_of(path, LARGEST)
}

/// Reads the text of a regular file of at most `largest` bytes, in UTF-8.
///
/// # Errors
/// The errors of [`read_text`].
pub fn read_text_of(path: &Path, largest: u64) -> io::Result<String> {
    String::from_utf8(read(path, largest)?)
        .map_err(|_| io::Error::new(ErrorKind::InvalidData, "the file is not a text in UTF-8"))
}

/// Removes " (os error N)" from a sentence that contains messages of the system.
pub fn without_numbers(sentence: &str) -> String {
    let mut left = String::with_capacity(sentence.len());
    let mut rest = sentence;
    while let Some((before, after)) = rest.split_once(" (os error ") {
        left.push_str(before);
        rest = after.trim_start_matches(|digit: char| digit.is_ascii_digit());
        rest = rest.strip_prefix(')').unwrap_or(rest);
    }
    left.push_str(rest);
    left
}

/// Longest row of a log, in bytes: a hundred thousand numbers. A file without line ends, for example a picture, is
/// rejected at this length, before all of it has been read.
pub const LONGEST_ROW: usize = 1_000_000;

/// Longest quotation from a file, in characters.
pub const LONGEST_QUOTE: usize = 200;

/// Truncates a text longer than [`LONGEST_QUOTE`], and marks the truncation with "…".
#[must_use]
pub fn quoted(text: &str) -> Cow<'_, str> {
    cut(text, LONGEST_QUOTE)
}

/// Truncates a text to `most` characters, and marks the truncation with "…".
#[must_use]
pub fn cut(text: &str, most: usize) -> Cow<'_, str> {
    if text.len() <= most {
        return Cow::Borrowed(text);
    }
    match text.char_indices().nth(most) {
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => Cow::Borrowed(text),
    }
}

/// Reads the first line. Returns that line and a reader of the whole input, which converts every line ending to a line
/// feed. If the line is longer than [`LONGEST_ROW`], only its beginning is returned.
///
/// # Errors
/// Errors of the reader.
pub fn first_line<R: Read>(input: R) -> io::Result<(String, Lines<R>)> {
    const BUFFER: usize = 1 << 18;
    let (mut reader, mut first) = (BufReader::with_capacity(BUFFER, input), Vec::new());
    reader.by_ref().take(LONGEST_ROW as u64).read_until(b'\n', &mut first)?;
    let text = String::from_utf8_lossy(&first).into_owned();
    Ok((text, Lines { input: Cursor::new(first).chain(reader), last: b'\n', open: 0 }))
}

/// Reader that converts every line ending to a line feed, because programs count lines with other line endings
/// differently. A row longer than [`LONGEST_ROW`] is an error.
#[derive(Debug)]
pub struct Lines<R> {
    input: Chain<Cursor<Vec<u8>>, BufReader<R>>,
    /// Last byte of the input that was read, to recognise the line ending CR LF across two reads.
    last: u8,
    /// Number of bytes, without line feeds, that were returned since the last row ended.
    open: usize,
}

impl<R: Read> Lines<R> {
    /// Records that a row of the log has ended. The length of the next row is then counted from 0.
    pub fn row_is_over(&mut self) {
        self.open = 0;
    }
}

impl<R: Read> Read for Lines<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled == 0 && !out.is_empty() {
            let found = self.input.fill_buf()?;
            if found.is_empty() {
                if matches!(self.last, b'\n' | b'\r') {
                    return Ok(0);
                }
                (self.last, out[0]) = (b'\n', b'\n');
                return Ok(1);
            }
            let taken = found.len().min(out.len());
            let found = &found[..taken];
            if self.last != b'\r' && !found.contains(&b'\r') {
                out[..taken].copy_from_slice(found);
                (filled, self.last) = (taken, found[taken - 1]);
            } else {
                for byte in found {
                    if (self.last, *byte) != (b'\r', b'\n') {
                        out[filled] = if *byte == b'\r' { b'\n' } else { *byte };
                        filled += 1;
                    }
                    self.last = *byte;
                }
            }
            self.input.consume(taken);
        }
        // Empty lines are not rows, so no row end is recorded for them.
        self.open += out[..filled].iter().filter(|byte| **byte != b'\n').count();
        if self.open > LONGEST_ROW {
            let limit = LONGEST_ROW / 1_000_000;
            let text = format!(
                "this row is longer than {limit} MB: check that the file is a log, and that each quotation \
                 mark (\") in the row is closed"
            );
            return Err(io::Error::new(ErrorKind::FileTooLarge, text));
        }
        Ok(filled)
    }
}

fn regular(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let text = format!(
        "this is {}, not a regular file: put a regular file at this path, or give another path",
        what(metadata.file_type())
    );
    Err(io::Error::new(ErrorKind::InvalidInput, text))
}

fn what(file_type: FileType) -> &'static str {
    match () {
        () if file_type.is_dir() => "a directory",
        () if file_type.is_fifo() => "a named pipe",
        () if file_type.is_socket() => "a socket",
        () => "a device",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_at_once_and_named() {
        let directory = tempfile::tempdir().unwrap();
        let pipe = directory.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let socket = directory.path().join("socket");
        let _socket = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let link = directory.path().join("link");
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        let found = [(pipe, "a named pipe"), (socket, "a socket"), (link, "a device")];
        for (path, what) in found.into_iter().chain([(directory.path().to_owned(), "a directory")]) {
            let why = read(&path, 1).unwrap_err().to_string();
            assert_eq!(
                why,
                format!(
                    "this is {what}, not a regular file: put a regular file at this path, or give another path"
                )
            );
        }
    }

    #[test]
    fn a_row_without_an_end_is_refused_and_rows_without_number_are_not() {
        let endless = std::io::repeat(0);
        let (first, mut lines) = first_line(endless).unwrap();
        assert_eq!(first.len(), LONGEST_ROW);
        let why = io::copy(&mut lines, &mut io::sink()).unwrap_err();
        assert_eq!(why.kind(), ErrorKind::FileTooLarge);
        assert!(why.to_string().contains("longer than 1 MB"), "{why}");
        let empty = "\n".repeat(3 * LONGEST_ROW);
        let (_, mut lines) = first_line(empty.as_bytes()).unwrap();
        assert_eq!(io::copy(&mut lines, &mut io::sink()).unwrap(), 3 * LONGEST_ROW as u64);
        let rows = "a,b\r\n".repeat(LONGEST_ROW);
        let (_, mut lines) = first_line(rows.as_bytes()).unwrap();
        let (mut part, mut all) = ([0; 4096], 0);
        while let Ok(count @ 1..) = lines.read(&mut part) {
            assert!(!part[..count].contains(&b'\r'));
            all += count;
            lines.row_is_over();
        }
        assert_eq!(all, 4 * LONGEST_ROW);
    }

    #[test]
    fn what_is_quoted_is_cut_between_two_characters() {
        assert_eq!(quoted("short"), "short");
        let long = "µ".repeat(LONGEST_QUOTE + 1);
        assert_eq!(quoted(&long), format!("{}…", "µ".repeat(LONGEST_QUOTE)));
        assert_eq!(quoted(&long[2..]), &long[2..]);
    }

    #[test]
    fn a_file_may_be_as_large_as_that_and_no_larger() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        std::fs::write(&path, [7; 9]).unwrap();
        assert_eq!(read(&path, 9).unwrap(), [7; 9]);
        assert_eq!(read(&path, 8).unwrap_err().kind(), ErrorKind::FileTooLarge);
    }

    #[test]
    fn the_systems_numbers_are_left_out_of_a_sentence() {
        for (said, left) in [
            ("a.csv: No such file or directory (os error 2)", "a.csv: No such file or directory"),
            ("a (os error 13): b (os error 5)", "a: b"),
            ("nothing of it", "nothing of it"),
        ] {
            assert_eq!(without_numbers(said), left);
        }
    }
}
