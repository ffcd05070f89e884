//! Log of the outputs: a replay gives the inputs and actions of each output again, whatever happened on the lines.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::cli::replay::{OutputsSummary, replay, replay_outputs};
use isotherm::clock::Clock;
use isotherm::observe::status::Command;
use isotherm::virtual_machine::FaultScript;
use isotherm_core::quantity::Moment;

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on, patient, profile};

const MINUTE: Duration = Duration::from_secs(60);
const BLOCK: &str = include_str!("plc.toml");

fn runs(text: &str, faults: &str, directory: &Path, spans: &[Duration]) -> Vec<Trace> {
    block_on(async {
        let mut world = World::new(text, faults).await;
        let mut traces = Vec::new();
        for span in spans {
            let state = Some(directory.to_owned());
            let trial = world.gateway().options(|options| options.directory = state);
            // A shared register is not zero. The operator confirms that its value is the operator offset.
            traces.push(trial.command(Duration::from_secs(3), Command::Arm).run(*span).await);
        }
        traces
    })
}

fn logs(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let is_log = |path: &PathBuf| path.to_str().unwrap().ends_with(".outputs.csv");
    let mut logs: Vec<_> = entries.filter(is_log).collect();
    logs.sort();
    logs
}

fn replayed(log: &Path) -> OutputsSummary {
    replay_outputs(fs::File::open(log).unwrap(), log.to_str().unwrap()).unwrap()
}

/// The only log of this directory, after a check that its replay gives all actions again, and its text.
fn again(directory: &Path) -> (OutputsSummary, String) {
    let logs = logs(directory);
    assert_eq!(logs.len(), 1, "{logs:?}");
    let summary = replayed(&logs[0]);
    comes_out_again(&summary);
    (summary, fs::read_to_string(&logs[0]).unwrap())
}

fn comes_out_again(summary: &OutputsSummary) {
    assert_eq!(summary.warnings, [""; 0], "{summary}");
    assert!(!summary.outputs.is_empty() && summary.rows > 20, "{summary}");
    for output in summary.outputs.values() {
        assert!(output.rows > 10 && output.first.is_none(), "{summary}");
    }
}

#[track_caller]
fn has(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "{word} does not stand in the log");
    }
}

#[test]
fn a_register_with_faults_and_a_restarted_gateway_comes_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let faults = "
        [[fault]]
        device = \"cnc\"
        kind = \"half-open\"
        at = \"40s\"
        for_time = \"10s\"
        [[fault]]
        device = \"cnc\"
        kind = \"exception\"
        code = 4
        at = \"90s\"
        for_time = \"30s\"
        [[fault]]
        device = \"cnc\"
        kind = \"restart\"
        at = \"150s\"
        [[fault]]
        device = \"cnc\"
        kind = \"register\"
        register = \"holding:104\"
        words = [0, 33]
        at = \"250s\"";
    let traces = runs(BENCH, faults, directory.path(), &[4 * MINUTE, 3 * MINUTE]);
    traces.iter().for_each(law::holds);
    let (summary, text) = again(directory.path());
    assert_eq!(summary.outputs.keys().collect::<Vec<_>>(), ["cnc_z", "heartbeat", "readout_z"]);
    has(
        &text,
        &[
            "cnc_z,begin,,,,,,\"{",
            "\"\"armed\"\":\"\"policy\"\"",
            "cnc_z,demand,",
            "cnc_z,read,",
            "cnc_z,done,",
            "cnc_z,no-answer,",
            ",write,",
            ",repeat,",
            "readout_z,position-begin,",
            "readout_z,writes,",
            "heartbeat,heartbeat-begin,",
            "heartbeat,writes,60,",
            "heartbeat,fault,",
            "heartbeat,failures,",
        ],
    );
    assert_eq!(text.matches("cnc_z,begin,").count(), 2, "once a run");
    for (rows, name) in [("readout_z,position,", "readout_z"), ("heartbeat,heartbeat,", "heartbeat")] {
        let (rows, turns) = (u64::try_from(text.matches(rows).count()).unwrap(), summary.outputs[name].rows);
        assert!(rows >= 5 && turns > 400 && rows * 2 < turns, "{rows} rows of {name} for {turns} turns");
    }
}

#[test]
fn a_register_that_an_operator_writes_to_as_well_comes_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let text = BENCH.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"");
    let faults = [(1200, "0s"), (3000, "60s")].map(|(counts, at)| {
        format!(
            "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:104\"\nwords = [0, {counts}]\nat = \"{at}\"\n"
        )
    });
    let traces = runs(&text, &faults.concat(), directory.path(), &[2 * MINUTE, MINUTE]);
    traces.iter().for_each(law::holds);
    assert_eq!(traces[0].reported("operator-change"), 1, "{}", traces[0].lines());
    let (_, text) = again(directory.path());
    has(
        &text,
        &["\"\"armed\"\":\"\"person\"\"", "cnc_z,on-disk,", ",keep,", ",write,", "\"\"is_shared\"\":true"],
    );
}

#[test]
fn a_set_with_a_handshake_and_lost_answers_comes_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let keys = "handshake = { strobe = \"coil:20\", acknowledge = \"input:16.0\", timeout = \"400ms\" }";
    let text = BLOCK.replace("[set.block]", &format!("[set.block]\n{keys}"));
    let faults = "
        [[fault]]
        device = \"plc\"
        kind = \"half-open\"
        at = \"30s\"
        for_time = \"5s\"
        [[fault]]
        device = \"plc\"
        kind = \"exception\"
        code = 6
        at = \"60s\"
        for_time = \"5s\"";
    let traces = runs(&text, faults, directory.path(), &[2 * MINUTE]);
    law::holds(&traces[0]);
    let (summary, text) = again(directory.path());
    assert_eq!(summary.outputs.keys().collect::<Vec<_>>(), ["set block"]);
    let rows = [
        "set block,set-begin,",
        "set block,set,,,write,",
        "set block,set,,,raise,",
        "set block,set,,,acknowledge,",
    ];
    has(&text, &rows);
    assert_eq!(
        text.matches("set block,set-begin,").count(),
        1,
        "each of its inputs is replayed from the one before"
    );
}

#[test]
fn a_row_that_was_changed_is_reported_with_file_line_output_and_both_actions() {
    let directory = tempfile::tempdir().unwrap();
    runs(BENCH, "", directory.path(), &[MINUTE]);
    let log = logs(directory.path()).remove(0);
    let text = fs::read_to_string(&log).unwrap();
    let (place, row) = text.lines().enumerate().find(|(_, row)| row.contains(",write,10,")).unwrap();
    fs::write(&log, text.replacen(row, &row.replace(",write,10,", ",write,11,"), 1)).unwrap();
    let summary = replayed(&log);
    let output = &summary.outputs["cnc_z"];
    let first = output.first.as_ref().unwrap();
    assert_eq!((output.differing, first.line), (1, u64::try_from(place).unwrap() + 1));
    let reported = summary.to_string();
    let place = format!("first in {}, line {}: `write 11 until ", log.display(), first.line);
    assert!(reported.contains("output cnc_z: 1 of ") && reported.contains(&place), "{reported}");
    assert!(reported.contains("in the log, `write 10 until "), "{reported}");
}

#[test]
fn a_run_over_midnight_leaves_two_files_that_each_come_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let ten_to_midnight = Moment::from_nanos(1_767_657_000_000_000_000);
    block_on(async {
        let profile = profile(&patient());
        let faults = FaultScript::parse("", &profile).unwrap();
        let mut world = World::start(profile, faults, Some(Clock::simulated(ten_to_midnight, None))).await;
        let state = Some(directory.path().to_owned());
        world.gateway().options(|options| options.directory = state).run(20 * MINUTE).await
    });
    let logs = logs(directory.path());
    let names: Vec<_> = logs.iter().map(|log| log.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["bench-2026-01-05.outputs.csv", "bench-2026-01-06.outputs.csv"]);
    for log in &logs {
        comes_out_again(&replayed(log));
        let text = fs::read_to_string(log).unwrap();
        has(&text, &["cnc_z,begin,", "readout_z,position-begin,", "heartbeat,heartbeat-begin,"]);
    }
}

#[test]
fn a_day_takes_a_few_megabytes_and_the_decisions_are_replayed_beside_it() {
    let directory = tempfile::tempdir().unwrap();
    runs(BENCH, "", directory.path(), &[20 * MINUTE]);
    let (summary, text) = again(directory.path());
    let a_day = text.len() * 72;
    let decisions = directory.path().join("bench-2026-01-05.csv");
    let of_decisions = fs::metadata(&decisions).unwrap().len() * 72;
    println!("{a_day} bytes a day in {} rows of 20 minutes; the decisions {of_decisions}", summary.rows);
    assert!(a_day < 40_000_000, "{a_day} bytes a day");
    let axis = replay(&profile(BENCH), fs::File::open(decisions).unwrap(), "the day", None).unwrap();
    assert_eq!(axis.axes["z"].reproduced.as_ref().unwrap().first, None, "{axis}");
}
