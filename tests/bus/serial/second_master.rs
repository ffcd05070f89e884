//! Tests of a second client of a serial server that sends every answer to all its clients.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::line::Attribution;
use isotherm::fieldbus::wire::Answer;
use isotherm::gateway::{Gateway, Options};
use isotherm_core::codec::checksum;
use isotherm_profile::{DeviceId, parse};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::Instant;

use crate::serial::port::{answer, bus, line, read, word};
use crate::support::frames::{Frames, Received};

/// Unit, function, first register, count.
type Question = (u8, u8, u16, u16);

/// Read of the other master: one register of the same unit with the same function.
const OTHERS: Question = (1, 3, 300, 1);
/// Time of a request and its answer on the serial line.
const EXCHANGE: Duration = Duration::from_millis(10);
const TIMEOUT: Duration = Duration::from_millis(40);
/// Intervals between the requests of the other master, in milliseconds. The gateway needs gaps to send its own.
const PAUSES: std::ops::Range<u64> = 60..140;

/// Delay of an answer after which the gateway need not wait for it: a busy computer held the server of the test.
const HELD: Duration = Duration::from_millis(5);

/// Number of wrong answers that may be taken for the gateway's before it has detected the other master. After each of
/// them the gateway receives its own answer without a request, and two such answers show another master.
const BEFORE_DETECTION: u32 = 2;

/// The other master, as the test and the server see it.
#[derive(Default)]
struct Other {
    is_there: AtomicBool,
    /// Number of answers that were sent later than [`HELD`] after their time.
    late: AtomicU32,
}

/// Serves one serial line to two masters, one request at a time. Each answer is sent to the gateway's connection. The
/// other master sends requests at random times while `is_there` is set.
async fn serves(frames: Frames, mut stream: TcpStream, seed: u64, other: Arc<Other>) {
    stream.set_nodelay(true).unwrap();
    let mut random = Pcg32::seed_from_u64(seed);
    let mut asked: VecDeque<Question> = VecDeque::new();
    let mut received = Received::new(frames);
    let mut done = Instant::now();
    let mut other_asks = Instant::now();
    loop {
        let mut bytes = [0; 256];
        let before = asked.len();
        tokio::select! {
            count = stream.read(&mut bytes) => match count {
                Ok(count) if count > 0 => received.push(&bytes[..count]),
                _ => return,
            },
            () = tokio::time::sleep_until(done), if !asked.is_empty() => {
                other.late.fetch_add(u32::from(done.elapsed() > HELD), Ordering::SeqCst);
                if let Some(question) = asked.pop_front()
                    && stream.write_all(&frames.encode(answer(question))).await.is_err()
                {
                    return;
                }
                done = Instant::now() + EXCHANGE;
            }
            () = tokio::time::sleep_until(other_asks) => {
                other_asks = Instant::now() + Duration::from_millis(random.random_range(PAUSES));
                if other.is_there.load(Ordering::SeqCst) {
                    asked.push_back(OTHERS);
                }
            }
        }
        while let Some(frame) = received.bytes.get(..8) {
            assert_eq!(checksum(&frame[..6]).to_le_bytes(), frame[6..8], "{frame:x?}");
            let word = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
            asked.push_back((frame[0], frame[1], word(2), word(4)));
            received.bytes.drain(..8);
        }
        if before == 0 && !asked.is_empty() {
            done = Instant::now() + EXCHANGE;
        }
    }
}

/// Starts a server that serves one connection at a time. Returns its address.
async fn server(frames: Frames, seed: u64, other: &Arc<Other>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (address, other) = (listener.local_addr().unwrap().to_string(), other.clone());
    tokio::spawn(async move {
        for connection in 0.. {
            let (stream, _) = listener.accept().await.unwrap();
            serves(frames, stream, seed + connection, other.clone()).await;
        }
    });
    address
}

#[tokio::test]
async fn an_answer_that_may_be_the_other_master_s_is_marked_as_soon_as_that_was_noticed() {
    answers_of_the_other_master_are_marked(Frames::Rtu).await;
}

#[tokio::test]
async fn an_ascii_answer_that_may_be_the_other_master_s_is_marked_as_soon_as_that_was_noticed() {
    answers_of_the_other_master_are_marked(Frames::Ascii).await;
}

/// This test needs a few seconds, because the line has a fixed speed.
async fn answers_of_the_other_master_are_marked(frames: Frames) {
    let other = Arc::new(Other { is_there: AtomicBool::new(true), ..Other::default() });
    let bus = bus(frames.through_tcp(), &server(frames, 1, &other).await, TIMEOUT);
    let mut line = line(&bus, 1);
    let (mut right, mut wrong, mut contested, mut unmarked, mut mistaken, mut void) = (0, 0, 0, 0, 0, 0);
    for poll in 0..200_u16 {
        line.revive(None);
        let register = poll % 7;
        let late = other.late.load(Ordering::SeqCst);
        let Ok(answered) = line.request_unverified(DeviceId(0), read(register, 1)).await else { continue };
        tokio::time::sleep(2 * EXCHANGE + Duration::from_millis(u64::from(poll % 11))).await;
        if other.late.load(Ordering::SeqCst) != late {
            void += 1;
            continue;
        }
        let is_right = answered.answer == Answer::Registers(vec![word(1, register)]);
        right += u32::from(is_right);
        wrong += u32::from(!is_right);
        match answered.attribution {
            Attribution::Ours => unmarked += u32::from(!is_right),
            Attribution::Ambiguous => mistaken += u32::from(!is_right),
            Attribution::Contested => contested += 1,
        }
    }
    println!(
        "{right} right answers, {wrong} wrong; {contested} contested; {unmarked} wrong ones were taken for ours and \
         {mistaken} were not contested; {void} void, because the server was held"
    );
    assert!(wrong > 0 && right > 0, "the other master was never in between");
    assert!(unmarked <= BEFORE_DETECTION && mistaken == 0, "{unmarked} and {mistaken} of {wrong}");
    let (mut confirmed, mut mistaken) = (0, 0);
    for _ in 0..40 {
        line.revive(None);
        let Ok(answered) = line.read_confirmed(DeviceId(0), read(5, 1)).await else { continue };
        confirmed += 1;
        mistaken += u32::from(answered.answer != Answer::Registers(vec![word(1, 5)]));
    }
    println!("{confirmed} confirmed answers, {mistaken} of them wrong");
    assert!(confirmed > 0 && mistaken == 0, "{mistaken} of {confirmed}");
}

fn profile(frames: Frames, address: &str, limits: &str) -> isotherm_profile::Profile {
    let kind = frames.type_through_tcp();
    let mut text = format!(
        "[machine]\nname = \"cell\"\n[bus.cell]\ntype = \"{kind}\"\naddress = \"{address}\"\n\
         timeout = \"40ms\"\n[device.m]\nbus = \"cell\"\nunit = 1\nevery = \"100ms\"\n"
    );
    for (signal, register) in [("bed", 0), ("oil", 100)] {
        text += &format!(
            "[signal.{signal}]\ndevice = \"m\"\nregister = \"holding:{register}\"\ntype = \"u16\"\nscale = 0.01\n\
             unit = \"degC\"\n{limits}\n"
        );
    }
    parse(Path::new("cell.toml"), &text, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Returns the number of good samples, of wrong ones among them, and the reports about the line.
async fn watched(frames: Frames, limits: &str, seed: u64) -> (usize, usize, Vec<String>) {
    let other = Arc::new(Other::default());
    let profile = profile(frames, &server(frames, seed, &other).await, limits);
    let gateway = Gateway::new(profile, &Clock::wall(), Options::default());
    let source = gateway.source();
    let (mut good, mut wrong) = (0, 0);
    let watch = async {
        // Time for thirty good readings, so that the detection keeps the last one.
        tokio::time::sleep(Duration::from_secs(10)).await;
        other.is_there.store(true, Ordering::SeqCst);
        let is_reported = || source.status().events.iter().any(|event| event.kind == "bus-trouble");
        for look in 0..2400 {
            // On a busy computer, the line may need more than ten seconds to detect the other master.
            if look >= 200 && good > 100 && is_reported() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
            for signal in source.status().signals.iter().filter(|signal| signal.quality == "good") {
                let register = if signal.name == "bed" { 0 } else { 100 };
                let right = f64::from(word(1, register)) / 100.0;
                good += 1;
                wrong += usize::from(signal.value.is_none_or(|value| (value - right).abs() > 0.001));
            }
        }
    };
    gateway.run(watch, std::future::pending()).await;
    let events = source.status().events;
    let reported = events.into_iter().filter(|event| event.kind == "bus-trouble").map(|event| event.text);
    (good, wrong, reported.collect())
}

#[tokio::test]
async fn a_second_master_is_an_alarm_and_its_register_is_no_reading() {
    its_register_is_no_reading(Frames::Rtu).await;
}

#[tokio::test]
async fn a_second_master_with_modbus_ascii_is_an_alarm_and_its_register_is_no_reading() {
    its_register_is_no_reading(Frames::Ascii).await;
}

/// This test needs 21 s, because the line has a fixed speed.
async fn its_register_is_no_reading(frames: Frames) {
    // After a gap of `max_age`, 30 readings in a row would have to agree, and this other master asks too often for that.
    let runs = [11, 12, 13].map(|seed| watched(frames, "max_rate = 0.1\nmax_age = \"10s\"", seed));
    for run in futures_of(runs).await {
        let (good, wrong, reported) = run;
        println!("{good} good samples, {wrong} of the other master; {reported:?}");
        assert_eq!(wrong, 0, "{reported:?}");
        assert!(good > 100, "{good}");
        let last = reported.last().unwrap();
        assert!(last.contains("bus cell") && last.contains("another master is on the line"), "{last}");
        assert!(last.contains("bed, oil") && last.contains("only one master is allowed on a line"), "{last}");
        assert!(!last.contains("cannot be detected"), "{last}");
    }
    let (good, wrong, reported) = watched(frames, "max_age = \"2s\"", 14).await;
    println!("without max_rate: {good} good samples, {wrong} of the other master; {reported:?}");
    assert!(
        reported
            .last()
            .unwrap()
            .contains("two equal answers of the other master cannot be detected: bed, oil"),
        "{reported:?}"
    );
    // Until a second frame of the other master arrives, one of its answers may be accepted. That value is used for at
    // most `max_age`: 2 s of the 10 s of the test.
    assert!(100 * wrong <= 20 * good, "{wrong} of {good}");
}

async fn futures_of<F: Future>(all: [F; 3]) -> [F::Output; 3] {
    let [one, two, three] = all;
    let (one, two, three) = tokio::join!(one, two, three);
    [one, two, three]
}
