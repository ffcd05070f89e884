//! Brokers that refuse a subscription, or close the connection after a denied message.

use super::*;

/// Number of the reported events with these words.
fn count(machine: &Machine, words: &str) -> usize {
    machine.said().iter().filter(|said| said.contains(words)).count()
}

#[tokio::test(start_paused = true)]
async fn a_refused_subscription_is_reported_once_and_again_when_it_is_accepted() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let topic = "g/press/command/+";
    broker.0.lock().unwrap().refuses = vec![topic.into()];
    let refused = Mutex::new(Vec::new());
    let went = run_as((json(true), RecordQueue::in_memory()), &machine, &broker, async {
        for _ in 0..3 {
            passes(5).await;
            broker.0.lock().unwrap().is_away = true;
            passes(2).await;
            broker.0.lock().unwrap().is_away = false;
        }
        passes(60).await;
        assert_eq!(count(&machine, "refuses this subscription"), 1, "{:?}", machine.said());
        refused.lock().unwrap().extend(broker.0.lock().unwrap().subscribed.clone());
        broker.0.lock().unwrap().refuses.clear();
        broker.0.lock().unwrap().is_away = true;
        passes(2).await;
        broker.0.lock().unwrap().is_away = false;
        passes(60).await;
    })
    .await;
    assert!(refused.lock().unwrap().len() >= 2, "each connection subscribes");
    assert_eq!(count(&machine, "accepts this subscription now"), 1, "{:?}", machine.said());
    assert_eq!((went.connected, went.refused), (true, Vec::<String>::new()));
}

#[tokio::test(start_paused = true)]
async fn a_refused_subscription_keeps_nothing_from_being_published() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().refuses = vec!["g/press/command/+".into()];
    machine.is_busy(1);
    let went = run_as((json(true), RecordQueue::in_memory()), &machine, &broker, passes(30)).await;
    assert_eq!((went.connected, went.refused), (true, vec!["g/press/command/+".to_owned()]));
    assert!(events_of(&broker).len() >= 29);
}

#[tokio::test(start_paused = true)]
async fn the_first_message_follows_the_answer_to_the_subscription() {
    use isotherm_plant::sparkplug::{Address, Sparkplug};
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let node = Sparkplug::new(Address::new("g", "press").unwrap(), None, false);
    run_as((Box::new(node), RecordQueue::in_memory()), &machine, &broker, passes(3)).await;
    let state = broker.0.lock().unwrap();
    assert_eq!(state.subscribed, [("spBv1.0/g/NCMD/press".to_owned(), 0)]);
    assert_eq!(state.taken[0].topic, "spBv1.0/g/NBIRTH/press");
}

#[tokio::test(start_paused = true)]
async fn a_topic_that_closes_the_connection_is_named_and_given_up_and_the_others_go_on() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().denies = vec!["g/press/event".into()];
    machine.is_busy(1);
    let went = run(&machine, &broker, passes(3600)).await;
    let attempts = broker.0.lock().unwrap().attempts;
    assert_eq!(attempts, 5, "the first, and three that name the topic");
    assert!(went.connected);
    assert_eq!(went.refused, ["g/press/event"]);
    let said = machine.said();
    let denied = "g/press/event: mqtt://here closed the connection three times after a message to this topic";
    assert_eq!(said.iter().filter(|said| said.starts_with(denied)).count(), 1, "{said:#?}");
    let named = "the broker closes the connection after a message to g/press/event";
    assert_eq!(count(&machine, named), 1, "{said:#?}");
    // It is back after the first broken connection, and when the topic is given up.
    assert_eq!(count(&machine, "connected after"), 2, "{said:#?}");
    let state = broker.0.lock().unwrap();
    let documents = state.taken.iter().filter(|message| message.topic == "g/press/gateway").count();
    assert!((60..80).contains(&documents), "{documents} in an hour");
}

#[tokio::test(start_paused = true)]
async fn a_broker_that_denies_everything_is_tried_seldom_and_reported_as_that_once() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().denies =
        ["gateway", "state", "event"].map(|kind| format!("g/press/{kind}")).into();
    let went = run(&machine, &broker, passes(3600)).await;
    let attempts = broker.0.lock().unwrap().attempts;
    assert!((100..300).contains(&attempts), "{attempts}");
    assert_eq!(went.refused, Vec::<String>::new());
    assert_eq!(count(&machine, "after the first message"), 1, "{:#?}", machine.said());
    assert!(machine.said().len() <= 3, "{:#?}", machine.said());
}

/// Some brokers close the connection instead of answering.
#[tokio::test(start_paused = true)]
async fn a_subscription_that_closes_the_connection_is_reported_once_until_it_is_accepted() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().closes_on = vec!["g/press/command/+".into()];
    let went = run_as((json(true), RecordQueue::in_memory()), &machine, &broker, async {
        passes(3600).await;
        assert_eq!(machine.said().len(), 1, "{:#?}", machine.said());
        broker.0.lock().unwrap().closes_on.clear();
        passes(60).await;
    })
    .await;
    assert!(went.connected);
    let said = machine.said();
    assert_eq!(said.len(), 2, "{said:#?}");
    assert!(said[0].contains("refuses the subscription to g/press/command/+"), "{said:#?}");
    assert!(said[1].contains("connected after"), "{said:#?}");
}
