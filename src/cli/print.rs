//! Output of the verbs. A failed write, for example to a closed pipe or a full disk, is an error of the verb, never a
//! panic. Control characters in quoted text are escaped.

use std::fmt::Arguments;
use std::io::{Error, Result, Write, stdout};

use super::journal_stream;
use isotherm_profile::lines;

/// Standard output, with control characters escaped. Its errors say that standard output cannot be written.
pub(crate) struct Out;

/// Standard output without escaping, for the control sequences by which a terminal is redrawn.
pub(crate) struct Screen;

impl Write for Out {
    fn write(&mut self, text: &[u8]) -> Result<usize> {
        let Ok(readable) = std::str::from_utf8(text) else { return Screen.write(text) };
        Screen.write_all(lines(readable).as_bytes()).map(|()| text.len())
    }

    fn flush(&mut self) -> Result<()> {
        Screen.flush()
    }
}

impl Write for Screen {
    fn write(&mut self, text: &[u8]) -> Result<usize> {
        stdout().write(text).map_err(not_taken)
    }

    fn flush(&mut self) -> Result<()> {
        stdout().flush().map_err(not_taken)
    }
}

/// Prints one line of the result.
///
/// # Errors
/// Standard output cannot be written.
pub(crate) fn line(text: Arguments<'_>) -> Result<()> {
    all(format_args!("{text}\n"))
}

/// Prints text of the result, without a line break at its end.
///
/// # Errors
/// Standard output cannot be written.
pub(crate) fn all(text: Arguments<'_>) -> Result<()> {
    // Formatted before, because standard output would write each line separately.
    Out.write_all(text.to_string().as_bytes()).and_then(|()| Out.flush())
}

/// Prints a JSON document, indented.
///
/// # Errors
/// The document cannot be serialised, or standard output cannot be written.
pub(crate) fn print_json(document: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(line(format_args!("{}", serde_json::to_string_pretty(document)?))?)
}

/// Clears the terminal.
///
/// # Errors
/// Standard output cannot be written.
pub(crate) fn clear() -> Result<()> {
    Screen.write_all(b"\x1b[H\x1b[2J")
}

fn not_taken(error: Error) -> Error {
    Error::new(error.kind(), format!("standard output cannot be written: {error}"))
}

/// Maximum number of characters in a line of a diagnostic. A longer line is cut, because it probably quotes a file or a
/// device.
const LONGEST_LINE: usize = 2000;
/// Maximum number of bytes in a diagnostic. Further lines are only counted.
const MOST_SAID: usize = 64_000;

/// Prints a diagnostic on stderr, for example a warning or a progress line. Write errors are ignored.
pub(crate) fn beside(text: Arguments<'_>) {
    let text = readable(&lines(&text.to_string()));
    let text = if journal_stream::is_stderr() { journal_stream::prioritised(&text) } else { text };
    let _ = std::io::stderr().write_all(format!("{text}\n").as_bytes());
}

/// Shortens a diagnostic to a length that a person can read.
fn readable(text: &str) -> String {
    let mut said = String::new();
    let mut lines = text.split('\n');
    while let Some(line) = lines.next() {
        let end = line.char_indices().nth(LONGEST_LINE).map_or(line.len(), |(end, _)| end);
        if said.len() + end > MOST_SAID {
            let more = 1 + lines.count();
            said.push_str(&format!("\n… and {more} more lines"));
            break;
        }
        if !said.is_empty() {
            said.push('\n');
        }
        said.push_str(&line[..end]);
        if end < line.len() {
            said.push('…');
        }
    }
    said
}

/// Prints text on stderr without a line break at its end, for example a progress line that is redrawn. Write
/// errors are ignored.
pub(crate) fn progress(text: Arguments<'_>) {
    let mut err = std::io::stderr();
    let _ = err.write_fmt(text).and_then(|()| err.flush());
}

/// `println!` that returns an error instead of panicking.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::print::line(format_args!($($text)*)) };
}
/// `print!` that returns an error instead of panicking.
macro_rules! say_all {
    ($($text:tt)*) => { $crate::cli::print::all(format_args!($($text)*)) };
}
/// Prints a diagnostic on stderr, and ignores write errors.
macro_rules! say_beside {
    ($($text:tt)*) => { $crate::cli::print::beside(format_args!($($text)*)) };
}
/// Prints text on stderr without a line break at its end, and ignores write errors.
macro_rules! say_progress {
    ($($text:tt)*) => { $crate::cli::print::progress(format_args!($($text)*)) };
}
pub(crate) use {say, say_all, say_beside, say_progress};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_told_more_than_can_be_read() {
        assert_eq!(readable("a line\n\n  and another"), "a line\n\n  and another");
        assert_eq!(readable(&"µ".repeat(3000)), format!("{}…", "µ".repeat(LONGEST_LINE)));
        let many = readable(&"sixteen letters.\n".repeat(100_000));
        assert!(many.len() < MOST_SAID + 100 && many.ends_with("more lines"), "{}", &many[many.len() - 60..]);
    }
}
