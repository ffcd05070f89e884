use super::*;
use proptest::prelude::*;

#[test]
fn text_of_each_protocol_is_recognised() {
    for (bytes, protocol) in [
        (&b":010402000000F9\r\n"[..], TextProtocol::ModbusAscii),
        (b":1103006B00037E\r\n", TextProtocol::ModbusAscii),
        (b"\x00\xff:010402000000F9\r\n", TextProtocol::ModbusAscii),
        (b"!01400600\r", TextProtocol::Dcon),
        (b"?01\r", TextProtocol::Dcon),
        (b">+025.12+020.45\r", TextProtocol::Dcon),
        (b"#01\r>+025.12\r", TextProtocol::Dcon),
        (b"$012\r\n!01400600\r\n", TextProtocol::Dcon),
        (b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n", TextProtocol::Other),
        (b"SSH-2.0-OpenSSH_9.2\r\n", TextProtocol::Other),
        (b"login:\r\n", TextProtocol::Other),
        (b":010402000000FA\r\n", TextProtocol::Other),
    ] {
        assert_eq!(recognise(bytes), Some(protocol), "{}", bytes.escape_ascii());
    }
}

/// Frames of Modbus ASCII with 7 data bits and even parity, on a port with 8 data bits.
#[test]
fn modbus_ascii_with_a_parity_in_the_highest_bit_is_recognised() {
    let with_parity = |byte: &u8| byte | if byte.count_ones() % 2 == 1 { 0x80 } else { 0 };
    let bytes: Vec<u8> = b":010402000000F9\r\n".iter().map(with_parity).collect();
    assert_eq!(recognise(&bytes), Some(TextProtocol::ModbusAscii));
}

#[test]
fn frames_and_noise_are_no_text() {
    for bytes in [
        &[][..],
        &[1, 4, 2, 0, 9, 0x78, 0xf6],
        &[3, 3, 0, 0, 0, 1, 0x85, 0xe8],
        &[0x55; 600],
        &[0; 9],
        &[0xff; 9],
        b"UU\r",
        b"?01",
        b">+025",
    ] {
        assert_eq!(recognise(bytes), None, "{bytes:?}");
    }
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic_and_bytes_with_a_zero_are_at_most_modbus_ascii(
        mut bytes in proptest::collection::vec(any::<u8>(), 0..300),
        at in 0usize..300,
    ) {
        let at = at % (bytes.len() + 1);
        bytes.insert(at, 0);
        prop_assert!(matches!(recognise(&bytes), None | Some(TextProtocol::ModbusAscii)));
    }
}
