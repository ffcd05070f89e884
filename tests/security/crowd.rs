//! More connections than the page accepts, and connections that do nothing.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use isotherm::clock::BootClock;
use isotherm::observe::http::{Admission, HttpListener, Limits, serve};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};

use crate::fake::Fake;
use crate::on_time::OnTime;
use crate::rig::Machine;

const PATIENCE: Duration = Duration::from_secs(60);

/// Starts the page of a fake machine, with these limits.
async fn page(limits: Limits) -> SocketAddr {
    page_of(Arc::default(), limits).await
}

async fn page_of(fake: Arc<Fake>, limits: Limits) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let door = HttpListener::from(listener).within(limits);
    let admission = Admission { commands: isotherm_profile::Commands::Local, ..Admission::default() };
    tokio::spawn(serve(door, fake, admission, std::future::pending()));
    address
}

/// Starts the page of a compensated machine, as every gateway has it.
fn machine() -> (Machine, OnTime, SocketAddr) {
    let mut machine = Machine::start(None, &[], "[web]\nlisten = \"127.0.0.1:0\"\ncommands = \"local\"\n");
    let page = machine.page();
    let on_time = machine.on_time();
    (machine, on_time, page)
}

/// Connects from 127.0.0.`from`.
async fn from(from: u8, page: SocketAddr) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(([127, 0, 0, from], 0).into()).unwrap();
    socket.connect(page).await.unwrap()
}

/// Sends a request on a connection that stays open. Returns the answer; empty if the connection was closed.
async fn asks(stream: &mut TcpStream, page: SocketAddr, path: &str) -> String {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {page}\r\n\r\n");
    let mut answer = [0; 64 * 1024];
    let read = async {
        stream.write_all(request.as_bytes()).await?;
        stream.read(&mut answer).await
    };
    let count = tokio::time::timeout(PATIENCE, read).await.expect("no answer").unwrap_or(0);
    String::from_utf8_lossy(&answer[..count]).into_owned()
}

async fn is_in(stream: &mut TcpStream, page: SocketAddr) -> bool {
    asks(stream, page, "/healthz").await.starts_with("HTTP/1.1 200")
}

/// Reads until the page closes the connection.
async fn ended(stream: &mut TcpStream) -> String {
    let mut said = Vec::new();
    let read = tokio::time::timeout(PATIENCE, stream.read_to_end(&mut said)).await;
    assert!(read.is_ok(), "it is still open");
    String::from_utf8_lossy(&said).into_owned()
}

#[tokio::test]
async fn sixteen_of_one_address_come_in_and_sixty_four_of_all() {
    let (_machine, _on_time, page) = machine();
    let mut inside = Vec::new();
    for address in 1..=4 {
        for count in 0..20 {
            let mut stream = from(address, page).await;
            let comes_in = is_in(&mut stream, page).await;
            assert_eq!(comes_in, count < 16, "127.0.0.{address}, number {count}");
            if comes_in {
                inside.push(stream);
            }
        }
    }
    assert_eq!(inside.len(), 64);
    let mut late = from(5, page).await;
    assert!(!is_in(&mut late, page).await);
    // A closed connection makes room for another one.
    inside.pop();
    let mut waited = Duration::ZERO;
    while !is_in(&mut from(5, page).await, page).await {
        assert!(waited < PATIENCE, "nobody comes in any more");
        tokio::time::sleep(Duration::from_millis(50)).await;
        waited += Duration::from_millis(50);
    }
}

#[tokio::test]
async fn whoever_comes_too_late_is_told_why() {
    let page = page(Limits::of(2)).await;
    let mut inside = [from(1, page).await, from(2, page).await];
    for stream in &mut inside {
        assert!(is_in(stream, page).await);
    }
    let said = ended(&mut from(3, page).await).await;
    assert!(said.starts_with("HTTP/1.1 503") && said.contains("too many connections"), "{said}");
}

/// Sends one byte of this text each second, as long as the page accepts it.
async fn drips(stream: &mut TcpStream, text: &str) -> String {
    let (mut reader, mut writer) = stream.split();
    let mut said = Vec::new();
    let dripping = async {
        for byte in text.bytes() {
            if writer.write_all(&[byte]).await.is_err() {
                break;
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
        std::future::pending().await
    };
    tokio::select! {
        read = tokio::time::timeout(PATIENCE, reader.read_to_end(&mut said)) => drop(read.expect("it is still open")),
        () = dripping => {}
    }
    String::from_utf8_lossy(&said).into_owned()
}

#[tokio::test]
async fn a_head_and_a_body_have_ten_seconds_each_however_they_drip() {
    let (_machine, _on_time, page) = machine();
    let begun = BootClock::default().passed();
    let took = || BootClock::default().passed() - begun;
    let silent = async {
        let said = ended(&mut from(1, page).await).await;
        (said, took())
    };
    let slow_head = async {
        let text = format!("GET / HTTP/1.1\r\nHost: {page}\r\nX-More: {}", "x".repeat(100));
        let said = drips(&mut from(1, page).await, &text).await;
        (said, took())
    };
    let slow_body = async {
        let mut stream = from(1, page).await;
        let head = format!("POST /api/disarm HTTP/1.1\r\nHost: {page}\r\nContent-Length: 900\r\n\r\n");
        stream.write_all(head.as_bytes()).await.unwrap();
        let said = drips(&mut stream, &"x".repeat(100)).await;
        (said, took())
    };
    let (silent, head, body) = tokio::join!(silent, slow_head, slow_body);
    for (what, (said, took)) in [("silent", silent), ("head", head), ("body", body)] {
        assert!(took >= Duration::from_secs(9), "{what}: {took:?}");
        let words = if what == "body" { "did not arrive within 10 s" } else { "" };
        assert!(said.contains(words) && (what == "body" || said.is_empty()), "{what}: {said}");
        println!("{what}: closed after {took:?}");
    }
}

#[tokio::test]
async fn whoever_asks_on_stays_and_whoever_is_idle_is_let_go() {
    let limits = Limits { idle: Duration::from_secs(5), head: PATIENCE, ..Limits::default() };
    let page = page(limits).await;
    let mut stream = from(1, page).await;
    let begun = BootClock::default().passed();
    while BootClock::default().passed() - begun < Duration::from_secs(10) {
        assert!(is_in(&mut stream, page).await);
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert_eq!(ended(&mut stream).await, "");
}

#[tokio::test]
async fn the_thirty_third_who_watches_is_refused_with_a_sentence() {
    let (_machine, _on_time, page) = machine();
    let mut watching = Vec::new();
    for place in 0..32 {
        let mut stream = from(1 + place / 16, page).await;
        let said = asks(&mut stream, page, "/api/live").await;
        assert!(said.contains("text/event-stream"), "{place}: {said}");
        watching.push(stream);
    }
    let mut one_more = from(9, page).await;
    let said = asks(&mut one_more, page, "/api/live").await;
    assert!(said.starts_with("HTTP/1.1 503") && said.contains("/api/status"), "{said}");
    assert!(is_in(&mut one_more, page).await, "what is no stream is answered");
    drop(watching);
    let mut waited = Duration::ZERO;
    while !asks(&mut from(9, page).await, page, "/api/live").await.contains("text/event-stream") {
        assert!(waited < PATIENCE, "nobody watches any more");
        tokio::time::sleep(Duration::from_millis(100)).await;
        waited += Duration::from_millis(100);
    }
}

#[tokio::test]
async fn a_reader_who_takes_nothing_gives_his_place_back() {
    let soon = Duration::from_secs(2);
    let limits = Limits { connections: 1, of_one_address: 1, stall: soon, idle: soon, ..Limits::default() };
    let page = page(limits).await;
    let mut greedy = from(1, page).await;
    let all = format!("GET /api/status HTTP/1.1\r\nHost: {page}\r\n\r\n").repeat(20_000);
    // The page stops accepting requests when the client does not read its answers.
    let _ = tokio::time::timeout(Duration::from_secs(1), greedy.write_all(all.as_bytes())).await;
    let mut waited = Duration::ZERO;
    while !is_in(&mut from(2, page).await, page).await {
        assert!(waited < PATIENCE, "he still has it");
        tokio::time::sleep(Duration::from_millis(100)).await;
        waited += Duration::from_millis(100);
    }
}

#[tokio::test]
async fn a_disk_that_hangs_keeps_nobody_else_from_the_page() {
    let fake = Arc::<Fake>::default();
    let page = page_of(fake.clone(), Limits::default()).await;
    let (resumes, waits) = std::sync::mpsc::channel::<()>();
    let (hangs, is_hanging) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let _disk = fake.disk.lock();
        hangs.send(()).unwrap();
        let _ = waits.recv();
    });
    is_hanging.recv().unwrap();
    let mut hanging = Vec::new();
    for path in ["/api/history", "/api/history.csv", "/api/events"] {
        let mut stream = from(1, page).await;
        let request = format!("GET {path} HTTP/1.1\r\nHost: {page}\r\n\r\n");
        stream.write_all(request.as_bytes()).await.unwrap();
        hanging.push(stream);
        assert!(is_in(&mut from(2, page).await, page).await, "{path}");
    }
    for path in ["/api/history", "/api/history.csv", "/api/events"] {
        let said = asks(&mut from(2, page).await, page, path).await;
        assert!(said.starts_with("HTTP/1.1 503") && said.contains("try again in a moment"), "{path}: {said}");
    }
    drop(resumes);
    let said = asks(&mut from(2, page).await, page, "/api/events").await;
    assert!(said.starts_with("HTTP/1.1 200"), "{said}");
}
