//! An FE input file: a mesh, its materials and one heat-transfer load case, in the subset of Abaqus and CalculiX input that
//! Gmsh and PrePoMax write.
//!
//! ```text
//! card ───── what stands in the files: cards, parameters, lines, with their locations
//! keywords ─ which cards there are, and when each is read: after all that it may name
//! reader ─── what has been read so far; mesh, material and load read their cards into it
//! ```
//! A Gmsh mesh names surfaces by flat elements (`CPS3`, `CPS6`): the nodes of such a set can be used as a node set, and
//! its faces in `*FILM` and `*DFLUX` with the side `F` or `S` without a number.
//!
//! Nothing is skipped: what is not understood is an error. A solver that passes over a card computes another structure
//! than the one that was meant, and its numbers look just as good.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::body::{LoadCase, Materials, Progress};
use crate::each::each;
use crate::mesh::Mesh;

mod card;
mod keywords;
mod load;
mod material;
mod mesh;
mod reader;

#[cfg(test)]
mod tests;

/// A mesh, what it is made of, and one load case.
#[derive(Debug, Clone, PartialEq)]
pub struct FeInput {
    /// The name of the file without its ending: the name of the load case.
    pub name: String,
    /// The mesh with its sets.
    pub mesh: Mesh,
    /// What the elements are made of.
    pub materials: Materials,
    /// What warms the body.
    pub load: LoadCase,
    /// Names of the surfaces on which films and fluxes act.
    pub surfaces: SurfaceNames,
    /// Nodes that `*BOUNDARY` holds in x, y and z, ascending; often empty, since conduction does not ask for it.
    pub supports: Vec<usize>,
}

/// Names of surfaces or sets in small letters; a single element is called by its number.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SurfaceNames {
    /// One for each film of the load case.
    pub films: Vec<String>,
    /// One for each flux of the load case.
    pub fluxes: Vec<String>,
}

/// One thing that is wrong in an FE input file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// The file.
    pub file: PathBuf,
    /// Its line, from 1; none where the fault is about the file as a whole.
    pub line: Option<usize>,
    /// The card, with its asterisk; empty where none is meant.
    pub card: String,
    /// What is wrong, and what to do.
    pub message: String,
}

impl Fault {
    /// A fault of a file as a whole.
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

/// Everything that is wrong in an FE input file. The first are described, the others are counted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Faults {
    /// In the order in which they were found.
    pub described: Vec<Fault>,
    /// Beyond these.
    pub more: usize,
}

/// More than these nobody reads at once.
const SHOWN: usize = 20;
/// More than these need not be described to be counted: a mesh without its nodes has one in every line.
const MOST_DESCRIBED: usize = 10_000;
/// A sentence quotes what stands in a file.
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
        // The same mistake in line after line is shown once.
        let alike = |a: &Fault, b: &Fault| (&a.file, &a.card, &a.message) == (&b.file, &b.card, &b.message);
        let groups: Vec<&[Fault]> = self.described.chunk_by(alike).collect();
        for (number, faults) in groups.iter().take(SHOWN).enumerate() {
            let sentence = faults[0].to_string();
            let end = sentence.char_indices().nth(LONGEST_SENTENCE).map_or(sentence.len(), |(end, _)| end);
            let dots = if end < sentence.len() { "…" } else { "" };
            write!(f, "{}{}{dots}", if number == 0 { "" } else { "\n" }, &sentence[..end])?;
            if faults.len() > 1 {
                write!(f, " (and so in {} more lines)", faults.len() - 1)?;
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

/// Reads an FE input file and everything it includes.
///
/// # Errors
/// Everything that is wrong in it, with file, line and card.
pub fn read(path: &Path) -> Result<FeInput, Faults> {
    let mut faults = Faults::default();
    let cards = card::read(path, &mut faults);
    if cards.is_empty() && faults.is_empty() {
        faults.push(Fault::of_file(path, "the FE input file is empty"));
    }
    keywords::read(path, &cards, faults)
}

/// Reads several, at once.
pub fn read_each(paths: &[PathBuf], progress: Progress<'_>) -> Vec<Result<FeInput, Faults>> {
    each("FE input files", paths, progress, |path| read(path))
}
