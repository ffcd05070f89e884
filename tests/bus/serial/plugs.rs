//! Tests of ports that disappear and return, of adapters that hang, and of lines that are never silent.

use std::sync::Arc;
use std::time::{Duration, Instant};

use isotherm::fieldbus::error::{Fault, LinkFault, PeerFault};
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::wire::Answer;
use isotherm_profile::{DeviceId, Transport};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpListener;
use tokio::sync::Notify;

use crate::serial::port::{Exchanges, Plug, answer, asked, bus, line, read, serial, word};

/// Timeout. A line first listens to its port for a few timeouts. A busy computer may be late once: see [`until_good`].
const TIMEOUT: Duration = Duration::from_millis(400);
const UNIT: DeviceId = DeviceId(0);
/// Shortest first pause of a port that could not be opened.
const PAUSE: Duration = Duration::from_millis(750);

fn good() -> Result<Answer, Fault> {
    Ok(Answer::Registers(vec![word(1, 7)]))
}

/// Answers every request.
fn alive(plug: &Arc<Plug>) -> tokio::task::JoinHandle<()> {
    let plug = plug.clone();
    tokio::spawn(async move {
        loop {
            let question = plug.asked().await;
            plug.say(&answer(question));
        }
    })
}

/// Sends a request every 20 ms until the answer is good. Returns the time that this took, and the faults before.
async fn until_good(line: &mut DeviceLine) -> (Duration, Vec<Fault>) {
    let (begun, mut faults) = (Instant::now(), Vec::new());
    loop {
        match asked(line, UNIT, read(7, 1)).await {
            Ok(answer) => {
                assert_eq!(Ok(answer), good());
                return (begun.elapsed(), faults);
            }
            Err(fault) if faults.last() != Some(&fault) => faults.push(fault),
            Err(_) => {}
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{faults:?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Sends requests until the line closes the port, because answers are missing or wrong.
async fn until_closed(line: &mut DeviceLine, plug: &Plug) {
    let begun = Instant::now();
    loop {
        let answer = asked(line, UNIT, read(7, 1)).await;
        let is_miss = matches!(answer, Err(Fault::Timeout | Fault::Peer(PeerFault::Malformed)));
        assert!(is_miss, "{answer:?}");
        if !line.is_connected() {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(60));
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(!plug.is_open());
}

#[tokio::test]
async fn an_adapter_that_is_unplugged_and_comes_back_under_its_name_is_found_again_within_the_backoff() {
    let home = tempfile::tempdir().unwrap();
    let name = home.path().join("usb-adapter");
    let first = Arc::new(Plug::new());
    first.under(&name);
    let speaks = alive(&first);
    let exchanges = Exchanges::default();
    let line = line(&bus(serial(115_200), name.to_str().unwrap(), TIMEOUT), 1);
    let mut line = line.witnessed(Arc::new(exchanges.clone()));
    until_good(&mut line).await;
    assert!(!exchanges.said().contains(&None));

    speaks.abort();
    let _ = speaks.await;
    std::fs::remove_file(&name).unwrap();
    drop(first);
    let failed = Instant::now();
    let gone = asked(&mut line, UNIT, read(7, 1)).await;
    assert_eq!(gone, Err(Fault::Link(LinkFault::Absent)), "at once, by its name");
    assert!(exchanges.said().contains(&None), "each device on it may be another one when it is back");
    let again = asked(&mut line, UNIT, read(7, 1)).await;
    // On a busy computer the pause may be over, and the line tries again.
    let is_over = failed.elapsed() >= PAUSE && again == Err(Fault::Link(LinkFault::Absent));
    assert!(is_over || again == Err(Fault::Link(LinkFault::Down)), "{again:?}");
    tokio::time::sleep(Duration::from_millis(300)).await;

    let second = Arc::new(Plug::new());
    second.under(&name);
    let speaks = alive(&second);
    let (took, faults) = until_good(&mut line).await;
    println!("back {took:?} after it was plugged in again, {faults:?}");
    speaks.abort();
}

#[tokio::test]
async fn an_adapter_that_has_lost_itself_is_opened_anew_under_its_name_after_the_second_miss() {
    let home = tempfile::tempdir().unwrap();
    let name = home.path().join("usb-adapter");
    let (mute, new) = (Arc::new(Plug::new()), Arc::new(Plug::new()));
    mute.under(&name);
    let exchanges = Exchanges::default();
    let line = line(&bus(serial(115_200), name.to_str().unwrap(), TIMEOUT), 1);
    let mut line = line.witnessed(Arc::new(exchanges.clone()));
    assert_eq!(asked(&mut line, UNIT, read(7, 1)).await, Err(Fault::Timeout));
    assert_eq!(exchanges.said(), [], "one answer was lost");
    // The name points to the new port. The old port is open and silent.
    new.under(&name);
    let speaks = alive(&new);
    let (took, faults) = until_good(&mut line).await;
    println!("good {took:?} after the first miss");
    assert_eq!(faults, [Fault::Timeout]);
    assert_eq!(exchanges.said(), [None], "each device on it may be another one");
    speaks.abort();
}

#[tokio::test]
async fn a_port_that_is_opened_again_after_lost_or_garbled_answers_is_the_same_one() {
    /// Wrong answers: none, and bytes that are no frame.
    const GARBAGE: [&[u8]; 2] = [&[], &[0x55; 9]];
    for garbage in GARBAGE {
        let plug = Arc::new(Plug::new());
        let exchanges = Exchanges::default();
        let line = line(&bus(serial(115_200), plug.path.to_str().unwrap(), TIMEOUT), 1);
        let mut line = line.witnessed(Arc::new(exchanges.clone()));
        let device = plug.clone();
        let garbles = tokio::spawn(async move {
            loop {
                device.asked().await;
                device.say(garbage);
            }
        });
        until_closed(&mut line, &plug).await;
        garbles.abort();
        let _ = garbles.await;
        let speaks = alive(&plug);
        until_good(&mut line).await;
        assert_eq!(exchanges.said(), [], "no device can be another one after {garbage:x?}");
        speaks.abort();
    }
}

#[tokio::test]
async fn an_adapter_that_takes_the_name_of_another_while_the_port_is_closed_is_another_one() {
    let home = tempfile::tempdir().unwrap();
    let name = home.path().join("usb-adapter");
    let first = Arc::new(Plug::new());
    first.under(&name);
    let exchanges = Exchanges::default();
    let line = line(&bus(serial(115_200), name.to_str().unwrap(), TIMEOUT), 1);
    let mut line = line.witnessed(Arc::new(exchanges.clone()));
    until_closed(&mut line, &first).await;
    assert_eq!(exchanges.said(), []);
    // If the second pseudo-terminal gets the number of the first, only the time of its creation differs.
    let path = first.path.clone();
    drop(first);
    let second = Arc::new(Plug::new());
    second.under(&name);
    println!("first {}, then {}", path.display(), second.path.display());
    let speaks = alive(&second);
    until_good(&mut line).await;
    assert_eq!(exchanges.said(), [None]);
    speaks.abort();
}

#[tokio::test]
async fn an_adapter_that_is_exchanged_between_two_questions_is_another_one() {
    let home = tempfile::tempdir().unwrap();
    let name = home.path().join("usb-adapter");
    let first = Arc::new(Plug::new());
    first.under(&name);
    let speaks = alive(&first);
    let exchanges = Exchanges::default();
    let line = line(&bus(serial(115_200), name.to_str().unwrap(), TIMEOUT), 1);
    let mut line = line.witnessed(Arc::new(exchanges.clone()));
    until_good(&mut line).await;
    assert!(!exchanges.said().contains(&None));
    speaks.abort();
    let _ = speaks.await;
    drop(first);
    let second = Arc::new(Plug::new());
    second.under(&name);
    let speaks = alive(&second);
    until_good(&mut line).await;
    assert!(exchanges.said().contains(&None));
    speaks.abort();
}

#[tokio::test]
async fn a_path_that_is_no_port_and_one_that_is_not_there_are_told_apart() {
    let home = tempfile::tempdir().unwrap();
    let nowhere = home.path().join("nowhere");
    let file = home.path().join("file");
    std::fs::write(&file, "").unwrap();
    for (path, fault) in [(nowhere, LinkFault::Absent), (file, LinkFault::Unsuited)] {
        let mut line = line(&bus(serial(9600), path.to_str().unwrap(), TIMEOUT), 1);
        assert_eq!(asked(&mut line, UNIT, read(7, 1)).await, Err(Fault::Link(fault)));
    }
}

#[tokio::test]
async fn a_port_is_one_program_s_alone_and_free_again_when_that_has_ended() {
    let plug = Arc::new(Plug::new());
    let bus = bus(serial(115_200), plug.path.to_str().unwrap(), TIMEOUT);
    let speaks = alive(&plug);
    let (mut first, mut second) = (line(&bus, 1), line(&bus, 1));
    until_good(&mut first).await;
    assert_eq!(asked(&mut second, UNIT, read(7, 1)).await, Err(Fault::Link(LinkFault::Busy)));
    drop(first);
    let (_, faults) = until_good(&mut second).await;
    // On a busy computer the pause may already be over, and an answer may be lost.
    let may = [Fault::Link(LinkFault::Down), Fault::Timeout];
    assert!(faults.iter().all(|fault| may.contains(fault)), "{faults:?}");
    speaks.abort();
}

#[tokio::test]
async fn what_a_device_still_says_to_a_gateway_that_was_killed_is_not_the_next_one_s_answer() {
    let plug = Arc::new(Plug::new());
    let bus = bus(serial(115_200), plug.path.to_str().unwrap(), 2 * TIMEOUT);
    let mut killed = line(&bus, 1);
    let (is_asked, is_killed) = (Notify::new(), Notify::new());
    let device = async {
        let old = plug.asked().await;
        is_asked.notify_one();
        is_killed.notified().await;
        while !plug.is_open() {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        // The next gateway has opened the port, and waits for late answers.
        tokio::time::sleep(Duration::from_millis(30)).await;
        plug.say(&answer(old));
        loop {
            let new = plug.asked().await;
            plug.say(&answer(new));
        }
    };
    let gateways = async {
        tokio::select! {
            answered = asked(&mut killed, UNIT, read(3, 1)) => panic!("{answered:?} before it was killed"),
            () = is_asked.notified() => {}
        }
        drop(killed);
        is_killed.notify_one();
        let mut next = line(&bus, 1);
        until_good(&mut next).await;
    };
    tokio::select! {
        never = device => never,
        () = gateways => {}
    }
}

#[tokio::test]
async fn silence_of_three_and_a_half_characters_is_before_every_request_at_9600_baud() {
    let plug = Arc::new(Plug::new());
    let mut line = line(&bus(serial(9600), plug.path.to_str().unwrap(), TIMEOUT), 1);
    let device = async {
        let mut pauses = Vec::new();
        let mut answered: Option<Instant> = None;
        for _ in 0..20 {
            let question = plug.asked().await;
            pauses.extend(answered.map(|answered| answered.elapsed()));
            plug.say(&answer(question));
            answered = Some(Instant::now());
        }
        pauses
    };
    let asks = async {
        loop {
            until_good(&mut line).await;
        }
    };
    let pauses = tokio::select! {
        pauses = device => pauses,
        never = asks => never,
    };
    let shortest = pauses.iter().min().unwrap();
    assert_eq!(pauses.len(), 19);
    assert!(*shortest >= Duration::from_micros(4010), "{pauses:?}");
}

#[tokio::test]
async fn pauses_and_a_port_that_is_closed_after_each_answer_are_kept_on_a_serial_line() {
    let plug = Arc::new(Plug::new());
    let mut bus = bus(serial(115_200), plug.path.to_str().unwrap(), TIMEOUT);
    bus.quirks.pause_after_connect = Duration::from_millis(40);
    bus.quirks.close_after_each = true;
    let mut line = line(&bus, 1);
    let speaks = alive(&plug);
    let begun = Instant::now();
    for _ in 0..3 {
        until_good(&mut line).await;
        assert!(line.is_connected(), "closed by us is not down");
    }
    assert!(begun.elapsed() >= Duration::from_millis(120), "{:?}", begun.elapsed());
    speaks.abort();
}

#[tokio::test]
async fn a_server_that_never_stops_talking_costs_its_timeout_and_nobody_else_s_turn() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    // Sends from a separate thread, as fast as the socket accepts it.
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async move {
            let listener = TcpListener::from_std(listener.into_std().unwrap()).unwrap();
            while let Ok((mut stream, _)) = listener.accept().await {
                let noise: Vec<u8> = (0..=255).cycle().take(64 * 1024).collect();
                while stream.write_all(&noise).await.is_ok() {}
            }
        });
    });
    let mut line = line(&bus(Transport::RtuOverTcp, &address, TIMEOUT), 1);
    let begun = Instant::now();
    for _ in 0..3 {
        // Counts turns, not time: a busy computer delays both tasks alike.
        let mut turns = 0;
        // Skip the back-off.
        line.revive(None);
        let others = async {
            loop {
                turns += 1;
                tokio::task::yield_now().await;
            }
        };
        let answer = tokio::select! {
            answer = asked(&mut line, UNIT, read(7, 1)) => answer,
            never = others => never,
        };
        assert!(matches!(answer, Err(Fault::Peer(_))), "{answer:?}");
        assert!(turns > 10, "{turns} turns of others during a question");
    }
    // Three timeouts are 1.2 s. Without a limit, a request would never end.
    let took = begun.elapsed();
    assert!(took < Duration::from_secs(60), "{took:?}");
}
