//! Stop of the gateway with different states of the broker: records are published or kept, never lost.

use super::*;
use isotherm_plant::sparkplug::{Address, Sparkplug};

/// A Sparkplug node and its queue, in this directory.
fn node(directory: &std::path::Path) -> (Box<dyn Publisher>, RecordQueue) {
    let node = Sparkplug::new(Address::new("g", "press").unwrap(), None, false);
    (Box::new(node), kept(directory))
}

fn kept(directory: &std::path::Path) -> RecordQueue {
    RecordQueue::on_disk(directory, 1 << 20).unwrap()
}

/// Numbers of the events in the queue on disk.
fn waiting(directory: &std::path::Path) -> Vec<u64> {
    let records = kept(directory).next(Moment::default(), Moment::default());
    records.iter().flat_map(|record| numbers(&record.0)).collect()
}

#[tokio::test(start_paused = true)]
async fn what_happens_last_is_kept_where_the_broker_is_away_or_does_not_answer() {
    for is_cut_off in [false, true] {
        let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
        let directory = tempfile::tempdir().unwrap();
        broker.0.lock().unwrap().is_away = true;
        broker.0.lock().unwrap().is_cut_off = is_cut_off;
        run_as(node(directory.path()), &machine, &broker, async {
            machine.has(2);
            tokio::time::sleep(Duration::from_millis(4500)).await;
            machine.has(1);
        })
        .await;
        assert_eq!(waiting(directory.path()), [0, 1, 2], "{is_cut_off}");
    }
}

#[tokio::test(start_paused = true)]
async fn what_has_not_arrived_when_the_gateway_stops_is_kept() {
    for breaks in [false, true] {
        let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
        let directory = tempfile::tempdir().unwrap();
        run_as(node(directory.path()), &machine, &broker, async {
            machine.has(2);
            passes(3).await;
            {
                let mut state = broker.0.lock().unwrap();
                (state.is_cut_off, state.last_received) = (true, Some(Moment::default()));
            }
            machine.has(1);
            passes(3).await;
            machine.has(1);
            broker.0.lock().unwrap().is_away = breaks;
        })
        .await;
        assert_eq!(waiting(directory.path()), [0, 1, 2, 3], "{breaks}");
    }
}

#[tokio::test(start_paused = true)]
async fn what_has_arrived_when_the_gateway_stops_is_not_kept() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let directory = tempfile::tempdir().unwrap();
    run_as(node(directory.path()), &machine, &broker, async {
        machine.has(2);
        passes(3).await;
        machine.has(1);
    })
    .await;
    assert_eq!((events_of(&broker), waiting(directory.path())), (vec![0, 1, 2], vec![]));
}

#[tokio::test(start_paused = true)]
async fn what_waits_in_memory_is_told_before_the_farewell() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    broker.0.lock().unwrap().is_away = true;
    machine.is_busy(1);
    run(&machine, &broker, async {
        passes(800).await;
        broker.0.lock().unwrap().is_away = false;
        while broker.0.lock().unwrap().taken.is_empty() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await;
    let all: Vec<u64> = (0..machine.happened()).collect();
    assert_eq!(events_of(&broker), all);
    let state = broker.0.lock().unwrap();
    assert_eq!(state.taken.last().unwrap().payload, b"offline");
}

/// A first number above 0 would show a host a connection that never was.
#[tokio::test(start_paused = true)]
async fn an_attempt_that_the_stop_ends_uses_its_number_only_if_the_packet_was_sent() {
    for (is_cut_off, number) in [(true, None), (false, Some(0))] {
        let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
        let directory = tempfile::tempdir().unwrap();
        broker.0.lock().unwrap().is_cut_off = is_cut_off;
        let (memory, _) = Memory::of_deaths(directory.path());
        run_with(memory, node(directory.path()), &machine, &broker, passes(5)).await;
        assert_eq!(Memory::of_deaths(directory.path()).1, number, "{is_cut_off}");
    }
}
