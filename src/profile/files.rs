//! Where the files that a profile names are: beside it, or, for one that is part of the program, in the program.

use std::io::Read;
use std::path::Path;

/// A larger one is not what a model of a machine tool is made of.
const LARGEST: u64 = 64 * 1024 * 1024;

/// The files of one profile.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Files<'a> {
    /// Relative to this directory.
    Beside(&'a Path),
    /// By name.
    Inside(&'a [(&'a str, &'a [u8])]),
}

impl Files<'_> {
    /// The bytes of a file.
    ///
    /// # Errors
    /// A sentence: not there, not readable, too large.
    pub(crate) fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        match self {
            Files::Beside(directory) => {
                let path = directory.join(name);
                let unreadable = |why| format!("{} cannot be read: {why}", path.display());
                let file = std::fs::File::open(&path).map_err(unreadable)?;
                let mut bytes = Vec::new();
                file.take(LARGEST + 1).read_to_end(&mut bytes).map_err(unreadable)?;
                if bytes.len() as u64 > LARGEST {
                    return Err(format!("{} is larger than {} MB", path.display(), LARGEST >> 20));
                }
                Ok(bytes)
            }
            Files::Inside(files) => match files.iter().find(|(known, _)| *known == name) {
                Some((_, bytes)) => Ok(bytes.to_vec()),
                None => Err(format!("{name} is not among the files of this profile")),
            },
        }
    }
}
