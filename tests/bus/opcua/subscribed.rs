//! Tests of signals with a subscription.

use std::time::Duration;

use super::gateway::{beside, events, reported, wait_until};
use super::held::{bed, wait};
use super::rig::{Line, Server, profile, subscribing, with_many};
use isotherm::clock::Clock;
use isotherm::fieldbus::error::{Fault, PeerFault};
use isotherm::fieldbus::wire::{Answer, Request, Stamped};
use isotherm::gateway::Options;
use isotherm_core::reading::Reason;
use isotherm_profile::DeviceId;

const EVERY: Duration = Duration::from_millis(100);

type Signals = [Result<f64, Reason>; 2];

/// Reads once a period until the signals have these values.
async fn until(line: &mut Line, what: &str, wanted: Signals) {
    let mut found = Err(Fault::Timeout);
    for _ in 0..900 {
        found = line.signals().await;
        if found == Ok(wanted) {
            return;
        }
        tokio::time::sleep(EVERY).await;
    }
    panic!("{what}: {found:?}");
}

/// Reads until the server gets no more Read calls for the values.
async fn until_sent(line: &mut Line, server: &mut Server) {
    for _ in 0..900 {
        let before = server.does("reads");
        assert!(line.signals().await.is_ok());
        tokio::time::sleep(EVERY).await;
        if server.does("reads") == before {
            return;
        }
    }
    panic!("its nodes are still read");
}

#[tokio::test]
async fn what_changes_is_sent_and_nothing_is_read_for_it() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    assert_eq!(
        line.signals().await,
        Ok([Ok(20.0), Ok(100.0)]),
        "the first is read: nothing is old at the beginning"
    );
    until_sent(&mut line, &mut server).await;
    let before = server.does("reads");
    server.does("value bed 27.5");
    until(&mut line, "the value has changed", [Ok(27.5), Ok(100.0)]).await;
    server.does("status bed BadSensorFailure");
    until(&mut line, "it is bad", [Err(Reason::Status(0x808c_0000)), Ok(100.0)]).await;
    server.does("status bed Good");
    until(&mut line, "it is good again", [Ok(27.5), Ok(100.0)]).await;
    assert_eq!(server.does("reads"), before);
    assert_eq!(line.writes(12).await, Ok(Answer::Done));
    assert_eq!(line.stands().await, Ok(12), "what was written is read");
    assert_ne!(server.does("reads"), before);
}

#[tokio::test]
async fn a_value_is_as_old_as_the_request_that_brought_it_and_older_by_its_stamp() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    until_sent(&mut line, &mut server).await;
    let clock = Clock::wall();
    let requests = line.profile.requests(DeviceId(0));
    let mut before = None;
    for _ in 0..10 {
        let (asked, now) = {
            let answered = line.asks(Request::from(&requests[0].asks)).await.unwrap();
            (answered.answer.asked(&requests[0].fields[0]), clock.now())
        };
        // The request was sent one round before, or more rounds if this computer was slow.
        let asked = asked.expect("it was sent");
        assert!(asked >= before.unwrap_or(asked) && now.since(asked) >= EVERY / 2, "{:?}", now.since(asked));
        before = Some(asked);
        tokio::time::sleep(EVERY).await;
    }
    server.does("stamp bed -3600");
    for _ in 0..600 {
        tokio::time::sleep(EVERY).await;
        let answered = line.asks(Request::from(&requests[0].asks)).await.unwrap();
        if matches!(answered.answer.stamped(&requests[0].fields[0]), Stamped::Ago(age) if age.as_secs() >= 3599)
        {
            return;
        }
    }
    panic!("its stamp is an hour old, and nobody says so");
}

#[tokio::test]
async fn a_server_that_takes_one_node_a_call_is_given_one_a_call_and_what_it_lacks_is_bad() {
    let mut server = Server::start(&["--most", "1"]);
    let text = subscribing(server.port).replacen("s=scale", "s=nowhere", 1);
    let directory = tempfile::tempdir().unwrap();
    let mut line = Line::new(profile(&text, directory.path()));
    let wanted = [Ok(20.0), Err(Reason::Status(0x8034_0000))];
    assert_eq!(line.signals().await, Ok(wanted));
    until_sent(&mut line, &mut server).await;
    assert_eq!(line.signals().await, Ok(wanted));
}

#[tokio::test]
async fn nodes_are_subscribed_to_in_calls_that_the_server_accepts() {
    let cases: [&[&str]; 4] = [
        &["--many", "11", "--unsaid", "5"],
        &["--many", "11", "--unsaid", "5", "--refusal", "BadResponseTooLarge"],
        &["--many", "300", "--buffers", "8192,1,4096"],
        &["--many", "300", "--buffers", "8192,1,0"],
    ];
    for arguments in cases {
        let mut server = Server::start(arguments);
        let count = arguments[1].parse().unwrap();
        let directory = tempfile::tempdir().unwrap();
        let text = with_many(&subscribing(server.port), count);
        let mut line = Line::new(profile(&text, directory.path()));
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]), "{arguments:?}");
        until_sent(&mut line, &mut server).await;
        server.does("value bed 27.5");
        until(&mut line, "the value has changed", [Ok(27.5), Ok(100.0)]).await;
        assert_eq!(server.does("subscriptions"), "1", "{arguments:?}: none is left at the server");
    }
}

#[tokio::test]
async fn a_server_that_was_killed_is_subscribed_to_anew() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    until_sent(&mut line, &mut server).await;
    let mut server = server.dies(&[]);
    server.does("value bed 31");
    until(&mut line, "the new server is read", [Ok(31.0), Ok(100.0)]).await;
    until_sent(&mut line, &mut server).await;
    server.does("value bed 32");
    until(&mut line, "it sends", [Ok(32.0), Ok(100.0)]).await;
}

#[tokio::test]
async fn a_session_that_is_over_is_made_anew_with_its_subscription() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    until_sent(&mut line, &mut server).await;
    server.does("drop");
    server.does("value bed 31");
    until(&mut line, "it is read", [Ok(31.0), Ok(100.0)]).await;
    until_sent(&mut line, &mut server).await;
    assert_eq!((server.does("open"), server.does("subscriptions")), ("1".to_owned(), "1".to_owned()));
}

#[tokio::test]
async fn silence_is_a_fault_in_words_and_the_nodes_are_read_before_they_are_sent_again() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    until_sent(&mut line, &mut server).await;
    server.does("silent on");
    server.does("value bed 31");
    let mut fault = None;
    for _ in 0..900 {
        fault = line.signals().await.err();
        if fault.is_some() {
            break;
        }
        tokio::time::sleep(EVERY).await;
    }
    let fault = fault.expect("nothing was sent, and nobody says so");
    assert_eq!(fault, Fault::Peer(PeerFault::Silent));
    assert!(isotherm::fieldbus::explain::explain(fault).contains("read = \"poll\""), "{fault}");
    assert_eq!(line.signals().await, Ok([Ok(31.0), Ok(100.0)]));
    server.does("silent off");
    until_sent(&mut line, &mut server).await;
    assert_eq!(server.does("subscriptions"), "1", "none is left behind");
}

#[tokio::test]
async fn a_subscription_that_the_server_has_lost_is_made_anew() {
    let mut server = Server::start(&[]);
    let mut line = Line::subscribed(&server);
    until_sent(&mut line, &mut server).await;
    server.does("forget");
    server.does("value bed 31");
    until(&mut line, "it is read", [Ok(31.0), Ok(100.0)]).await;
    until_sent(&mut line, &mut server).await;
    server.does("value bed 32");
    until(&mut line, "it is sent", [Ok(32.0), Ok(100.0)]).await;
    assert_eq!(server.does("subscriptions"), "1");
}

#[test]
fn a_gateway_follows_what_is_sent_and_a_server_that_was_killed_and_is_back() {
    let mut server = Server::start(&[]);
    server.does("value bed 23");
    let text = subscribing(server.port);
    beside(&text, Options::default(), move |source| {
        wait(&mut server, |server| server.does("read offset") == "30");
        server.does("value bed 24");
        wait(&mut server, |server| server.does("read offset") == "40");
        let mut server = server.dies(&[]);
        server.does("value bed 21");
        wait_until(source, "the server is read again", |status| bed(status) == "good");
        wait(&mut server, |server| server.does("read offset") == "10");
        for (seconds, quality) in [("-3600", "stale"), ("3600", "source-clock")] {
            server.does(&format!("stamp bed {seconds}"));
            wait_until(source, quality, |status| bed(status) == quality);
            server.does("stamp bed 0");
            wait_until(source, "its clock is right", |status| bed(status) == "good");
        }
    });
}

#[test]
fn a_server_that_has_no_subscription_left_or_sends_too_seldom_is_read_and_that_is_told_once() {
    let cases = [
        (["--subscriptions", "0"], "BadTooManySubscriptions): the gateway polls the nodes instead"),
        (["--interval", "3000"], "`max_age` is 2s. The gateway polls the nodes instead"),
        (["--interval", "300"], "the server sends every 300ms, not every 100ms"),
    ];
    for (arguments, said) in cases {
        let mut server = Server::start(&arguments);
        server.does("value bed 23");
        let text = subscribing(server.port);
        beside(&text, Options::default(), move |source| {
            wait(&mut server, |server| server.does("read offset") == "30");
            wait_until(source, said, |status| {
                events(status)
                    .iter()
                    .any(|event| event.starts_with("device cnc: the subscription: ") && event.contains(said))
            });
            server.does("drop");
            server.does("value bed 24");
            wait(&mut server, |server| server.does("read offset") == "40");
            assert_eq!(reported(&source.status(), "subscription"), 1, "{:?}", events(&source.status()));
        });
    }
}
