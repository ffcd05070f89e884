//! Learning from touches run by run: products, candidate, judged days, and the verb `learn`.

use std::path::Path;
use std::process::Command;

use isotherm_core::quantity::Moment;
use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::{Dataset, Split};
use isotherm_identify::learning::{InUse, Learning, TakenRun, choice};
use isotherm_identify::setup::units;
use isotherm_identify::uses;
use isotherm_profile::Profile;
use serde_json::Value;

use super::rig::{self, Day};
use super::whitened::days;

/// Midnight of the first day, s since the Unix epoch: 2026-01-05.
const FIRST: u64 = 1_767_571_200;
const A_DAY: u64 = 86_400;
/// Rows between two touches: an hour.
const HOUR: usize = 60;

/// Model in use that explains nothing.
const POOR: &str = "[[axis.z.model]]\nname = \"poor\"\nkind = \"linear\"\nexpected = { since_datum = [1.0, 2.0], since_touch = [0.5, 0.2] }\n\
                    terms = [ { signal = \"s1\", gain = 0.01, reference = \"start\" } ]\n";
/// Model in use that explains the simulated machine completely.
const TRUE: &str = "[[axis.z.model]]\nname = \"true\"\nkind = \"linear\"\nterms = [\n\
                    { signal = \"s0\", gain = -3.0, reference = \"start\", lag = \"25min\" },\n\
                    { signal = \"s2\", gain = 1.5, reference = \"start\" },\n]\n";

// A correction may drift fast, so that the residual of a poor model is not doubted.
const PROBE: &str = "[axis.z.probe]\nlimit = 50.0\nmax_error = 100.0\nq = 400.0\n";
const RUNNING: &str = "[signal.running]\ndevice = \"m\"\nregister = \"input:90\"\ntype = \"u16\"\nunit = \"bool\"\nmax_age = \"5s\"\n";

fn text(model: &str) -> String {
    rig::profile_with(4, &format!("{model}{PROBE}{RUNNING}"))
        .replace("settle = \"3min\"", "settle = \"3min\"\non = \"running\"")
}

fn profile(model: &str) -> Profile {
    rig::parsed(Path::new("bench.toml"), &text(model))
}

/// Log of the gateway of one day: the machine is on from row 30 to row 400, and probed once an hour.
fn log(number: u64, day: &Day, wrong: Option<usize>) -> String {
    let mut log =
        "time,running,s0,s1,s2,s3,z_permit,z_from_um,z_raw_um,z_cz_um,z_model,z_state,z_acted,z_measured_um,\
                   z_acting_um,z_correction_um,machine_memory,machine_zero\n"
            .to_owned();
    for row in 0..day.times.len() {
        let error = day.error[row] - day.error[30];
        let touch = match row > 30 && row < 400 && row.is_multiple_of(HOUR) {
            true if wrong == Some(row) => format!("{},1.5", error + 300.0),
            true => format!("{},1.5", error + 1.5),
            false => ",".to_owned(),
        };
        let sensors: Vec<String> = day.temperatures.iter().map(|sensor| sensor[row].to_string()).collect();
        let is_on = u8::from((30..400).contains(&row));
        let second = FIRST + number * A_DAY + 60 * u64::try_from(row).unwrap();
        let from = if row == 0 { "0" } else { "" };
        log +=
            &format!("{second},{is_on},{},armed,{from},1.5,1.5,m,active,,{touch},0,,\n", sensors.join(","));
    }
    log
}

/// Days that begin with constant temperatures up to row 30.
fn machine_days(count: u64, seed: u64) -> Vec<Day> {
    let mut days = days(count, seed, 0.0);
    for day in &mut days {
        for sensor in &mut day.temperatures {
            let cold = sensor[0];
            let warm = sensor.clone();
            let rows = sensor.len();
            sensor[..30].fill(cold);
            sensor[30..].copy_from_slice(&warm[..rows - 30]);
        }
        let error = day.error.clone();
        let rows = error.len();
        day.error[..30].fill(error[0]);
        day.error[30..].copy_from_slice(&error[..rows - 30]);
    }
    days
}

/// Takes these logs, one file for each, as `isotherm learn` does.
fn take(learning: &mut Learning, profile: &Profile, logs: &[String], now: u64) -> Vec<TakenRun> {
    take_without(learning, profile, (logs, &[]), now)
}

/// Takes these logs without some signals.
fn take_without(
    learning: &mut Learning,
    profile: &Profile,
    (logs, without): (&[String], &[String]),
    now: u64,
) -> Vec<TakenRun> {
    let (home, choice, applied) =
        (tempfile::tempdir().unwrap(), choice(profile, "z", without), Applied::AsLogged);
    let files = rig::logs(home.path(), logs);
    let uses = uses::of_identify(profile, &choice, &applied);
    let dataset = Dataset::read(&files, &Split::default(), &units(profile), &uses).unwrap();
    let in_use = InUse::of(profile, "z").unwrap();
    learning
        .take(profile, dataset, (&choice, Some(&in_use)), Some(Moment::from_nanos(now * 1_000_000_000)))
        .unwrap()
}

fn nothing() -> Learning {
    Learning::restore("z", Vec::new(), None).0
}

/// Midnight after a day.
fn after(number: u64) -> u64 {
    FIRST + (number + 1) * A_DAY
}

#[test]
fn a_candidate_is_learned_day_by_day_judged_before_and_better_than_a_poor_model() {
    let (profile, days) = (profile(POOR), machine_days(9, 71));
    let mut learning = nothing();
    let mut judged = 0;
    for (number, day) in (0..).zip(&days) {
        let taken = take(&mut learning, &profile, &[log(number, day, None)], after(number));
        assert_eq!(taken.len(), 1, "{taken:?}");
        assert_eq!((taken[0].touches, taken[0].skipped.as_deref()), (Some(6), None), "{taken:?}");
        judged += usize::from(taken[0].judged.is_some());
    }
    assert_eq!((learning.runs(), judged), (9, 8), "the first day has no candidate");
    let gain = learning.judgement().gain().unwrap();
    assert_eq!((gain.days, gain.touches), (5, 30));
    assert!(learning.judgement().is_better(), "{gain:?}");
    assert!(gain.candidate.get() < 0.8 * gain.in_use.get(), "{gain:?}");
    // The block has the expected error of the model before it.
    let candidate = learning.candidate().unwrap();
    let block = learning.block(&candidate, InUse::of(&profile, "z").ok().as_ref());
    assert!(block.contains("since_datum = [1.0, 2.0], since_touch = [0.5, 0.2]"), "{block}");
    rig::pasted(&text(&block), &[]);
}

#[test]
fn a_model_that_is_right_stays() {
    let (profile, days) = (profile(TRUE), machine_days(7, 73));
    let mut learning = nothing();
    for (number, day) in (0..).zip(&days) {
        take(&mut learning, &profile, &[log(number, day, None)], after(number));
    }
    let gain = learning.judgement().gain().unwrap();
    assert!(gain.in_use.get() < 0.5 && !learning.judgement().is_better(), "{gain:?}");
}

#[test]
fn stored_runs_give_the_same_candidate_and_no_run_is_learned_twice() {
    let (profile, days) = (profile(POOR), machine_days(4, 79));
    let logs: Vec<String> = (0..).zip(&days).map(|(number, day)| log(number, day, None)).collect();
    let mut learning = nothing();
    assert_eq!(take(&mut learning, &profile, &logs[..3], after(2)).len(), 3);
    let files: Vec<(String, Vec<u8>)> =
        learning.new_files(&[]).unwrap().into_iter().map(|(name, text)| (name, text.into_bytes())).collect();
    assert!(files.iter().all(|(name, _)| Learning::is_run("z", name) && !Learning::is_run("y", name)));
    let record = learning.record().unwrap();
    let (mut restored, wrong) = Learning::restore("z", files.clone(), Some(record.as_bytes()));
    assert_eq!((wrong, restored.candidate()), (Vec::new(), learning.candidate()));
    assert_eq!(restored.judgement(), learning.judgement());
    // The days that are known are read again with the new one.
    let taken = take(&mut restored, &profile, &logs[1..], after(3));
    assert_eq!((taken.len(), restored.runs()), (1, 4), "{taken:?}");
    let known: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
    assert_eq!(restored.new_files(&known).unwrap().len(), 1);
    // Changed files are rejected, and the others are used.
    let mut changed = files.clone();
    changed[0].1 =
        String::from_utf8(changed[0].1.clone()).unwrap().replacen("\"rows\":", "\"rows\":1", 1).into_bytes();
    // The candidate from the other runs is another one, which no day has judged.
    let (partly, wrong) = Learning::restore("z", changed.clone(), Some(record.as_bytes()));
    assert_eq!((partly.runs(), partly.judgement().days().len(), wrong.len()), (2, 0, 1), "{wrong:?}");
    let damaged = record.replacen("\"touches\":", "\"touches\":1", 1);
    let (partly, wrong) = Learning::restore("z", changed, Some(damaged.as_bytes()));
    assert_eq!((partly.runs(), wrong.len()), (2, 2), "{wrong:?}");
    assert!(wrong.iter().all(|why| why.contains("the checksum is wrong")), "{wrong:?}");
}

#[test]
fn a_candidate_with_other_inputs_is_judged_anew() {
    let (profile, days) = (profile(POOR), machine_days(5, 103));
    let logs: Vec<String> = (0..).zip(&days).map(|(number, day)| log(number, day, None)).collect();
    let mut learning = nothing();
    take(&mut learning, &profile, &logs[..3], after(2));
    assert_eq!(learning.judgement().days().len(), 2);
    // The model in use has this input, and is compared nevertheless.
    let without = ["s1".to_owned()];
    let mut take = |number: u64| {
        let log = &logs[usize::try_from(number).unwrap()..][..1];
        take_without(&mut learning, &profile, (log, &without), after(number));
        (learning.judgement().days().len(), learning.unlike())
    };
    assert_eq!((take(3), take(4)), ((0, 3), (1, 3)));
}

#[test]
fn a_run_that_may_go_on_is_learned_when_it_is_complete() {
    let (profile, days) = (profile(POOR), machine_days(1, 83));
    let whole = log(0, &days[0], None);
    // The log ends while the machine is on.
    let part: String = whole.lines().take(1 + 300).map(|line| format!("{line}\n")).collect();
    let mut learning = nothing();
    assert!(take(&mut learning, &profile, std::slice::from_ref(&part), FIRST + 300 * 60).is_empty());
    // The machine is off at the end of the whole log.
    assert_eq!(take(&mut learning, &profile, &[whole], FIRST + 420 * 60).len(), 1);
    // An hour after the last row, a run is complete in any case.
    assert_eq!(take(&mut nothing(), &profile, &[part], FIRST + 361 * 60).len(), 1);
}

#[test]
fn each_run_is_learned_although_the_machine_is_on_at_the_end_of_each_log() {
    let home = tempfile::tempdir().unwrap();
    let state = home.path().join("state");
    std::fs::create_dir(&state).unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    let days = machine_days(6, 107);
    for (number, day) in (0..).zip(&days) {
        // The main switch turns off the machine and the gateway.
        let log: String =
            log(number, day, None).lines().take(1 + 390).map(|line| format!("{line}\n")).collect();
        std::fs::write(state.join(format!("bench-2026-01-{:02}.csv", 5 + number)), log).unwrap();
    }
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && said.contains("axis z: 6 runs new, candidate from 6 runs"), "{said}");
}

#[test]
fn a_chip_under_the_probe_is_not_learned_from() {
    let (profile, days) = (profile(TRUE), machine_days(4, 89));
    let mut learning = nothing();
    for (number, day) in (0..).zip(&days) {
        let wrong = (number == 3).then_some(3 * HOUR);
        let taken = take(&mut learning, &profile, &[log(number, day, wrong)], after(number));
        let doubted = usize::from(number == 3);
        assert_eq!((taken[0].touches, taken[0].doubted), (Some(6 - doubted), doubted), "{taken:?}");
    }
    let gain = learning.judgement().gain().unwrap();
    assert!(gain.in_use.get() < 0.5, "the wrong touch judges no model: {gain:?}");
}

#[test]
fn a_day_on_which_another_part_was_probed_is_named_and_not_learned_from() {
    let (profile, days) = (profile(TRUE), machine_days(2, 109));
    let mut learning = nothing();
    take(&mut learning, &profile, &[log(0, &days[0], None)], after(0));
    let mut other = days[1].clone();
    other.error[31..].iter_mut().for_each(|error| *error += 300.0);
    let taken = take(&mut learning, &profile, &[log(1, &other, None)], after(1));
    assert_eq!((taken[0].touches, taken[0].doubted, taken[0].judged), (Some(0), 6, None), "{taken:?}");
    let why = taken[0].skipped.as_deref().unwrap_or_default();
    assert!(why.starts_with("all touches of the run (6) were rejected as wrong"), "{taken:?}");
    assert_eq!(learning.runs(), 1);
}

#[test]
fn another_model_in_use_begins_the_judgement_again_and_a_faulty_day_is_left_out() {
    let days = machine_days(5, 97);
    let logs: Vec<String> = (0..).zip(&days).map(|(number, day)| log(number, day, None)).collect();
    let mut learning = nothing();
    take(&mut learning, &profile(POOR), &logs[..3], after(2));
    assert_eq!(learning.judgement().days().len(), 2);
    take(&mut learning, &profile(TRUE), &logs[3..4], after(3));
    assert_eq!(learning.judgement().days().len(), 1);
    let mut faulty = days[4].clone();
    // Missing in more than a fifth of the rows.
    faulty.temperatures[3][100..300].fill(f64::NAN);
    let text = log(4, &faulty, None).replace("NaN", "");
    let taken = take(&mut learning, &profile(TRUE), &[text], after(4));
    assert!(taken[0].skipped.as_ref().is_some_and(|why| why.contains("s3")), "{taken:?}");
    assert_eq!(learning.runs(), 4);
}

/// Runs `isotherm learn`. Returns its output, and whether it succeeded.
fn learn(home: &Path, arguments: &[&str]) -> (String, bool) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home).current_dir(home);
    command.args(["learn", "bench.toml", "--state", "state"]).args(arguments);
    let ended = command.output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (said, ended.status.success())
}

#[test]
fn the_verb_learns_from_the_logs_of_the_state_directory_and_keeps_the_runs_when_the_logs_are_gone() {
    let home = tempfile::tempdir().unwrap();
    let state = home.path().join("state");
    std::fs::create_dir(&state).unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    let days = machine_days(6, 101);
    for (number, day) in (0..).zip(&days) {
        let name = format!("bench-2026-01-{:02}.csv", 5 + number);
        // A power cut leaves a part of a row, and an empty file.
        let cut_off = if number == 2 { "1767765600,1,20." } else { "" };
        std::fs::write(state.join(name), log(number, day, None) + cut_off).unwrap();
    }
    std::fs::write(state.join("bench-2026-01-07.2.csv"), "").unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(said.contains("bench-2026-01-07.2.csv"), "{said}");
    assert!(is_good && said.contains("axis z: 6 runs new, candidate from 6 runs"), "{said}");
    assert!(
        said.contains("proposed: the candidate would have left") && said.contains("touches: 6"),
        "{said}"
    );
    assert!(said.contains("; --write MODEL.toml writes it"), "{said}");
    let daily = text(POOR).replacen("q = 400.0", "q = 400.0\nlearn = \"daily\"", 1);
    std::fs::write(home.path().join("bench.toml"), &daily).unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && said.contains("; `isotherm adopt` adopts it"), "{said}");
    for entry in std::fs::read_dir(&state).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "csv") {
            std::fs::remove_file(path).unwrap();
        }
    }
    let (said, is_good) = learn(home.path(), &["--axis", "z", "--write", "z.toml", "--json"]);
    assert!(is_good, "{said}");
    let document: Value = serde_json::from_str(&said).unwrap();
    let axis = &document["axes"][0];
    assert_eq!((axis["runs"].as_u64(), axis["proposed"].as_bool()), (Some(6), Some(true)), "{axis}");
    assert_eq!(axis["new"], Value::Array(Vec::new()));
    assert!(state.join("bench.products/z.candidate.json").is_file(), "the gateway may adopt it");
    let block = std::fs::read_to_string(home.path().join("z.toml")).unwrap();
    assert!(block.contains("[[axis.z.model]]\nname = \"learned-2026-01-10-"), "{block}");
    // The block is the model in use now. It is not judged yet, so that nothing is proposed.
    std::fs::write(home.path().join("bench.toml"), text(&block)).unwrap();
    let (said, is_good) = learn(home.path(), &["--axis", "z", "--write", "again.toml"]);
    assert!(!is_good && said.contains("again.toml is not written"), "{said}");
    assert!(!home.path().join("again.toml").exists());
}

#[test]
fn an_unusable_file_of_a_run_is_named_and_a_lost_run_is_learned_again_from_its_log() {
    let home = tempfile::tempdir().unwrap();
    let (state, products) = (home.path().join("state"), home.path().join("state/bench.products"));
    std::fs::create_dir(&state).unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    let days = machine_days(4, 109);
    for (number, day) in (0..).zip(&days) {
        std::fs::write(state.join(format!("bench-2026-01-{:02}.csv", 5 + number)), log(number, day, None))
            .unwrap();
    }
    learn(home.path(), &[]);
    let unreadable = "z@2026-01-01T00:30:00Z.products.json";
    std::fs::create_dir(products.join(unreadable)).unwrap();
    let lost = products.join("z@2026-01-06T00:30:00Z.products.json");
    assert!(lost.is_file());
    std::fs::write(&lost, "").unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && said.contains(unreadable) && said.contains("z@2026-01-06T00:30:00Z"), "{said}");
    assert!(said.contains("1 run new, candidate from 4 runs"), "{said}");
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && !said.contains("z@2026-01-06T00:30:00Z"), "{said}");
    assert!(said.contains("0 runs new, candidate from 4 runs"), "{said}");
}

#[test]
fn a_copy_of_a_recorded_day_under_another_name_is_not_learned_again() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    let files = rig::logs(home.path(), &[days(1, 113, 0.0)[0].log()]);
    let copy = home.path().join("copy.csv");
    std::fs::copy(&files[0], &copy).unwrap();
    let (said, is_good) = learn(home.path(), &[&files[0].display().to_string()]);
    assert!(is_good && said.contains("1 run new, candidate from 1 run"), "{said}");
    let (said, is_good) = learn(home.path(), &[&copy.display().to_string()]);
    assert!(is_good && said.contains("not used: this run has the same rows as the run in z@"), "{said}");
    assert!(said.contains("candidate from 1 run"), "{said}");
    let (said, _) = learn(home.path(), &[&files[0].display().to_string()]);
    assert!(said.contains("the named logs have no new run"), "{said}");
}

#[test]
fn logs_that_are_older_than_named_touches_are_counted() {
    let home = tempfile::tempdir().unwrap();
    let state = home.path().join("state");
    std::fs::create_dir(&state).unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    for (number, day) in (0..).zip(&machine_days(3, 131)) {
        std::fs::write(state.join(format!("bench-2026-01-{:02}.csv", 5 + number)), log(number, day, None))
            .unwrap();
    }
    std::fs::copy(state.join("bench-2026-01-07.csv"), home.path().join("copy.csv")).unwrap();
    let (said, is_good) = learn(home.path(), &["copy.csv"]);
    assert!(is_good && said.contains("candidate from 1 run") && said.contains("not used: 2 days"), "{said}");
}

#[test]
fn the_reason_is_given_if_there_is_nothing_to_learn_from() {
    let home = tempfile::tempdir().unwrap();
    let state = home.path().join("state");
    std::fs::create_dir(&state).unwrap();
    std::fs::write(home.path().join("bench.toml"), text(POOR)).unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && said.contains("there is no log of bench in state"), "{said}");
    let untouched: String =
        log(0, &machine_days(1, 127)[0], None).lines().take(1 + 40).map(|line| format!("{line}\n")).collect();
    std::fs::write(state.join("bench-2026-01-05.csv"), untouched).unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(is_good && said.contains("1 day in state have no complete run with touches"), "{said}");
}

#[test]
fn an_axis_that_does_not_exist_or_has_no_probe_is_named() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("bench.toml"), rig::profile_with(4, POOR)).unwrap();
    let (said, is_good) = learn(home.path(), &[]);
    assert!(!is_good && said.contains("no axis of the profile has a probe"), "{said}");
    let (said, is_good) = learn(home.path(), &["--axis", "q"]);
    assert!(!is_good && said.contains("no axis q") && said.contains('z'), "{said}");
}
