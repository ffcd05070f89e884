//! The verbs as a new user runs them: help, exit codes, and error messages.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::Write;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use serde_json::Value;

use crate::support::process;

use process::{PATIENCE, Running, file, free_port, isotherm};

const MACHINE: &str = include_str!("../interop/machine.toml");

pub(super) const VERBS: &[&str] = &[
    "demo",
    "run",
    "check",
    "read",
    "scan",
    "virtual",
    "record",
    "replay",
    "identify",
    "learn",
    "select",
    "place",
    "report",
    "logs",
    "arm",
    "disarm",
    "zero",
    "measured",
    "confirm",
    "adopt",
    "release",
    "trace",
    "schema",
    "completions",
    "man",
    "events",
    #[cfg(feature = "parquet")]
    "export",
    "status",
    "init",
    "sign",
    "restart",
    "backup",
    "restore",
    #[cfg(feature = "opcua")]
    "opcua",
    "token",
];

/// Result of a verb.
pub(super) struct Ended {
    pub(super) code: Option<i32>,
    pub(super) out: String,
    pub(super) said: String,
}

pub(super) fn ended(command: &mut Command) -> Ended {
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ended { code: status.code(), out: text(stdout), said: text(stderr) }
}

fn run(arguments: &[&str]) -> Ended {
    let home = tempfile::tempdir().unwrap();
    ended(isotherm(home.path()).args(arguments))
}

/// The machine of the interop tests, with a separate port.
pub(super) fn machine(directory: &Path) -> (String, String) {
    let address = format!("127.0.0.1:{}", free_port());
    (MACHINE.replace("127.0.0.1:1\"", &format!("{address}\"")), directory.display().to_string())
}

fn devices(home: &Path, profile: &Path) -> Running {
    let mut devices = Running::start(isotherm(home).arg("virtual").arg(profile));
    devices.receives("stop with Ctrl-C");
    devices
}

#[test]
fn the_help_of_each_verb_has_an_example() {
    let all = run(&["--help"]);
    assert_eq!(all.code, Some(0));
    for verb in VERBS.iter().copied() {
        assert!(all.out.lines().any(|line| line.trim_start().starts_with(verb)), "{verb} is not in --help");
        let help = run(&[verb, "--help"]);
        assert_eq!(help.code, Some(0), "{verb}");
        assert!(help.out.contains(&format!("  isotherm {verb}")), "{verb} has no example:\n{}", help.out);
    }
    let commands = all.out.split("Commands:").nth(1).unwrap().split("\n\n").next().unwrap();
    // The description of a verb may have more than one line.
    let is_verb = |line: &&str| line.starts_with("  ") && !line.starts_with("   ");
    assert_eq!(commands.lines().filter(is_verb).count(), VERBS.len() + 1, "and help");
}

#[test]
fn wrong_arguments_are_code_2_and_tell_what_is_allowed() {
    for (arguments, word) in [
        (&["demmo"][..], "demo"),
        (&["demo", "--speed", "0"], "above 0"),
        (&["run"], "PROFILE"),
        (&["check", "x.toml", "--set", "bus.cell.address"], "KEY=VALUE"),
        (&["completions", "tcsh"], "bash"),
    ] {
        let ended = run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}");
        assert!(ended.said.contains(word), "{arguments:?}: {}", ended.said);
    }
}

#[test]
fn a_wrong_profile_is_code_64_with_every_error_at_its_place() {
    let home = tempfile::tempdir().unwrap();
    let text = MACHINE
        .replace("limit    = 40.0", "limit    = -40.0")
        .replace("deadband = 0.0", "dedband = 0.0")
        .replace("word_order = \"lsw-first\"\n", "");
    let profile = file(home.path(), "wrong.toml", &text);
    let line = |part: &str| text.lines().position(|line| line.contains(part)).unwrap() + 1;
    let ended_in_words = ended(isotherm(home.path()).arg("check").arg(&profile));
    assert_eq!((ended_in_words.code, ended_in_words.out.as_str()), (Some(64), ""));
    for (part, words) in [("limit    = -40.0", "axis.z.limit"), ("dedband", "did you mean `deadband`?")] {
        let place = format!("wrong.toml:{}:", line(part));
        assert!(ended_in_words.said.contains(&place), "{place} in {}", ended_in_words.said);
        assert!(ended_in_words.said.contains(words), "{words} in {}", ended_in_words.said);
    }
    assert!(ended_in_words.said.contains("signal.scale_z.word_order"), "{}", ended_in_words.said);
    let document = ended(isotherm(home.path()).arg("check").arg(&profile).arg("--json"));
    assert_eq!(document.code, Some(64));
    let errors: Value = serde_json::from_str(&document.out).unwrap();
    let keys: Vec<&str> =
        errors.as_array().unwrap().iter().filter_map(|error| error["key"].as_str()).collect();
    assert!(keys.contains(&"axis.z.limit") && keys.contains(&"signal.scale_z.word_order"), "{keys:?}");
    for verb in ["run", "read", "virtual", "arm"] {
        let refused = ended(isotherm(home.path()).arg(verb).arg(&profile));
        assert_eq!(refused.code, Some(64), "{verb}: {}", refused.said);
    }
    assert_eq!(run(&["check", "not-there.toml"]).code, Some(64));
}

#[test]
fn a_later_layer_wins() {
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "machine.toml", MACHINE);
    let address = |command: &mut Command| {
        let ended = ended(command.arg("check").arg(&profile).arg("--json"));
        let document: Value = serde_json::from_str(&ended.out).unwrap_or_else(|_| panic!("{}", ended.said));
        document["buses"][0]["address"].as_str().unwrap().to_owned()
    };
    assert_eq!(address(&mut isotherm(home.path())), "127.0.0.1:1");
    file(home.path(), "machine.local.toml", "[bus.cell]\naddress = \"127.0.0.1:2\"\n");
    assert_eq!(address(&mut isotherm(home.path())), "127.0.0.1:2");
    let variable = ("ISOTHERM__BUS__CELL__ADDRESS", "127.0.0.1:3");
    assert_eq!(address(isotherm(home.path()).env(variable.0, variable.1)), "127.0.0.1:3");
    let set = ["--set", "bus.cell.address=127.0.0.1:4"];
    let mut all = isotherm(home.path());
    let ended = ended(all.env(variable.0, variable.1).arg("check").arg(&profile).arg("--json").args(set));
    assert!(ended.out.contains("127.0.0.1:4"), "{}{}", ended.out, ended.said);
}

#[test]
fn what_a_program_reads_can_be_read() {
    let schema: Value = serde_json::from_str(&run(&["schema"]).out).unwrap();
    assert!(schema["$schema"].as_str().is_some_and(|url| url.contains("json-schema.org")));
    let checked: Value = serde_json::from_str(&run(&["check", "surface-grinder", "--json"]).out).unwrap();
    assert_eq!(checked["machine"], "surface-grinder");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let completions = run(&["completions", shell]);
        assert!(completions.code == Some(0) && completions.out.contains("replay"), "{shell}");
    }
    assert!(run(&["man"]).out.starts_with(".ie"), "a manual page");
    let pages = tempfile::tempdir().unwrap();
    assert_eq!(run(&["man", "--dir", pages.path().to_str().unwrap()]).code, Some(0));
    for page in std::fs::read_dir(pages.path()).unwrap().map(|page| page.unwrap().path()) {
        let text = std::fs::read_to_string(&page).unwrap();
        let cited = text.split("isotherm\\-").skip(1).filter_map(|rest| rest.split_once("(1)"));
        for (verb, _) in cited.filter(|(verb, _)| verb.chars().all(|letter| letter.is_ascii_lowercase())) {
            assert!(
                pages.path().join(format!("isotherm-{verb}.1")).is_file(),
                "{verb} of {}",
                page.display()
            );
        }
    }
    assert!(VERBS.iter().all(|verb| pages.path().join(format!("isotherm-{verb}.1")).is_file()));
}

#[test]
fn a_short_demo_gives_one_json_document_the_same_for_the_same_seed() {
    let demo = || {
        run(&[
            "demo",
            "--json",
            "--for",
            "20min",
            "--speed",
            "100000",
            "--seed",
            "7",
            "--listen",
            "127.0.0.1:0",
        ])
    };
    let (first, second) = (demo(), demo());
    assert_eq!((first.code, first.said.as_str()), (Some(0), ""));
    let document: Value = serde_json::from_str(&first.out).unwrap();
    assert_eq!(document["machine"], "surface-grinder");
    assert_eq!(document["seed"], 7);
    assert!((document["machine_hours"].as_f64().unwrap() - 1.0 / 3.0).abs() < 0.01);
    assert!(document["axes"]["z"]["uncompensated_range_um"].is_f64());
    assert_eq!(first.out, second.out);
}

#[test]
fn an_unknown_machine_is_refused_with_the_known_ones() {
    let demo = run(&["demo", "lathe"]);
    assert_eq!(demo.code, Some(1));
    assert!(demo.said.contains("surface-grinder, sinker-edm"), "{}", demo.said);
}

#[test]
fn a_missing_gateway_and_a_page_open_to_the_network_are_reported_in_words() {
    let home = tempfile::tempdir().unwrap();
    for verb in ["arm", "disarm", "zero"] {
        let alone = ended(isotherm(home.path()).args([verb, "surface-grinder"]));
        assert_eq!(alone.code, Some(1), "{verb}");
        assert!(alone.said.contains("no gateway of this machine is running here"), "{}", alone.said);
        assert!(alone.said.contains("start it with `isotherm run`"), "{}", alone.said);
    }
    let measured = |more: &[&str]| {
        let verb = ["measured", "surface-grinder", "--axis", "z"];
        ended(isotherm(home.path()).args(verb).args(more))
    };
    for more in [&["--error", "-3.2"][..], &["--clear"]] {
        let alone = measured(more);
        assert_eq!(alone.code, Some(1), "{more:?}");
        assert!(alone.said.contains("no gateway of this machine is running here"), "{}", alone.said);
    }
    for more in [&["--error", "much"][..], &["--error", "NaN"], &["--error", "1", "--clear"], &[]] {
        assert_eq!(measured(more).code, Some(2), "{more:?}");
    }
    let open = ended(isotherm(home.path()).args(["run", "surface-grinder", "--listen", "0.0.0.0:0"]));
    assert_eq!(open.code, Some(1));
    assert!(open.said.contains("token_file"), "{}", open.said);
    file(home.path(), "token", "of sixteen characters and more");
    let token = home.path().join("token").display().to_string();
    std::fs::set_permissions(&token, std::os::unix::fs::PermissionsExt::from_mode(0o600)).unwrap();
    let web = format!("\n[web]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"{token}\"\n");
    let profile = file(home.path(), "machine.toml", &(machine(home.path()).0 + &web));
    let open = ended(isotherm(home.path()).arg("run").arg(&profile).args(["--listen", "0.0.0.0:0"]));
    assert_eq!(open.code, Some(1));
    assert!(open.said.contains("in plain text") && open.said.contains("`plain = true`"), "{}", open.said);
}

#[test]
fn reading_devices_that_are_not_there_is_a_failure_that_names_them() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let profile = file(home.path(), "machine.toml", &text);
    for arguments in [&["read"][..], &["check", "--online"]] {
        let read = ended(isotherm(home.path()).args(arguments).arg(&profile));
        assert_eq!(read.code, Some(1), "{}", read.out);
        assert!(read.said.contains("4 of 4 signals cannot be used: bed, "), "{}", read.said);
    }
}

#[test]
fn a_stopped_gateway_is_at_rest_remembers_and_its_log_replays_bit_for_bit() {
    let home = tempfile::tempdir().unwrap();
    let (text, state) = machine(home.path());
    let text = text + "\n[axis.z.probe]\nlimit = 10.0\nfilter = 0.5\nmax_error = 100.0\n";
    let profile = file(home.path(), "machine.toml", &text);
    let _devices = devices(home.path(), &profile);
    let mut gateway = isotherm(home.path());
    gateway.arg("run").arg(&profile).args(["--listen", "127.0.0.1:0", "--state", &state]);
    let mut gateway = Running::start(&mut gateway);
    gateway.receives("page http://127.0.0.1:");
    gateway.receives("axis z: armed, starting from 0.0 µm");
    let command = |verb: &str| ended(isotherm(home.path()).arg(verb).arg(&profile).args(["--state", &state]));
    let second = ended(isotherm(home.path()).arg("run").arg(&profile).args(["--state", &state]));
    assert_eq!(second.code, Some(1));
    assert!(second.said.contains("another gateway of this machine is running"), "{}", second.said);
    assert!(second.said.contains("end it first"), "{}", second.said);
    let off = command("disarm");
    assert!(off.code == Some(0) && off.out.contains("the registers keep their values"), "{}", off.said);
    gateway.receives("switched off by a person");
    assert_eq!(command("arm").code, Some(0));
    gateway.receives("axis z: armed");
    let measured = |more: &[&str]| {
        let verb =
            isotherm(home.path()).arg("measured").arg(&profile).args(["--state", &state]).args(more).output();
        String::from_utf8(verb.unwrap().stdout).unwrap()
    };
    // While the register is being written, the acting Cz is uncertain. The gateway then asks to measure again.
    let learns = || {
        let learned = measured(&["--axis", "z", "--error", "-0.5", "--json"]);
        let is_certain = learned.contains("z: error -0.5 µm, measured while a Cz of");
        std::thread::sleep(Duration::from_millis(if is_certain { 0 } else { 100 }));
        is_certain
    };
    assert!((0..100).any(|_| learns()), "{}", gateway.said.join("\n"));
    gateway.receives("axis z: probed -0.5 µm");
    assert!(measured(&["--axis", "z", "--clear"]).contains("is removed"));
    gateway.receives("the correction from probings is removed");
    std::thread::sleep(Duration::from_secs(3));
    gateway.signal("TERM");
    gateway.receives("stopping: the fault actions run; this takes at most");
    assert_eq!(gateway.ends_within(PATIENCE).code(), Some(0), "{}", gateway.said.join("\n"));
    assert!(gateway.said.join("\n").contains("stopped; cnc_z holds 0.0 µm"), "{}", gateway.said.join("\n"));
    assert!(home.path().join("interop.state.json").exists());

    let files = std::fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().path());
    let logs = files.filter(|path| path.extension().is_some_and(|end| end == "csv"));
    let (of_outputs, logs): (Vec<_>, Vec<_>) =
        logs.partition(|path| path.to_str().is_some_and(|path| path.ends_with(".outputs.csv")));
    assert!(!logs.is_empty() && logs.len() == of_outputs.len(), "{of_outputs:?}");
    for log in logs {
        let replay = ended(isotherm(home.path()).arg("replay").arg(&profile).arg(&log).arg("--json"));
        assert_eq!(replay.code, Some(0), "{}", replay.said);
        let document: Value = serde_json::from_str(&replay.out).unwrap();
        assert_eq!(document["axes"]["z"]["reproduced"]["differing"], 0, "{}", replay.out);
        assert!(document["axes"]["z"]["reproduced"]["rows"].as_u64().unwrap() > 3, "{}", replay.out);
        let out = home.path().join("replayed.out");
        let replay =
            ended(isotherm(home.path()).arg("replay").arg(&profile).arg(&log).arg("--out").arg(&out));
        assert!(replay.out.contains("bit for bit"), "{}", replay.out);
        let of_outputs = log.with_extension("outputs.csv");
        let alone = ended(isotherm(home.path()).arg("replay").arg(&profile).arg(&of_outputs));
        assert_eq!(alone.code, Some(0), "{}", alone.said);
        assert!(
            alone.out.contains("output cnc_z: the ") && alone.out.contains("of the log again"),
            "{}",
            alone.out
        );
        assert!(replay.out.ends_with(&alone.out), "it is replayed with the log beside it: {}", replay.out);
        assert_eq!(document["outputs"]["outputs"]["cnc_z"]["differing"], 0);
        let staged =
            ended(isotherm(home.path()).arg("replay").arg(&profile).arg(&of_outputs).arg("--out").arg(&out));
        assert!(staged.code == Some(1) && staged.said.contains("leave out --out"), "{}", staged.said);
        std::fs::remove_file(&of_outputs).unwrap();
        let without = ended(isotherm(home.path()).arg("replay").arg(&profile).arg(&log));
        assert_eq!(without.out + &alone.out, replay.out, "a log of before has none beside it");
        let table = std::fs::read_to_string(&out).unwrap();
        assert_eq!(table.lines().next(), Some("time,z_raw_um,z_cz_um,z_model,z_state,z_acted"));
    }
}

#[test]
fn a_second_signal_ends_it_at_once_and_says_what_is_left() {
    let home = tempfile::tempdir().unwrap();
    let (text, state) = machine(home.path());
    // The target is about 40 µm. At this rate, the way back takes as long as the way there.
    let text = text
        .replace("  { signal = \"wheelhead\", gain = -2.4, reference = 0.0 },\n", "")
        .replace("rate     = 50.0", "rate     = 0.5");
    let profile = file(home.path(), "machine.toml", &text);
    let _devices = devices(home.path(), &profile);
    let mut gateway = isotherm(home.path());
    let mut gateway = Running::start(gateway.arg("run").arg(&profile).args(["--state", &state]));
    gateway.receives("axis z: armed");
    // After this time, the way back is longer than the delay of a busy computer until the second signal.
    std::thread::sleep(Duration::from_secs(20));
    gateway.signal("TERM");
    gateway.receives("stopping: the fault actions run; this takes at most");
    gateway.signal("TERM");
    assert_eq!(gateway.ends_within(PATIENCE).code(), Some(1), "{}", gateway.said.join("\n"));
    let said = gateway.said.join("\n");
    assert!(said.contains("stopped before the fault actions were complete; cnc_z hold"), "{said}");
    assert!(home.path().join("interop.state.json").exists());
}

#[test]
fn nobody_reading_what_it_says_does_not_hold_it_up() {
    let home = tempfile::tempdir().unwrap();
    let (text, state) = machine(home.path());
    let profile = file(home.path(), "machine.toml", &text);
    let _devices = devices(home.path(), &profile);
    // The pipe is full: any further write blocks until its reader reads.
    let (_unread, mut full) = std::io::pipe().unwrap();
    full.write_all(&[b'x'; 65_536]).unwrap();
    let mut gateway = isotherm(home.path());
    gateway.arg("run").arg(&profile).args(["--state", &state]).stderr(full);
    let mut gateway = gateway.spawn().unwrap();
    // The last rows exist only if the gateway continues.
    process::until("it does not go on", || {
        let mut files = std::fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().path());
        let is_log = |path: &str| path.ends_with(".csv") && !path.ends_with(".outputs.csv");
        let log = files.find(|path| path.to_str().is_some_and(is_log));
        let text = log.map_or(String::new(), |path| std::fs::read_to_string(path).unwrap());
        let active = text.matches(",active,").count();
        if active > 5 { Ok(()) } else { Err(format!("{active} updates")) }
    });
    gateway.kill().unwrap();
    gateway.wait().unwrap();
}

#[test]
fn a_recorded_run_has_every_signal_and_overwrites_nothing() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let profile = file(home.path(), "machine.toml", &text);
    let _devices = devices(home.path(), &profile);
    let log = home.path().join("monday.csv");
    let record = || {
        let mut record = isotherm(home.path());
        record.arg("record").arg(&profile).arg("--out").arg(&log).args(["--every", "100ms"]);
        record
    };
    let mut recording = Running::start(&mut record());
    recording.receives("recording 4 signals into");
    process::until("there are rows with every signal", || {
        let rows = std::fs::read_to_string(&log).unwrap_or_default();
        // The last row may be incomplete.
        let whole = rows.lines().rev().skip(1).filter(|row| row.split(',').all(|cell| !cell.is_empty()));
        if whole.count() > 15 { Ok(()) } else { Err(rows) }
    });
    recording.signal("INT");
    assert_eq!(recording.ends_within(PATIENCE).code(), Some(0), "{}", recording.said.join("\n"));
    assert!(recording.said.join("\n").contains("rows over "), "{}", recording.said.join("\n"));
    let rows = std::fs::read_to_string(&log).unwrap();
    assert_eq!(rows.lines().next(), Some("time,bed,wheelhead,scale_z,cnc_on"));
    let last = rows.lines().last().unwrap();
    assert!(rows.lines().count() > 10 && last.split(',').all(|cell| !cell.is_empty()), "{rows}");
    let again = ended(&mut record());
    assert_eq!(again.code, Some(1));
    assert!(again.said.contains("is not overwritten"), "{}", again.said);
    assert_eq!(std::fs::read_to_string(&log).unwrap(), rows);
}

#[test]
fn help_fits_the_terminal() {
    let widest = |columns: &str, verb: &str| {
        let mut help = isotherm(Path::new("/nonexistent"));
        let help = ended(help.args([verb, "--help"]).env("COLUMNS", columns)).out;
        // A word that is longer than a line cannot be wrapped.
        let lines = help.lines().filter(|line| line.split_whitespace().all(|word| word.len() < 30));
        lines.map(|line| line.chars().count()).max().unwrap()
    };
    for verb in VERBS {
        assert!(widest("60", verb) <= 60, "{verb}: {}", widest("60", verb));
        assert!(widest("300", verb) <= 100, "{verb}: {}", widest("300", verb));
    }
}

#[test]
fn a_recording_on_a_plant_is_the_same_for_the_same_seed_and_turns_to_a_new_file_in_time() {
    let home = tempfile::tempdir().unwrap();
    let record = |out: &str| {
        let out = home.path().join(out);
        let arguments =
            ["surface-grinder", "--virtual", "--seed", "3", "--for", "25min", "--rotate", "10min"];
        let ended = ended(isotherm(home.path()).arg("record").args(arguments).arg("--out").arg(out));
        assert_eq!(ended.code, Some(0), "{}", ended.said);
        ended.out
    };
    let said = record("day.csv");
    assert!(said.contains("day-3.csv: 150 rows over 25m"), "{said}");
    record("again/");
    let read = |path: &Path| std::fs::read_to_string(path).unwrap();
    let mut again: Vec<_> =
        std::fs::read_dir(home.path().join("again")).unwrap().map(|entry| entry.unwrap().path()).collect();
    again.sort();
    assert_eq!(again.len(), 3);
    for (again, name) in again.iter().zip(["day.csv", "day-2.csv", "day-3.csv"]) {
        let day = read(&home.path().join(name));
        assert_eq!(read(again), day);
        let header: Vec<&str> = day.lines().next().unwrap().split(',').collect();
        assert_eq!((header[0], *header.last().unwrap()), ("time", "z_error_um"));
    }
}

#[test]
fn a_shipped_machine_that_was_mistyped_is_named() {
    for verb in ["demo", "check"] {
        let Ended { code, said, .. } = run(&[verb, "surface-grindr"]);
        assert!(
            code != Some(0) && said.contains("did you mean") && said.contains("`surface-grinder`"),
            "{said}"
        );
    }
    let Ended { code, said, .. } = run(&["--log", "verbose", "schema"]);
    assert!(code == Some(2) && said.contains("allowed: error, warn, info, debug, trace"), "{said}");
}

#[test]
fn what_is_said_of_a_wrong_profile_ends_its_last_line() {
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "wrong.toml", "[machine]\nname = 5\n");
    let Ended { code, said, .. } = ended(isotherm(home.path()).arg("check").arg(profile));
    assert!(code == Some(64) && said.ends_with("in the profile\n"), "{said:?}");
}

#[test]
fn check_says_what_keeps_a_profile_from_running_on_this_computer() {
    let home = tempfile::tempdir().unwrap();
    let deep = "a".repeat(100);
    let more = format!(
        "[web]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"nothing.token\"\n[history]\ndirectory = \"{deep}\"\n"
    );
    let profile = file(home.path(), "machine.toml", &(machine(home.path()).0 + &more));
    let Ended { code, said, .. } = ended(isotherm(home.path()).arg("check").arg(&profile));
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("nothing.token does not exist") && said.contains("at most 107 are possible"),
        "{said}"
    );
    let mut run = isotherm(home.path());
    let Ended { code, said, .. } =
        ended(run.arg("run").arg(&profile).current_dir(home.path()).args(["--state", &deep]));
    assert!(code == Some(1) && !said.contains("SUN_LEN"), "{said}");
}

#[test]
fn status_has_the_content_of_the_page_for_people_programs_and_a_watchdog() {
    let home = tempfile::tempdir().unwrap();
    let (text, _) = machine(home.path());
    let profile = file(home.path(), "machine.toml", &text);
    let _devices = devices(home.path(), &profile);
    let state = home.path().join("state");
    let status =
        |more: &[&str]| ended(isotherm(home.path()).args(["status", "--state"]).arg(&state).args(more));
    let nobody = status(&[]);
    assert!(nobody.code == Some(1) && nobody.said.contains("no gateway runs"), "{}", nobody.said);
    let mut gateway =
        Running::start(isotherm(home.path()).arg("run").arg(&profile).arg("--state").arg(&state));
    gateway.receives("the gateway runs");
    process::until("every device has answered", || {
        let Ended { out, .. } = status(&[]);
        if out.contains(" good\n") { Ok(()) } else { Err(out) }
    });
    let Ended { code, out, said } = status(&[]);
    assert_eq!(code, Some(0), "{said}");
    for part in ["axis z: ", "Cz ", "signals\n", "outputs\n", "devices\n", "last events\n", "clock "] {
        assert!(out.contains(part), "{part}: {out}");
    }
    let json: Value = serde_json::from_str(&status(&["--json"]).out).unwrap();
    let axis = &json["axes"]["z"];
    for key in ["state", "display", "why", "cz_um", "expected_um", "verified_um", "verified_age_s"] {
        assert!(axis.get(key).is_some(), "{key}: {axis}");
    }
    assert!(json["devices"].is_array() && json["signals"].is_array() && json["clock"].is_string(), "{json}");
    let healthy = status(&["--healthy"]);
    let missing = json["missing"].as_array().unwrap().len();
    assert!(
        matches!(healthy.code, Some(0 | 1)) && (missing == 0 || healthy.said.contains("not healthy: ")),
        "{}",
        healthy.said
    );
    gateway.stands_still();
    let silent = status(&["--healthy"]);
    assert!(silent.code == Some(3) && silent.said.contains("no answer"), "{:?} {}", silent.code, silent.said);
    gateway.resumes();
}
