//! Touches of a probe as measured errors: in logs of the gateway, in other logs, and together with commissioning runs.

use std::fmt::Write;

use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::{BadLog, Dataset, Split};
use isotherm_identify::drift::drift;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{ready, units, without_cz};
use isotherm_identify::{Identified, identify, uses};
use isotherm_profile::Profile;

use super::command;
use super::rig::{self, Day, choice};
use super::whitened::{days, logs};

/// Rows between two touches: an hour.
const HOUR: usize = 60;

/// Cz that acts in a row, µm. It does not follow from the temperatures.
fn cz(row: usize) -> f64 {
    f64::from(u32::try_from(row % 97).unwrap()) / 10.0
}

/// Whether the machine is probed in this row.
fn is_touch(row: usize) -> bool {
    row > 0 && row.is_multiple_of(HOUR)
}

/// Log of the gateway of these days without a pause, with touches only. `memory` is the state before the first row.
/// The machine is off in the first 30 rows of each day, if the log has its signal.
fn gateway(days: &[Day], memory: &str, zeros: &[usize]) -> String {
    let mut log =
        "time,running,s0,s1,s2,s3,z_permit,z_from_um,z_raw_um,z_cz_um,z_model,z_state,z_acted,z_measured_um,\
                   z_acting_um,z_correction_um,machine_memory,machine_zero\n"
            .to_owned();
    let rows = days.iter().flat_map(|day| (0..day.times.len()).map(move |row| (day, row)));
    for (place, (day, row)) in rows.enumerate() {
        let touch = match is_touch(row) && row > 30 {
            true => format!("{},{}", day.error[row] - day.error[0] + cz(row), cz(row)),
            false => ",".to_owned(),
        };
        let sensors: Vec<String> = day.temperatures.iter().map(|sensor| sensor[row].to_string()).collect();
        let state = if place == 0 { memory } else { "" };
        let zero = if zeros.contains(&place) { "1970-01-01T00:00:00Z z" } else { "" };
        let from = if place == 0 { "0" } else { "" };
        writeln!(
            log,
            "{},{},{},armed,{from},{},{},m,active,,{touch},0,\"{}\",{zero}",
            place * 60,
            u8::from(row >= 30),
            sensors.join(","),
            cz(row),
            cz(row),
            state.replace('"', "\"\"")
        )
        .unwrap();
    }
    log
}

/// Value of a column in a row of a day.
type Cell<'a> = &'a dyn Fn(&Day, usize) -> String;

/// Log from elsewhere with these columns after the temperatures; each is a function of the day and the row.
fn elsewhere(day: &Day, columns: &[(&str, Cell)]) -> String {
    let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
    let mut log = format!("time,s0,s1,s2,s3,{}\n", names.join(","));
    for row in 0..day.times.len() {
        let sensors: Vec<String> = day.temperatures.iter().map(|sensor| sensor[row].to_string()).collect();
        let more: Vec<String> = columns.iter().map(|(_, of)| of(day, row)).collect();
        writeln!(log, "{},{},{}", day.times[row], sensors.join(","), more.join(",")).unwrap();
    }
    log
}

fn measured(day: &Day, row: usize) -> String {
    if is_touch(row) { (day.error[row] - day.error[0] + cz(row)).to_string() } else { String::new() }
}

fn acting(_: &Day, row: usize) -> String {
    if is_touch(row) { cz(row).to_string() } else { String::new() }
}

fn profile(model: &str) -> Profile {
    let running = "[signal.running]\ndevice = \"m\"\nregister = \"input:90\"\ntype = \"u16\"\nunit = \"bool\"\nmax_age = \"5s\"\n";
    let text = rig::profile_with(4, &format!("{model}{running}"));
    rig::parsed(std::path::Path::new("bench.toml"), &text)
}

/// Reads these logs as `isotherm identify` does, with the touches as errors.
fn read(profile: &Profile, texts: &[String], applied: &Applied) -> Result<Dataset, BadLog> {
    let (home, choice) = (tempfile::tempdir().unwrap(), choice());
    let files = rig::logs(home.path(), texts);
    let uses = uses::of_identify(profile, &choice, applied);
    let mut dataset = Dataset::read(&files, &Split::default(), &units(profile), &uses)?;
    without_cz(profile, &mut dataset, &choice, applied)?;
    Ok(dataset)
}

fn by(profile: &Profile, texts: &[String]) -> Identified {
    let dataset = read(profile, texts, &Applied::AsLogged).unwrap();
    let ready = ready(profile, &dataset, &choice()).unwrap();
    identify(&ready, &Settings::default(), None, false, &|_, _| {}).unwrap()
}

#[test]
fn touches_without_any_commissioning_give_a_model_that_explains_most_of_other_days() {
    let days = days(8, 41, 0.0);
    let texts: Vec<String> = days.iter().map(|day| gateway(std::slice::from_ref(day), "", &[])).collect();
    let found = by(&profile(rig::NO_MODEL), &texts);
    assert_eq!(found.runs.len(), 8);
    assert!(found.runs.iter().all(|run| run.touches == Some(6)), "{:?}", found.runs);
    let (left, before) = (found.means.mean_rmse_um, found.uncompensated.mean_rmse_um);
    assert!(left < 0.75 * before, "{left} µm of {before} µm");
    assert!(found.expected.is_some() && found.expected_missing.is_none());
    let touches = found.columns.iter().filter(|column| column.used == "touches");
    assert_eq!(touches.count(), 2, "{:?}", found.columns);
}

#[test]
fn commissioning_runs_and_touches_are_used_together_and_the_ranges_of_touches_are_marked() {
    let days = days(6, 43, 1.0);
    let mut texts = logs(&days[..3]);
    texts.extend(days[3..].iter().map(|day| gateway(std::slice::from_ref(day), "", &[])));
    let found = by(&profile(rig::NO_MODEL), &texts);
    let touches: Vec<Option<usize>> = found.runs.iter().map(|run| run.touches).collect();
    assert_eq!(touches, [None, None, None, Some(6), Some(6), Some(6)]);
    assert_eq!((found.runs[0].mark().as_str(), found.runs[3].mark().as_str()), ("", " (× 1.3)"));
    let remarks = found.notes.remarks.join("; ");
    assert!(remarks.contains("3 of 6 runs were measured by touches"), "{remarks}");
    assert!(
        !remarks.contains("The Cz was removed"),
        "the Cz at a touch is removed from that touch: {remarks}"
    );
    let home = tempfile::tempdir().unwrap();
    let (said, is_good) = command::identify(
        home.path(),
        &rig::profile_with(4, rig::NO_MODEL),
        &texts,
        &["--write", "z.toml", "--report", "z.html"],
    );
    assert!(is_good && said.contains("(× 1.3), 6 touches"), "{said}");
    assert!(said.contains("touches z_measured_um (displacement), z_acting_um (displacement)"), "{said}");
    let [block, page] =
        ["z.toml", "z.html"].map(|name| std::fs::read_to_string(home.path().join(name)).unwrap());
    assert!(
        block.contains("3 of these runs were measured by touches") && page.contains("(× 1.3)"),
        "{block}"
    );
}

#[test]
fn the_cz_that_acted_at_a_touch_is_removed_whoever_wrote_the_log() {
    let days = days(4, 47, 0.0);
    let bare = |day: &Day| {
        let error = |day: &Day, row: usize| match is_touch(row) {
            true => (day.error[row] - day.error[0]).to_string(),
            false => String::new(),
        };
        elsewhere(day, &[("z_measured_um", &error)])
    };
    let named = |day: &Day| elsewhere(day, &[("z_measured_um", &measured), ("z_acting_um", &acting)]);
    let profile = profile(rig::NO_MODEL);
    let gains = |of: &dyn Fn(&Day) -> String| -> Vec<f64> {
        let texts: Vec<String> = days.iter().map(of).collect();
        by(&profile, &texts).terms.iter().map(|term| term.gain).collect()
    };
    let (without, with) = (gains(&bare), gains(&named));
    assert_eq!(without.len(), with.len());
    for (one, other) in without.iter().zip(&with) {
        assert!((one - other).abs() < 1e-6 * (1.0 + one.abs()), "{one} {other}");
    }
    // Without the Cz of each touch, a Cz that changed must be named.
    let cz_um = |_: &Day, row: usize| cz(row).to_string();
    let unknown = |day: &Day| elsewhere(day, &[("z_measured_um", &measured), ("z_cz_um", &cz_um)]);
    let texts: Vec<String> = days.iter().map(unknown).collect();
    let why = read(&profile, &texts, &Applied::AsLogged).unwrap_err().to_string();
    assert!(why.contains("--cz z_cz_um") && why.contains("z_acting_um"), "{why}");
    let named = Applied::Column("z_cz_um".to_owned());
    let dataset = read(&profile, &texts, &named).unwrap();
    let error = dataset.column("z_error_um").unwrap();
    let (day, run) = (&days[0], &dataset.runs[0]);
    assert!((run.values[error].at(HOUR) - (day.error[HOUR] - day.error[0])).abs() < 1e-9);
    let missing = read(&profile, &texts, &Applied::Column("cz".to_owned())).unwrap_err().to_string();
    assert!(missing.contains("`cz`"), "{missing}");
}

#[test]
fn files_of_one_gateway_are_one_record_which_each_machine_start_divides() {
    let days = days(3, 53, 0.0);
    let text = gateway(&days, "", &[]);
    let (head, rows) = text.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    // The second file begins in the middle of the second day, while the machine is on.
    let cut = 420 + 200;
    let on = "{\"on_since\":25200000000000,\"was_on\":true}";
    let second = rows[cut].replace(",\"\",", &format!(",\"{}\",", on.replace('"', "\"\"")));
    let second_file = [&[second.as_str()][..], &rows[cut + 1..]].concat().join("\n");
    let texts = vec![format!("{head}\n{}\n", rows[..cut].join("\n")), format!("{head}\n{second_file}\n")];
    let machine = rig::profile_with(4, rig::NO_MODEL)
        .replace("settle = \"3min\"", "settle = \"3min\"\non = \"running\"");
    let machine = machine
        + "[signal.running]\ndevice = \"m\"\nregister = \"input:90\"\ntype = \"u16\"\nunit = \"bool\"\nmax_age = \"5s\"\n";
    let profile = rig::parsed(std::path::Path::new("bench.toml"), &machine);
    let dataset = read(&profile, &texts, &Applied::AsLogged).unwrap();
    let rows: Vec<usize> = dataset.runs.iter().map(|run| run.times.len()).collect();
    // Each day begins with 30 rows in which the machine is off. They belong to no run.
    assert_eq!(rows, [390, 390, 390], "{:?}", dataset.runs.iter().map(|run| &run.name).collect::<Vec<_>>());
    let whole = read(&profile, &[text], &Applied::AsLogged).unwrap();
    for (joined, whole) in dataset.runs.iter().zip(&whole.runs) {
        assert_eq!((&joined.times, joined.values.len()), (&whole.times, whole.values.len()));
    }
}

#[test]
fn after_a_zero_that_the_axis_uses_errors_and_rises_count_from_it() {
    let mut all = days(8, 59, 0.0);
    let zero = 200;
    // A zero at this row takes the error of that moment away.
    for day in &mut all {
        let at = day.error[zero];
        day.error[zero..].iter_mut().for_each(|error| *error -= at);
        day.error[0] = 0.0;
    }
    let texts: Vec<String> = all.iter().map(|day| gateway(std::slice::from_ref(day), "", &[zero])).collect();
    let zeroed = rig::profile_with(4, rig::NO_MODEL).replace("[axis.z]\n", "[axis.z]\ndatum = \"zero\"\n");
    let zeroed = rig::parsed(std::path::Path::new("bench.toml"), &zeroed);
    let found = by(&zeroed, &texts);
    // Each day has a run before the zero, and one after it.
    assert_eq!(found.runs.len(), 16, "{:?}", found.runs);
    let (left, before) = (found.means.mean_rmse_um, found.uncompensated.mean_rmse_um);
    assert!(left < 0.75 * before, "{left} µm of {before} µm");
    let ignored = by(&profile(rig::NO_MODEL), &texts);
    assert_eq!(ignored.runs.len(), 8, "no datum of this axis");
}

#[test]
fn a_record_that_begins_on_a_warm_machine_counts_from_its_first_touch() {
    let days = days(4, 61, 0.0);
    let warm = "{\"on_since\":1,\"was_on\":true}";
    let shifted = |day: &Day| {
        let mut day = day.clone();
        // The error since the datum is not in the log.
        day.error[1..].iter_mut().for_each(|error| *error += 25.0);
        gateway(&[day], warm, &[])
    };
    let texts: Vec<String> = days.iter().map(shifted).collect();
    let found = by(&profile(rig::NO_MODEL), &texts);
    let touches: Vec<Option<usize>> = found.runs.iter().map(|run| run.touches).collect();
    assert_eq!(touches, [Some(5); 4], "the first touch is the zero");
    let held = &found.held_out[0];
    assert_eq!(held.error.first(), Some(&0.0));
}

#[test]
fn an_expected_error_that_is_missing_has_a_reason() {
    let profile = profile(rig::NO_MODEL);
    for count in [1, 2] {
        let found = by(&profile, &logs(&days(count, 67, 1.0)));
        assert!(found.expected.is_none());
        assert!(found.expected_missing.is_some_and(|why| why.contains("three runs")), "{count}");
    }
    let found = by(&profile, &logs(&days(3, 67, 1.0)));
    assert!(found.expected.is_some() && found.expected_missing.is_none());
    let home = tempfile::tempdir().unwrap();
    let bench = rig::profile_with(4, rig::NO_MODEL);
    let one = logs(&days(1, 67, 1.0));
    let (said, is_good) =
        command::identify(home.path(), &bench, &one, &["--write", "z.toml", "--report", "z.html"]);
    assert!(
        is_good && said.contains("expected error: not known, because at least three runs are needed"),
        "{said}"
    );
    let [block, page] =
        ["z.toml", "z.html"].map(|name| std::fs::read_to_string(home.path().join(name)).unwrap());
    assert!(
        block.contains("# The expected error is not known: at least three runs are needed")
            && page.contains("Not known: at least three runs are needed")
    );
}

#[test]
fn a_report_of_a_log_of_the_gateway_is_about_the_measured_error_and_counts_its_touches() {
    let (directory, profile, applied) =
        (tempfile::tempdir().unwrap(), profile(rig::NO_MODEL), Applied::AsLogged);
    let text = gateway(&days(1, 59, 0.0), "", &[]);
    // A gateway with other keys has more columns. A column without values is no unusable displacement.
    let mut lines = text.lines();
    let mut log =
        format!("{},z_behind_um,z_return_um,z_expected_um,z_worse,machine_clock\n", lines.next().unwrap());
    lines.for_each(|line| log += &format!("{line},,,1.5,,\n"));
    let (files, units) = (rig::logs(directory.path(), &[log]), units(&profile));
    let uses = uses::of_report(&[], &applied, &units);
    let dataset = Dataset::read(&files, &Split::default(), &units, &uses).unwrap();
    let drifts = drift(&dataset, &[], None, &units).unwrap();
    let names: Vec<&str> = drifts[0].displacements.iter().map(|moved| moved.name.as_str()).collect();
    assert_eq!(names, ["z_measured_um"]);
    let remarks = drifts[0].remarks.join("; ");
    assert!(remarks.contains("would give a range that is about 1.3 times"), "{remarks}");
}
