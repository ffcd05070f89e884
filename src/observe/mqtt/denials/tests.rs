//! Brokers that close the connection after a denied message, in a small model.

use proptest::prelude::*;

use super::*;

fn at(seconds: u64) -> Moment {
    Moment::from_nanos(seconds * 1_000_000_000)
}

fn message(topic: &str, retained: bool) -> (Moment, Message) {
    (at(0), Message { topic: topic.to_owned(), payload: Vec::new(), qos: Qos::AtMostOnce, retained })
}

fn outbox(topics: &[&str]) -> VecDeque<(Moment, Message)> {
    topics.iter().map(|topic| message(topic, true)).collect()
}

/// One connection to a broker that closes it after a message to one of these topics. Returns the accepted topics, and
/// what the end of the connection means; `None` if it stays open.
fn connection(
    denials: &mut Denials,
    topics: &[&str],
    denied: &[&str],
) -> (Vec<String>, Option<(Fault, Option<String>)>) {
    let (mut outbox, mut accepted) = (outbox(topics), Vec::new());
    denials.begins(at(100));
    while denials.may_send(true) {
        let Some((_, message)) = denials.next(&mut outbox) else { break };
        let awaited = denials.awaits(&message);
        awaited.iter().for_each(|topic| denials.is_sent(topic));
        if denied.contains(&message.topic.as_str()) {
            return (accepted, Some(denials.ends(Fault::Broken, false)));
        }
        accepted.push(message.topic);
    }
    (accepted, None)
}

#[test]
fn a_denied_topic_is_named_and_given_up_after_three_closed_connections() {
    let mut denials = Denials::default();
    let topics = ["a", "b", "c", "d"];
    let mut connect = || connection(&mut denials, &topics, &["b"]);
    // The first time, messages are not sent one by one.
    assert_eq!(connect().1, Some((Fault::Broken, None)));
    assert_eq!(connect(), (vec!["a".into()], Some((Fault::Denied("b".into()), None))));
    let others = vec!["a".to_owned(), "c".into(), "d".into()];
    assert_eq!(connect(), (others.clone(), Some((Fault::Denied("b".into()), None))), "the others go first");
    assert_eq!(connect(), (others.clone(), Some((Fault::Denied("b".into()), Some("b".into())))));
    assert_eq!(connect(), (others.clone(), None));
    assert_eq!(connect(), (others, None));
}

#[test]
fn a_topic_that_comes_first_is_found_too() {
    let mut denials = Denials::default();
    let mut connect = || connection(&mut denials, &["a", "b"], &["a"]).1;
    assert_eq!(connect(), Some((Fault::Broken, None)));
    assert_eq!(connect(), Some((Fault::DeniesAll, None)), "nothing was accepted so far");
    assert_eq!(connect(), Some((Fault::Denied("a".into()), None)));
    assert_eq!(connect(), Some((Fault::Denied("a".into()), Some("a".into()))));
    assert_eq!(connect(), None);
}

#[test]
fn a_broker_that_accepts_nothing_is_named_as_that_and_no_topic_is_given_up() {
    let mut denials = Denials::default();
    let topics = ["a", "b", "c"];
    assert_eq!(connection(&mut denials, &topics, &topics).1, Some((Fault::Broken, None)));
    for _ in 0..50 {
        assert_eq!(connection(&mut denials, &topics, &topics).1, Some((Fault::DeniesAll, None)));
    }
    // The permissions are corrected.
    assert_eq!(connection(&mut denials, &topics, &[]), (topics.map(str::to_owned).to_vec(), None));
}

#[test]
fn the_topics_of_home_assistant_are_given_up_together() {
    let mut denials = Denials::default();
    let topics = ["homeassistant/sensor/x/a/config", "homeassistant/sensor/x/b/config", "g/m/state"];
    let mut ends = Vec::new();
    while let (_, Some(end)) = connection(&mut denials, &topics, &topics[..2]) {
        ends.push(end);
    }
    assert_eq!(ends.len(), 4);
    assert_eq!(ends[3].1.as_deref(), Some("homeassistant/#"));
    assert_eq!(connection(&mut denials, &topics, &topics[..2]).0, ["g/m/state"]);
}

#[test]
fn messages_that_must_keep_their_order_keep_it_and_their_quality() {
    let mut denials = Denials::default();
    denials.ends(Fault::Broken, true);
    denials.begins(at(1));
    let mut outbox: VecDeque<_> = ["NBIRTH", "NDATA", "NDATA"].map(|topic| message(topic, false)).into();
    denials.is_sent("NBIRTH");
    assert_eq!(denials.ends(Fault::Broken, false).0, Fault::DeniesAll);
    let mut sent = Vec::new();
    while let Some((_, message)) = denials.next(&mut outbox) {
        assert_eq!(message.qos, Qos::AtMostOnce);
        sent.push(message.topic);
    }
    assert_eq!(sent, ["NBIRTH", "NDATA", "NDATA"]);
}

#[test]
fn only_one_message_is_without_an_answer_until_the_connection_has_lasted() {
    let mut denials = Denials::default();
    denials.ends(Fault::Broken, true);
    denials.begins(at(10));
    let mut waiting = outbox(&["a", "b"]);
    let (_, first) = denials.next(&mut waiting).unwrap();
    assert_eq!((first.qos, denials.awaits(&first).as_deref()), (Qos::AtLeastOnce, Some("a")));
    denials.is_sent("a");
    assert!(!denials.may_send(false) && !denials.may_send(false));
    denials.rests(at(1000));
    assert!(!denials.may_send(false), "an answer is awaited");
    assert!(denials.may_send(true));
    denials.rests(at(69));
    assert!(denials.awaits(&first).is_some());
    denials.rests(at(70));
    assert!(denials.awaits(&first).is_none() && denials.may_send(false));
    assert_eq!(denials.next(&mut waiting).unwrap().1.qos, Qos::AtMostOnce);
}

#[test]
fn a_broker_that_does_not_answer_gets_its_messages_all_the_same() {
    let mut denials = Denials::default();
    denials.ends(Fault::Broken, true);
    denials.begins(at(1));
    for second in [100, 200, 300] {
        // An answer that comes late begins the wait again.
        denials.is_sent("a");
        denials.waits(at(second));
        denials.waits(at(second + 29));
        assert!(!denials.may_send(false) && denials.may_send(true));
    }
    denials.is_sent("a");
    denials.waits(at(400));
    denials.waits(at(429));
    assert!(!denials.may_send(false));
    denials.waits(at(430));
    assert!(denials.may_send(false) && !denials.has_suspects());
}

/// A topic may have no further message for hours.
#[test]
fn a_connection_that_has_lasted_is_usable_although_a_topic_was_suspected() {
    let mut denials = Denials::default();
    denials.ends(Fault::Broken, true);
    denials.begins(at(1));
    denials.is_sent("a");
    denials.ends(Fault::Broken, false);
    denials.begins(at(10));
    assert!(denials.may_send(true) && denials.has_suspects());
    denials.rests(at(69));
    assert!(denials.has_suspects());
    denials.rests(at(70));
    assert!(!denials.has_suspects());
}

#[test]
fn a_connection_that_breaks_for_another_reason_blames_no_topic() {
    for (fault, is_done) in [(Fault::Silent, false), (Fault::Broken, true)] {
        let mut denials = Denials::default();
        for _ in 0..10 {
            denials.ends(Fault::Broken, true);
            denials.begins(at(1));
            denials.is_sent("a");
            assert!(denials.may_send(true), "one message was accepted");
            denials.is_sent("b");
            assert_eq!(denials.ends(fault.clone(), is_done), (fault.clone(), None));
        }
        assert!(denials.denied.is_empty());
    }
}

#[test]
fn an_answer_begins_the_count_again() {
    let mut denials = Denials::default();
    denials.ends(Fault::Broken, true);
    for _ in 0..20 {
        // The line breaks twice with this message under way, then the message arrives.
        for is_done in [false, false, true] {
            denials.begins(at(1));
            denials.is_sent("a");
            assert!(denials.may_send(true));
            denials.is_sent("b");
            assert_eq!(denials.ends(Fault::Broken, is_done).1, None);
        }
    }
    assert!(denials.denied.is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever subset of the topics is denied, the others are published in the end, and only the denied ones are given
    /// up. At most three connections are closed for each denied topic, and one before.
    #[test]
    fn exactly_the_denied_topics_are_given_up(denied in proptest::collection::vec(any::<bool>(), 8)) {
        let topics = ["a", "b", "c", "d", "e", "f", "g", "h"];
        prop_assume!(denied.contains(&false));
        let (refused, taken): (Vec<_>, Vec<_>) = topics.iter().zip(&denied).partition(|(_, denied)| **denied);
        let names = |list: Vec<(&&'static str, &bool)>| list.into_iter().map(|(topic, _)| *topic).collect::<Vec<_>>();
        let (refused, taken) = (names(refused), names(taken));
        let mut denials = Denials::default();
        let mut closed = 0;
        while connection(&mut denials, &topics, &refused).1.is_some() {
            closed += 1;
            prop_assert!(closed <= 1 + 3 * refused.len(), "{} connections", closed);
        }
        let (accepted, end) = connection(&mut denials, &topics, &refused);
        prop_assert_eq!((accepted, end), (taken.iter().map(|topic| (*topic).to_owned()).collect::<Vec<_>>(), None));
        let given_up: Vec<&str> = denials.denied.iter().map(String::as_str).collect();
        prop_assert_eq!(given_up, refused);
    }
}
