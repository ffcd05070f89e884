//! Disk, HTTP and the log do not change anything on the bus, and the log gives the decisions of the day again.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::cli::replay::replay;
use isotherm::clock::Clock;
use isotherm::gateway::Options;
use isotherm::observe::http::Admission;
use isotherm::virtual_machine::FaultScript;
use isotherm_core::quantity::Moment;

use crate::faults::law;
use crate::faults::rig::{Trace, World, block_on, patient, profile};

const MINUTE: Duration = Duration::from_secs(60);

pub(crate) fn kept_in(directory: Option<PathBuf>) -> impl FnOnce(&mut Options) {
    move |options| options.directory = directory
}

fn run_with(directory: Option<&Path>) -> Trace {
    block_on(async {
        let mut world = World::new(&patient(), "").await;
        world.gateway().options(kept_in(directory.map(Path::to_owned))).run(5 * MINUTE).await
    })
}

pub(crate) fn same_on_the_wire(one: &Trace, other: &Trace) {
    assert_eq!(one.wire.len(), other.wire.len());
    for (one, other) in one.wire.iter().zip(&other.wire) {
        assert_eq!(one, other);
    }
}

#[test]
fn with_a_state_directory_that_is_a_file_the_first_write_waits_for_what_may_still_arrive() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("state");
    fs::write(&file, "not a directory").unwrap();
    let (without, with) = (run_with(None), run_with(Some(&file)));
    law::holds(&with);
    // A previous run may have left a write that can still arrive. Nothing is written before its time is over.
    let first = |trace: &Trace| trace.seconds(trace.writes("cnc_z").first().unwrap().0);
    let (at_once, waited) = (first(&without), first(&with));
    assert!(at_once < 5.0 && (30.0..33.0).contains(&waited), "{at_once} {waited}");
    assert_eq!(
        with.reported("not-kept"),
        4,
        "state, both logs and events not kept, once each\n{}",
        with.lines()
    );
}

#[test]
fn a_full_disk_changes_nothing_on_the_bus_and_is_reported_once() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("bench-2026-01-05.csv");
    std::os::unix::fs::symlink("/dev/full", &log).unwrap();
    let (without, with) = (run_with(None), run_with(Some(directory.path())));
    same_on_the_wire(&without, &with);
    assert_eq!(with.reported("not-kept"), 1, "{}", with.lines());
    assert!(directory.path().join("bench.state.json").exists());
}

#[test]
fn a_disk_that_works_changes_nothing_on_the_bus_either() {
    let directory = tempfile::tempdir().unwrap();
    same_on_the_wire(&run_with(None), &run_with(Some(directory.path())));
}

#[test]
fn clients_that_never_read_change_nothing_on_the_bus() {
    let without = run_with(None);
    let with = block_on(async {
        let mut world = World::new(&patient(), "").await;
        let mut clients = Vec::new();
        let trial = world.gateway().at(Duration::ZERO, |stage| {
            let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
            listener.set_nonblocking(true).unwrap();
            let address = listener.local_addr().unwrap();
            let listener = tokio::net::TcpListener::from_std(listener).unwrap();
            let source = stage.source.clone();
            tokio::spawn(isotherm::observe::http::serve(
                listener,
                source,
                Admission::default(),
                std::future::pending(),
            ));
            for _ in 0..20 {
                let mut client = std::net::TcpStream::connect(address).unwrap();
                let ask = "GET /api/status HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(50);
                std::io::Write::write_all(&mut client, ask.as_bytes()).unwrap();
                clients.push(client);
            }
        });
        trial.run(5 * MINUTE).await
    });
    same_on_the_wire(&without, &with);
}

#[test]
fn the_log_of_a_day_with_faults_and_a_restart_gives_its_decisions_again_bit_for_bit() {
    let directory = tempfile::tempdir().unwrap();
    let faults = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"sentinel\"
        signal = \"bed\"
        at = \"5min\"
        for_time = \"2min\"
        [[fault]]
        device = \"thermocouples\"
        kind = \"nan\"
        signal = \"wheelhead\"
        at = \"9min\"
        for_time = \"2min\"
        [[fault]]
        device = \"cnc\"
        kind = \"restart\"
        at = \"15min\"
        [[fault]]
        device = \"cnc\"
        kind = \"refuse\"
        at = \"18min\"
        for_time = \"90s\"
        [[fault]]
        device = \"cnc\"
        kind = \"register\"
        register = \"holding:104\"
        words = [0, 33]
        at = \"55min\"";
    let (first, second) = block_on(async {
        let mut world = World::new(&patient(), faults).await;
        let state = Some(directory.path().to_owned());
        let first = world.gateway().options(kept_in(state.clone())).run(40 * MINUTE).await;
        let second = world.gateway().options(kept_in(state));
        let zero = isotherm::observe::status::Command::Zero;
        (first, second.command(10 * MINUTE, zero).run(25 * MINUTE).await)
    });
    law::holds(&first);
    law::holds(&second);
    let log = directory.path().join("bench-2026-01-05.csv");
    let summary = replay(&profile(&patient()), fs::File::open(log).unwrap(), "the day", None).unwrap();
    let axis = &summary.axes["z"];
    let reproduced = axis.reproduced.as_ref().unwrap();
    assert_eq!(reproduced.first, None, "{summary}");
    assert!(reproduced.rows > 1500, "{summary}");
    for state in ["off", "active", "degraded", "holding", "ramping", "zeroed"] {
        assert!(axis.states.contains_key(state), "{state}: {summary}");
    }
}

#[test]
fn a_run_over_midnight_leaves_two_files_that_each_give_their_decisions_again() {
    let directory = tempfile::tempdir().unwrap();
    let faults = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"silent\"
        at = \"590s\"
        for_time = \"150s\"";
    let ten_to_midnight = Moment::from_nanos(1_767_657_000_000_000_000);
    let trace = block_on(async {
        let profile = profile(&patient());
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let clock = Clock::simulated(ten_to_midnight, None);
        let mut world = World::start(profile, faults, Some(clock)).await;
        world.gateway().options(kept_in(Some(directory.path().to_owned()))).run(30 * MINUTE).await
    });
    law::holds(&trace);
    for (day, states) in
        [("2026-01-05", vec!["active", "holding"]), ("2026-01-06", vec!["holding", "ramping", "active"])]
    {
        let log = fs::File::open(directory.path().join(format!("bench-{day}.csv"))).unwrap();
        let summary = replay(&profile(&patient()), log, day, None).unwrap();
        let axis = &summary.axes["z"];
        assert_eq!(axis.reproduced.as_ref().unwrap().first, None, "{summary}");
        for state in states {
            assert!(axis.states.contains_key(state), "{state} on {day}: {summary}\n{}", trace.lines());
        }
    }
}
