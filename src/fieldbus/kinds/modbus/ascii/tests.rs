use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

use super::*;
use crate::clock::{Clock, WallTimeout};
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::kinds::modbus::rtu::Rtu;
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, ModbusRequest, Request, Wire};
use isotherm_core::codec::{Register, Table, checksum};

const READ: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 4 }, 2);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 4, value: 9 });

fn line() -> (Rtu, DuplexStream) {
    let (ours, theirs) = duplex(2048);
    (Rtu::new(AsciiPort::new(ours), None, &Tap::default()), theirs)
}

/// Returns the characters of a frame.
fn framed(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let content = [&[unit], pdu].concat();
    let sum = checksum(&content).to_le_bytes();
    ascii_frame(&[content, sum.to_vec()].concat())
}

/// Returns the result of a request to unit 3 within one second, and what the device received. The device answers with
/// these characters.
async fn asked(request: Request<'_>, answer: &[u8]) -> (Result<Answer, Fault>, String) {
    let (mut wire, mut device) = line();
    let call = async {
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        let exchange = wire.exchange(3, request, &mut send_guard);
        let answer = WallTimeout::new().within(Duration::from_secs(1), exchange).await;
        answer.unwrap_or_else(|| Err(wire.missed()))
    };
    let device = async {
        let mut characters = [0; 64];
        let count = device.read(&mut characters).await.unwrap();
        device.write_all(answer).await.unwrap();
        // The connection stays open.
        (String::from_utf8(characters[..count].to_vec()).unwrap(), device)
    };
    let (answer, (received, _device)) = tokio::join!(call, device);
    (answer, received)
}

#[tokio::test(start_paused = true)]
async fn a_read_and_a_write_are_frames_of_modbus_ascii() {
    let registers = framed(3, &[3, 4, 0, 1, 0, 2]);
    let (answer, received) = asked(READ, &registers).await;
    assert_eq!((answer, received.as_str()), (Ok(Answer::Registers(vec![1, 2])), ":030300040002F4\r\n"));
    let (answer, received) = asked(WRITE, &framed(3, &[6, 0, 4, 0, 9])).await;
    assert_eq!((answer, received.as_str()), (Ok(Answer::Done), ":030600040009EA\r\n"));
}

#[tokio::test(start_paused = true)]
async fn a_wrong_frame_is_no_answer() {
    let registers = framed(3, &[3, 4, 0, 1, 0, 2]);
    let mut wrong_sum = registers.clone();
    let last = wrong_sum.len() - 3;
    wrong_sum[last] = if wrong_sum[last] == b'0' { b'1' } else { b'0' };
    let noise = [b"?\r\n\0", registers.as_slice()].concat();
    for (answer, expected) in [
        (noise, Ok(Answer::Registers(vec![1, 2]))),
        (wrong_sum, Err(Fault::Peer(PeerFault::Malformed))),
        (registers[..9].to_vec(), Err(Fault::Timeout)),
        (framed(4, &[3, 4, 0, 1, 0, 2]), Err(Fault::Peer(PeerFault::Foreign))),
        (framed(3, &[0x83, 2]), Err(Fault::Exception(2))),
    ] {
        let found = asked(READ, &answer).await.0;
        assert_eq!(found, expected, "{}", String::from_utf8_lossy(&answer));
    }
}

#[tokio::test(start_paused = true)]
async fn an_echo_of_the_adapter_is_no_answer() {
    let echo = framed(3, &[3, 0, 4, 0, 2]);
    let answer = [echo.as_slice(), &framed(3, &[3, 4, 0, 1, 0, 2])].concat();
    assert_eq!(asked(READ, &answer).await.0, Ok(Answer::Registers(vec![1, 2])));
    assert_eq!(asked(READ, &echo).await.0, Err(Fault::Timeout));
}

#[tokio::test(start_paused = true)]
async fn input_that_waits_is_taken_as_frames() {
    let (ours, mut theirs) = duplex(64);
    let mut port = AsciiPort::new(ours);
    let mut bytes = [0; 4];
    assert_eq!(port.take_waiting(&mut bytes).unwrap_err().kind(), io::ErrorKind::WouldBlock);
    theirs.write_all(b":0207").await.unwrap();
    assert_eq!(port.take_waiting(&mut bytes).unwrap_err().kind(), io::ErrorKind::WouldBlock);
    theirs.write_all(b"F7\r\n").await.unwrap();
    assert_eq!((port.take_waiting(&mut bytes).unwrap(), bytes[..2].to_vec()), (4, vec![2, 7]));
    drop(theirs);
    assert_eq!(port.take_waiting(&mut bytes).unwrap(), 0);
}

#[tokio::test(start_paused = true)]
async fn a_frame_that_was_given_up_is_never_sent() {
    let rtu = |content: &[u8]| [content, &checksum(content).to_le_bytes()].concat();
    let (write, read) = (rtu(&[3, 6, 0, 4, 0, 9]), rtu(&[2, 7]));
    // The other end takes four characters, and then none.
    let (ours, mut theirs) = duplex(4);
    let mut port = AsciiPort::new(ours);
    let sends = async {
        port.write_all(&write).await.unwrap();
        port.flush().await.unwrap();
    };
    assert_eq!(WallTimeout::new().within(Duration::from_secs(1), sends).await, None);
    let sends = async move {
        port.write_all(&read).await.unwrap();
        port.flush().await.unwrap();
    };
    let mut characters = Vec::new();
    let (received, ()) = tokio::join!(theirs.read_to_end(&mut characters), sends);
    assert_eq!((received.unwrap(), String::from_utf8(characters).unwrap().as_str()), (13, ":030:0207F7\r\n"));
}
