//! FE input file: a mesh, its materials, and one heat-transfer load case. The format is the subset of Abaqus and
//! CalculiX input that Gmsh and PrePoMax write.
//!
//! ```text
//! card ───── cards of the files: keyword, parameters, lines, with their locations
//! keywords ─ known cards, and the order in which they are read: each after all that it may name
//! reader ─── data read so far; mesh, material and load read their cards into it
//! ```
//! A Gmsh mesh names surfaces by flat elements (`CPS3`, `CPS6`). The nodes of such a set can be used as a node set. The
//! faces of the set can be used in `*FILM` and `*DFLUX`, with the side `F` or `S` without a number.
//!
//! Nothing is skipped: an unknown card is an error. A solver that ignores a card computes another structure, and its
//! wrong results look plausible.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::body::{LoadCase, Materials, Progress};
use crate::mesh::Mesh;
use crate::parallel::each;

mod card;
mod keywords;
mod load;
mod material;
mod mesh;
mod reader;

#[cfg(test)]
mod tests;

/// A mesh, its materials, and one load case.
#[derive(Debug, Clone, PartialEq)]
pub struct FeInput {
    /// Name of the load case: the file name without extension.
    pub name: String,
    /// Mesh with its sets.
    pub mesh: Mesh,
    /// Materials of the elements.
    pub materials: Materials,
    /// Load case: initial temperatures, loads and time range.
    pub load: LoadCase,
    /// Names of the surfaces with films and fluxes.
    pub surfaces: SurfaceNames,
    /// Nodes that `*BOUNDARY` fixes in x, y and z, ascending. The list is often empty, because heat conduction does not
    /// require it.
    pub supports: Vec<usize>,
}

/// Names of the surfaces or sets of the loads, in small letters. The name of a single element is its number.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SurfaceNames {
    /// Name for each film of the load case.
    pub films: Vec<String>,
    /// Name for each flux of the load case.
    pub fluxes: Vec<String>,
}

/// One error in an FE input file, with its location.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Path of the file with the error.
    pub file: PathBuf,
    /// Line, from 1; `None` if the error concerns the whole file.
    pub line: Option<usize>,
    /// Card with its asterisk; empty if the error concerns no card.
    pub card: String,
    /// Cause and remedy in one sentence.
    pub message: String,
}

impl Fault {
    /// Creates an error that concerns the whole file.
    fn of_file(path: &Path, message: impl Into<String>) -> Fault {
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
    /// Described errors, in the order in which they were found.
    pub described: Vec<Fault>,
    /// Number of further errors.
    pub more: usize,
}

/// Maximum number of errors in the message.
const SHOWN: usize = 20;
/// Maximum number of described errors; further errors are only counted. A mesh without its nodes has an error in every
/// line.
const MOST_DESCRIBED: usize = 10_000;
/// Maximum length of a message in characters. A message may quote a long text of a file.
const LONGEST_SENTENCE: usize = 800;

impl Faults {
    fn push(&mut self, fault: Fault) {
        if self.described.len() < MOST_DESCRIBED { self.described.push(fault) } else { self.more += 1 }
    }

    fn len(&self) -> usize {
        self.described.len() + self.more
    }

    fn is_empty(&self) -> bool {
        self.described.is_empty()
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

/// Reads an FE input file and all included files.
///
/// # Errors
/// Returns all errors in the files, with file, line and card.
pub fn read(path: &Path) -> Result<FeInput, Faults> {
    let mut faults = Faults::default();
    let cards = card::read(path, &mut faults);
    if cards.is_empty() && faults.is_empty() {
        faults.push(Fault::of_file(path, "the FE input file is empty"));
    }
    keywords::read(path, &cards, faults)
}

/// Reads several files in parallel.
pub fn read_each(paths: &[PathBuf], progress: Progress<'_>) -> Vec<Result<FeInput, Faults>> {
    each("FE input files", paths, progress, |path| read(path))
}
