//! A register that an operator writes to as well: its division into operator offset and gateway share survives every
//! fault.

use std::fs;
use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::gateway::{Disk, Files};
use isotherm::observe::status::Command;
use isotherm_core::quantity::Moment;
use rustix::fs::{CWD, RenameFlags};

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on};

const MINUTE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);

/// Operator offset at the start, µm.
const BASE: f64 = 120.0;

/// Bench with a shared register that contains an operator offset of 120.0 µm.
fn joint() -> String {
    BENCH.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"")
}

fn register(counts: i32, at: &str) -> String {
    let [a, b, c, d] = counts.to_be_bytes();
    let words = [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])];
    format!(
        "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:104\"\nwords = {words:?}\nat = \"{at}\"\n"
    )
}

fn cnc(keys: &str) -> String {
    format!("[[fault]]\ndevice = \"cnc\"\n{keys}\n")
}

fn at_start() -> String {
    register(1200, "0s")
}

/// Time at which the operator confirms the division of a register that is not zero, after the gateway has asked.
const CONFIRMED: Duration = Duration::from_secs(3);

/// Runs the bench several times with the same disk and the same register. In the first run the operator confirms that
/// the value in the register is the operator offset.
fn runs(text: &str, faults: &str, directory: &Path, spans: &[Duration]) -> Vec<Trace> {
    block_on(async {
        let mut world = World::new(text, faults).await;
        let mut traces = Vec::new();
        for span in spans {
            let state = Some(directory.to_owned());
            let trial = world.gateway().options(|options| options.directory = state);
            let trial = if traces.is_empty() { trial.command(CONFIRMED, Command::Arm) } else { trial };
            traces.push(trial.run(*span).await);
        }
        traces
    })
}

fn run(text: &str, faults: &str, span: Duration) -> Trace {
    let directory = tempfile::tempdir().unwrap();
    let trace = runs(text, faults, directory.path(), &[span]).remove(0);
    law::holds(&trace);
    trace
}

/// Register value at the end, µm.
fn left(trace: &Trace) -> f64 {
    let output = trace.profile.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let there = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.device == output.device && seen.address == output.address && seen.count == 2
    };
    let last = trace.wire.iter().rfind(there).unwrap();
    output.encoding.decode(&last.after).unwrap()
}

fn shares(trace: &Trace, second: u64) -> (f64, f64) {
    let sample = trace.between(second, second + 1).next().unwrap();
    let output = sample.status.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let shares = output.shares.unwrap_or_else(|| panic!("no shares at {second} s\n{}", trace.lines()));
    assert!((output.value.unwrap() - shares.base - shares.share).abs() < 1e-9);
    (shares.base, shares.share)
}

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 0.05, "{found}, not {expected}");
}

fn writes(trace: &Trace, from: u64, to: u64) -> Vec<f64> {
    let at = |seconds| trace.begin.after(Duration::from_secs(seconds));
    let inside = |(when, _): &(Moment, f64)| *when >= at(from) && *when <= at(to);
    trace.writes("cnc_z").into_iter().filter(inside).map(|(_, value)| value).collect()
}

#[test]
fn the_share_walks_in_on_top_of_what_the_operator_has_and_leaves_it_behind() {
    let trace = run(&joint(), &at_start(), 3 * MINUTE);
    let (base, share) = shares(&trace, 120);
    near(base, BASE);
    assert!(share > 5.0, "{share}\n{}", trace.lines());
    assert_eq!(trace.states(), ["waiting", "off", "active"], "{}", trace.lines());
    assert_eq!(
        (trace.reported("ledger-opened"), trace.reported("operator-change")),
        (1, 0),
        "{}",
        trace.lines()
    );
    assert!(trace.outcome.rested, "{:?}", trace.outcome);
    near(left(&trace), BASE);
    assert!(trace.outcome.left.contains("cnc_z holds 0.0 µm from the gateway"), "{:?}", trace.outcome);
}

#[test]
fn a_steady_share_is_looked_at_and_not_written_again() {
    let trace = run(&joint(), &at_start(), 3 * MINUTE);
    let all = writes(&trace, 0, 180);
    assert!(all.windows(2).all(|pair| (pair[0] - pair[1]).abs() > 0.05), "{all:?}");
}

#[test]
fn an_operators_edit_is_kept_and_reported_and_the_axis_goes_on_with_its_share() {
    let trace = run(&joint(), &(at_start() + &register(3000, "60s")), 3 * MINUTE);
    let share = shares(&trace, 58).1;
    assert_eq!(trace.reported("operator-change"), 1, "{}", trace.lines());
    assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
    let (base, now) = shares(&trace, 75);
    // The edit set the value of the whole register, with the share of that moment.
    let at_edit = [58, 59, 60, 61].map(|second| shares(&trace, second).1);
    let is_kept = at_edit.iter().any(|share| (base + share - 300.0).abs() < 0.05);
    assert!(is_kept, "{base} {at_edit:?}\n{}", trace.lines());
    assert!((now - share).abs() < 2.0, "{share} → {now}");
    assert_eq!(trace.states(), ["waiting", "off", "active"], "{}", trace.lines());
    near(left(&trace), base);
}

#[test]
fn an_operators_edit_while_nobody_looks_is_his_when_the_gateway_is_back() {
    let directory = tempfile::tempdir().unwrap();
    // The axis holds, so that the share is still in the register when the gateway has ended.
    let text = joint().replace("action = \"ramp\", after = \"30s\"", "action = \"hold\"");
    let faults = at_start() + &register(3000, "66s");
    let traces = block_on(async {
        let mut world = World::new(&text, &faults).await;
        let state = Some(directory.path().to_owned());
        let first = world.gateway().options(|options| options.directory = state.clone());
        let first = first.command(CONFIRMED, Command::Arm).run(MINUTE).await;
        world.clock.skip(20 * SECOND);
        [first, world.gateway().options(|options| options.directory = state).run(MINUTE).await]
    });
    let share = left(&traces[0]) - BASE;
    assert!((5.0..=12.0).contains(&share), "{share}\n{}", traces[0].lines());
    let again = &traces[1];
    assert_eq!(
        (again.reported("operator-change"), again.reported("ledger-opened")),
        (1, 0),
        "{}",
        again.lines()
    );
    assert!(again.lines().contains(&format!("armed, starting from {share:.1}")), "{}", again.lines());
    near(shares(again, 30).0, 300.0 - share);
}

#[test]
fn a_restart_finds_the_share_that_is_there_and_neither_doubles_nor_drops_it() {
    let directory = tempfile::tempdir().unwrap();
    let text = joint().replace("action = \"ramp\", after = \"30s\"", "action = \"hold\"");
    let traces = runs(&text, &at_start(), directory.path(), &[MINUTE; 3]);
    for trace in &traces {
        law::holds(trace);
        near(shares(trace, 50).0, BASE);
        assert!(shares(trace, 50).1 > 5.0, "{:?}\n{}", shares(trace, 50), trace.lines());
    }
    for pair in traces.windows(2) {
        let from = format!("armed, starting from {:.1} µm", left(&pair[0]) - BASE);
        assert!(pair[1].lines().contains(&from), "{from}\n{}", pair[1].lines());
    }
    assert_eq!(traces.iter().map(|trace| trace.reported("ledger-opened")).sum::<usize>(), 1);
}

#[test]
fn a_restarted_cnc_has_lost_both_parts_and_the_share_walks_in_again() {
    let trace = run(&joint(), &(at_start() + &cnc("kind = \"restart\"\nat = \"60s\"")), 3 * MINUTE);
    assert_eq!(
        (trace.reported("cnc-restarted"), trace.reported("operator-change")),
        (1, 0),
        "{}",
        trace.lines()
    );
    let after = writes(&trace, 61, 180);
    assert!(after[0] <= 1.0 && shares(&trace, 170).1 > 5.0, "{after:?}");
    near(shares(&trace, 170).0, 0.0);
}

#[test]
fn what_an_operator_enters_before_a_restart_is_seen_is_a_question_where_the_boot_counter_tells() {
    let counted = joint().replace("share =", "restart = { boot_counter = \"holding:98\" }\nshare =");
    let restart = cnc("kind = \"restart\"\nat = \"60500ms\"");
    let faults = at_start() + &restart + &register(2000, "60500ms");
    let trace = run(&counted, &faults, 2 * MINUTE);
    assert_eq!(
        (trace.reported("cnc-booted"), trace.reported("operator-change")),
        (1, 0),
        "{}",
        trace.lines()
    );
    assert_eq!(trace.reported("ledger-doubt"), 1, "{}", trace.lines());
    assert_eq!(writes(&trace, 61, 119), [0.0; 0], "nothing is written while it is in question");
}

#[test]
fn a_cnc_that_ignores_writes_is_no_operator() {
    let faults = at_start() + &cnc("kind = \"ignored-write\"\nat = \"8s\"\nfor_time = \"20s\"");
    let trace = run(&joint(), &faults, 2 * MINUTE);
    assert_eq!((trace.reported("verify-failed"), trace.reported("verified")), (1, 1), "{}", trace.lines());
    assert_eq!(trace.reported("operator-change") + trace.reported("ledger-doubt"), 0, "{}", trace.lines());
    assert_eq!(trace.states_between(12, 27), ["holding"], "{}", trace.lines());
    near(shares(&trace, 110).0, BASE);
}

#[test]
fn an_overflow_of_the_sum_cuts_the_change_and_loses_nothing() {
    let text = joint().replacen(
        "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1",
        "type = \"i16\"\nscale = 0.1",
        1,
    );
    let fault = "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:104\"\nwords = [32740]\nat = \"0s\"\n";
    let directory = tempfile::tempdir().unwrap();
    let trace = runs(&text, fault, directory.path(), &[2 * MINUTE]).remove(0);
    assert_eq!(trace.reported("saturated"), 1, "{}", trace.lines());
    let (base, share) = shares(&trace, 100);
    near(base, 3274.0);
    near(share, 2.7);
    assert_eq!(trace.writes("cnc_z").last().map(|(_, value)| (value * 10.0).round()), Some(32740.0));
}

#[test]
fn a_diameter_with_a_bias_and_a_register_that_counts_down_works_the_same() {
    let text = joint()
        .replace("deadband = 0.1", "deadband = 0.1\ndiameter = true")
        .replace("scale = 0.1\nverify", "scale = -0.1\nbias = 32768\nverify");
    let trace = run(&text, &register(32768 - 1200, "0s"), 2 * MINUTE);
    let (base, share) = shares(&trace, 100);
    near(base, BASE);
    let status = &trace.between(100, 101).next().unwrap().status;
    assert!((share / 2.0 - status.axes[0].cz_um).abs() <= 0.11 && share > 8.0, "{share}");
    near(left(&trace), BASE);
}

#[test]
fn a_disk_that_takes_no_ledger_keeps_its_output_unwritten_and_changes_nothing_for_the_others() {
    let directory = tempfile::tempdir().unwrap();
    // A directory of that name can be neither read nor replaced.
    fs::create_dir(directory.path().join("bench.state.json")).unwrap();
    let trace = runs(&joint(), &at_start(), directory.path(), &[2 * MINUTE]).remove(0);
    assert_eq!(trace.writes("cnc_z").len(), 0, "{}", trace.lines());
    assert!(trace.reported("not-kept") >= 1 && trace.reported("not-kept") <= 2, "{}", trace.lines());
    assert_eq!(trace.reported("ledger-doubt"), 1, "{}", trace.lines());
    assert!(trace.beats().len() > 100);
    near(left(&trace), BASE);
}

#[test]
fn without_a_state_directory_nothing_is_written_and_that_is_reported() {
    let trace = crate::faults::rig::run(&joint(), &at_start(), MINUTE);
    assert_eq!(trace.writes("cnc_z").len(), 0, "{}", trace.lines());
    assert!(trace.lines().contains("there is no state directory"), "{}", trace.lines());
}

#[test]
fn a_disk_that_fails_later_stops_the_writing_and_the_axis_says_so_until_it_works_again() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("state");
    let trace = block_on(async {
        let mut world = World::new(&joint(), &at_start()).await;
        let state = Some(place.clone());
        let away = directory.path().join("away");
        fs::write(&away, "not a directory").unwrap();
        let (here, there) = (place.clone(), away.clone());
        // The exchange is atomic, because the writer of the ledger creates a missing directory.
        let change_places = move || {
            rustix::fs::renameat_with(CWD, &here, CWD, &there, RenameFlags::EXCHANGE).unwrap();
        };
        let trial = world.gateway().options(|options| options.directory = state);
        let back = change_places.clone();
        let trial = trial.command(CONFIRMED, Command::Arm).at(9 * SECOND, move |_| change_places());
        trial.at(MINUTE, move |_| back()).run(3 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(writes(&trace, 12, 59), [0.0; 0], "{}", trace.lines());
    assert!(trace.states_between(13, 30).contains(&"holding"), "{}", trace.lines());
    assert_eq!(trace.states_between(120, 170), ["active"], "{}", trace.lines());
    near(shares(&trace, 170).0, BASE);
    near(left(&trace), BASE);
    // At first the log files are missing, and then there is no directory: another cause.
    assert!(trace.reported("not-kept") <= 6 && trace.reported("kept-again") >= 1, "{}", trace.lines());
}

#[test]
fn a_spoilt_ledger_is_a_question_and_a_person_answers_it() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("bench.state.json"), "{ half").unwrap();
    let trace = block_on(async {
        let mut world = World::new(&joint(), &at_start()).await;
        let state = Some(directory.path().to_owned());
        let trial = world.gateway().options(|options| options.directory = state);
        trial.command(MINUTE, Command::Arm).run(3 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(writes(&trace, 0, 59), [0.0; 0], "{}", trace.lines());
    assert_eq!(
        (trace.reported("ledger-doubt"), trace.reported("ledger-opened")),
        (1, 1),
        "{}",
        trace.lines()
    );
    assert_eq!(trace.states_between(70, 170), ["active"], "{}", trace.lines());
    near(shares(&trace, 170).0, BASE);
    let aside = fs::read_to_string(directory.path().join("bench.state.json.bad"));
    assert_eq!(aside.unwrap(), "{ half");
}

#[test]
fn a_dry_run_keeps_nothing_of_a_shared_register() {
    let directory = tempfile::tempdir().unwrap();
    let trace = block_on(async {
        let mut world = World::new(&joint(), &at_start()).await;
        let state = Some(directory.path().to_owned());
        let trial = world.gateway().options(|options| (options.directory, options.dry_run) = (state, true));
        trial.run(MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let kept = fs::read_to_string(directory.path().join("bench.state.json")).unwrap();
    let (_, outputs) = kept.split_once("\"outputs\": {\n").unwrap();
    assert!(outputs.starts_with("\"readout_z\": ") && !outputs.contains("\"cnc_z\": "), "{kept}");
}

/// A run of the bench: whether it is a dry run, and whether it is killed.
#[derive(Clone, Copy)]
struct Start {
    is_dry: bool,
    is_killed: bool,
}

/// Returns how many outputs wait for late writes at the start of the last of these runs.
fn waiting_at_the_last_start(starts: &[Start]) -> usize {
    let directory = tempfile::tempdir().unwrap();
    let traces = block_on(async {
        let mut world = World::new(BENCH, "").await;
        let mut traces = Vec::new();
        for start in starts {
            let state = Some(directory.path().to_owned());
            let trial = world
                .gateway()
                .options(|options| (options.directory, options.dry_run) = (state, start.is_dry));
            traces.push(if start.is_killed {
                trial.killed_after(MINUTE).await
            } else {
                trial.run(MINUTE).await
            });
        }
        traces
    });
    let last = traces.last().unwrap();
    law::holds(last);
    last.reported("waits-after-start")
}

#[test]
fn the_first_run_after_a_dry_run_waits_for_no_late_write() {
    let dry = Start { is_dry: true, is_killed: false };
    let real = Start { is_dry: false, is_killed: false };
    let killed = |start: Start| Start { is_killed: true, ..start };
    assert_eq!(waiting_at_the_last_start(&[dry, real]), 0);
    assert_eq!(waiting_at_the_last_start(&[killed(dry), dry, real]), 0, "a dry run writes nothing");
    assert_eq!(waiting_at_the_last_start(&[dry, real, dry, real]), 0);
    assert!(
        waiting_at_the_last_start(&[killed(real), dry, real]) > 0,
        "a dry run does not hide a killed run"
    );
    assert!(waiting_at_the_last_start(&[dry, killed(real), real]) > 0);
}

/// Disk that keeps nothing under a second name before its sender is dropped.
struct HangingDisk(Mutex<Receiver<()>>);

impl Disk for HangingDisk {
    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        Files.read(path)
    }

    fn replace(&self, path: &Path, document: &[u8]) -> io::Result<()> {
        Files.replace(path, document)
    }

    fn keep(&self, path: &Path, aside: &Path) -> io::Result<()> {
        let _ = self.0.lock().unwrap().recv();
        Files.keep(path, aside)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        Files.rename(from, to)
    }

    fn forget(&self, path: &Path) {
        Files.forget(path);
    }

    fn has(&self, path: &Path) -> bool {
        Files.has(path)
    }
}

#[test]
fn a_disk_that_hangs_holds_nobody_up_and_its_output_waits_for_it() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("bench.state.json"), "{ half").unwrap();
    let (hanging, again) = channel();
    let trace = block_on(async {
        let mut world = World::new(&joint(), &at_start()).await;
        let state = Some(directory.path().to_owned());
        let disk = Arc::new(HangingDisk(Mutex::new(again)));
        let trial = world.gateway().options(|options| (options.directory, options.disk) = (state, disk));
        let trial = trial.command(20 * SECOND, Command::Arm);
        trial.at(MINUTE, |_| drop(hanging)).run(3 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(writes(&trace, 0, 59), [0.0; 0], "{}", trace.lines());
    assert!(trace.lines().contains("the disk has not answered for 5 s"), "{}", trace.lines());
    let late = trace.beats().len();
    assert!(late >= 170, "{late} beats in three minutes");
    assert_eq!(trace.states_between(120, 170), ["active"], "{}", trace.lines());
    near(shares(&trace, 170).0, BASE);
    near(left(&trace), BASE);
}
