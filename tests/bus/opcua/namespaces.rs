//! Namespaces that a server numbers in another order after a restart.

use super::gateway::{beside, wait_until};
use super::held::bed;
use super::rig::{Line, SHORTLY, Server, machine, profile, subscribing};
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::wire::Answer;
use isotherm::gateway::Options;
use isotherm_core::reading::{Reason, Status};

/// The machine by the URI of its namespace.
fn by_uri(text: &str) -> String {
    text.replace("ns=2;", "nsu=urn:test;")
}

fn line(text: &str) -> Line {
    let directory = tempfile::tempdir().unwrap();
    Line::new(profile(&by_uri(text), directory.path()))
}

#[tokio::test]
async fn a_node_that_is_named_by_its_uri_is_found_at_whatever_index_the_server_has_it() {
    let text = |server: &Server, is_subscribed| match is_subscribed {
        true => subscribing(server.port),
        false => machine(server.port, ""),
    };
    for is_subscribed in [false, true] {
        let server = Server::start(&[]);
        let mut line = line(&text(&server, is_subscribed));
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
        // The namespace of another machine has its place now, and nodes with the same names.
        let mut server = server.dies(&["--before", "1"]);
        let mut read = 0;
        while read < 3 {
            // At first it is not there, or sends nothing yet.
            if let Ok(signals) = line.signals().await {
                assert_eq!(signals, [Ok(20.0), Ok(100.0)]);
                read += 1;
            }
            tokio::time::sleep(SHORTLY).await;
        }
        assert_eq!(line.writes(4).await, Ok(Answer::Done));
        assert_eq!((server.does("read offset").as_str(), server.does("other offset").as_str()), ("4", "0"));
    }
}

#[tokio::test]
async fn a_namespace_that_is_not_there_or_there_twice_has_no_nodes() {
    let unknown = Reason::Status(Status::NO_SUCH_NODE.0);
    let mut server = Server::start(&["--twice"]);
    let mut twice = line(&machine(server.port, ""));
    assert_eq!(twice.signals().await, Ok([Err(unknown), Err(unknown)]));
    assert_eq!(twice.writes(4).await, Err(Fault::Status(Status::NO_SUCH_NODE)));
    let mut gone = line(&machine(server.port, "").replace("ns=2;s=bed", "nsu=urn:gone;s=bed"));
    assert_eq!(gone.signals().await.unwrap()[0], Err(unknown));
    assert_eq!(server.does("read offset"), "0");
    // A node that is named by its index is found, whichever namespace has that index.
    let directory = tempfile::tempdir().unwrap();
    let mut by_index = Line::new(profile(&machine(server.port, ""), directory.path()));
    assert_eq!(by_index.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}

#[tokio::test]
async fn beside_a_node_that_is_not_there_the_others_are_read() {
    let server = Server::start(&[]);
    let text = machine(server.port, "").replace("ns=2;s=bed", "nsu=urn:gone;s=bed");
    for text in
        [text.clone(), text.replacen("every = \"100ms\"", "every = \"100ms\"\nread = \"subscription\"", 1)]
    {
        let mut line = line(&text);
        for _ in 0..3 {
            let unknown = Err(Reason::Status(Status::NO_SUCH_NODE.0));
            assert_eq!(line.signals().await, Ok([unknown, Ok(100.0)]));
            tokio::time::sleep(SHORTLY).await;
        }
    }
}

#[test]
fn a_gateway_compensates_its_own_machine_after_the_server_has_another_order() {
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    let text = by_uri(&machine(server.port, ""));
    beside(&text, Options::default(), move |source| {
        let holds = |server: &mut Server, counts: &str| {
            while server.does("read offset") != counts {
                std::thread::sleep(SHORTLY);
            }
        };
        holds(&mut server, "30");
        let mut server = server.dies(&["--before", "2"]);
        server.does("value bed 21");
        wait_until(source, "the server is read again", |status| bed(status) == "good");
        holds(&mut server, "10");
        assert_eq!(server.does("other offset"), "0");
    });
}
