//! Received messages cost little, and cause no loss of events.

use super::*;
use isotherm_plant::sparkplug::{Address, Metric, Payload, Raw, Sparkplug};

fn rebirth() -> Vec<u8> {
    let name = Some("Node Control/Rebirth".into());
    let asks = Metric { name, datatype: Some(11), value: Some(Raw::Boolean(true)), ..Metric::default() };
    Payload { timestamp: Some(1), metrics: vec![asks], seq: None }.bytes()
}

#[tokio::test(start_paused = true)]
async fn no_message_that_arrives_takes_an_event_with_it() {
    let sparkplug = || Sparkplug::new(Address::new("g", "press").unwrap(), None, false);
    let measured = br#"{"axis":"z","error_um":3.5}"#.to_vec();
    let (command, node) = ("g/press/command/measured", "spBv1.0/g/NCMD/press");
    let cases: [(Box<dyn Publisher>, &str, Vec<u8>); 4] = [
        (json(true), command, measured),
        (json(true), command, b"garbage".to_vec()),
        (Box::new(sparkplug()), node, rebirth()),
        (Box::new(sparkplug()), node, b"garbage".to_vec()),
    ];
    for (publisher, topic, payload) in cases {
        let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
        machine.is_busy(1);
        let went = run_as((publisher, RecordQueue::in_memory()), &machine, &broker, async {
            for _ in 0..30 {
                broker.brings(topic, &payload);
                tokio::time::sleep(Duration::from_millis(1700)).await;
            }
            machine.is_busy(0);
            passes(5).await;
        })
        .await;
        assert_eq!((went.dropped, went.queued), (0, 0));
        let all: Vec<u64> = (0..machine.happened()).collect();
        assert_eq!(events_of(&broker), all, "{topic} {payload:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_message_that_the_broker_delivers_again_is_marked_as_that() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let topic = "g/press/command/measured";
    run_as((json(true), RecordQueue::in_memory()), &machine, &broker, async {
        broker.brings(topic, br#"{"axis":"z","error_um":3.5,"id":"a"}"#);
        passes(2).await;
        broker.brings_again(topic, br#"{"axis":"z","error_um":3.5,"id":"a"}"#);
        passes(2).await;
    })
    .await;
    let first = MeasuredReport::new(3.5, None, Some("a")).unwrap();
    let again = MeasuredReport { redelivered: true, ..first.clone() };
    assert_eq!(*machine.measured.lock().unwrap(), [first, again]);
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_messages_has_the_state_looked_at_once_a_second() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    run_as((json(true), RecordQueue::in_memory()), &machine, &broker, async {
        for _ in 0..300 {
            (0..20).for_each(|_| broker.brings("g/press/command/measured", b"garbage"));
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        broker.brings("g/press/command/measured", br#"{"axis":"z","error_um":3.5}"#);
        passes(2).await;
    })
    .await;
    assert_eq!(*machine.measured.lock().unwrap(), [3.5.into()], "it is heard all the same");
    let looks = machine.looks();
    assert!((30..=70).contains(&looks), "{looks} looks in half a minute");
}
