//! Recognises the kind of a file by its content. A message can then say that the user gave another kind of file than
//! expected.
//!
//! The kind of a file is guessed only after the file has been rejected as invalid. A wrong guess therefore never
//! rejects a valid file.

use std::io::Read as _;
use std::path::Path;

use crate::safe_file;

mod kind;
mod table;
mod text;
mod toml_tables;
mod yaml;

pub use kind::{FileKind, Misplaced};

/// Decodes a text in UTF-16 with a byte order mark. `None` if the bytes do not begin with a byte order mark.
pub(crate) fn wide(bytes: &[u8]) -> Option<String> {
    text::wide(bytes)
}

/// Number of bytes at the beginning of a file from which its kind is recognised.
const HEAD: usize = 64 * 1024;

/// First bytes of binary files, each with the kind of file.
const MAGIC: [(&[u8], FileKind); 15] = [
    (b"PAR1", FileKind::Parquet),
    (b"PK\x03\x04", FileKind::Workbook),
    (b"\xd0\xcf\x11\xe0", FileKind::Workbook),
    (b"\x1f\x8b", FileKind::Compressed),
    (b"MDF     ", FileKind::Measurement),
    (b"LOGG\x90\x00", FileKind::Measurement),
    (b"TDSm", FileKind::Measurement),
    (b"BZh", FileKind::Packed),
    (b"\xfd7zXZ\x00", FileKind::Packed),
    (b"\x28\xb5\x2f\xfd", FileKind::Packed),
    (b"7z\xbc\xaf\x27\x1c", FileKind::Packed),
    (b"ARROW1", FileKind::OtherTable),
    (b"\x89HDF\r\n\x1a\n", FileKind::OtherTable),
    (b"MATLAB 5.0 MAT-file", FileKind::OtherTable),
    (b"%PDF", FileKind::Pdf),
];

impl FileKind {
    /// Recognises the kind of a file by its first bytes. `None` if the kind is unknown.
    pub fn of(bytes: &[u8]) -> Option<FileKind> {
        let head = &bytes[..bytes.len().min(HEAD)];
        if let Some((_, kind)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
            return Some(*kind);
        }
        let text = text::decoded(head)?;
        let of_tables = || toml_tables::of(&text).or_else(|| table::of(&text));
        text::of_marks(&text).or_else(of_tables).or_else(|| yaml::of(&text))
    }

    /// Recognises the kind of the file at this path. `None` if the file cannot be read, or if the kind is unknown.
    pub fn of_file(path: &Path) -> Option<FileKind> {
        let mut head = Vec::new();
        safe_file::open(path).ok()?.take(HEAD as u64).read_to_end(&mut head).ok()?;
        FileKind::of(&head)
    }

    /// Returns a message if the file at this path is of another kind than `wanted`. Also returns a message for a log
    /// whose file extension belongs to another format. `None` if the file may be of the kind `wanted`.
    pub fn mistake(path: &Path, wanted: FileKind) -> Option<String> {
        let kind = FileKind::of_file(path)?;
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        match kind.of_another_ending(ending).filter(|_| wanted == FileKind::Log) {
            Some(why) => Some(format!("{}: {why}", path.display())),
            None => kind.instead_of(wanted).map(|other| other.line(path)),
        }
    }
}

#[cfg(test)]
mod tests;
