//! Tests with a peer whose answers are written by hand.

use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::*;
use crate::clock::{BootClock, Clock, TimeOfDay, WallTimeout};
use crate::fieldbus::kinds::modbus::text::TextProtocol;
use crate::fieldbus::send_guard::SendDeadline;
use isotherm_core::codec::{Register, Table};

const READ: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 4 }, 2);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 4, value: 9 });
const WRITE_TWO: Request<'static> = Request::Modbus(ModbusRequest::WriteMultiple { at: 4, values: &[1, 2] });

/// Builds a frame. `transaction` and `unit` are added to those of the request.
fn frame(asked: &[u8], transaction: u8, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let length = u8::try_from(pdu.len() + 1).unwrap();
    let mut bytes = vec![asked[0], asked[1].wrapping_add(transaction), 0, 0, 0, length, asked[6] + unit];
    bytes.extend(pdu);
    bytes
}

async fn receive(peer: &mut DuplexStream) -> Vec<u8> {
    let mut header = [0; 6];
    peer.read_exact(&mut header).await.unwrap();
    let mut asked = header.to_vec();
    asked.resize(6 + usize::from(header[5]), 0);
    peer.read_exact(&mut asked[6..]).await.unwrap();
    asked
}

/// Returns the result of one request. The peer answers it with these bytes, and then closes.
async fn asked(request: Request<'_>, answer: impl FnOnce(&[u8]) -> Vec<u8>) -> Result<Answer, Fault> {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let peer = async {
        let asked = receive(&mut theirs).await;
        theirs.write_all(&answer(&asked)).await.unwrap();
        drop(theirs);
    };
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    tokio::join!(wire.exchange(3, request, &mut send_guard), peer).0
}

async fn plain(request: Request<'_>, pdu: &[u8]) -> Result<Answer, Fault> {
    asked(request, |asked| frame(asked, 0, 0, pdu)).await
}

const fn peer(fault: PeerFault) -> Result<Answer, Fault> {
    Err(Fault::Peer(fault))
}

#[tokio::test]
async fn registers_arrive_in_their_order() {
    assert_eq!(plain(READ, &[3, 4, 0, 1, 2, 3]).await, Ok(Answer::Registers(vec![1, 0x0203])));
}

#[tokio::test]
async fn too_few_and_too_many_registers_are_no_answer() {
    assert_eq!(plain(READ, &[3, 2, 0, 1]).await, peer(PeerFault::Length));
    assert_eq!(plain(READ, &[3, 6, 0, 1, 0, 2, 0, 3]).await, peer(PeerFault::Length));
}

#[tokio::test]
async fn an_answer_of_another_transaction_or_unit_is_foreign() {
    let pdu = [3, 4, 0, 1, 0, 2];
    assert_eq!(asked(READ, |asked| frame(asked, 1, 0, &pdu)).await, peer(PeerFault::Foreign));
    assert_eq!(asked(READ, |asked| frame(asked, 255, 0, &pdu)).await, peer(PeerFault::Foreign));
    assert_eq!(asked(READ, |asked| frame(asked, 1, 1, &pdu)).await, peer(PeerFault::Foreign));
    assert_eq!(asked(READ, |asked| frame(asked, 0, 1, &pdu)).await, peer(PeerFault::Unit(4)));
    assert_eq!(asked(WRITE, |asked| frame(asked, 0, 252, ECHO)).await, peer(PeerFault::Unit(255)));
}

#[tokio::test]
async fn an_exception_of_three_or_four_bytes_is_one_with_its_code_and_a_longer_one_is_malformed() {
    for (request, refused) in [(READ, 0x83), (WRITE, 0x86)] {
        assert_eq!(plain(request, &[refused, 2, 0]).await, peer(PeerFault::LongException(2)));
        assert_eq!(plain(request, &[refused, 2, 0, 0]).await, peer(PeerFault::LongException(2)));
        assert_eq!(plain(request, &[refused, 2, 0, 0, 0]).await, peer(PeerFault::Malformed));
    }
}

#[tokio::test]
async fn a_request_that_comes_back_is_no_answer_and_has_a_fault_of_its_own() {
    assert_eq!(asked(READ, <[u8]>::to_vec).await, peer(PeerFault::Echoed));
    let bits = Request::read_registers(Register { table: Table::Discrete, offset: 0 }, 3);
    assert_eq!(asked(bits, <[u8]>::to_vec).await, peer(PeerFault::Echoed));
}

#[tokio::test]
async fn text_is_named() {
    for (text, protocol) in [
        (&b"HTTP/1.1 400 Bad Request\r\n\r\n"[..], TextProtocol::Other),
        (b"SSH-2.0-OpenSSH_9.2\r\n", TextProtocol::Other),
        (b":010402000000F9\r\n", TextProtocol::ModbusAscii),
        (b">+025.12\r", TextProtocol::Dcon),
    ] {
        assert_eq!(asked(READ, |_| text.to_vec()).await, peer(PeerFault::Text(protocol)));
    }
}

#[tokio::test]
async fn text_that_is_shorter_than_a_header_is_named_after_the_timeout() {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    for (text, fault) in
        [(&[][..], Fault::Timeout), (b"?01\r", Fault::Peer(PeerFault::Text(TextProtocol::Dcon)))]
    {
        theirs.write_all(text).await.unwrap();
        let exchange = wire.exchange(3, READ, &mut send_guard);
        let answer = WallTimeout::new().within(Duration::from_millis(20), exchange).await;
        assert_eq!((answer, wire.missed()), (None, fault));
    }
}

#[tokio::test]
async fn an_answer_of_another_function_is_no_answer() {
    assert_eq!(plain(READ, &[4, 4, 0, 1, 0, 2]).await, peer(PeerFault::Function));
    assert_eq!(plain(WRITE, &[5, 0, 4, 255, 0]).await, peer(PeerFault::Function));
}

#[tokio::test]
async fn a_write_is_done_only_where_the_echo_repeats_it() {
    assert_eq!(plain(WRITE, &[6, 0, 4, 0, 9]).await, Ok(Answer::Done));
    assert_eq!(plain(WRITE, &[6, 0, 4, 0, 8]).await, peer(PeerFault::Echo));
    assert_eq!(plain(WRITE, &[6, 0, 5, 0, 9]).await, peer(PeerFault::Echo));
    assert_eq!(plain(WRITE_TWO, &[16, 0, 4, 0, 2]).await, Ok(Answer::Done));
    assert_eq!(plain(WRITE_TWO, &[16, 0, 4, 0, 1]).await, peer(PeerFault::Echo));
    assert_eq!(plain(WRITE_TWO, &[16, 0, 3, 0, 2]).await, peer(PeerFault::Echo));
    let coil = Request::write_coil(4, true);
    assert_eq!(plain(coil, &[5, 0, 4, 255, 0]).await, Ok(Answer::Done));
    assert_eq!(plain(coil, &[5, 0, 4, 0, 0]).await, peer(PeerFault::Echo));
}

#[tokio::test]
async fn an_exception_comes_with_its_code() {
    assert_eq!(plain(READ, &[0x83, 2]).await, Err(Fault::Exception(2)));
    assert_eq!(plain(WRITE, &[0x86, 6]).await, Err(Fault::Exception(6)));
}

#[tokio::test]
async fn an_exception_with_a_code_of_its_own_is_still_an_exception() {
    assert_eq!(plain(READ, &[0x83, 0x42]).await, Err(Fault::Exception(0x42)));
}

#[tokio::test]
async fn bits_come_in_whole_bytes_and_only_those_asked_for_are_kept() {
    let bits = |count| Request::read_registers(Register { table: Table::Discrete, offset: 0 }, count);
    assert_eq!(plain(bits(3), &[2, 1, 0b101]).await, Ok(Answer::Bits(vec![true, false, true])));
    assert_eq!(plain(bits(3), &[2, 2, 0b101, 0]).await, peer(PeerFault::Length));
    assert_eq!(plain(bits(9), &[2, 1, 0xff]).await, peer(PeerFault::Length));
}

#[tokio::test]
async fn what_is_no_modbus_is_never_an_answer() {
    let answer = asked(READ, |asked| {
        let mut bytes = frame(asked, 0, 0, &[3, 4, 0, 1, 0, 2]);
        bytes[2] = 7;
        bytes
    });
    let answer = answer.await;
    assert!(matches!(answer, Err(Fault::Peer(_) | Fault::BROKEN)), "{answer:?}");
    let answer = plain(READ, &[3, 9, 0, 1]).await;
    assert!(matches!(answer, Err(Fault::Peer(_) | Fault::BROKEN)), "{answer:?}");
}

#[tokio::test]
async fn a_connection_that_ends_in_the_middle_of_an_answer_is_broken() {
    for kept in 0..12 {
        let answer = asked(READ, |asked| frame(asked, 0, 0, &[3, 4, 0, 1, 0, 2])[..kept].to_vec()).await;
        assert_eq!(answer, Err(Fault::BROKEN), "after {kept} bytes");
    }
}

/// Sends a write with a read after it, and then requests that read. The peer answers both at once. Returns both
/// results.
async fn pair(
    answers: impl FnOnce(&[u8], &[u8]) -> Vec<Vec<u8>>,
) -> (Result<Answer, Fault>, Result<Answer, Fault>) {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let peer = async {
        // Both arrive together: the second request is sent before the first is answered.
        let mut both = [0; 24];
        theirs.read_exact(&mut both).await.unwrap();
        let (write, read) = both.split_at(12);
        for bytes in answers(write, read) {
            theirs.write_all(&bytes).await.unwrap();
            tokio::task::yield_now().await;
        }
        // Nothing else is sent.
        theirs.shutdown().await.unwrap();
        assert_eq!(theirs.read(&mut both).await.unwrap(), 0);
    };
    let ours = async {
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        send_guard.begins(Duration::from_secs(1));
        wire.set_follow_up(Some((3, READ)));
        let written = wire.exchange(3, WRITE, &mut send_guard).await;
        let read = wire.exchange(3, READ, &mut send_guard).await;
        drop(wire);
        (written, read)
    };
    tokio::join!(ours, peer).0
}

const ECHO: &[u8] = &[6, 0, 4, 0, 9];
const TWO: &[u8] = &[3, 4, 0, 1, 0, 2];

#[tokio::test]
async fn of_two_questions_in_one_go_each_gets_its_own_answer_in_whatever_order_and_pieces_they_come() {
    let right = (Ok(Answer::Done), Ok(Answer::Registers(vec![1, 2])));
    let in_order = |write: &[u8], read: &[u8]| [frame(write, 0, 0, ECHO), frame(read, 0, 0, TWO)].concat();
    assert_eq!(pair(|write, read| vec![in_order(write, read)]).await, right);
    let turned = |write: &[u8], read: &[u8]| [frame(read, 0, 0, TWO), frame(write, 0, 0, ECHO)].concat();
    assert_eq!(pair(|write, read| vec![turned(write, read)]).await, right);
    for piece in [1, 7, 12, 13] {
        let pieces = |bytes: Vec<u8>| bytes.chunks(piece).map(<[u8]>::to_vec).collect::<Vec<_>>();
        assert_eq!(pair(|write, read| pieces(in_order(write, read))).await, right, "{piece}");
        assert_eq!(pair(|write, read| pieces(turned(write, read))).await, right, "{piece}");
    }
    let refused = pair(|write, read| vec![frame(write, 0, 0, &[0x86, 4]), frame(read, 0, 0, &[0x83, 2])]);
    assert_eq!(refused.await, (Err(Fault::Exception(4)), Err(Fault::Exception(2))));
}

#[tokio::test]
async fn of_two_questions_nothing_is_believed_that_a_single_one_would_not_be() {
    let done = Ok(Answer::Done);
    // Echo of another value; unknown transaction; unknown unit; one register instead of two.
    let wrong_echo = pair(|write, read| vec![frame(write, 0, 0, &[6, 0, 4, 0, 8]), frame(read, 0, 0, TWO)]);
    assert_eq!(wrong_echo.await.0, peer(PeerFault::Echo));
    let neither = pair(|write, read| vec![frame(write, 0, 0, ECHO), frame(read, 5, 0, TWO)]);
    assert_eq!(neither.await, (done.clone(), peer(PeerFault::Foreign)));
    let nobody = pair(|write, read| vec![frame(write, 0, 0, ECHO), frame(read, 0, 1, TWO)]);
    assert_eq!(nobody.await, (done.clone(), peer(PeerFault::Unit(4))));
    let short = pair(|write, read| vec![frame(write, 0, 0, ECHO), frame(read, 0, 0, &[3, 2, 0, 1])]);
    assert_eq!(short.await, (done.clone(), peer(PeerFault::Length)));
    // The answer to the second request does not answer the first, even with its transaction.
    let swapped = pair(|write, read| vec![frame(write, 0, 0, TWO), frame(read, 0, 0, ECHO)]);
    assert_eq!(swapped.await.0, peer(PeerFault::Function));
    // Two answers to the first request, and none to the second.
    let twice = pair(|write, _| vec![[frame(write, 0, 0, ECHO), frame(write, 0, 0, ECHO)].concat()]);
    assert_eq!(twice.await, (done.clone(), peer(PeerFault::Foreign)));
    let lost = pair(|write, _| vec![frame(write, 0, 0, ECHO)]);
    assert_eq!(lost.await, (done, Err(Fault::BROKEN)));
}

#[tokio::test]
async fn bytes_behind_both_answers_close_the_connection() {
    let more = pair(|write, read| vec![frame(write, 0, 0, ECHO), [frame(read, 0, 0, TWO), vec![0]].concat()]);
    assert_eq!(more.await.1, peer(PeerFault::Unasked));
}

#[tokio::test]
async fn an_answer_that_nobody_asked_for_in_time_is_forgotten_and_the_question_put_anew() {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let peer = async {
        let (write, read) = (receive(&mut theirs).await, receive(&mut theirs).await);
        theirs.write_all(&[frame(&write, 0, 0, ECHO), frame(&read, 0, 0, TWO)].concat()).await.unwrap();
        // Another write between the two.
        let again = receive(&mut theirs).await;
        theirs.write_all(&frame(&again, 0, 0, ECHO)).await.unwrap();
        let anew = receive(&mut theirs).await;
        theirs.write_all(&frame(&anew, 0, 0, &[3, 4, 0, 7, 0, 8])).await.unwrap();
    };
    let ours = async {
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        send_guard.begins(Duration::from_millis(20));
        wire.set_follow_up(Some((3, READ)));
        assert_eq!(wire.exchange(3, WRITE, &mut send_guard).await, Ok(Answer::Done));
        assert_eq!(wire.exchange(3, WRITE, &mut send_guard).await, Ok(Answer::Done));
        tokio::time::sleep(Duration::from_millis(30)).await;
        assert_eq!(wire.exchange(3, READ, &mut send_guard).await, Ok(Answer::Registers(vec![7, 8])));
    };
    tokio::join!(ours, peer);
}

#[tokio::test]
async fn what_is_read_behind_a_question_is_as_old_as_that() {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let peer = async {
        let (write, read) = (receive(&mut theirs).await, receive(&mut theirs).await);
        theirs.write_all(&frame(&write, 0, 0, ECHO)).await.unwrap();
        tokio::time::sleep(Duration::from_millis(20)).await;
        theirs.write_all(&frame(&read, 0, 0, TWO)).await.unwrap();
    };
    let ours = async {
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        send_guard.begins(Duration::from_secs(1));
        wire.set_follow_up(Some((3, READ)));
        wire.exchange(3, WRITE, &mut send_guard).await.unwrap();
        let left = send_guard.asked();
        send_guard.next(READ, SendDeadline::None);
        wire.exchange(3, READ, &mut send_guard).await.unwrap();
        assert_eq!(send_guard.asked(), left);
        assert!(send_guard.took() >= Duration::from_millis(20));
    };
    tokio::join!(ours, peer);
}

#[tokio::test]
async fn a_read_behind_a_question_that_is_not_answered_was_sent_with_that() {
    let (ours, mut theirs) = duplex(512);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let peer = async {
        let write = receive(&mut theirs).await;
        theirs.write_all(&frame(&write, 0, 0, ECHO)).await.unwrap();
    };
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    send_guard.begins(Duration::from_secs(1));
    wire.set_follow_up(Some((3, READ)));
    let (written, ()) = tokio::join!(wire.exchange(3, WRITE, &mut send_guard), peer);
    written.unwrap();
    let left = send_guard.asked();
    assert_eq!(wire.unanswered_behind(), left.map(|asked| (3, READ, asked)));
    send_guard.next(READ, SendDeadline::None);
    let answer = wire.exchange(3, READ, &mut send_guard);
    assert!(tokio::time::timeout(Duration::from_millis(20), answer).await.is_err());
    assert_eq!(send_guard.asked(), left);
    assert_eq!(wire.unanswered_behind(), None, "it has become the present request");
}

#[tokio::test]
async fn the_form_of_an_answer_is_known_though_it_is_a_wrong_one() {
    for (pdu, form) in [
        (&[3, 2, 0, 1][..], ReplySignature::of_answer(&[3, 2])),
        (&[4, 4, 0, 1, 0, 2], ReplySignature::of_answer(&[4, 4])),
        (&[0x83, 2], None),
        (ECHO, None),
    ] {
        let (ours, mut theirs) = duplex(512);
        let mut wire = ModbusTcp::new(ours, &Tap::default());
        let peer = async {
            let asked = receive(&mut theirs).await;
            theirs.write_all(&frame(&asked, 0, 0, pdu)).await.unwrap();
        };
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        let (answer, ()) = tokio::join!(wire.exchange(3, READ, &mut send_guard), peer);
        assert!(answer.is_err());
        assert_eq!(wire.received_form(), form, "{pdu:?}");
    }
}

#[tokio::test]
async fn what_nobody_asked_for_keeps_a_write_from_leaving_and_is_found_behind_one_that_follows_an_answer_at_once()
 {
    // The pause counts from the answer, however long the device has taken for it.
    for (took, pause, left, fault) in [
        (0, 0, true, PeerFault::Foreign),
        (0, 1, false, PeerFault::Unasked),
        (5, 0, true, PeerFault::Foreign),
        (5, 1, false, PeerFault::Unasked),
    ] {
        let (ours, mut theirs) = duplex(512);
        let clock = Clock::simulated(Moment::default().after(Duration::from_secs(60)), None);
        let mut wire = ModbusTcp::new(ours, &Tap::default());
        let mut send_guard = SendGuard::without_deadline(&clock);
        let mut asked = Vec::new();
        // A write after the first answer of a connection is always checked.
        for _ in 0..2 {
            let peer_answers = async {
                asked = receive(&mut theirs).await;
                clock.skip(Duration::from_millis(took));
                theirs.write_all(&frame(&asked, 0, 0, TWO)).await.unwrap();
            };
            let (read, ()) = tokio::join!(wire.exchange(3, READ, &mut send_guard), peer_answers);
            assert_eq!(read, Ok(Answer::Registers(vec![1, 2])));
        }
        theirs.write_all(&frame(&asked, 0, 0, TWO)).await.unwrap();
        clock.skip(Duration::from_millis(pause));
        send_guard.sample();
        assert_eq!(wire.exchange(3, WRITE, &mut send_guard).await, peer(fault));
        drop(wire);
        let mut heard = Vec::new();
        theirs.read_to_end(&mut heard).await.unwrap();
        assert_eq!(!heard.is_empty(), left, "{pause} ms after an answer of {took} ms");
    }
}

/// Connection to a peer, with a request that the wire has given up.
struct Late {
    wire: ModbusTcp,
    peer: DuplexStream,
    send_guard: SendGuard,
    clock: Clock,
    /// Request that was given up, and its time.
    asked: Vec<u8>,
    sent: Moment,
}

/// Sends a read that the peer does not answer within the timeout.
async fn given_up() -> Late {
    let (ours, mut peer) = duplex(2048);
    let clock = Clock::simulated(Moment::default().after(Duration::from_secs(60)), None);
    let (mut wire, mut send_guard) =
        (ModbusTcp::new(ours, &Tap::default()), SendGuard::without_deadline(&clock));
    let exchange = wire.exchange(3, READ, &mut send_guard);
    assert!(tokio::time::timeout(Duration::from_millis(20), exchange).await.is_err());
    assert!(wire.give_up());
    let sent = send_guard.asked().unwrap();
    assert!(wire.expects_late(3, sent) && !wire.expects_late(4, sent));
    let asked = receive(&mut peer).await;
    Late { wire, peer, send_guard, clock, asked, sent }
}

impl Late {
    /// Sends bytes and then the answer to the next request. Returns the result of that request.
    async fn next(&mut self, request: Request<'_>, late: &[u8], pdu: &[u8]) -> Result<Answer, Fault> {
        let Late { wire, peer, send_guard, .. } = self;
        let answers = async {
            let asked = receive(peer).await;
            let answer = [late, &frame(&asked, 0, 0, pdu)].concat();
            peer.write_all(&answer).await.unwrap();
            std::future::pending::<()>().await;
        };
        tokio::select! {
            answer = wire.exchange(3, request, send_guard) => answer,
            () = answers => unreachable!(),
        }
    }

    fn reply(&self) -> Vec<u8> {
        frame(&self.asked, 0, 0, &[3, 4, 0, 9, 0, 9])
    }
}

const NEXT: &[u8] = &[3, 4, 0, 1, 0, 2];

#[tokio::test]
async fn a_late_answer_is_discarded_and_the_next_request_gets_its_own() {
    let right = Ok(Answer::Registers(vec![1, 2]));
    let mut late = given_up().await;
    let reply = late.reply();
    assert_eq!(late.next(READ, &reply, NEXT).await, right, "before the answer");
    assert!(!late.wire.expects_late(3, late.sent));
    let [reply] = late.wire.late_replies().try_into().unwrap();
    assert_eq!((reply.unit, reply.is_of_a_gateway, reply.received), (3, false, Some(late.clock.now())));
    // The late answer arrives while no request is open, and the time of its arrival is not known.
    let mut late = given_up().await;
    let reply = late.reply();
    late.peer.write_all(&reply).await.unwrap();
    late.clock.skip(Duration::from_secs(1));
    late.send_guard.sample();
    assert_eq!(late.next(READ, &[], NEXT).await, right, "while no request is open");
    assert_eq!(late.wire.late_replies()[0].received, None);
    // The late answer arrives in the same segment, after the answer.
    let mut late = given_up().await;
    let reply = late.reply();
    let behind = async {
        let asked = receive(&mut late.peer).await;
        late.peer.write_all(&[frame(&asked, 0, 0, NEXT), reply].concat()).await.unwrap();
    };
    let (answer, ()) = tokio::join!(late.wire.exchange(3, READ, &mut late.send_guard), behind);
    assert_eq!(answer, right, "behind the answer");
    assert!(!late.wire.expects_late(3, late.sent));
}

#[tokio::test]
async fn a_late_exception_of_a_gateway_is_told_from_an_answer_of_the_unit() {
    for (pdu, is_of_a_gateway) in [(&[0x83, 11][..], true), (&[0x83, 10], true), (&[0x83, 4], false)] {
        let mut late = given_up().await;
        let bytes = frame(&late.asked, 0, 0, pdu);
        late.peer.write_all(&bytes).await.unwrap();
        assert_eq!(late.wire.await_late((3, late.sent), &mut late.send_guard).await, Ok(()));
        assert_eq!(late.wire.late_replies()[0].is_of_a_gateway, is_of_a_gateway, "{pdu:?}");
    }
}

/// The wait for a late answer was announced. If the clock samples during the wait ended the announcement, the line would
/// drop all readings.
#[tokio::test]
async fn a_long_wait_with_a_late_answer_is_no_stop_of_the_computer() {
    for is_request in [false, true] {
        let passed = Arc::new(Mutex::new(Duration::ZERO));
        let time = passed.clone();
        let clock = Clock::wall_by(BootClock::by(move || *time.lock().unwrap()), TimeOfDay::default());
        let mut late = given_up().await;
        late.send_guard = SendGuard::without_deadline(&clock).aged(Duration::from_secs(5));
        let (reply, sent) = (late.reply(), late.sent);
        let waits = |seconds: u64| *passed.lock().unwrap() += Duration::from_secs(seconds);
        let Late { wire, peer, send_guard, .. } = &mut late;
        send_guard.begins(Duration::from_secs(6));
        if is_request {
            let answers = async {
                let asked = receive(peer).await;
                waits(3);
                peer.write_all(&reply).await.unwrap();
                tokio::task::yield_now().await;
                waits(3);
                peer.write_all(&frame(&asked, 0, 0, NEXT)).await.unwrap();
            };
            let (answer, ()) = tokio::join!(wire.exchange(3, READ, send_guard), answers);
            assert_eq!(answer, Ok(Answer::Registers(vec![1, 2])));
        } else {
            let answers = async {
                waits(6);
                peer.write_all(&reply).await.unwrap();
            };
            let (received, ()) = tokio::join!(wire.await_late((3, sent), send_guard), answers);
            assert_eq!(received, Ok(()));
        }
        send_guard.sample();
        assert!(!send_guard.has_stalled(), "{is_request}");
    }
}

#[tokio::test]
async fn a_late_answer_that_arrived_while_the_line_was_idle_is_discarded_without_the_time_of_its_arrival() {
    let mut late = given_up().await;
    assert_eq!(late.wire.discard_arrived(), Ok(()));
    assert!(late.wire.expects_late(3, late.sent), "nothing has arrived");
    let reply = late.reply();
    late.peer.write_all(&reply).await.unwrap();
    assert_eq!(late.wire.discard_arrived(), Ok(()));
    assert!(!late.wire.expects_late(3, late.sent));
    assert_eq!(late.wire.late_replies()[0].received, None);
    late.peer.write_all(&reply).await.unwrap();
    assert_eq!(late.wire.discard_arrived(), Err(Fault::UNASKED), "twice");
}

#[tokio::test]
async fn anything_but_one_late_answer_to_each_given_up_request_still_closes_the_connection() {
    let foreign = peer(PeerFault::Foreign);
    let pdu = [3, 4, 0, 9, 0, 9];
    for (transaction, unit, of) in
        [(1, 0, "another transaction"), (255, 0, "the one before"), (0, 1, "another unit")]
    {
        let mut late = given_up().await;
        let bytes = frame(&late.asked, transaction, unit, &pdu);
        assert_eq!(late.next(READ, &bytes, NEXT).await, foreign, "{of}");
        let mut late = given_up().await;
        let bytes = frame(&late.asked, transaction, unit, &pdu);
        late.peer.write_all(&bytes).await.unwrap();
        assert_eq!(late.next(WRITE, &[], ECHO).await, peer(PeerFault::Unasked), "{of}, before the request");
    }
    let mut late = given_up().await;
    let twice = [late.reply(), late.reply()].concat();
    assert_eq!(late.next(READ, &twice, NEXT).await, foreign, "twice");
    let mut late = given_up().await;
    let bytes = [late.reply(), vec![0]].concat();
    late.peer.write_all(&bytes).await.unwrap();
    assert_eq!(
        late.wire.await_late((3, late.sent), &mut late.send_guard).await,
        Err(Fault::UNASKED),
        "a byte behind it"
    );
}

#[tokio::test]
async fn a_connection_in_the_middle_of_a_frame_cannot_be_kept() {
    for bytes in [1, 6, 11] {
        let (ours, mut theirs) = duplex(512);
        let mut wire = ModbusTcp::new(ours, &Tap::default());
        let mut send_guard = SendGuard::without_deadline(&Clock::wall());
        let part = async {
            let asked = receive(&mut theirs).await;
            theirs.write_all(&frame(&asked, 0, 0, NEXT)[..bytes]).await.unwrap();
            std::future::pending::<()>().await;
        };
        let exchange = async { tokio::join!(wire.exchange(3, READ, &mut send_guard), part) };
        assert!(tokio::time::timeout(Duration::from_millis(20), exchange).await.is_err());
        assert!(!wire.give_up(), "{bytes} bytes of the answer");
    }
    // A request of which a part was sent.
    let (ours, _theirs) = duplex(5);
    let mut wire = ModbusTcp::new(ours, &Tap::default());
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    let exchange = wire.exchange(3, READ, &mut send_guard);
    assert!(tokio::time::timeout(Duration::from_millis(20), exchange).await.is_err());
    assert!(!wire.give_up());
}

#[tokio::test]
async fn a_connection_that_ends_while_a_late_answer_is_awaited_was_closed_while_idle() {
    let mut late = given_up().await;
    drop(late.peer);
    assert_eq!(late.wire.await_late((3, late.sent), &mut late.send_guard).await, Err(Fault::CLOSED));
    assert_eq!(late.wire.ending(), Ending::Closed);
}
