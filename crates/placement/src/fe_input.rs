//! FE input file: a mesh, its materials, and one heat-transfer load case. The format is the subset of Abaqus and
//! CalculiX input that Gmsh and PrePoMax write. A card is a line with a keyword such as `*NODE` and its parameters,
//! together with the data lines below it.
//!
//! ```text
//! foreign ── files in other formats, which are refused with the command that converts them
//! card ───── cards of the files: keyword, parameters, lines, with their locations
//! assembly ─ converts an Abaqus file with a part and its instance to the cards of a file without parts
//! keywords ─ known cards, and the order in which they are read: each after all cards that it may refer to
//! reader ─── data read so far; mesh, material and load add the data of their cards, with temperatures in °C
//! ```
//! A Gmsh mesh names surfaces by flat elements (`CPS3`, `CPS6`). The nodes of such a set can be used as a node set. The
//! faces of the set can be used in `*FILM` and `*DFLUX`, with the side `F` or `S` without a number.
//!
//! Nothing is skipped: an unknown card is an error. A solver that ignores a card computes another structure, and its
//! wrong results look plausible.

use std::path::{Path, PathBuf};

use crate::body::Progress;
use crate::parallel::each;

mod assembly;
mod card;
mod contents;
mod fault;
mod foreign;
mod keywords;
mod load;
mod material;
mod mesh;
mod position;
mod reader;
mod temperature;

#[cfg(test)]
mod tests;

pub use contents::{FeInput, SurfaceNames};
pub use fault::{Fault, Faults};

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
    keywords::read(path, cards, faults)
}

/// Reads several files in parallel. Returns one result for each path, in the same order; see [`read`].
pub fn read_each(paths: &[PathBuf], progress: Progress<'_>) -> Vec<Result<FeInput, Faults>> {
    each("FE input files", paths, progress, |path| read(path))
}
