//! Decoder of the Thrift compact protocol, in which the page headers of Parquet files are encoded. The decoder extracts
//! integers and skips everything else. It rejects a length that exceeds the available bytes.

/// Maximum nesting depth of structures. Page headers are nested less deeply.
const DEEPEST: u32 = 8;

/// Decodes a structure, and calls `tell` for each integer with its path and its value. The path contains the numbers of
/// the nested fields, from the outermost to the innermost. Returns the length of the structure in bytes; `None` if it
/// is invalid or truncated.
pub(super) fn read(bytes: &[u8], tell: &mut dyn FnMut(&[i16], i64)) -> Option<usize> {
    let rest = structure(bytes, &mut Vec::new(), DEEPEST, tell)?;
    Some(bytes.len() - rest.len())
}

fn structure<'b>(
    mut bytes: &'b [u8],
    path: &mut Vec<i16>,
    depth: u32,
    tell: &mut dyn FnMut(&[i16], i64),
) -> Option<&'b [u8]> {
    let mut field = 0i16;
    loop {
        let (head, rest) = bytes.split_first()?;
        let kind = head & 0x0f;
        if kind == 0 {
            return Some(rest);
        }
        let (number, rest) = match head >> 4 {
            0 => {
                let (number, rest) = integer(rest)?;
                (i16::try_from(number).ok()?, rest)
            }
            more => (field.checked_add(i16::from(more))?, rest),
        };
        field = number;
        path.push(number);
        bytes = value(kind, rest, path, depth, tell)?;
        path.pop();
    }
}

fn value<'b>(
    kind: u8,
    bytes: &'b [u8],
    path: &mut Vec<i16>,
    depth: u32,
    tell: &mut dyn FnMut(&[i16], i64),
) -> Option<&'b [u8]> {
    match kind {
        // As a field, true and false are types of their own.
        1 | 2 => Some(bytes),
        3 => bytes.get(1..),
        4..=6 => {
            let (number, rest) = integer(bytes)?;
            tell(path, number);
            Some(rest)
        }
        7 => bytes.get(8..),
        8 => {
            let (length, rest) = varint(bytes)?;
            rest.get(usize::try_from(length).ok()?..)
        }
        9 | 10 => list(bytes, path, depth.checked_sub(1)?, tell),
        12 => structure(bytes, path, depth.checked_sub(1)?, tell),
        _ => None,
    }
}

fn list<'b>(
    bytes: &'b [u8],
    path: &mut Vec<i16>,
    depth: u32,
    tell: &mut dyn FnMut(&[i16], i64),
) -> Option<&'b [u8]> {
    let (head, rest) = bytes.split_first()?;
    let (count, mut rest) = match head >> 4 {
        15 => varint(rest)?,
        count => (u64::from(count), rest),
    };
    for _ in 0..count {
        rest = match head & 0x0f {
            1 | 2 => rest.get(1..)?,
            kind => value(kind, rest, path, depth, tell)?,
        };
    }
    Some(rest)
}

/// Decodes a zigzag integer: the varints 0, 1, 2, 3, … mean 0, −1, 1, −2, … Also returns the bytes after the integer;
/// `None` if the integer is truncated or too long.
fn integer(bytes: &[u8]) -> Option<(i64, &[u8])> {
    let (raw, rest) = varint(bytes)?;
    Some(((raw >> 1).cast_signed() ^ -(raw & 1).cast_signed(), rest))
}

/// Decodes a varint: seven bits per byte, the lowest first. The highest bit of the last byte is zero. Also returns the
/// bytes after the varint; `None` if it is truncated or too long.
fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let end = bytes.iter().take(10).position(|byte| byte & 0x80 == 0)?;
    let number = bytes[..=end].iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f));
    Some((number, &bytes[end + 1..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Length of a structure, and its integers with their paths.
    type Told = (usize, Vec<(Vec<i16>, i64)>);

    fn told(bytes: &[u8]) -> Option<Told> {
        let mut told = Vec::new();
        let length = read(bytes, &mut |path, number| told.push((path.to_vec(), number)))?;
        Some((length, told))
    }

    #[test]
    fn the_numbers_of_a_head_are_told_with_their_place() {
        // 1: i32 0, 2: i32 1206, 5: { 1: i32 100, 5: { 5: binary "ab" } }, then the bytes after the header.
        let head = [0x15, 0, 0x15, 0xec, 0x12, 0x3c, 0x15, 0xc8, 1, 0x4c, 0x58, 2, b'a', b'b', 0, 0, 0, 9, 9];
        let expected = vec![(vec![1], 0), (vec![2], 1206), (vec![5, 1], 100)];
        assert_eq!(told(&head), Some((head.len() - 2, expected)));
        for cut in 0..head.len() - 2 {
            assert_eq!(told(&head[..cut]), None, "{cut}");
        }
    }

    #[test]
    fn a_length_that_is_not_there_and_structures_without_end_are_refused() {
        assert_eq!(told(&[0x18, 0xff, 0xff, 0xff, 0xff, 0x0f, 0]), None);
        assert_eq!(told(&[0x19, 0xfc, 0xff, 0xff, 0xff, 0x0f, 0]), None);
        assert_eq!(told(&[0x1c; 100]), None);
    }
}
