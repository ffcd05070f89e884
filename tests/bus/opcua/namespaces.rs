//! Tests of namespaces whose order changes with a restart of the server.

use std::path::Path;
use std::sync::Arc;

use super::gateway::{beside, events, reported, wait_until};
use super::held::bed;
use super::rig::{Line, SHORTLY, Server, machine, profile, subscribing};
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::wire::Answer;
use isotherm::gateway::Options;
use isotherm::observe::requester::{Channel, Requester};
use isotherm_core::reading::{Reason, Status};

/// Returns a profile that names its namespace by URI.
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
        // The namespace of another machine has the old index now. It has nodes with the same names.
        let mut server = server.dies(&["--before", "1"]);
        let mut read = 0;
        while read < 3 {
            // At first, the server is not running or sends nothing yet.
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
    // A node that is named by an index is found, with any namespace at that index.
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

/// Returns options of a gateway that keeps its state in this directory.
fn remembering(directory: &Path) -> Options {
    Options { directory: Some(directory.to_owned()), ..Options::default() }
}

fn holds(server: &mut Server, counts: &str) {
    while server.does("read offset") != counts {
        std::thread::sleep(SHORTLY);
    }
}

#[test]
fn a_namespace_that_is_named_by_its_index_is_found_at_another_index_also_by_the_next_run() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    let (port, text) = (server.port, machine(server.port, ""));
    let options = || remembering(directory.path());
    beside(&text, options(), move |source| {
        holds(&mut server, "30");
        wait_until(source, "its URI is remembered", |status| reported(status, "namespace-recorded") == 1);
        let mut server = server.dies(&["--before", "2"]);
        server.does("value bed 21");
        holds(&mut server, "10");
        assert_eq!(server.does("other offset"), "0");
        wait_until(source, "it says where it is", |status| {
            let words = "bus control: namespace urn:test is ns=4 at the server, not ns=2";
            events(status).iter().any(|text| text.starts_with(words))
        });
        assert_eq!(reported(&source.status(), "namespace-moved"), 1);
    });
    let port = port.to_string();
    // At another address there may be another server, for which nothing is stored.
    for (arguments, event) in
        [(vec!["--port", &port, "--before", "1"], "namespace-moved"), (vec![], "namespace-recorded")]
    {
        let mut server = Server::start(&arguments);
        server.does("value bed 24");
        let text = machine(server.port, "");
        beside(&text, options(), move |source| {
            wait_until(source, event, |status| reported(status, event) == 1);
            wait_until(source, "it is read", |status| bed(status) == "good");
            if event == "namespace-moved" {
                assert_eq!(server.does("other offset"), "0");
                assert_eq!(reported(&source.status(), "namespace-recorded"), 0);
            }
        });
    }
}

#[test]
fn a_namespace_that_is_gone_or_there_twice_is_used_only_after_a_person_has_confirmed() {
    for (arguments, words, uri) in [
        (&["--twice"][..], "the server has namespace urn:test (ns=2) more than once: write", "urn:test"),
        (
            &["--uri", "urn:mill"],
            "the server no longer has namespace urn:test (ns=2); ns=2 is urn:mill: write",
            "urn:mill",
        ),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let mut server = Server::start(&[]);
        server.does("value bed 23");
        let text = machine(server.port, "");
        beside(&text, remembering(directory.path()), move |source| {
            holds(&mut server, "30");
            wait_until(source, "its URI is remembered", |status| reported(status, "namespace-recorded") == 1);
            let mut server = server.dies(arguments);
            wait_until(source, words, |status| events(status).iter().any(|text| text.contains(words)));
            wait_until(source, "nothing of it is good", |status| bed(status) != "good");
            std::thread::sleep(10 * SHORTLY);
            assert_eq!(server.does("read offset"), "0", "nothing is written");
            let person = Arc::new(Requester::new(Channel::Socket, "maria"));
            let said = source.confirm("cnc", &person).map(|answer| answer.text().to_owned());
            assert_eq!(said, Ok(format!("cnc: confirmed; ns=2 is {uri} from now on")));
            wait_until(source, "it is read again", |status| bed(status) == "good");
            assert_eq!(reported(&source.status(), "as-expected"), 1);
        });
    }
}

#[test]
fn a_namespace_that_the_server_loads_late_is_used_as_soon_as_it_is_there() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    // No node is polled while the namespace is missing, but the list of namespaces is read again.
    let text = subscribing(server.port);
    beside(&text, remembering(directory.path()), move |source| {
        holds(&mut server, "30");
        let mut server = server.dies(&["--late"]);
        wait_until(source, "it is not there", |status| reported(status, "not-as-expected") == 1);
        assert_eq!(server.does("load"), "done");
        wait_until(source, "it is there", |status| reported(status, "as-expected") == 1);
        wait_until(source, "it is read again", |status| bed(status) == "good");
    });
}

#[test]
fn a_shared_register_whose_namespace_is_another_one_is_not_confirmed() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(&[]);
    server.does("value bed 20");
    let text =
        machine(server.port, "").replace("writes = \"offset\"", "writes = \"offset\"\nshare = \"ledger\"");
    beside(&text, remembering(directory.path()), move |source| {
        wait_until(source, "its URI is remembered", |status| reported(status, "namespace-recorded") == 1);
        let mut server = server.dies(&["--uri", "urn:mill"]);
        wait_until(source, "it is another", |status| reported(status, "not-as-expected") == 1);
        let person = Arc::new(Requester::new(Channel::Socket, "maria"));
        let said = source.confirm("cnc", &person).map(|answer| answer.text().to_owned()).unwrap_err();
        assert!(said.starts_with("output offset shares its register with an operator"), "{said}");
        assert_eq!(server.does("read offset"), "0");
        assert_ne!(bed(&source.status()), "good");
    });
}
