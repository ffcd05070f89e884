use super::*;
use crate::fieldbus::kinds::modbus::request::ModbusRequest;
use crate::fieldbus::kinds::modbus::rtu::frame;
use crate::fieldbus::kinds::modbus::text::TextProtocol;
use isotherm_core::codec::{Register, Table};
use proptest::prelude::*;

fn read(offset: u16, count: u16) -> ModbusRequest<'static> {
    ModbusRequest::Read { from: Register { table: Table::Holding, offset }, count }
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &checksum(body).to_le_bytes()].concat()
}

/// Returns the fault of this input after a read of one register of unit 3.
fn fault(received: &[u8]) -> Option<PeerFault> {
    let (_, answer) = frame::lengths(read(0, 1));
    assess(received, &frame::request(3, read(0, 1)), &frame::request(2, read(0, 1)), answer)
}

/// Checks that an echo, whole or damaged, early or late, with or without noise, is never an invalid answer.
#[test]
fn an_echo_is_no_invalid_answer() {
    let echo = frame::request(3, read(0, 1));
    let before = frame::request(2, read(0, 1));
    for cut in 0..=echo.len() {
        assert_eq!(fault(&echo[..cut]), None, "{cut}");
    }
    for noise in [&[][..], &[0], &[0xff, 0]] {
        assert_eq!(fault(&[noise, &echo].concat()), None, "{noise:?} before it");
        assert_eq!(fault(&[&echo, noise].concat()), None, "{noise:?} after it");
        assert_eq!(fault(&[noise, &before, &echo].concat()), None, "{noise:?} and the late echo before it");
    }
    for at in 0..DAMAGED {
        let mut damaged = echo.clone();
        damaged[at] ^= 0x40;
        assert_eq!(fault(&damaged), None, "byte {at} is wrong");
    }
    assert_eq!(fault(&[echo.as_slice(), &echo].concat()), None, "twice");
}

/// Checks that the request of another master, which was not sent here, is no echo.
#[test]
fn a_request_of_another_master_is_not_removed() {
    assert_eq!(fault(&frame::request(9, read(0, 1))), Some(PeerFault::Malformed));
}

#[test]
fn an_invalid_answer_after_an_echo_is_one() {
    let echo = frame::request(3, read(0, 1));
    let mut wrong = framed(&[3, 3, 2, 0, 9]);
    *wrong.last_mut().unwrap() ^= 1;
    assert_eq!(fault(&wrong), Some(PeerFault::Malformed));
    assert_eq!(fault(&[echo, wrong].concat()), Some(PeerFault::Malformed));
    assert_eq!(fault(&[0x55; 600]), Some(PeerFault::Malformed));
    assert_eq!(fault(&[0x55; 6]), None, "shorter than an answer");
    assert_eq!(fault(&[]), None);
}

#[test]
fn an_exception_of_three_or_four_bytes_is_one_with_its_code() {
    for surplus in [&[0][..], &[0, 0], &[0xff, 1]] {
        let exception = framed(&[&[3, 0x83, 2], surplus].concat());
        assert_eq!(fault(&exception), Some(PeerFault::LongException(2)), "{surplus:?}");
        let noisy = [&[0xff][..], &exception].concat();
        assert_eq!(fault(&noisy), Some(PeerFault::LongException(2)), "{surplus:?}");
        let of_another = framed(&[&[4, 0x83, 2], surplus].concat());
        assert!(!matches!(fault(&of_another), Some(PeerFault::LongException(_))), "{surplus:?}");
    }
    let longer = framed(&[3, 0x83, 2, 0, 0, 0]);
    assert_eq!(fault(&longer), Some(PeerFault::Malformed));
}

#[test]
fn text_is_recognised_also_if_it_is_shorter_than_an_answer() {
    let echo = frame::request(3, read(0, 1));
    assert_eq!(fault(b"?01\r"), Some(PeerFault::Text(TextProtocol::Dcon)));
    assert_eq!(fault(&[&echo[..], b"!01400600\r"].concat()), Some(PeerFault::Text(TextProtocol::Dcon)));
    assert_eq!(fault(b":010402000000F9\r\n"), Some(PeerFault::Text(TextProtocol::ModbusAscii)));
}

#[test]
fn without_a_request_there_is_no_fault() {
    assert_eq!(assess(&[0x55; 20], &[], &[], 0), None);
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(
        received in proptest::collection::vec(any::<u8>(), 0..300),
        question in proptest::collection::vec(any::<u8>(), 0..12),
    ) {
        let fault = assess(&received, &question, &received, 7);
        prop_assert!(fault != Some(PeerFault::Malformed) || received.len() >= 7);
    }
}
