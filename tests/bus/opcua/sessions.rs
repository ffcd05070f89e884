//! Tests of sessions that are lost, resumed or refused.

use std::time::Duration;

use super::rig::{Line, SHORTLY, Server, no_session};
use isotherm::fieldbus::error::{Fault, Outcome};
use isotherm::fieldbus::explain::explain;
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;
use isotherm::fieldbus::wire::Answer;
use isotherm_core::reading::Status;

#[tokio::test]
async fn a_server_that_was_killed_and_is_back_is_read_and_written_again() {
    let server = Server::start(&[]);
    let mut line = Line::to(&server);
    assert!(line.signals().await.is_ok());
    assert_eq!(line.exchanges(), 0, "the first connection follows none");
    let mut server = server.dies(&[]);
    server.does("value bed 31");
    assert_eq!(line.signals().await, Ok([Ok(31.0), Ok(100.0)]));
    assert!(line.exchanges() > 0, "it does not know the session");
    assert_eq!(line.writes(4).await, Ok(Answer::Done));
    assert_eq!(server.does("read offset"), "4");
}

#[tokio::test]
async fn a_write_whose_answer_comes_too_late_is_unknown_and_what_follows_gets_answers_of_its_own() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    assert!(line.signals().await.is_ok());
    server.does("hold offset 7");
    let fault = line.writes(9).await.unwrap_err();
    assert_eq!((fault, fault.outcome()), (Fault::Timeout, Outcome::Unknown));
    tokio::time::sleep(Duration::from_secs(4)).await;
    assert_eq!(line.stands().await, Ok(9));
    assert_eq!(line.exchanges(), 0, "the server knows the session");
}

#[tokio::test]
async fn a_server_that_has_ended_the_session_may_be_another_one() {
    let mut server = Server::start(&[]);
    let mut line = Line::to(&server);
    assert!(line.signals().await.is_ok());
    server.does("drop");
    let mut answered = line.signals().await;
    for _ in 0..100 {
        if answered.is_ok() {
            break;
        }
        tokio::time::sleep(SHORTLY).await;
        answered = line.signals().await;
    }
    assert!(answered.is_ok(), "{answered:?}");
    assert!(line.exchanges() > 0);
}

#[tokio::test]
async fn a_full_session_table_is_told_with_what_to_do_and_is_over_when_a_place_is_free() {
    let mut server = Server::start(&[]);
    server.does("sessions 0");
    let mut line = Line::to(&server);
    let fault = line.signals().await.unwrap_err();
    assert_eq!(fault, no_session(OpcUaFault::NoSession));
    let said = explain(fault);
    assert!(said.contains("the server has no free session; close another client"), "{said}");
    server.does("sessions 1");
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}

/// Starts a peer that answers the messages of each connection with these, and then closes it. Returns its port.
fn peer(answers: Vec<Vec<u8>>) -> u16 {
    use std::io::{Read, Write};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let (mut stream, mut asked) = (stream.unwrap(), [0; 65_536]);
            for answer in &answers {
                let talked = stream.read(&mut asked).and_then(|_| stream.write_all(answer));
                if talked.is_err() {
                    break;
                }
            }
        }
    });
    port
}

fn message(kind: &[u8], body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(8 + body.len()).unwrap();
    [kind, &length.to_le_bytes(), body].concat()
}

fn error(status: u32) -> Vec<u8> {
    message(b"ERRF", &[status.to_le_bytes(), (-1_i32).to_le_bytes()].concat())
}

#[tokio::test]
async fn a_server_that_refuses_a_channel_speaks_opc_ua_and_its_reason_is_reported() {
    let numbers = [0u32, 65_535, 65_535, 0, 0].map(u32::to_le_bytes).concat();
    let welcome = || message(b"ACKF", &numbers);
    let cases = [
        (vec![error(0x8081_0000)], OpcUaFault::NoChannel, "close another client"),
        (vec![error(0x807d_0000)], OpcUaFault::NoChannel, "close another client"),
        (vec![welcome(), error(0x8081_0000)], OpcUaFault::NoChannel, "close another client"),
        (vec![welcome(), error(0x8055_0000)], OpcUaFault::NoList, "discovery"),
        (vec![welcome(), Vec::new()], OpcUaFault::NotOpened, "no free channel"),
        (vec![Vec::new()], OpcUaFault::NoAnswer, "no free channel"),
        (vec![error(0x8083_0000)], OpcUaFault::Refused(Status(0x8083_0000)), "BadTcpEndpointUrlInvalid"),
    ];
    for (answers, why, words) in cases {
        let directory = tempfile::tempdir().unwrap();
        let port = peer(answers);
        let mut line = Line::new(super::rig::profile(&super::rig::machine(port, ""), directory.path()));
        let fault = line.signals().await.unwrap_err();
        assert_eq!(fault, no_session(why));
        let said = explain(fault);
        assert!(said.contains(words) && !said.contains("does not speak"), "{said}");
    }
}

#[tokio::test]
async fn whoever_does_not_speak_opc_ua_is_told_so() {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    tokio::spawn(async move {
        use tokio::io::AsyncWriteExt;
        while let Ok((mut stream, _)) = listener.accept().await {
            let _ = stream.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n").await;
        }
    });
    let directory = tempfile::tempdir().unwrap();
    let mut line = Line::new(super::rig::profile(&super::rig::machine(port, ""), directory.path()));
    assert_eq!(line.signals().await, Err(no_session(OpcUaFault::NoServer)));
}
