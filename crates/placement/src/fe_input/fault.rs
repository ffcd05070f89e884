//! Errors in FE input files.

use std::fmt;
use std::path::{Path, PathBuf};

use super::card::WITHOUT_CARDS;

/// One error in an FE input file, with its location.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Path of the file with the error.
    pub file: PathBuf,
    /// Line, from 1; `None` if the error concerns the whole file.
    pub line: Option<usize>,
    /// Keyword of the card with the error, with its asterisk; empty if the error concerns no card.
    pub card: String,
    /// Cause and remedy in one sentence.
    pub message: String,
}

impl Fault {
    /// Creates an error that concerns the whole file.
    pub(super) fn of_file(path: &Path, message: impl Into<String>) -> Fault {
        Fault { file: path.to_path_buf(), line: None, card: String::new(), message: message.into() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if !self.card.is_empty() {
            write!(f, ": {}", self.card)?;
        }
        write!(f, ": {}", self.message)
    }
}

/// All errors in an FE input file. The first errors are stored with their messages; further errors are only counted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Faults {
    /// Errors with their messages, in the order in which they were found.
    pub described: Vec<Fault>,
    /// Number of further errors, whose messages are not stored.
    pub more: usize,
}

/// Maximum number of errors that the printed text lists.
const SHOWN: usize = 20;
/// Maximum number of errors that are stored with their messages; further errors are only counted. A mesh without its
/// nodes has an error in every line.
const MOST_DESCRIBED: usize = 10_000;
/// Maximum length of a message in characters. A message may quote a long text of a file.
const LONGEST_SENTENCE: usize = 800;

impl Faults {
    pub(super) fn push(&mut self, fault: Fault) {
        if self.described.len() < MOST_DESCRIBED { self.described.push(fault) } else { self.more += 1 }
    }

    pub(super) fn len(&self) -> usize {
        self.described.len() + self.more
    }

    pub(super) fn is_empty(&self) -> bool {
        self.described.is_empty()
    }

    /// Returns whether the only error is that this file has no cards. Such a file may be in another format.
    #[must_use]
    pub fn is_without_cards(&self, path: &Path) -> bool {
        matches!(&self.described[..], [only] if only.message == WITHOUT_CARDS && only.file == path)
    }
}

impl Extend<Fault> for Faults {
    fn extend<T: IntoIterator<Item = Fault>>(&mut self, faults: T) {
        faults.into_iter().for_each(|fault| self.push(fault));
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The same error in consecutive lines is shown once.
        let alike = |a: &Fault, b: &Fault| (&a.file, &a.card, &a.message) == (&b.file, &b.card, &b.message);
        let groups: Vec<&[Fault]> = self.described.chunk_by(alike).collect();
        for (number, faults) in groups.iter().take(SHOWN).enumerate() {
            let sentence = faults[0].to_string();
            let end = sentence.char_indices().nth(LONGEST_SENTENCE).map_or(sentence.len(), |(end, _)| end);
            let dots = if end < sentence.len() { "…" } else { "" };
            write!(f, "{}{}{dots}", if number == 0 { "" } else { "\n" }, &sentence[..end])?;
            if faults.len() > 1 {
                write!(f, " (also in {} more lines)", faults.len() - 1)?;
            }
        }
        let more = groups.len().saturating_sub(SHOWN) + self.more;
        if more > 0 {
            write!(f, "\n… and {more} more")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}
