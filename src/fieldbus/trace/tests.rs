use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

use super::*;
use crate::fieldbus::error::PeerFault;
use crate::fieldbus::kinds::modbus::request::ModbusRequest;
use crate::fieldbus::kinds::modbus::tcp::ModbusTcp;
use crate::fieldbus::request::{NodeReading, Stamped};
use crate::fieldbus::send_guard::SendGuard;
use isotherm_core::codec::{DataType, Register, Table};
use isotherm_core::reading::Reason;

const READ: Request<'static> = Request::read_registers(Register { table: Table::Input, offset: 0 }, 2);
const DEVICE: DeviceId = DeviceId(0);

/// Sends one request over a tapped stream. The peer answers with these bytes after the transaction number.
async fn asked(tap: &Tap, answer: &[u8]) -> Result<Answer, Fault> {
    let (ours, mut theirs) = duplex(2048);
    let mut wire = ModbusTcp::new(ours, tap);
    let peer = async {
        let mut question = [0; 12];
        theirs.read_exact(&mut question).await.unwrap();
        let mut bytes = question[..2].to_vec();
        bytes.extend(answer);
        theirs.write_all(&bytes).await.unwrap();
        drop(theirs);
    };
    let begun = tap.begin();
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    let answer = tokio::join!(wire.exchange(1, READ, &mut send_guard), peer).0;
    if let Some(begun) = begun {
        tap.tell(begun, (DEVICE, 1), READ, &answer);
    }
    answer
}

const GOOD: [u8; 11] = [0, 0, 0, 7, 1, 4, 4, 0, 251, 0, 249];

#[tokio::test]
async fn an_exchange_is_shown_with_its_bytes_and_its_meaning() {
    let tap = Tap::default();
    let mut listening = tap.listen(None).unwrap();
    assert_eq!(asked(&tap, &GOOD).await, Ok(Answer::Registers(vec![251, 249])));
    let exchange = listening.next_now().unwrap();
    assert_eq!(exchange.sent[2..], [0, 0, 0, 6, 1, 4, 0, 0, 0, 2]);
    assert_eq!(exchange.received[2..], GOOD);
    // The first transaction number is random.
    let mut exchange = exchange;
    exchange.sent[..2].fill(0);
    exchange.received[..2].fill(0);
    let shown = Exchange {
        asked_at: Moment::from_nanos(43_201_234_567_890),
        took: Duration::from_micros(3200),
        ..exchange
    };
    let lines: Vec<String> = shown.to_string().lines().map(str::to_owned).collect();
    assert_eq!(lines[0], "12:00:01.234 → 00 00 00 00 00 06 01 04 00 00 00 02   unit 1 read input:0..1");
    assert_eq!(
        lines[1],
        "             ← 00 00 00 00 00 07 01 04 04 00 fb 00 f9   2 registers: 251 249, 3.2 ms"
    );
    let document = serde_json::to_value(&shown).unwrap();
    assert_eq!(document["asked_at"], "1970-01-01T12:00:01.23456789Z");
    assert_eq!((document["took_ms"].as_f64(), document["is_good"].as_bool()), (Some(3.2), Some(true)));
    assert_eq!(document["received"], "00 00 00 00 00 07 01 04 04 00 fb 00 f9");
}

#[tokio::test]
async fn an_answer_that_is_none_is_shown_as_it_came_beside_its_fault() {
    let tap = Tap::default();
    let mut listening = tap.listen(Some(DEVICE)).unwrap();
    let mut garbage = GOOD;
    garbage[1] = 9;
    assert!(asked(&tap, &garbage).await.is_err());
    let exchange = listening.next_now().unwrap();
    assert_eq!(exchange.received[2..], garbage);
    assert!(!exchange.is_good);
    let short = [0, 0, 0, 5, 1, 4, 2, 0, 251];
    assert_eq!(asked(&tap, &short).await, Err(Fault::Peer(PeerFault::Length)));
    assert_eq!(listening.next_now().unwrap().answered, "reply with the wrong number of registers");
}

#[tokio::test]
async fn while_nobody_listens_nothing_is_kept_and_a_listener_that_goes_is_gone_at_once() {
    let tap = Tap::default();
    asked(&tap, &GOOD).await.unwrap();
    assert!(tap.begin().is_none() && tap.passed().sent.is_empty());
    let listening = tap.listen(None).unwrap();
    assert!(tap.is_on());
    let second = tap.listen(None).unwrap();
    drop(listening);
    assert!(tap.is_on());
    drop(second);
    assert!(!tap.is_on() && locked(&tap.0.listeners).is_empty());
}

#[tokio::test]
async fn a_listener_hears_its_own_device_only_and_there_are_four_at_most() {
    let tap = Tap::default();
    let mut other = tap.listen(Some(DeviceId(1))).unwrap();
    let mut own = tap.listen(Some(DEVICE)).unwrap();
    asked(&tap, &GOOD).await.unwrap();
    assert!(own.next_now().is_some() && other.next_now().is_none());
    let _others = (tap.listen(None).unwrap(), tap.listen(None).unwrap());
    assert!(tap.listen(None).unwrap_err().contains("4 clients already trace"));
}

#[test]
fn one_who_does_not_take_what_comes_misses_the_rest_and_is_told_how_much() {
    let tap = Tap::default();
    let mut listening = tap.listen(None).unwrap();
    for _ in 0..UNHEARD + 7 {
        let begun = tap.begin().unwrap();
        tap.tell(begun, (DEVICE, 1), READ, &Err(Fault::Timeout));
    }
    assert_eq!(listening.dropped(), 7);
    assert_eq!(std::iter::from_fn(|| listening.next_now()).count(), UNHEARD);
}

#[test]
fn of_a_flood_only_the_beginning_is_kept_and_the_rest_is_counted() {
    let tap = Tap::default();
    let mut listening = tap.listen(None).unwrap();
    let begun = tap.begin().unwrap();
    (0..100).for_each(|_| tap.passed().keep(&[7; 100], false));
    tap.tell(begun, (DEVICE, 1), READ, &Err(Fault::Timeout));
    let exchange = listening.next_now().unwrap();
    assert_eq!((exchange.received.len(), exchange.more), (LONGEST, 10_000 - LONGEST));
    assert!(exchange.to_string().contains("→ nothing sent   unit 1 read input:0..1"), "{exchange}");
}

#[test]
fn what_was_never_tried_is_not_reported() {
    let tap = Tap::default();
    let mut listening = tap.listen(None).unwrap();
    let begun = tap.begin().unwrap();
    tap.tell(begun, (DEVICE, 1), READ, &Err(Fault::Link(LinkFault::Down)));
    assert!(listening.next_now().is_none());
}

#[test]
fn each_kind_of_request_is_named_with_its_place_and_its_words() {
    let read = |count| Request::read_registers("coil:65535".parse().unwrap(), count).to_string();
    assert_eq!(read(1), "read coil:65535");
    assert_eq!(Request::write_coil(3, true).to_string(), "write coil:3 = 1");
    assert_eq!(
        Request::Modbus(ModbusRequest::WriteSingle { at: 104, value: 7 }).to_string(),
        "write holding:104 = 7"
    );
    assert_eq!(
        Request::Modbus(ModbusRequest::WriteMultiple { at: 104, values: &[1, 65535] }).to_string(),
        "write holding:104 = 1 65535"
    );
    assert_eq!(exchange::answered(&Ok(Answer::Bits(vec![true, false]))), "2 bits: 1 0");
    assert_eq!(exchange::answered(&Ok(Answer::Done)), "done");
    assert_eq!(exchange::answered(&Err(Fault::Exception(2))), "exception 2 (illegal data address)");
}

#[test]
fn a_text_is_shown_with_its_numbers() {
    let reading = |value| NodeReading { value, stamped: Stamped::Unknown, asked: None };
    let number = DataType::F64.encode(110.791_f64.to_bits());
    let answer = Ok(Answer::Nodes(vec![reading(Ok(number)), reading(Err(Reason::BadReply))]));
    let shown = exchange::answered_text(b"+110.791 mm\r\n", &answer);
    assert_eq!(shown, format!("\"+110.791 mm\\r\\n\": 110.791; {}", Reason::BadReply));
    let malformed = Err(Fault::Peer(PeerFault::Malformed));
    assert_eq!(
        exchange::answered_text(b"ERR1\r", &malformed),
        "\"ERR1\\r\": the reply violates the protocol"
    );
    assert_eq!(exchange::answered_text(b"", &Err(Fault::Timeout)), "no answer in time");
}
