use super::*;
use proptest::prelude::*;

/// End of the first RTU request in these bytes.
fn whole(bytes: &[u8]) -> Option<usize> {
    Framing::Rtu.request(bytes).unwrap().map(|(_, pdu)| pdu.end + 2)
}

fn bank() -> Bank {
    let mut bank = Bank::default();
    for table in [Table::Coil, Table::Discrete, Table::Input, Table::Holding] {
        bank.reserve(&Register { table, offset: 0 }.into(), 32);
    }
    bank
}

fn ask(bank: &mut Bank, pdu: &[u8]) -> Vec<u8> {
    let answer = Request::decode(pdu).and_then(|request| request.answer(pdu, bank));
    answer.unwrap_or_else(|code| exception(pdu, code))
}

#[test]
fn each_function_answers_as_the_specification_shows() {
    let bank = &mut bank();
    assert_eq!(ask(bank, &[6, 0, 1, 0x12, 0x34]), [6, 0, 1, 0x12, 0x34]);
    assert_eq!(ask(bank, &[16, 0, 2, 0, 2, 4, 0xab, 0xcd, 0, 1]), [16, 0, 2, 0, 2]);
    assert_eq!(ask(bank, &[3, 0, 1, 0, 3]), [3, 6, 0x12, 0x34, 0xab, 0xcd, 0, 1]);
    assert_eq!(ask(bank, &[4, 0, 0, 0, 1]), [4, 2, 0, 0]);
    assert_eq!(ask(bank, &[5, 0, 3, 0xff, 0]), [5, 0, 3, 0xff, 0]);
    assert_eq!(ask(bank, &[15, 0, 8, 0, 3, 1, 0b101]), [15, 0, 8, 0, 3]);
    assert_eq!(ask(bank, &[1, 0, 0, 0, 11]), [1, 2, 0b1000, 0b101]);
    assert_eq!(ask(bank, &[2, 0, 0, 0, 8]), [2, 1, 0]);
}

#[test]
fn what_cannot_be_done_is_answered_with_the_right_exception() {
    let bank = &mut bank();
    assert_eq!(ask(bank, &[7]), [0x87, 1]);
    assert_eq!(ask(bank, &[3, 0, 31, 0, 2]), [0x83, 2]);
    assert_eq!(ask(bank, &[16, 0, 31, 0, 2, 4, 0, 0, 0, 0]), [0x90, 2]);
    assert_eq!(ask(bank, &[3, 0, 0, 0, 126]), [0x83, 3]);
    assert_eq!(ask(bank, &[3, 0, 0]), [0x83, 3]);
    assert_eq!(ask(bank, &[5, 0, 0, 1, 0]), [0x85, 3]);
    assert_eq!(ask(bank, &[15, 0, 0, 0, 9, 1, 0]), [0x8f, 3]);
    assert_eq!(ask(bank, &[16, 0, 0, 0, 2, 4, 0, 0]), [0x90, 3]);
    assert_eq!(ask(bank, &[]), [0x80, 1]);
}

#[test]
fn a_header_that_is_no_modbus_is_refused() {
    let tcp = |bytes: &[u8]| Framing::Tcp.request(bytes);
    let whole = [0, 9, 0, 0, 0, 6, 3, 3, 0, 0, 0, 1];
    assert_eq!(tcp(&whole), Ok(Some((Header { transaction: 9, unit: 3 }, 7..12))));
    assert_eq!((tcp(&whole[..11]), tcp(&whole[..6])), (Ok(None), Ok(None)));
    for bad in [[0, 9, 0, 1, 0, 6, 3], [0, 9, 0, 0, 0, 1, 3], [0, 9, 0, 0, 0, 0, 3], [0, 9, 0, 0, 1, 0, 3]] {
        assert_eq!(tcp(&bad), Err(NoModbus));
    }
}

#[test]
fn a_request_is_whole_with_its_last_byte_and_its_checksum() {
    for pdu in [[3, 0, 107, 0, 3].as_slice(), &[16, 0, 1, 0, 2, 4, 0, 1, 0, 2], &[5, 0, 1, 255, 0]] {
        let bytes = Framing::Rtu.frame(0, 17, pdu);
        assert_eq!(whole(&bytes), Some(bytes.len()));
        assert_eq!(whole(&bytes[..bytes.len() - 1]), None);
        let mut wrong = bytes.clone();
        wrong[3] ^= 1;
        assert_eq!(whole(&wrong), None);
    }
}

proptest! {
    #[test]
    fn no_bytes_make_the_device_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(whole(&bytes).is_none_or(|end| end <= bytes.len()));
    }

    #[test]
    fn no_request_makes_the_server_panic(pdu in proptest::collection::vec(any::<u8>(), 0..260)) {
        let answer = ask(&mut bank(), &pdu);
        prop_assert!(answer.len() >= 2 && answer.len() <= LARGEST_PDU);
    }

    #[test]
    fn no_body_of_a_known_function_makes_the_server_panic(
        function in prop_oneof![1u8..=6, 15u8..=16],
        body in proptest::collection::vec(prop_oneof![0u8..4, any::<u8>()], 0..20),
    ) {
        let answer = ask(&mut bank(), &[&[function], body.as_slice()].concat());
        prop_assert!(answer.len() >= 2 && answer.len() <= LARGEST_PDU);
    }
}
