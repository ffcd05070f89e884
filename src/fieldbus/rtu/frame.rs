//! RTU frames: requests as bytes, and the answer among the bytes that came. Pure.
//!
//! Frames are told apart by length and checksum, not by gaps: adapters on USB and on the network tear frames apart and
//! put them together as they like.

use crate::fieldbus::pdu;
use crate::fieldbus::request::Request;
use isotherm_core::codec::{Table, checksum};

/// The longest frame: unit, 253 bytes, checksum.
pub(super) const LONGEST: usize = 256;
/// Unit and checksum.
const AROUND: usize = 3;
/// The flag of an exception in the function code.
const EXCEPTION: u8 = 0x80;

/// What the bytes received so far come to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Reply {
    /// A whole frame of the unit that was asked: its protocol data unit, and the byte behind it.
    Own { pdu: std::ops::Range<usize>, end: usize },
    /// A whole frame of another unit, up to this byte.
    Foreign { end: usize },
    /// Nothing yet.
    Incomplete,
}

/// The frame of a request.
pub(super) fn request(unit: u8, request: Request<'_>) -> Vec<u8> {
    let mut bytes = vec![unit];
    pdu::question(request, &mut bytes);
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// How many bytes the frame of a request has, and that of its answer.
pub(super) fn lengths(request: Request<'_>) -> (usize, usize) {
    match request {
        Request::Read { from, count } if from.table.is_bits() => (8, 5 + usize::from(count.div_ceil(8))),
        Request::Read { count, .. } => (8, 5 + 2 * usize::from(count)),
        Request::WriteCoil { .. } | Request::WriteSingle { .. } => (8, 8),
        Request::WriteMultiple { words, .. } => (9 + 2 * words.len(), 8),
        Request::Can(_) => (0, 0),
    }
}

/// Whether an answer to this request could begin like the request itself, byte for byte.
pub(super) fn is_like_its_answer(request: Request<'_>) -> bool {
    match request {
        Request::Read { from, .. } => matches!(from.table, Table::Coil | Table::Discrete),
        Request::WriteCoil { .. } | Request::WriteSingle { .. } => true,
        Request::WriteMultiple { .. } | Request::Can(_) => false,
    }
}

/// Looks for a frame of `unit`, else for one of another unit. Bytes before it are noise.
pub(super) fn find(bytes: &[u8], unit: u8) -> Reply {
    let frames = (0..bytes.len()).filter_map(|start| whole(&bytes[start..]).map(|end| (start, start + end)));
    let mut foreign = Reply::Incomplete;
    for (start, end) in frames {
        if bytes[start] == unit {
            return Reply::Own { pdu: start + 1..end - 2, end };
        }
        if foreign == Reply::Incomplete {
            foreign = Reply::Foreign { end };
        }
    }
    foreign
}

/// The length of the answer that begins here, if it is there to its end and its checksum is right.
fn whole(bytes: &[u8]) -> Option<usize> {
    let data = match *bytes.get(1)? {
        function if function & EXCEPTION != 0 => 2,
        1..=4 => 2 + usize::from(*bytes.get(2)?),
        5 | 6 | 15 | 16 => 5,
        _ => return None,
    };
    let end = data + AROUND;
    let (body, sum) = bytes.get(..end)?.split_at(end - 2);
    (checksum(body).to_le_bytes() == *sum).then_some(end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::Register;
    use proptest::prelude::*;

    fn read(table: Table, offset: u16, count: u16) -> Request<'static> {
        Request::Read { from: Register { table, offset }, count }
    }

    fn framed(unit: u8, pdu: &[u8]) -> Vec<u8> {
        let mut bytes = [&[unit], pdu].concat();
        bytes.extend(checksum(&bytes).to_le_bytes());
        bytes
    }

    #[test]
    fn a_request_has_the_bytes_of_the_specification_s_example() {
        assert_eq!(request(17, read(Table::Holding, 107, 3)), [17, 3, 0, 107, 0, 3, 0x76, 0x87]);
    }

    #[test]
    fn each_request_has_the_bytes_of_the_specification_and_the_length_that_was_foretold() {
        let cases: [(Request<'_>, &[u8]); 5] = [
            (read(Table::Input, 0x0102, 7), &[9, 4, 1, 2, 0, 7]),
            (read(Table::Coil, 3, 11), &[9, 1, 0, 3, 0, 11]),
            (Request::WriteCoil { at: 2, value: true }, &[9, 5, 0, 2, 0xff, 0]),
            (Request::WriteSingle { at: 2, word: 0x1234 }, &[9, 6, 0, 2, 0x12, 0x34]),
            (
                Request::WriteMultiple { at: 2, words: &[1, 0xfffe] },
                &[9, 16, 0, 2, 0, 2, 4, 0, 1, 0xff, 0xfe],
            ),
        ];
        for (asked, body) in cases {
            let bytes = request(9, asked);
            assert_eq!(bytes[..bytes.len() - 2], *body);
            assert_eq!(bytes.len(), lengths(asked).0);
        }
    }

    #[test]
    fn an_answer_is_found_behind_noise_and_behind_an_answer_of_another_unit() {
        let own = framed(3, &[4, 2, 0, 9]);
        assert_eq!(find(&own, 3), Reply::Own { pdu: 1..5, end: 7 });
        let noisy = [&[0, 255], own.as_slice()].concat();
        assert_eq!(find(&noisy, 3), Reply::Own { pdu: 3..7, end: 9 });
        let late = framed(8, &[4, 2, 0, 1]);
        assert_eq!(find(&late, 3), Reply::Foreign { end: 7 });
        assert_eq!(find(&[late, own].concat(), 3), Reply::Own { pdu: 8..12, end: 14 });
        assert_eq!(find(&framed(3, &[0x84, 2]), 3), Reply::Own { pdu: 1..3, end: 5 });
    }

    proptest! {
        #[test]
        fn no_part_of_an_answer_and_none_with_a_wrong_byte_is_one(
            words in proptest::collection::vec(any::<u16>(), 1..20),
            cut in 0usize..45,
            (at, flip) in (0usize..45, 1u8..),
        ) {
            let mut pdu = vec![3, u8::try_from(2 * words.len()).unwrap()];
            pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
            let whole = framed(5, &pdu);
            let is_whole = |bytes: &[u8]| matches!(find(bytes, 5), Reply::Own { pdu: range, .. } if bytes[range.clone()] == pdu);
            prop_assert!(is_whole(&whole));
            prop_assert!(!is_whole(&whole[..cut.min(whole.len() - 1)]));
            let mut wrong = whole.clone();
            let at = at % wrong.len();
            wrong[at] ^= flip;
            prop_assert!(!is_whole(&wrong));
        }

        #[test]
        fn no_bytes_make_the_search_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), unit: u8) {
            if let Reply::Own { pdu, end } = find(&bytes, unit) {
                prop_assert!(pdu.len() >= 2 && end <= bytes.len());
            }
        }
    }
}
