//! Tests with a device whose bytes are written by hand.

use std::pin::Pin;
use std::task::Context;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, ReadBuf, duplex};

use super::*;
use crate::clock::{Clock, WallTimeout};
use crate::fieldbus::error::Outcome;
use crate::fieldbus::kinds::modbus::text::TextProtocol;
use isotherm_core::codec::{Register, Table, checksum};
use isotherm_profile::Parity;

const READ: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 4 }, 2);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 4, value: 9 });
const SLOW: Serial = Serial { baud: 9600, parity: Parity::None, stop_bits: 1 };

fn line() -> (Rtu, DuplexStream) {
    let (ours, theirs) = duplex(2048);
    (Rtu::new(ours, Some(SLOW), &Tap::default()), theirs)
}

fn framed(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut bytes = [&[unit], pdu].concat();
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

fn registers(high: u8, low: u8) -> Vec<u8> {
    framed(3, &[3, 4, 0, high, 0, low])
}

/// Returns the result of a request to unit 3 within one second. The device answers it with these bytes.
async fn asked(
    wire: &mut Rtu,
    device: &mut DuplexStream,
    request: Request<'_>,
    answer: &[u8],
) -> Result<Answer, Fault> {
    let call = async {
        let answer = WallTimeout::new()
            .within(Duration::from_secs(1), wire.exchange(3, request, &mut without_deadline()))
            .await;
        answer.unwrap_or_else(|| Err(wire.missed()))
    };
    let device = async {
        let mut question = vec![0; framed_question(3, request).len()];
        device.read_exact(&mut question).await.unwrap();
        device.write_all(answer).await.unwrap();
    };
    tokio::join!(call, device).0
}

const GOOD: [u16; 2] = [1, 2];

fn without_deadline() -> SendGuard {
    SendGuard::without_deadline(&Clock::wall())
}

fn good() -> Result<Answer, Fault> {
    Ok(Answer::Registers(GOOD.to_vec()))
}

/// Returns the frame of a request.
fn framed_question(unit: u8, request: Request<'_>) -> Vec<u8> {
    let Request::Modbus(request) = request else { panic!("{request:?} is not Modbus") };
    frame::request(unit, request)
}

#[tokio::test(start_paused = true)]
async fn registers_arrive_in_their_order_and_an_exception_with_its_code() {
    let (mut wire, mut device) = line();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
    let refusal = framed(3, &[0x83, 2]);
    assert_eq!(asked(&mut wire, &mut device, READ, &refusal).await, Err(Fault::Exception(2)));
    let echo = framed(3, &[6, 0, 4, 0, 9]);
    assert_eq!(asked(&mut wire, &mut device, WRITE, &echo).await, Ok(Answer::Done));
}

#[tokio::test(start_paused = true)]
async fn an_answer_may_come_one_byte_at_a_time() {
    let (mut wire, mut device) = line();
    let piecemeal = async {
        let mut question = [0; 8];
        device.read_exact(&mut question).await.unwrap();
        for byte in registers(1, 2) {
            device.write_all(&[byte]).await.unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let mut send_guard = without_deadline();
    assert_eq!(tokio::join!(wire.exchange(3, READ, &mut send_guard), piecemeal).0, good());
}

#[tokio::test(start_paused = true)]
async fn what_came_before_the_question_is_never_its_answer() {
    let (mut wire, mut device) = line();
    device.write_all(&registers(7, 7)).await.unwrap();
    assert_eq!(
        wire.exchange(3, READ, &mut without_deadline()).await,
        Err(Fault::UNASKED),
        "something answers out of turn"
    );
    device.write_all(&registers(8, 8)[..4]).await.unwrap();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good(), "noise does not");
}

#[tokio::test(start_paused = true)]
async fn of_two_answers_in_one_neither_is_believed() {
    let (mut wire, mut device) = line();
    let both = [registers(1, 2), registers(7, 7)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &both).await, Err(Fault::UNASKED));
}

#[tokio::test(start_paused = true)]
async fn a_late_answer_of_another_unit_and_noise_are_passed_over() {
    let (mut wire, mut device) = line();
    let late = framed(8, &[3, 4, 0, 7, 0, 7]);
    let noisy = [&late, [0, 0xff].as_slice(), &registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &noisy).await, good());
    let foreign = asked(&mut wire, &mut device, READ, &late).await;
    assert_eq!(foreign, Err(Fault::Peer(PeerFault::Foreign)));
}

#[tokio::test(start_paused = true)]
async fn a_wrong_checksum_a_torn_frame_and_garbage_are_no_answer() {
    let (mut wire, mut device) = line();
    let mut wrong = registers(1, 2);
    *wrong.last_mut().unwrap() ^= 1;
    let malformed = Err(Fault::Peer(PeerFault::Malformed));
    assert_eq!(asked(&mut wire, &mut device, READ, &wrong).await, malformed);
    assert_eq!(asked(&mut wire, &mut device, READ, &[0x55; 600]).await, malformed);
    assert!(wire.received.len() <= MOST_KEPT, "{} bytes are kept", wire.received.len());
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)[..6]).await, Err(Fault::Timeout));
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
}

#[tokio::test(start_paused = true)]
async fn an_answer_of_another_length_function_or_echo_is_refused_at_once() {
    let (mut wire, mut device) = line();
    let cases = [
        (READ, framed(3, &[3, 2, 0, 1]), PeerFault::Length),
        (READ, framed(3, &[4, 4, 0, 1, 0, 2]), PeerFault::Function),
        (WRITE, framed(3, &[6, 0, 4, 0, 8]), PeerFault::Echo),
    ];
    let clock = tokio_time();
    for (request, answer, fault) in cases {
        assert_eq!(asked(&mut wire, &mut device, request, &answer).await, Err(Fault::Peer(fault)));
    }
    assert!(clock() < Duration::from_millis(500));
}

/// Returns a function for the time on the paused clock since this call.
fn tokio_time() -> impl Fn() -> Duration {
    let begun = Silence::begin();
    let hour = Duration::from_secs(3600);
    move || hour - begun.left_of(hour)
}

#[tokio::test(start_paused = true)]
async fn silence_is_kept_after_an_answer_and_after_bytes_that_nobody_asked_for() {
    let (mut wire, mut device) = line();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
    let since = tokio_time();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
    let waited = since();
    assert!(waited >= SLOW.silence() && waited < SLOW.silence() + Duration::from_millis(2), "{waited:?}");
    tokio::time::sleep(Duration::from_millis(50)).await;
    device.write_all(&[0]).await.unwrap();
    let since = tokio_time();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
    assert!(since() >= SLOW.silence());
}

#[tokio::test(start_paused = true)]
async fn an_adapter_that_lets_us_hear_ourselves_is_seen_at_the_first_read_and_no_write_is_believed_by_its_echo()
 {
    let (mut wire, mut device) = line();
    let heard = |request, answer: &[u8]| [&framed_question(3, request), answer].concat();
    let answer = heard(READ, &registers(1, 2));
    assert_eq!(asked(&mut wire, &mut device, READ, &answer).await, good());
    let nobody = heard(WRITE, &[]);
    assert_eq!(asked(&mut wire, &mut device, WRITE, &nobody).await, Err(Fault::Timeout));
    let done = heard(WRITE, &framed(3, &[6, 0, 4, 0, 9]));
    assert_eq!(asked(&mut wire, &mut device, WRITE, &done).await, Ok(Answer::Done));
}

/// Sends these parts after the request, with 20 ms between them. Returns the result of the read within one second.
async fn in_parts(
    wire: &mut Rtu,
    device: &mut DuplexStream,
    read: Request<'_>,
    parts: impl Iterator<Item = Vec<u8>>,
) -> Result<Answer, Fault> {
    let call = async {
        let answer = WallTimeout::new()
            .within(Duration::from_secs(1), wire.exchange(3, read, &mut without_deadline()))
            .await;
        answer.unwrap_or_else(|| Err(wire.missed()))
    };
    let device = async {
        let mut question = [0; 8];
        device.read_exact(&mut question).await.unwrap();
        for part in parts {
            device.write_all(&part).await.unwrap();
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::join!(call, device).0
}

/// An answer of one register is shorter than its request. For a moment, an echo in parts therefore has the length of
/// the answer.
#[tokio::test(start_paused = true)]
async fn an_echo_in_parts_with_noise_or_late_is_no_invalid_answer_of_a_unit_that_does_not_exist() {
    let registers = Request::read_registers(Register { table: Table::Holding, offset: 0 }, 1);
    let coil = Request::read_registers(Register { table: Table::Coil, offset: 0 }, 1);
    for read in [registers, coil] {
        let echo = framed_question(3, read);
        for size in 1..=echo.len() {
            let (mut wire, mut device) = line();
            let parts = || echo.chunks(size).map(<[u8]>::to_vec);
            let nobody = in_parts(&mut wire, &mut device, read, parts()).await;
            assert_eq!(nobody, Err(Fault::Timeout), "{read:?}, {size} bytes at a time");
            let again = in_parts(&mut wire, &mut device, read, parts()).await;
            assert_eq!(again, Err(Fault::Timeout), "{read:?}, {size} bytes at a time, again");
        }
        for noise in [&[0][..], &[0xff, 0]] {
            let (mut wire, mut device) = line();
            let noisy = [noise, &echo].concat();
            assert_eq!(asked(&mut wire, &mut device, read, &noisy).await, Err(Fault::Timeout), "{noise:?}");
        }
        // The echo of the request before arrives after its timeout.
        let (mut wire, mut device) = line();
        let span = Duration::from_millis(100);
        let before = WallTimeout::new().within(span, wire.exchange(2, read, &mut without_deadline())).await;
        assert_eq!((before, wire.missed()), (None, Fault::Timeout));
        device.read_exact(&mut [0; 8]).await.unwrap();
        let late = [framed_question(2, read), echo].concat();
        assert_eq!(asked(&mut wire, &mut device, read, &late).await, Err(Fault::Timeout));
    }
}

#[tokio::test(start_paused = true)]
async fn a_request_that_comes_back_without_an_answer_is_told_apart_from_silence() {
    let echo = framed_question(3, READ);
    for size in [1, 7, echo.len()] {
        let (mut wire, mut device) = line();
        let nobody = in_parts(&mut wire, &mut device, READ, echo.chunks(size).map(<[u8]>::to_vec)).await;
        assert_eq!((nobody, wire.has_come_back()), (Err(Fault::Timeout), true), "{size} bytes at a time");
        let answered = [echo.as_slice(), &registers(1, 2)].concat();
        assert_eq!(asked(&mut wire, &mut device, READ, &answered).await, good());
        assert!(!wire.has_come_back());
        for other in [&[][..], &[0x55; 3], &echo[..5]] {
            assert_eq!(asked(&mut wire, &mut device, READ, other).await, Err(Fault::Timeout));
            assert!(!wire.has_come_back(), "{other:?}");
        }
        let noisy = [echo.as_slice(), &[0x55; 3]].concat();
        assert_eq!(asked(&mut wire, &mut device, READ, &noisy).await, Err(Fault::Timeout));
        assert!(!wire.has_come_back());
    }
}

#[tokio::test(start_paused = true)]
async fn an_answer_after_an_echo_in_parts_is_used() {
    let (mut wire, mut device) = line();
    let parts = [framed_question(3, READ), registers(1, 2)].concat();
    let parts = parts.chunks(3).map(<[u8]>::to_vec);
    assert_eq!(in_parts(&mut wire, &mut device, READ, parts).await, good());
}

#[tokio::test(start_paused = true)]
async fn an_exception_with_surplus_bytes_and_text_are_named() {
    let (mut wire, mut device) = line();
    let long = Fault::Peer(PeerFault::LongException(2));
    let answer = framed(3, &[0x83, 2, 0, 0]);
    let since = tokio_time();
    assert_eq!(asked(&mut wire, &mut device, READ, &answer).await, Err(long));
    assert!(since() < Duration::from_millis(500), "at once");
    let noisy = [&[0xff][..], &answer].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &noisy).await, Err(long));
    assert!(long.is_refusal() && !long.spoils_connection());
    assert_eq!(
        long.outcome(),
        Outcome::Unknown,
        "of a write, only an exception of two bytes proves something"
    );
    for (text, protocol) in [
        (&b":030304000100 02F3\r\n"[..], TextProtocol::Other),
        (b":03030400010002F3\r\n", TextProtocol::ModbusAscii),
        (b"?03\r", TextProtocol::Dcon),
        (b">+025.12+020.45\r", TextProtocol::Dcon),
    ] {
        let fault = Fault::Peer(PeerFault::Text(protocol));
        assert_eq!(asked(&mut wire, &mut device, READ, text).await, Err(fault), "{}", text.escape_ascii());
    }
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
}

#[tokio::test(start_paused = true)]
async fn frames_of_another_master_are_noted_and_neither_echoes_nor_late_answers_are() {
    let (mut wire, mut device) = line();
    let theirs = Request::read_registers(Register { table: Table::Holding, offset: 300 }, 1);
    let said = |unit| [framed_question(unit, theirs), framed(unit, &[3, 2, 0, 9])];
    let form = Some(ReplySignature::of(theirs));
    let noted = |unit| [true, false].map(|is_question| ForeignFrame { unit, form, is_question });
    device.write_all(&said(3).concat()).await.unwrap();
    assert_eq!(wire.exchange(3, READ, &mut without_deadline()).await, Err(Fault::UNASKED));
    assert_eq!(wire.overheard(), noted(3));
    assert_eq!(wire.overheard(), []);
    let before = [said(8).concat(), registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &before).await, good());
    assert_eq!(wire.overheard(), noted(8));
    let length = Err(Fault::Peer(PeerFault::Length));
    assert_eq!(asked(&mut wire, &mut device, READ, &said(3)[1]).await, length);
    assert_eq!(wire.overheard(), [], "a mistake of the device");
    let both = [said(3)[1].as_slice(), &registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &both).await, Err(Fault::UNASKED));
    assert_eq!(wire.overheard(), noted(3)[1..]);
    let echoed = [framed_question(3, READ), registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &echoed).await, good());
    wire.pass_over(vec![(8, ReplySignature::of(theirs))]);
    let late = [framed_question(3, READ), framed(8, &[3, 2, 0, 9]), registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &late).await, good());
    assert_eq!((wire.overheard(), wire.received_late()), (Vec::new(), vec![8]));
}

#[tokio::test(start_paused = true)]
async fn the_echo_of_a_question_that_was_given_up_is_no_question_of_another_master() {
    let (mut wire, mut device) = line();
    assert_eq!(asked(&mut wire, &mut device, READ, &[]).await, Err(Fault::Timeout));
    device.write_all(&framed_question(3, READ)).await.unwrap();
    assert_eq!(asked(&mut wire, &mut device, WRITE, &framed(3, &[6, 0, 4, 0, 9])).await, Ok(Answer::Done));
    assert_eq!(wire.overheard(), []);
    device.write_all(&framed_question(3, READ)).await.unwrap();
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
    let is_question = true;
    assert_eq!(
        wire.overheard(),
        [ForeignFrame { unit: 3, form: Some(ReplySignature::of(READ)), is_question }]
    );
}

/// Frame of five bytes in the middle of an answer: it looks like an exception of this unit.
#[tokio::test(start_paused = true)]
async fn a_frame_inside_of_an_answer_that_arrives_in_parts_is_a_part_of_it() {
    let read = Request::read_registers(Register { table: Table::Input, offset: 0 }, 6);
    for (unit, before) in [3, 8].into_iter().flat_map(|unit| (0..6).map(move |before| (unit, before))) {
        let mut data = vec![0; 12];
        data[before..before + 5].copy_from_slice(&framed(unit, &[0x84, 2]));
        let words: Vec<u16> = data.chunks(2).map(|word| u16::from_be_bytes([word[0], word[1]])).collect();
        let answer = framed(3, &[&[4, 12], data.as_slice()].concat());
        for noise in [&[][..], &[0xff, 3]] {
            let whole = [noise, &answer].concat();
            for cut in 1..whole.len() {
                let (mut wire, mut device) = line();
                let parts = async {
                    let mut question = [0; 8];
                    device.read_exact(&mut question).await.unwrap();
                    device.write_all(&whole[..cut]).await.unwrap();
                    tokio::time::sleep(Duration::from_millis(20)).await;
                    device.write_all(&whole[cut..]).await.unwrap();
                };
                let mut send_guard = without_deadline();
                let (answer, ()) = tokio::join!(wire.exchange(3, read, &mut send_guard), parts);
                assert_eq!(answer, Ok(Answer::Registers(words.clone())), "{unit} at {before}, cut at {cut}");
                assert_eq!((wire.overheard(), wire.received_late()), (Vec::new(), Vec::new()));
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_exception_that_answers_nothing_is_no_sign_of_another_master() {
    let (mut wire, mut device) = line();
    let before = [framed(8, &[0x83, 2]), registers(1, 2)].concat();
    assert_eq!(asked(&mut wire, &mut device, READ, &before).await, good());
    assert_eq!(wire.overheard(), []);
    device.write_all(&framed(3, &[0x83, 2])).await.unwrap();
    assert_eq!(wire.exchange(3, READ, &mut without_deadline()).await, Err(Fault::UNASKED));
    assert_eq!(wire.overheard(), []);
}

/// The echo of such a read has the form of its answer: three bytes of bits.
#[tokio::test(start_paused = true)]
async fn the_echo_of_a_read_is_no_answer_whatever_it_looks_like() {
    for (table, offset, count) in [Table::Coil, Table::Discrete].into_iter().flat_map(|table| {
        let offsets = [0x0300, 0x0301, 0x0380, 0x03ff];
        offsets.into_iter().flat_map(move |offset| (17..=24).map(move |count| (table, offset, count)))
    }) {
        let read = Request::read_registers(Register { table, offset }, count);
        let echo = framed_question(3, read);
        let answer = framed(3, &[read.function(), 3, 0b101, 0, 0]);
        let mut bits = vec![false; usize::from(count)];
        (bits[0], bits[2]) = (true, true);
        let (mut wire, mut device) = line();
        assert_eq!(asked(&mut wire, &mut device, read, &echo).await, Err(Fault::Timeout), "{read:?}");
        let both = [echo.as_slice(), &answer].concat();
        assert_eq!(
            asked(&mut wire, &mut device, read, &both).await,
            Ok(Answer::Bits(bits.clone())),
            "{read:?}"
        );
        let noisy = [&[0xff], both.as_slice()].concat();
        assert_eq!(asked(&mut wire, &mut device, read, &noisy).await, Ok(Answer::Bits(bits.clone())));
        // After another read has shown the echo, the echo of each request is expected.
        let shows = [framed_question(3, READ).as_slice(), &registers(1, 2)].concat();
        assert_eq!(asked(&mut wire, &mut device, READ, &shows).await, good());
        assert_eq!(asked(&mut wire, &mut device, read, &echo).await, Err(Fault::Timeout), "{read:?}");
        assert_eq!(asked(&mut wire, &mut device, read, &both).await, Ok(Answer::Bits(bits)), "{read:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_connection_that_ends_while_idle_is_told_apart_from_one_that_breaks_under_a_question() {
    let (mut wire, device) = line();
    drop(device);
    assert_eq!(wire.exchange(3, READ, &mut without_deadline()).await, Err(Fault::CLOSED));
    let (mut wire, mut device) = line();
    let dies = async {
        let mut question = [0; 8];
        device.read_exact(&mut question).await.unwrap();
        drop(device);
    };
    let mut send_guard = without_deadline();
    assert_eq!(tokio::join!(wire.exchange(3, READ, &mut send_guard), dies).0, Err(Fault::BROKEN));
}

#[tokio::test(start_paused = true)]
async fn while_listening_a_late_answer_is_discarded() {
    let (mut wire, mut device) = line();
    let late = async {
        tokio::time::sleep(Duration::from_millis(200)).await;
        device.write_all(&registers(7, 7)).await.unwrap();
    };
    let (heard, ()) =
        tokio::join!(wire.listen(3, Duration::from_millis(300), Duration::from_millis(100)), late);
    assert_eq!(heard, Ok(()));
    assert_eq!(asked(&mut wire, &mut device, READ, &registers(1, 2)).await, good());
}

/// Line on which input is always waiting, because the device never stops sending.
struct Chatter;

impl Port for Chatter {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        bytes.fill(0x55);
        Ok(bytes.len())
    }
}

impl AsyncRead for Chatter {
    fn poll_read(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> std::task::Poll<io::Result<()>> {
        buffer.put_slice(&[0x55; 16]);
        std::task::Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Chatter {
    fn poll_write(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
        bytes: &[u8],
    ) -> std::task::Poll<io::Result<usize>> {
        std::task::Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> std::task::Poll<io::Result<()>> {
        std::task::Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> std::task::Poll<io::Result<()>> {
        std::task::Poll::Ready(Ok(()))
    }
}

#[tokio::test]
async fn whoever_never_stops_talking_is_listened_to_for_as_long_as_was_said_and_no_longer() {
    let mut wire = Rtu::new(Chatter, Some(SLOW), &Tap::default());
    let (span, quiet) = (Duration::from_millis(40), Duration::from_millis(20));
    let listened = WallTimeout::new().within(Duration::from_secs(30), wire.listen(3, span, quiet)).await;
    assert_eq!(listened, Some(Ok(())));
    let asked = WallTimeout::new().within(quiet, wire.exchange(3, READ, &mut without_deadline())).await;
    assert_eq!((asked, wire.missed()), (None, Fault::Peer(PeerFault::Malformed)));
}
