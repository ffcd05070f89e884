//! State of the primary host.

use proptest::prelude::*;

use super::*;

const STATE: &str = "spBv1.0/STATE/scada";

fn waiting() -> Sparkplug {
    let mut node = node().waiting_for(Address::state_topic("scada").unwrap());
    node.will();
    node.connect_sent();
    node
}

fn state(online: bool, timestamp: u64) -> Vec<u8> {
    format!("{{\"online\": {online}, \"timestamp\": {timestamp}}}").into_bytes()
}

/// Receives this state of a host. Returns the state of the primary host after it, and the reason of a refusal.
fn receives(node: &mut Sparkplug, topic: &str, payload: &[u8]) -> (PrimaryHost, Option<String>) {
    let reaction = node.received(at(0), &snapshot(Some(1.0), true, at(0)), topic, payload);
    assert_eq!(reaction.messages, [], "the gateway asks for the birth");
    let why = reaction.outcome.map(|outcome| match outcome {
        Outcome::Refused { command, why } => format!("{command}: {why}"),
        Outcome::Asked(command) => panic!("{command:?}"),
    });
    (node.host(), why)
}

#[test]
fn a_node_without_a_primary_host_hears_no_state_of_any() {
    let (mut node, _) = connected(at(0), &snapshot(Some(1.0), true, at(0)));
    assert_eq!(node.host(), PrimaryHost::NotNeeded);
    assert!(node.host().is_present() && !node.takes_retained(STATE));
    assert_eq!(receives(&mut node, STATE, &state(false, u64::MAX)), (PrimaryHost::NotNeeded, None));
    assert!(node.may_forward());
}

#[test]
fn the_state_is_subscribed_to_after_the_commands() {
    let node = waiting();
    let filters: Vec<_> = node.subscriptions().into_iter().map(|one| (one.filter, one.qos)).collect();
    let expected = ["spBv1.0/shop/NCMD/grinder-3", STATE].map(|topic| (topic.to_owned(), Qos::AtLeastOnce));
    assert_eq!(filters, expected);
    assert!(node.takes_retained(STATE) && !node.takes_retained("spBv1.0/shop/NCMD/grinder-3"));
}

#[test]
fn a_host_is_what_its_newest_state_says() {
    let mut node = waiting();
    assert_eq!((node.host(), node.host().is_present()), (PrimaryHost::Unknown, false));
    let table = [
        (STATE, state(false, 100), PrimaryHost::Offline),
        (STATE, state(false, 99), PrimaryHost::Offline),
        (STATE, state(true, 100), PrimaryHost::Online),
        (STATE, state(true, 99), PrimaryHost::Online),
        ("spBv1.0/STATE/other", state(false, 200), PrimaryHost::Online),
        ("spBv1.0/STATE/scada/x", state(false, 200), PrimaryHost::Online),
        // The will of a host has the time of its birth.
        (STATE, state(false, 100), PrimaryHost::Offline),
        (STATE, state(true, 300), PrimaryHost::Online),
        (STATE, state(false, 299), PrimaryHost::Online),
        (STATE, br#"{"online":false,"timestamp":301,"bdSeq":7}"#.to_vec(), PrimaryHost::Offline),
    ];
    for (topic, payload, expected) in table {
        let found = receives(&mut node, topic, &payload);
        assert_eq!(found, (expected, None), "{topic} {}", String::from_utf8_lossy(&payload));
    }
}

/// The clock of the host was ahead, and was set while the host was offline. The node waits, and a person must know why.
#[test]
fn a_host_that_is_online_with_an_older_time_than_its_offline_state_is_refused_in_words() {
    let mut node = waiting();
    receives(&mut node, STATE, &state(false, 3_600_000));
    let (host, why) = receives(&mut node, STATE, &state(true, 1000));
    assert_eq!(host, PrimaryHost::Offline);
    let why = why.unwrap();
    assert!(why.starts_with("STATE: the timestamp is too old: the host is online"), "{why}");
    assert_eq!(receives(&mut node, STATE, &state(true, 3_600_000)), (PrimaryHost::Online, None));
}

#[test]
fn a_new_connection_knows_nothing_of_the_host() {
    let mut node = waiting();
    receives(&mut node, STATE, &state(true, u64::MAX));
    assert_eq!(node.host(), PrimaryHost::Online);
    node.will();
    assert_eq!(node.host(), PrimaryHost::Unknown);
    // The clock of the host was ahead, and is right now.
    assert_eq!(receives(&mut node, STATE, &state(true, 100)), (PrimaryHost::Online, None));
}

#[test]
fn what_is_no_state_changes_nothing_and_is_refused_in_words() {
    let long = format!("{{\"online\": false, \"timestamp\": 1{}}}", " ".repeat(2000));
    for payload in ["", "OFFLINE", "{}", "{\"online\":0,\"timestamp\":1}", "{\"online\":false}", "[]", &long]
    {
        let mut node = waiting();
        receives(&mut node, STATE, &state(true, 1));
        let (host, why) = receives(&mut node, STATE, payload.as_bytes());
        assert_eq!(host, PrimaryHost::Online, "{payload}");
        let why = why.unwrap();
        assert!(why.starts_with("STATE: ") && why.contains("as Sparkplug B 3.0 requires"), "{why}");
    }
}

/// The host dies while the node publishes: the broker reports this only later.
#[test]
fn what_was_published_before_the_host_was_known_to_be_offline_is_kept_too() {
    let mut node = waiting();
    receives(&mut node, STATE, &state(true, 1));
    let born = node.connected(at(0), &snapshot(Some(0.0), true, at(0)));
    assert_eq!(read(&born[0]).0, "NBIRTH");
    for second in 1..=20_u32 {
        let time = u64::from(second) * 1000;
        node.publish(at(time), &snapshot(Some(second.into()), true, at(time)));
    }
    receives(&mut node, STATE, &state(false, 1));
    let deaths = node.farewell(at(21_000));
    assert_eq!((deaths.len(), read(&deaths[0]).0), (1, "NDEATH"));
    let mut kept = node.disconnected(Moment::default());
    for second in 22..=30_u32 {
        let time = u64::from(second) * 1000;
        kept.extend(node.absent(at(time), &snapshot(Some(second.into()), true, at(time))));
    }
    node.will();
    node.connect_sent();
    receives(&mut node, STATE, &state(true, 2));
    let birth = read(&node.connected(at(31_000), &snapshot(Some(31.0), true, at(31_000)))[0]).1;
    let bed = alias(&birth, "signal/bed/value");
    let messages = node.forward(at(32_000), &kept);
    let is_historical = |metric: &Metric| metric.is_historical == Some(true);
    assert!(messages.iter().all(|message| read(message).1.metrics.iter().all(is_historical)));
    let times: Vec<u64> =
        rows(&messages).into_iter().filter(|row| row.1 == bed).map(|row| row.2 / 1000).collect();
    assert_eq!(times, (0..=20).chain(22..=30).collect::<Vec<_>>());
}

/// The host dies while it receives the values of a gap.
#[test]
fn stored_values_that_the_host_may_have_lost_are_kept_again_and_others_are_not() {
    for (host, expected) in [(Some(false), vec![5, 6, 7]), (None, vec![])] {
        let mut node = waiting();
        let state_at = |second: u32| snapshot(Some(second.into()), true, at(u64::from(second) * 1000));
        let kept: Vec<Record> = (5..8).flat_map(|second| node.absent(at(8_000), &state_at(second))).collect();
        receives(&mut node, STATE, &state(true, 1));
        node.connected(at(10_000), &state_at(7));
        assert_eq!(rows(&node.forward(at(11_000), &kept)).len(), 4, "three temperatures, and a flag");
        if let Some(online) = host {
            receives(&mut node, STATE, &state(online, 1));
        }
        let again: Vec<u64> = node
            .disconnected(Moment::default())
            .iter()
            .flat_map(|record| Payload::decode(record.0.as_slice()).unwrap().metrics)
            .filter(|metric| metric.name.as_deref() == Some("signal/bed/value"))
            .map(|metric| (metric.timestamp.unwrap() - ms(0).unwrap()) / 1000)
            .collect();
        assert_eq!(again, expected, "{host:?}");
        assert_eq!(node.left_out(), LostValues::default());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// The state is that of the last message that is not older than each one before it.
    #[test]
    fn the_newest_state_wins_in_any_order(states in proptest::collection::vec((any::<bool>(), 0u64..6), 1..20)) {
        let mut node = waiting();
        let mut expected = (PrimaryHost::Unknown, 0);
        for (online, timestamp) in states {
            if timestamp >= expected.1 {
                expected = (if online { PrimaryHost::Online } else { PrimaryHost::Offline }, timestamp);
            }
            prop_assert_eq!(receives(&mut node, STATE, &state(online, timestamp)).0, expected.0);
        }
    }

    /// Bytes of any sender are a state, or are refused without an effect.
    #[test]
    fn no_bytes_do_harm(bytes in proptest::collection::vec(any::<u8>(), 0..60)) {
        let mut node = waiting();
        let (host, why) = receives(&mut node, STATE, &bytes);
        prop_assert!(why.is_none() || host == PrimaryHost::Unknown);
    }
}
