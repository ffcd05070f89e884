use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::sleep;

use super::*;
use crate::clock::Clock;
use crate::fieldbus::error::PeerFault;
use isotherm_core::codec::{Encoding, Scale, TextValue, WordOrder};
use isotherm_profile::plan::Field;

const TIMEOUT: Duration = Duration::from_millis(500);
/// Timeout, wait for a late answer, and reserve.
const LONG: Duration = Duration::from_secs(5);
const ENCODING: Encoding = Encoding {
    data_type: DataType::F64,
    word_order: WordOrder::MswFirst,
    byte_swap: false,
    scale: Scale::ONE,
    offset: 0.0,
    bias: 0,
    bad: Vec::new(),
};

fn wire() -> (TextWire, DuplexStream) {
    let (port, peer) = tokio::io::duplex(4096);
    (TextWire::new(port, 8, TIMEOUT, &Tap::default()), peer)
}

/// Returns a line with a long timeout, so that a busy computer does not change which answers may still arrive.
fn patient_wire(pending: &Arc<Mutex<PendingAnswers>>) -> (TextWire, DuplexStream) {
    let (port, peer) = tokio::io::duplex(4096);
    let port = TextPort::new(port, 8, &Tap::default());
    (TextWire::of(port, None, Duration::from_mins(5), pending.clone()), peer)
}

fn texts(request: &str, patterns: &[&str]) -> Vec<TextValue> {
    let value = |pattern: &&str| TextValue { request: request.to_owned(), pattern: pattern.parse().unwrap() };
    patterns.iter().map(value).collect()
}

async fn answer(wire: &mut TextWire, texts: &[TextValue]) -> Result<Answer, Fault> {
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    let request = Request::Texts(TextRequest(texts));
    Wire::exchange(wire, 0, request, &mut send_guard).await
}

/// Reads the values, and returns their numbers or faults.
async fn read(wire: &mut TextWire, texts: &[TextValue]) -> Result<Vec<Result<f64, Reason>>, Fault> {
    let answer = answer(wire, texts).await?;
    let field = |at| Field { at, ..Field::value(isotherm_core::reading::SignalId(0), 4) };
    Ok((0..).take(texts.len()).map(|at| answer.decode(&field(at), &ENCODING)).collect())
}

/// Waits for this request, and sends an answer.
async fn answers(peer: &mut DuplexStream, request: &str, answer: &str) {
    let mut bytes = vec![0; request.len()];
    peer.read_exact(&mut bytes).await.unwrap();
    assert_eq!(bytes, request.as_bytes());
    peer.write_all(answer.as_bytes()).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn all_values_of_an_answer_are_read_by_one_request() {
    let (mut wire, mut peer) = wire();
    let texts = texts("#01\r", &[">{number}{any}", ">{skip}{number}{any}"]);
    for _ in 0..2 {
        let (found, ()) =
            tokio::join!(read(&mut wire, &texts), answers(&mut peer, "#01\r", ">+025.12+023.40\r\n"));
        assert_eq!(found, Ok(vec![Ok(25.12), Ok(23.4)]));
    }
}

#[tokio::test(start_paused = true)]
async fn an_answer_of_several_lines_is_read_up_to_its_end() {
    let (mut wire, mut peer) = wire();
    let texts = texts("\u{2}", &["X{number} mm", "Y{number} mm"]);
    let both = answers(&mut peer, "\u{2}", "X+1.5 mm\r\nY-2.5 mm\r\n");
    assert_eq!(tokio::join!(read(&mut wire, &texts), both).0, Ok(vec![Ok(1.5), Ok(-2.5)]));
    let inch = answers(&mut peer, "\u{2}", "X+1.5 mm\r\nY-0.09 in\r\n");
    let found = tokio::join!(read(&mut wire, &texts), inch).0;
    assert_eq!(found, Ok(vec![Ok(1.5), Err(Reason::BadReply)]));
}

#[tokio::test(start_paused = true)]
async fn a_readout_that_was_switched_to_inch_has_no_value() {
    let (mut wire, mut peer) = wire();
    let texts = texts("\u{2}", &["{number}  {any 2}"]);
    let inch = answers(&mut peer, "\u{2}", "+    0.4860 \"  \r\n");
    let found = tokio::join!(read(&mut wire, &texts), inch).0;
    assert_eq!(found, Err(Fault::Peer(PeerFault::Malformed)));
}

#[tokio::test(start_paused = true)]
async fn text_that_arrived_before_the_read_is_not_used() {
    let (mut wire, mut peer) = wire();
    let texts = texts("", &["{number} mm"]);
    peer.write_all(b"+1.0 mm\r\n+2.0 mm\r\n+3").await.unwrap();
    let sends = async {
        sleep(Duration::from_millis(100)).await;
        peer.write_all(b"9.0 mm\r\n+4.0 mm\r\n").await.unwrap();
    };
    assert_eq!(tokio::join!(read(&mut wire, &texts), sends).0, Ok(vec![Ok(4.0)]), "+39.0 began before");
    assert_eq!(read(&mut wire, &texts).await, Err(Fault::Timeout));
}

#[tokio::test(start_paused = true)]
async fn the_late_answer_of_one_module_is_not_that_of_another() {
    let (mut wire, mut peer) = patient_wire(&Arc::default());
    let (first, second) = (texts("#01\r", &[">{number}"]), texts("#02\r", &[">{number}"]));
    assert_eq!(read(&mut wire, &first).await, Err(Fault::Timeout));
    let late = async {
        let mut bytes = [0; 4];
        peer.read_exact(&mut bytes).await.unwrap();
        sleep(Duration::from_millis(300)).await;
        peer.write_all(b">+99.0\r").await.unwrap();
        answers(&mut peer, "#02\r", ">+20.0\r").await;
    };
    assert_eq!(tokio::join!(read(&mut wire, &second), late).0, Ok(vec![Ok(20.0)]));
}

#[tokio::test(start_paused = true)]
async fn the_age_of_a_late_answer_counts_from_its_own_request() {
    let (mut wire, mut peer) = patient_wire(&Arc::default());
    let texts = texts("#01\r", &[">{number}"]);
    assert_eq!(read(&mut wire, &texts).await, Err(Fault::Timeout));
    let between = Clock::wall().now();
    let late = answers(&mut peer, "#01\r#01\r", ">+20.0\r");
    let found = tokio::join!(answer(&mut wire, &texts), late).0;
    let Ok(Answer::Nodes(nodes)) = found else { panic!("{found:?}") };
    assert!(nodes[0].asked.is_some_and(|asked| asked <= between), "{nodes:?}");
    let second = answers(&mut peer, "#01\r", ">+21.0\r");
    let found = tokio::join!(answer(&mut wire, &texts), second).0;
    let Ok(Answer::Nodes(nodes)) = found else { panic!("{found:?}") };
    assert!(nodes[0].asked.is_some(), "an answer may still be missing: {nodes:?}");
}

/// The line opens the port again after a timeout. Without a wait, `12.5` would be a value.
#[tokio::test(start_paused = true)]
async fn the_rest_of_an_answer_on_a_new_connection_is_no_value() {
    let pending = Arc::default();
    let texts = texts("#01\r", &["{number}"]);
    let (mut wire, mut peer) = patient_wire(&pending);
    let half = answers(&mut peer, "#01\r", "-1");
    assert_eq!(tokio::join!(read(&mut wire, &texts), half).0, Err(Fault::Timeout));
    let (mut wire, mut peer) = patient_wire(&pending);
    let rest = async {
        sleep(Duration::from_secs(2)).await;
        peer.write_all(b"12.5\r").await.unwrap();
        answers(&mut peer, "#01\r", "-112.5\r").await;
    };
    let found = tokio::join!(answer(&mut wire, &texts), rest).0;
    let Ok(Answer::Nodes(nodes)) = found else { panic!("{found:?}") };
    assert_eq!(nodes[0].value, Ok(DataType::F64.encode((-112.5_f64).to_bits())));
    assert!(nodes[0].asked.is_some() && !pending.lock().unwrap().is_open(), "{nodes:?}");
}

#[tokio::test(start_paused = true)]
async fn text_that_a_serial_server_has_kept_is_not_used() {
    let (mut wire, mut peer) = wire();
    let texts = texts("", &["{number} mm"]);
    let sends = async {
        sleep(Duration::from_millis(20)).await;
        peer.write_all(b"5.0 mm\r\n+1.0 mm\r\n+1.1 mm\r\n").await.unwrap();
        sleep(Duration::from_millis(200)).await;
        peer.write_all(b"+2.0 mm\r\n").await.unwrap();
    };
    assert_eq!(tokio::join!(read(&mut wire, &texts), sends).0, Ok(vec![Ok(2.0)]));
    // The system hands over a long backlog in parts.
    peer.write_all(&b"+2.1 mm\r\n".repeat(350)).await.unwrap();
    let sends = async {
        sleep(Duration::from_millis(20)).await;
        peer.write_all(b"+2.2 mm\r\n+2.3 mm\r\n").await.unwrap();
        sleep(Duration::from_millis(200)).await;
        peer.write_all(b"+3.0 mm\r\n").await.unwrap();
    };
    assert_eq!(tokio::join!(read(&mut wire, &texts), sends).0, Ok(vec![Ok(3.0)]));
}

/// The device answers the request of the last run of the program.
#[tokio::test(start_paused = true)]
async fn the_first_request_waits_for_the_answer_to_an_earlier_run() {
    let (mut wire, mut peer) = wire();
    let texts = texts("#02\r", &[">{number}"]);
    let late = async {
        sleep(Duration::from_millis(300)).await;
        peer.write_all(b">+99.0\r").await.unwrap();
        answers(&mut peer, "#02\r", ">+20.0\r").await;
    };
    assert_eq!(tokio::join!(read(&mut wire, &texts), late).0, Ok(vec![Ok(20.0)]));
}

/// One line has a device that sends by itself and one that answers requests.
#[tokio::test(start_paused = true)]
async fn the_first_answer_after_text_without_a_request_is_used() {
    let (mut wire, mut peer) = wire();
    assert_eq!(read(&mut wire, &texts("", &["{number} mm"])).await, Err(Fault::Timeout));
    let module = texts("#01\r", &[">{number}"]);
    let sends = answers(&mut peer, "#01\r", ">+1.5\r");
    assert_eq!(tokio::join!(read(&mut wire, &module), sends).0, Ok(vec![Ok(1.5)]));
}

#[tokio::test(start_paused = true)]
async fn a_device_that_sends_by_itself_gets_no_request() {
    let (mut wire, mut peer) = wire();
    let texts = texts("?\r", &["{number}"]);
    let sends = async {
        for _ in 0..400 {
            if peer.write_all(b"+1.0\r").await.is_err() {
                return;
            }
            sleep(Duration::from_millis(5)).await;
        }
    };
    let found = tokio::select! {
        found = read(&mut wire, &texts) => found,
        () = sends => panic!("the read has no end"),
    };
    assert_eq!(found, Err(Fault::UNASKED));
}

#[tokio::test(start_paused = true)]
async fn a_read_ends_within_its_time_whatever_arrives() {
    for piece in [&b"1"[..], b"\r", b"+1.0 in\r", b"\0"] {
        for request in ["", "?\r"] {
            let (mut wire, mut peer) = wire();
            let texts = texts(request, &["{number} mm"]);
            let sends = async {
                while peer.write_all(piece).await.is_ok() {
                    sleep(Duration::from_millis(1)).await;
                }
                std::future::pending::<()>().await;
            };
            let found = tokio::select! {
                found = tokio::time::timeout(LONG, read(&mut wire, &texts)) => found.unwrap(),
                () = sends => panic!("pending"),
            };
            assert!(found.is_err(), "{piece:?} after {request:?}: {found:?}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_closed_connection_is_a_fault_of_the_link() {
    let (mut wire, peer) = wire();
    drop(peer);
    for request in ["", "?\r"] {
        assert_eq!(read(&mut wire, &texts(request, &["{number}"])).await, Err(Fault::CLOSED));
    }
    let (mut wire, _peer) = self::wire();
    let register = isotherm_core::codec::Register { table: isotherm_core::codec::Table::Input, offset: 0 };
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    let refused = Wire::exchange(&mut wire, 0, Request::read_registers(register, 1), &mut send_guard).await;
    assert_eq!(refused, Err(Fault::Caller(CallerFault::Function)));
}
