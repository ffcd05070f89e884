//! The gateway's clock was set, but the publisher's clock was not: messages have the gateway's time.

use super::*;
use isotherm_plant::sparkplug::{Address, Payload, Sparkplug};

/// Time of the gateway in milliseconds, half a year away from the publisher's clock.
fn now() -> u64 {
    "2026-07-02T12:00:00Z".parse::<jiff::Timestamp>().unwrap().as_millisecond().try_into().unwrap()
}

#[tokio::test(start_paused = true)]
async fn births_data_and_what_is_kept_have_the_time_that_the_gateway_has() {
    let (machine, broker) = (Arc::new(Machine::default()), Fake::default());
    let node = Sparkplug::new(Address::new("g", "press").unwrap(), None, true);
    machine.is_busy(1);
    run_as((Box::new(node), RecordQueue::in_memory()), &machine, &broker, async {
        passes(5).await;
        broker.0.lock().unwrap().is_away = true;
        passes(5).await;
        broker.0.lock().unwrap().is_away = false;
        passes(10).await;
    })
    .await;
    let state = broker.0.lock().unwrap();
    let told = state.taken.iter().filter(|message| !message.topic.contains("NDEATH"));
    let stamps: Vec<u64> = told
        .flat_map(|message| {
            let payload = Payload::arrived(&message.payload).unwrap();
            let of_metrics: Vec<_> = payload.metrics.iter().map(|metric| metric.timestamp).collect();
            std::iter::once(payload.timestamp).chain(of_metrics).flatten()
        })
        .collect();
    assert!(stamps.len() > 30, "{}", stamps.len());
    let apart = stamps.iter().map(|stamp| stamp.abs_diff(now())).max().unwrap();
    assert!(apart < 10_000, "{apart} ms");
}
