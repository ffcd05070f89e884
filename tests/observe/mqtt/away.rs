//! The broker is killed or hangs under load. The machine is compensated as before, queues are bounded, and events are
//! published later.

use std::time::Duration;

use super::broker::Broker;
use super::machine::Machine;
use super::process::until;
use crate::support::tell;

/// Duration of the broker's absence; `tests/run long` uses one minute.
pub(crate) fn away() -> Duration {
    let seconds = std::env::var("TEST_BROKER_AWAY_SECONDS").ok().and_then(|text| text.parse().ok());
    Duration::from_secs(seconds.unwrap_or(5))
}

/// Share of late polls without publishing above which the computer is too busy for a comparison.
const BUSY: f64 = 0.05;

/// Maximum number of queued records: a state, its events, and records that are kept for later.
const MOST_QUEUED: u64 = 3000;

fn mqtt(broker: &Broker) -> String {
    format!("[mqtt]\nbroker = \"mqtt://127.0.0.1:{}\"\nevery = \"100ms\"\n", broker.port)
}

/// Asserts that both machines have about the same share of late polls. Other load of the computer delays both.
#[track_caller]
fn as_punctual(published: &Machine, plain: &Machine) {
    let [(late, all), (plain_late, plain_all)] = [published, plain].map(|machine| machine.late(10.0));
    println!(
        "polls later than 10 ms: {late} of {all} while publishing, {plain_late} of {plain_all} beside it without"
    );
    assert!(all > 20 && plain_all > 20);
    let share = |late: u64, all: u64| late as f64 / all as f64;
    let (here, there) = (share(late, all), share(plain_late, plain_all));
    if there > BUSY {
        return tell(&format!("while publishing {here} of the polls are late: void, {there} without it"));
    }
    assert!(here < 2.0 * there + 0.02, "{here} of the polls are late, and {there} without publishing");
}

#[test]
fn a_broker_that_is_killed_costs_the_machine_nothing_and_hears_later_what_happened() {
    let mut broker = Broker::open();
    let (machine, plain) = (Machine::with(&mqtt(&broker)), Machine::with(""));
    machine.is_active();
    plain.is_active();
    until("it publishes", || {
        let published = machine.status()["mqtt"]["published"].as_u64().unwrap();
        if published > 500 { Ok(()) } else { Err(published.to_string()) }
    });
    broker.dies();
    until("it is known to be away", || {
        let mqtt = machine.status()["mqtt"].clone();
        if mqtt["connected"] == false { Ok(()) } else { Err(mqtt.to_string()) }
    });
    machine.answers(false);
    until("something happens meanwhile", || {
        let said = machine.verb("events", &["--json"]);
        if said.contains("\"signal-bad\"") { Ok(()) } else { Err(said) }
    });
    machine.answers(true);
    std::thread::sleep(away());
    let queued = machine.status()["mqtt"]["queued"].as_u64().unwrap();
    assert!((1..MOST_QUEUED).contains(&queued), "{queued} messages wait");
    as_punctual(&machine, &plain);

    // The reader subscribes before the gateway continues.
    machine.running.stands_still();
    broker.starts();
    let mut reader = broker.reads("isotherm/press/#", &[]);
    machine.running.resumes();
    let mut missing = vec![
        "press/state online",
        "\"kind\":\"broker-down\"",
        "\"kind\":\"signal-bad\"",
        "\"kind\":\"broker-up\"",
    ];
    until("it hears what happened", || {
        let said = reader.so_far();
        missing.retain(|text| !said.iter().any(|line| line.contains(text)));
        if missing.is_empty() { Ok(()) } else { Err(format!("{missing:?}")) }
    });
    let said = machine.verb("events", &["--json"]);
    // The connection broke, and then no broker listened. Each cause is reported once.
    let mut causes: Vec<&str> = said.lines().filter(|line| line.contains("\"broker-down\"")).collect();
    causes.iter_mut().for_each(|line| *line = line.split("\"text\"").last().unwrap());
    let count = causes.len();
    causes.dedup();
    assert!((1..=2).contains(&count) && causes.len() == count, "{said}");
    until("nothing waits any more", || {
        let queued = machine.status()["mqtt"]["queued"].as_u64().unwrap();
        if queued == 0 { Ok(()) } else { Err(queued.to_string()) }
    });
    assert_eq!(machine.status()["mqtt"]["dropped"], 0);
}

#[test]
fn a_broker_that_hangs_fills_no_memory_and_is_left_in_the_end() {
    let mut broker = Broker::open();
    let (mut machine, plain) = (Machine::with(&mqtt(&broker)), Machine::with(""));
    machine.is_active();
    plain.is_active();
    broker.process().stands_still();
    let mut most = 0;
    until("it is given up", || {
        let mqtt = machine.status()["mqtt"].clone();
        most = most.max(mqtt["queued"].as_u64().unwrap());
        if mqtt["connected"] == false { Ok(()) } else { Err(mqtt.to_string()) }
    });
    assert!(most < MOST_QUEUED, "{most} messages wait");
    as_punctual(&machine, &plain);
    // A hanging broker does not delay the stop either.
    machine.running.signal("TERM");
    assert!(machine.running.ends_within(Duration::from_secs(30)).success(), "{:?}", machine.running.said);
    broker.process().resumes();
    broker.dies();
}
