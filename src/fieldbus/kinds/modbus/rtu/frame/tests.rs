use super::*;
use isotherm_core::codec::Register;
use proptest::prelude::*;

fn read(table: Table, offset: u16, count: u16) -> ModbusRequest<'static> {
    ModbusRequest::Read { from: Register { table, offset }, count }
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
    let cases: [(ModbusRequest<'_>, &[u8]); 5] = [
        (read(Table::Input, 0x0102, 7), &[9, 4, 1, 2, 0, 7]),
        (read(Table::Coil, 3, 11), &[9, 1, 0, 3, 0, 11]),
        (ModbusRequest::WriteCoil { at: 2, value: true }, &[9, 5, 0, 2, 0xff, 0]),
        (ModbusRequest::WriteSingle { at: 2, value: 0x1234 }, &[9, 6, 0, 2, 0x12, 0x34]),
        (
            ModbusRequest::WriteMultiple { at: 2, values: &[1, 0xfffe] },
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
