//! Tests of a hostile peer at the server's address: a panic of the library is a fault of that line only. Also tests of
//! the ways in which a server asks for a password.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::thread;

use super::rig::{Line, Server, machine, no_session, profile, with_many};
use super::secured::{certificates, secured, serve};
use isotherm::fieldbus::error::{Fault, PeerFault};
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;

/// Starts a peer that answers the first message like a server, and the second with these bytes. Returns its port.
fn answers(second: Vec<u8>) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut asked = [0; 65_536];
            let numbers: Vec<u8> =
                [28u32, 0, 65_536, 65_536, 0, 0].into_iter().flat_map(u32::to_le_bytes).collect();
            let welcome = [b"ACKF".to_vec(), numbers].concat();
            let mut talk = |stream: &mut TcpStream| {
                let _hello = stream.read(&mut asked)?;
                stream.write_all(&welcome)?;
                let _channel = stream.read(&mut asked)?;
                stream.write_all(&second)?;
                stream.read(&mut asked)
            };
            let _ = talk(&mut stream);
        }
    });
    port
}

fn chunk(kind: &[u8], body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(8 + body.len()).unwrap();
    [kind, &length.to_le_bytes(), body].concat()
}

fn field(bytes: &[u8]) -> Vec<u8> {
    [&u32::try_from(bytes.len()).unwrap().to_le_bytes(), bytes].concat()
}

/// Returns a message that opens a channel. It is secured for a certificate that the gateway has not sent.
fn opened_for_somebody(directory: &Path) -> Vec<u8> {
    let policy = field(b"http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256");
    let cert = field(&std::fs::read(directory.join("server.der")).unwrap());
    let body = [vec![1, 0, 0, 0], policy, cert, field(&[0; 20]), vec![7; 256]].concat();
    chunk(b"OPNF", &body)
}

#[tokio::test]
async fn what_the_library_panics_at_is_no_opc_ua_and_the_gateway_goes_on() {
    let directory = certificates();
    for second in [opened_for_somebody(directory.path()), b"OPNF\xff\xff\xff\xff".repeat(1000)] {
        let port = answers(second);
        for bus in [String::new(), secured("sign-and-encrypt", "own", "")] {
            let mut line = Line::new(profile(&machine(port, &bus), directory.path()));
            for _ in 0..2 {
                assert_eq!(line.signals().await, Err(no_session(OpcUaFault::NoServer)));
            }
        }
    }
}

/// Starts a proxy to this port, and returns its own port. Once `is_told` is set, messages of the server are cut to 16
/// bytes.
fn between(server: u16, is_told: std::sync::Arc<std::sync::atomic::AtomicBool>) -> u16 {
    use std::sync::atomic::Ordering;
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        for stream in listener.incoming() {
            let (here, there) = (stream.unwrap(), TcpStream::connect(("127.0.0.1", server)).unwrap());
            let (mut from, mut to) = (here.try_clone().unwrap(), there.try_clone().unwrap());
            thread::spawn(move || std::io::copy(&mut from, &mut to));
            let (mut from, mut to, is_told) = (there, here, is_told.clone());
            thread::spawn(move || {
                let mut bytes = [0; 65_536];
                while let Ok(count @ 1..) = from.read(&mut bytes) {
                    let cut = chunk(b"MSGF", &bytes[8..16]);
                    let is_cut = is_told.load(Ordering::SeqCst) && bytes.starts_with(b"MSG");
                    if to.write_all(if is_cut { &cut } else { &bytes[..count] }).is_err() {
                        return;
                    }
                }
            });
        }
    });
    port
}

#[tokio::test]
async fn a_message_that_is_cut_on_an_encrypted_channel_is_a_fault_and_the_next_connection_is_right() {
    use std::sync::atomic::Ordering;
    let directory = certificates();
    let server = serve(directory.path(), "server", &[]);
    let is_told = std::sync::Arc::new(std::sync::atomic::AtomicBool::default());
    let port = between(server.port, is_told.clone());
    let text = machine(port, &secured("sign-and-encrypt", "own", ""));
    let mut line = Line::new(profile(&text, directory.path()));
    assert!(line.signals().await.is_ok());
    is_told.store(true, Ordering::SeqCst);
    let fault = line.signals().await.unwrap_err();
    assert!(matches!(fault, Fault::Peer(PeerFault::Malformed) | Fault::Link(_)), "{fault}");
    is_told.store(false, Ordering::SeqCst);
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}

#[tokio::test]
async fn more_nodes_than_the_library_takes_by_itself_are_read() {
    let server = Server::start(&["--many", "1200"]);
    let text = with_many(&machine(server.port, ""), 1200);
    let directory = tempfile::tempdir().unwrap();
    let mut line = Line::new(profile(&text, directory.path()));
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}
