//! Computers whose clock is wrong, and is set while they run or between two runs. This moves nothing and deletes no
//! log, and each log file gives its decisions again.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::cli::replay::{replay, replay_outputs};
use isotherm_core::quantity::{Moment, time};

use crate::faults::keeping::{kept_in, same_on_the_wire};
use crate::faults::law;
use crate::faults::rig::{Trace, World, block_on, patient, profile};

const MINUTE: Duration = Duration::from_secs(60);
const DAY: Duration = Duration::from_hours(24);
/// Day of the bench.
const TODAY: &str = "2026-01-05T08:00:00Z";

fn at(stamp: &str) -> Moment {
    time::parse(stamp).unwrap()
}

/// Bench with a lag, a datum at machine start, and a part that grows with the time since then.
pub(crate) fn slow() -> String {
    let text = patient().replace("arm  = \"auto\"", "arm = \"auto\"\nsettle = \"3min\"");
    text.replace(
        "{ signal = \"bed\", gain = 2.0, reference = 0.0 },",
        "{ signal = \"bed\", gain = 2.0, lag = \"20min\", reference = \"start\" },",
    )
}

/// Bench with a model that requests 0.01 µm more each second.
fn counting() -> String {
    let text = patient();
    let (head, tail) = text.split_once("[[axis.z.model]]").unwrap();
    let (_, outputs) = tail.split_once("[output.readout_z]").unwrap();
    let model = "[[axis.z.model]]\nname = \"by the time\"\nkind = \"formula\"\nformula = \"0.01 * t + 0 * bed\"\n\
                 inputs = { bed = \"bed\" }\n\n[output.readout_z]";
    format!("{head}{model}{outputs}")
}

fn logs(directory: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let is_one = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        name.ends_with(ending) && name.ends_with(".outputs.csv") == ending.starts_with(".outputs")
    };
    let mut logs: Vec<_> = entries.filter(is_one).collect();
    logs.sort();
    logs
}

/// Checks that every file gives its decisions and its actions again. Returns the number of rows of decisions.
#[track_caller]
fn replays(text: &str, directory: &Path, trace: &Trace) -> u64 {
    let mut rows = 0;
    for log in logs(directory, ".csv") {
        let name = log.display().to_string();
        let summary = replay(&profile(text), fs::File::open(&log).unwrap(), name.as_str(), None).unwrap();
        let again = summary.axes["z"].reproduced.as_ref().unwrap();
        assert_eq!(again.first, None, "{summary}\n{}", trace.lines());
        rows += again.rows;
    }
    for log in logs(directory, ".outputs.csv") {
        let name = log.display().to_string();
        let summary = replay_outputs(fs::File::open(&log).unwrap(), &name).unwrap();
        assert!(summary.outputs.values().all(|output| output.first.is_none()), "{summary}");
    }
    rows
}

#[test]
fn a_clock_that_is_set_while_it_runs_changes_nothing_but_stamps() {
    let (straight, crooked) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let run = |directory: &Path, corrections: &[(u64, &str)]| {
        block_on(async {
            let mut world = World::new(&slow(), "").await;
            let mut trial = world.gateway().options(kept_in(Some(directory.to_owned())));
            for (minutes, stamp) in corrections.iter().copied() {
                let to = at(stamp);
                trial = trial.at(MINUTE * u32::try_from(minutes).unwrap(), move |stage| {
                    stage.clock.set_time_of_day(to)
                });
            }
            trial.run(60 * MINUTE).await
        })
    };
    let without = run(straight.path(), &[]);
    let corrections = [
        (4, "1970-01-01T00:10:00Z"),
        (11, "2026-01-05T08:11:00Z"),
        (20, "2026-01-05T07:20:00Z"),
        (30, "2027-01-05T08:30:00Z"),
        (40, "2026-01-05T08:40:00Z"),
        // One second is drift of the crystal, not a correction.
        (45, "2026-01-05T08:45:01Z"),
        (50, "2026-01-04T08:50:00Z"),
    ];
    let with = run(crooked.path(), &corrections);
    law::holds(&with);
    same_on_the_wire(&without, &with);
    assert_eq!(with.reported("clock-set"), 6, "{}", with.lines());
    assert_eq!(with.reported("logs-deleted"), 0, "{}", with.lines());
    assert_eq!(
        replays(&slow(), straight.path(), &without),
        replays(&slow(), crooked.path(), &with),
        "no row is lost"
    );
    let files = logs(crooked.path(), ".csv");
    assert_eq!(files.len(), 7, "{files:?}");
    let said = files.iter().filter(|file| fs::read_to_string(file).unwrap().contains(" → ")).count();
    assert_eq!(said, 6, "all but the first say from when to when");
    let outputs = logs(crooked.path(), ".outputs.csv");
    let said =
        |file: &PathBuf| fs::read_to_string(file).unwrap().lines().nth(1).unwrap().contains(",,clock,");
    assert_eq!(outputs.iter().filter(|file| said(file)).count(), 6, "{outputs:?}");
    // The displayed time follows.
    let shown = |minutes: u64| with.between(minutes * 60, minutes * 60).next().unwrap().status.now.clone();
    assert_eq!(&shown(8)[..10], "1970-01-01");
    assert_eq!(&shown(15)[..10], "2026-01-05");
    assert_eq!(&shown(35)[..10], "2027-01-05");
}

/// Runs for this time, is killed, and starts again with the clock set to `second`.
fn restarted(text: &str, first: &str, second: &str, before: Duration) -> (Trace, Trace, tempfile::TempDir) {
    let directory = tempfile::tempdir().unwrap();
    let (first, second) = block_on(async {
        let mut world = World::new(text, "").await;
        world.clock.set_time_of_day(at(first));
        world.clock.check_time_of_day();
        let state = Some(directory.path().to_owned());
        let one = world.gateway().options(kept_in(state.clone())).killed_after(before).await;
        world.clock.set_time_of_day(at(second));
        world.clock.check_time_of_day();
        (one, world.gateway().options(kept_in(state)).run(40 * MINUTE).await)
    });
    (first, second, directory)
}

#[test]
fn killed_while_references_settle_it_arms_whatever_the_clock_says_then() {
    for (begun, again, is_doubtful) in [
        (TODAY, "2026-01-05T08:01:10Z", false),
        (TODAY, "2026-01-06T08:01:10Z", false),
        (TODAY, "2026-01-04T08:00:00Z", true),
        (TODAY, "2016-01-05T08:00:00Z", true),
        (TODAY, "2027-01-05T08:00:00Z", true),
        (TODAY, "1970-01-01T00:00:30Z", true),
        ("1970-01-01T00:00:10Z", TODAY, true),
    ] {
        let (_, second, directory) = restarted(&slow(), begun, again, MINUTE);
        law::holds(&second);
        let states = second.states_between(0, 300);
        assert!(states.contains(&"active"), "{begun} {again}: {states:?}\n{}", second.lines());
        let reported = second.reported("clock-doubtful");
        assert_eq!(reported, usize::from(is_doubtful), "{begun} {again}\n{}", second.lines());
        replays(&slow(), directory.path(), &second);
    }
}

#[test]
fn the_time_since_machine_start_is_what_was_counted_whatever_the_clock_says() {
    for (begun, again) in [
        (TODAY, "2026-01-05T08:10:01Z"),
        (TODAY, "2026-01-06T08:10:00Z"),
        (TODAY, "2026-01-05T07:00:00Z"),
        (TODAY, "2035-01-05T08:00:00Z"),
        (TODAY, "1970-01-01T00:00:30Z"),
        ("1970-01-01T00:00:10Z", TODAY),
    ] {
        let (first, second, _) = restarted(&counting(), begun, again, 10 * MINUTE);
        let raw = |trace: &Trace, seconds| {
            let sample = trace.between(seconds, seconds + 5).next().unwrap();
            sample.status.axes[0].raw_um.unwrap()
        };
        let (before, after) = (raw(&first, 595), raw(&second, 60));
        assert!(
            (before - 5.95).abs() < 0.1 && (after - before - 0.6).abs() < 0.2,
            "{again}: {before} {after}"
        );
    }
}

#[test]
fn a_start_with_a_wrong_clock_deletes_no_log() {
    for wrong in ["2035-01-06T08:00:00Z", "1970-01-01T00:00:30Z", "2026-01-07T08:00:00Z"] {
        let directory = tempfile::tempdir().unwrap();
        let names: Vec<String> = [1, 40, 80, 120, 400]
            .map(|days| {
                let stamp = at(TODAY).before(DAY * days).to_string();
                format!("bench-{}.csv", &stamp[..10])
            })
            .to_vec();
        for name in &names {
            fs::write(directory.path().join(name), "time,bed\n").unwrap();
        }
        let trace = block_on(async {
            let mut world = World::new(&patient(), "").await;
            world.clock.set_time_of_day(at(wrong));
            world.clock.check_time_of_day();
            world.gateway().options(kept_in(Some(directory.path().to_owned()))).run(MINUTE).await
        });
        assert_eq!(trace.reported("logs-deleted"), 0, "{wrong}\n{}", trace.lines());
        assert!(names.iter().all(|name| directory.path().join(name).exists()), "{wrong}");
    }
}

#[test]
fn logs_that_are_older_than_they_are_kept_are_deleted_and_that_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let log = |days: u32| {
        let stamp = at(TODAY).before(DAY * days).to_string();
        directory.path().join(format!("bench-{}.csv", &stamp[..10]))
    };
    [1, 89, 91, 400].iter().for_each(|days| fs::write(log(*days), "time,bed\n").unwrap());
    let trace = block_on(async {
        let mut world = World::new(&patient(), "").await;
        world.clock.set_time_of_day(at(TODAY));
        world.clock.check_time_of_day();
        world.gateway().options(kept_in(Some(directory.path().to_owned()))).run(MINUTE).await
    });
    assert_eq!(trace.reported("logs-deleted"), 1, "{}", trace.lines());
    assert_eq!([1, 89, 91, 400].map(|days| log(days).exists()), [true, true, false, false]);
}
