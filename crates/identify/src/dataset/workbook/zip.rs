//! Check of the parts of a workbook, which is a zip file. A small part can decompress to a huge one, even if the file
//! states another size.

use std::io::{self, Read};

use flate2::read::DeflateDecoder;

/// Maximum size of all decompressed parts together, bytes. Sheets may be this large, because the library
/// never keeps a whole sheet in memory.
const LARGEST: u64 = 1_000_000_000;
/// Maximum size of a decompressed part that the library keeps in memory, bytes. One such part contains the
/// texts of all sheets.
const LARGEST_TEXTS: u64 = 32_000_000;
/// Length of the end record of a zip file, bytes, without the file comment.
const END: usize = 22;
/// Lengths of the fixed headers of a part, bytes: `ENTRY` in the zip directory, and `LOCAL` before the data of the
/// part.
const ENTRY: usize = 46;
const LOCAL: usize = 30;

/// Checks the sizes of all parts.
///
/// # Errors
/// The file is not a valid zip file, a part is too large, or the zip directory states a wrong size of a part.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let damaged = "the file is not a workbook (.xlsx), or it is damaged: save the sheet as CSV";
    let mut at = directory(bytes).ok_or(damaged)?;
    let mut all = 0u64;
    while bytes.get(at..).is_some_and(|rest| rest.starts_with(b"PK\x01\x02")) {
        let part = Part::of(bytes, at).ok_or(damaged)?;
        let limit = if part.is_kept { LARGEST_TEXTS } else { LARGEST };
        all = all.saturating_add(part.unpacked);
        if part.unpacked > limit || all > LARGEST {
            let million = LARGEST / 1_000_000;
            return Err(format!(
                "the workbook is larger than {million} MB when it is decompressed, or has more than {} MB of texts: save the \
                 sheet as CSV",
                LARGEST_TEXTS / 1_000_000
            ));
        }
        if !part.is_as_stated() {
            return Err(damaged.to_owned());
        }
        at = part.next;
    }
    Ok(())
}

/// Returns the offset of the zip directory, which lists the parts; `None` if the file has none.
fn directory(bytes: &[u8]) -> Option<usize> {
    // A comment of at most 64 kB may follow the record.
    let begin = bytes.len().saturating_sub(END + (1 << 16));
    let place = bytes.get(begin..)?.windows(4).rposition(|four| four == b"PK\x05\x06")?;
    usize::try_from(number(bytes, begin + place + 16, 4)?).ok()
}

/// Returns the number in `length` bytes at the offset `at`; the lowest byte comes first. `None` if the data are too
/// short.
fn number(bytes: &[u8], at: usize, length: usize) -> Option<u64> {
    let own = bytes.get(at..at.checked_add(length)?)?;
    Some(own.iter().rev().fold(0, |sum, byte| (sum << 8) | u64::from(*byte)))
}

/// Part (file) inside the zip archive.
struct Part<'b> {
    packed: &'b [u8],
    is_packed: bool,
    /// Size of the decompressed part as the zip directory states it, bytes.
    unpacked: u64,
    /// Whether the library keeps the whole decompressed part in memory. This applies to all parts except sheets.
    is_kept: bool,
    /// Offset of the next entry in the zip directory.
    next: usize,
}

impl Part<'_> {
    fn of(bytes: &[u8], at: usize) -> Option<Part<'_>> {
        let field = |place: usize, length: usize| {
            number(bytes, at.checked_add(place)?, length).and_then(|number| usize::try_from(number).ok())
        };
        let lengths = [field(28, 2)?, field(30, 2)?, field(32, 2)?];
        let name = bytes.get(at + ENTRY..at + ENTRY + lengths[0])?;
        let local = field(42, 4)?;
        let of_local = |place: usize| number(bytes, local.checked_add(place)?, 2);
        let begin = local + LOCAL + usize::try_from(of_local(26)? + of_local(28)?).ok()?;
        let packed = bytes.get(begin..begin.checked_add(field(20, 4)?)?)?;
        let is_packed = match field(10, 2)? {
            0 => false,
            8 => true,
            _ => return None,
        };
        Some(Part {
            packed,
            is_packed,
            unpacked: number(bytes, at + 24, 4)?,
            is_kept: !name.starts_with(b"xl/worksheets/"),
            next: at + ENTRY + lengths.iter().sum::<usize>(),
        })
    }

    /// Returns whether the decompressed part has exactly the stated size. The decompressed data are discarded.
    fn is_as_stated(&self) -> bool {
        if !self.is_packed {
            return self.packed.len() as u64 == self.unpacked;
        }
        let mut unpacked = DeflateDecoder::new(self.packed).take(self.unpacked + 1);
        io::copy(&mut unpacked, &mut io::sink()).is_ok_and(|count| count == self.unpacked)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Writes a zip file whose parts are not compressed.
    pub(in super::super) fn stored<'a>(parts: impl Iterator<Item = (&'a str, &'a str)>) -> Vec<u8> {
        let all: Vec<(&str, &[u8], u64)> =
            parts.map(|(name, text)| (name, text.as_bytes(), text.len() as u64)).collect();
        written(&all, 0)
    }

    /// Writes a zip file of parts with these stated sizes.
    fn written(parts: &[(&str, &[u8], u64)], method: u16) -> Vec<u8> {
        let (mut file, mut directory) = (Vec::new(), Vec::new());
        let small = |number: usize| u32::try_from(number).unwrap().to_le_bytes();
        for (name, data, unpacked) in parts {
            let mut crc = flate2::Crc::new();
            crc.update(data);
            let sizes = [small(data.len()), u32::try_from(*unpacked).unwrap().to_le_bytes()].concat();
            let common = [
                &[20, 0, 0, 0][..],
                &method.to_le_bytes(),
                &[0; 4],
                &crc.sum().to_le_bytes(),
                &sizes,
                &u16::try_from(name.len()).unwrap().to_le_bytes(),
                &[0, 0],
            ]
            .concat();
            let offset = small(file.len());
            directory
                .extend([b"PK\x01\x02\x14\x00", &common[..], &[0; 10], &offset, name.as_bytes()].concat());
            file.extend([b"PK\x03\x04", &common[..], name.as_bytes(), data].concat());
        }
        let count = u16::try_from(parts.len()).unwrap().to_le_bytes();
        let (begin, length) = (small(file.len()), small(directory.len()));
        let end = [b"PK\x05\x06\0\0\0\0", &count[..], &count, &length, &begin, &[0, 0]].concat();
        [file, directory, end].concat()
    }

    #[test]
    fn parts_that_are_larger_than_they_state_or_than_allowed_are_refused() {
        use std::io::Write;
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(&[b' '; 100_000]).unwrap();
        let packed = encoder.finish().unwrap();
        let packed = packed.as_slice();
        assert_eq!(check(&written(&[("xl/worksheets/a.xml", packed, 100_000)], 8)), Ok(()));
        assert!(
            check(&written(&[("xl/worksheets/a.xml", packed, 1000)], 8)).unwrap_err().contains("damaged")
        );
        let large = check(&written(&[("xl/sharedStrings.xml", packed, 50_000_000)], 8)).unwrap_err();
        assert!(large.contains("32 MB of texts"), "{large}");
        assert!(check(b"time,bed\n0,20\n").unwrap_err().contains("the file is not a workbook"));
        let whole = written(&[("xl/worksheets/a.xml", b"text".as_slice(), 4)], 0);
        assert_eq!(check(&whole), Ok(()));
        for end in 0..whole.len() {
            let _ = check(&whole[..end]);
        }
    }
}
