//! A Sparkplug node with a primary host, which comes and goes.

use super::*;
use isotherm_plant::sparkplug::{Address, Payload, Sparkplug};

const STATE: &str = "spBv1.0/STATE/scada";

fn node(waits: bool) -> Box<dyn Publisher> {
    let node = Sparkplug::new(Address::new("g", "press").unwrap(), None, true);
    Box::new(if waits { node.waiting_for(Address::state_topic("scada").unwrap()) } else { node })
}

fn state(online: bool, timestamp: u64) -> Vec<u8> {
    format!("{{\"online\":{online},\"timestamp\":{timestamp}}}").into_bytes()
}

/// Kinds of the messages that the broker has taken, each once in a row.
fn kinds(broker: &Fake) -> Vec<String> {
    let state = broker.0.lock().unwrap();
    let mut kinds: Vec<String> = state.taken.iter().map(|message| kind(message).to_owned()).collect();
    kinds.dedup();
    kinds
}

fn kind(message: &Message) -> &str {
    message.topic.split('/').nth(2).unwrap()
}

#[tokio::test(start_paused = true)]
async fn nothing_is_published_before_the_host_is_online_and_all_of_it_then() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let directory = tempfile::tempdir().unwrap();
    let kept = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
    machine.is_busy(1);
    let waited = Mutex::new(String::new());
    let went = run_as((node(true), kept), &machine, &broker, async {
        passes(30).await;
        assert_eq!(kinds(&broker), [""; 0]);
        waited.lock().unwrap().push_str(&machine.said().join("\n"));
        broker.has_retained(STATE, &state(false, 1));
        passes(30).await;
        assert_eq!(kinds(&broker), [""; 0]);
        broker.brings(STATE, &state(true, 2));
        passes(10).await;
        machine.is_busy(0);
        passes(10).await;
    })
    .await;
    assert!(
        waited.lock().unwrap().contains("the broker has no message about the state of this host"),
        "{waited:?}"
    );
    assert_eq!(kinds(&broker), ["NBIRTH", "NDATA", "NDEATH"]);
    let mut told = events_of(&broker);
    told.sort_unstable();
    assert_eq!(told, (0..machine.happened()).collect::<Vec<_>>(), "each event once");
    assert_eq!((went.connected, went.primary_host.as_str(), went.dropped), (true, "online", 0));
    let said = machine.said();
    assert_eq!(said.len(), 2, "{said:#?}");
    assert!(said[1].starts_with("the host scada at mqtt://here is online"), "{said:#?}");
}

#[tokio::test(start_paused = true)]
async fn a_host_that_goes_offline_costs_no_value_and_gets_them_as_historical() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let directory = tempfile::tempdir().unwrap();
    let kept = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
    machine.is_busy(1);
    let before = Mutex::new((0, 0));
    run_as((node(true), kept), &machine, &broker, async {
        broker.has_retained(STATE, &state(true, 1));
        passes(10).await;
        let begun = machine.happened();
        broker.brings(STATE, &state(false, 1));
        passes(5).await;
        let taken = broker.0.lock().unwrap().taken.len();
        // The broker shows the retained state to each new connection.
        broker.has_retained(STATE, &state(false, 1));
        passes(25).await;
        *before.lock().unwrap() = (begun, taken);
        assert_eq!(broker.0.lock().unwrap().taken.len(), taken, "nothing is published meanwhile");
        broker.brings(STATE, &state(true, 3));
        passes(20).await;
        machine.is_busy(0);
        passes(10).await;
    })
    .await;
    assert_eq!(kinds(&broker), ["NBIRTH", "NDATA", "NDEATH", "NBIRTH", "NDATA", "NDEATH"]);
    let (begun, taken) = *before.lock().unwrap();
    let state = broker.0.lock().unwrap();
    let mut late: Vec<u64> = Vec::new();
    for message in state.taken[taken..].iter().filter(|message| kind(message) == "NDATA") {
        let payload = Payload::arrived(&message.payload).unwrap();
        let events = numbers(&message.payload);
        let is_historical = payload.metrics.iter().any(|metric| metric.is_historical == Some(true));
        late.extend(events.iter().filter(|_| is_historical));
    }
    late.sort_unstable();
    late.dedup();
    // Events from before are repeated, because the host may have been dead for some time.
    let missed: Vec<u64> = (begun..begun + 25).collect();
    assert!(missed.iter().all(|number| late.contains(number)), "{late:?}");
    assert!(late.contains(&0), "{late:?}");
    let said = machine.said();
    assert_eq!(said.len(), 2, "{said:#?}");
    assert!(said[0].contains("the host is offline") && said[1].contains("is online"), "{said:#?}");
}

/// Only the key of the profile makes the state of a host matter.
#[tokio::test(start_paused = true)]
async fn without_a_primary_host_no_state_disconnects() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    machine.is_busy(1);
    let went = run_as((node(false), RecordQueue::in_memory()), &machine, &broker, async {
        for timestamp in 0..20 {
            broker.brings(STATE, &state(false, timestamp));
            passes(1).await;
        }
    })
    .await;
    assert_eq!((went.connected, went.connections, went.primary_host.as_str()), (true, 1, ""));
    assert_eq!(kinds(&broker), ["NBIRTH", "NDATA", "NDEATH"]);
}

/// A host that flaps does not make the gateway connect more often than a broker that flaps.
#[tokio::test(start_paused = true)]
async fn a_host_that_flaps_is_followed_ever_more_slowly() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let directory = tempfile::tempdir().unwrap();
    let kept = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
    run_as((node(true), kept), &machine, &broker, async {
        for timestamp in 0..600 {
            broker.brings(STATE, &state(timestamp % 2 == 0, timestamp));
            passes(1).await;
        }
    })
    .await;
    let attempts = broker.0.lock().unwrap().attempts;
    assert!(attempts < 60, "{attempts} connections in ten minutes");
}

#[tokio::test(start_paused = true)]
async fn a_gateway_that_stops_while_it_waits_keeps_everything() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let directory = tempfile::tempdir().unwrap();
    let kept = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
    run_as((node(true), kept), &machine, &broker, async {
        machine.has(2);
        passes(10).await;
        machine.has(1);
    })
    .await;
    assert_eq!(kinds(&broker), [""; 0]);
    let mut kept = RecordQueue::on_disk(directory.path(), 1 << 20).unwrap();
    let records = kept.next(Moment::default(), Moment::default());
    assert_eq!(records.iter().flat_map(|record| numbers(&record.0)).collect::<Vec<_>>(), [0, 1, 2]);
}

#[tokio::test(start_paused = true)]
async fn without_a_connection_the_state_of_the_host_is_unknown() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let known = Mutex::new(String::new());
    let figures = |state: &BrokerStatus| (state.connected, state.primary_host.clone());
    for is_away in [true, false] {
        broker.0.lock().unwrap().is_away = is_away;
        let went = run_as((node(true), RecordQueue::in_memory()), &machine, &broker, passes(3)).await;
        assert_eq!(figures(&went), (!is_away, "unknown".to_owned()));
    }
    let went = run_as((node(true), RecordQueue::in_memory()), &machine, &broker, async {
        broker.has_retained(STATE, &state(true, 1));
        passes(5).await;
        known.lock().unwrap().push_str(&kinds(&broker).join(" "));
        broker.0.lock().unwrap().is_away = true;
        passes(60).await;
    })
    .await;
    assert!(known.lock().unwrap().starts_with("NBIRTH"), "{known:?}");
    assert_eq!(figures(&went), (false, "unknown".to_owned()));
}
