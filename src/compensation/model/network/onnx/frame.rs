//! Whether a file is all there. The runtime takes what a file cut short still says for the whole of it.

/// The fields of an ONNX model without which there is none: its graph, and the operators' version.
const NEEDED: [u64; 2] = [7, 8];

/// Whether the fields of the outermost message fill the file to its last byte, and those that are needed are there.
pub(super) fn is_whole(mut bytes: &[u8]) -> bool {
    let mut needed = NEEDED.to_vec();
    while !bytes.is_empty() {
        let Some((tag, rest)) = varint(bytes) else { return false };
        let after = match tag & 7 {
            0 => varint(rest).map(|(_, rest)| rest),
            1 => rest.get(8..),
            2 => varint(rest).and_then(|(length, rest)| rest.get(usize::try_from(length).ok()?..)),
            5 => rest.get(4..),
            _ => None,
        };
        let Some(after) = after else { return false };
        needed.retain(|field| *field != tag >> 3);
        bytes = after;
    }
    needed.is_empty()
}

/// A number of seven bits a byte, the last without the highest bit; and what follows it.
fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let end = bytes.iter().take(10).position(|byte| byte & 0x80 == 0)?;
    let number = bytes[..=end].iter().rev().fold(0, |number, byte| number << 7 | u64::from(byte & 0x7f));
    Some((number, &bytes[end + 1..]))
}
