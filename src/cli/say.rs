//! What a verb prints. Nobody may be there to read it, and a disk may be full: that is an error of the verb, never a panic.
//! What others wrote may stand in it: it steers no terminal.

use std::fmt::Arguments;
use std::io::{Error, Result, Write, stdout};

use super::journal_stream;
use isotherm_profile::lines;

/// Standard output, which says so where it cannot be written.
pub(crate) struct Out;

/// The same for a terminal that is redrawn: what steers it is our own.
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

/// A line of what the verb is for.
///
/// # Errors
/// Nobody takes it.
pub(crate) fn line(text: Arguments<'_>) -> Result<()> {
    all(format_args!("{text}\n"))
}

/// The same without a line break.
///
/// # Errors
/// Nobody takes it.
pub(crate) fn all(text: Arguments<'_>) -> Result<()> {
    Out.write_fmt(text).and_then(|()| Out.flush())
}

/// Takes away what a terminal shows.
///
/// # Errors
/// Nobody takes it.
pub(crate) fn clear() -> Result<()> {
    Screen.write_all(b"\x1b[H\x1b[2J")
}

fn not_taken(error: Error) -> Error {
    Error::new(error.kind(), format!("what is printed (standard output) cannot be written: {error}"))
}

/// A line beside that is cut after so many characters: it quotes what a file, or a device, says.
const LONGEST_LINE: usize = 2000;
/// What is said beside at once, in bytes.
const MOST_SAID: usize = 64_000;

/// A line beside that: a warning, or how far something is. It is lost where nobody takes it.
pub(crate) fn beside(text: Arguments<'_>) {
    let text = readable(&lines(&text.to_string()));
    let text = if journal_stream::is_stderr() { journal_stream::prioritised(&text) } else { text };
    let _ = std::io::stderr().write_all(format!("{text}\n").as_bytes());
}

/// As much of a text as a person can read.
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

/// What stands in the last line of a terminal, and is written over by the next.
pub(crate) fn progress(text: Arguments<'_>) {
    let mut err = std::io::stderr();
    let _ = err.write_fmt(text).and_then(|()| err.flush());
}

/// `println!` that fails instead of panicking.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::say::line(format_args!($($text)*)) };
}
/// `print!` that fails instead of panicking.
macro_rules! say_all {
    ($($text:tt)*) => { $crate::cli::say::all(format_args!($($text)*)) };
}
/// Beside what is printed; lost where nobody takes it.
macro_rules! say_beside {
    ($($text:tt)*) => { $crate::cli::say::beside(format_args!($($text)*)) };
}
/// Written over by the next.
macro_rules! say_progress {
    ($($text:tt)*) => { $crate::cli::say::progress(format_args!($($text)*)) };
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
