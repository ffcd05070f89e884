//! `identify --into-profile`: the model is in the profile after a yes, and nothing else in it changes.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use super::rig;
use super::whitened::{days, logs};

/// Signal that shows the machine on.
const ON: &str = "[signal.running]\ndevice = \"m\"\nregister = \"discrete:3\"\nunit = \"bool\"\n\n";

/// Profile without a model, with comments around the axis.
fn bench() -> String {
    let text = rig::profile_with(4, "# until then nothing is compensated\n");
    let text = text.replacen("[axis.z]", &format!("{ON}# the axis\n[axis.z]   # Z"), 1);
    text.replacen("[output.z]", "# the register\n[output.z]", 1)
}

/// Runs `identify --into-profile` with these answers. Returns its output, and whether it succeeded.
fn identify(home: &Path, arguments: &[&str], answers: &str) -> (String, bool) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home).current_dir(home);
    command.args(["identify", "bench.toml"]).args(rig::logs(home, &logs(&days(4, 11, 0.1))));
    command.arg("--into-profile").args(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(answers.as_bytes()).unwrap();
    let ended = child.wait_with_output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (said, ended.status.success())
}

fn read(home: &Path, name: &str) -> String {
    std::fs::read_to_string(home.join(name)).unwrap()
}

#[test]
fn after_a_yes_the_model_is_in_and_every_other_line_stays() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("bench.toml"), bench()).unwrap();
    let (said, is_good) = identify(home, &[], "perhaps\nyes\nrunning\n");
    assert!(is_good, "{said}");
    for words in
        ["write yes or no", "bench.toml, line", "The model counts from machine start", "Next: isotherm check"]
    {
        assert!(said.contains(words), "`{words}`: {said}");
    }
    assert_eq!(read(home, "bench.toml.old"), bench(), "the profile before is kept");
    let text = read(home, "bench.toml");
    for line in bench().lines() {
        assert!(text.lines().any(|kept| kept == line), "`{line}` is gone: {text}");
    }
    let loaded = isotherm_profile::load(&home.join("bench.toml"), &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}\n{text}")).profile;
    assert!(profile.axes[0].has_model(), "{text}");
    assert_eq!(profile.machine.on.map(|id| profile.signal(id).name.as_str()), Some("running"), "{text}");
    assert!(text.find("[[axis.z.model]]") < text.find("# the register\n[output.z]"), "{text}");

    // Another day: the model is replaced, and the files of the first one stay for the profile before.
    let first = text;
    let (said, is_good) = identify(home, &["--yes"], "");
    assert!(is_good && said.contains(", instead of "), "{said}");
    let text = read(home, "bench.toml");
    assert_eq!(read(home, "bench.toml.old"), first);
    assert_eq!(text.matches("[[axis.z.model]]").count(), first.matches("[[axis.z.model]]").count());
    let old = isotherm_profile::load(&home.join("bench.toml.old"), &[], &[]);
    assert!(old.is_ok(), "{}", old.unwrap_err());
}

#[test]
fn without_a_yes_nothing_changes() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("bench.toml"), bench()).unwrap();
    for answers in ["no\n", ""] {
        let (said, is_good) = identify(home, &[], answers);
        assert!(!is_good && said.contains("is not changed"), "{said}");
    }
    assert_eq!(read(home, "bench.toml"), bench());
    let mut left: Vec<String> = std::fs::read_dir(home)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    left.retain(|name| name.starts_with("bench"));
    assert_eq!(left, ["bench.toml"], "no file of a model is left behind");
}

#[test]
fn a_start_that_no_signal_shows_is_asked_for_and_may_stay_unknown() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("bench.toml"), bench()).unwrap();
    let (said, is_good) = identify(home, &[], "y\nruning\nnone\n");
    assert!(is_good && said.contains("did you mean `running`?"), "{said}");
    let loaded = isotherm_profile::load(&home.join("bench.toml"), &[], &[]).unwrap();
    assert!(loaded.profile.machine.on.is_none() && loaded.profile.axes[0].has_model());
}

#[test]
fn a_shipped_machine_has_no_file_to_change() {
    let home = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home.path()).current_dir(home.path());
    let ended = command.args(["identify", "surface-grinder", "day.csv", "--into-profile"]).output().unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(!ended.status.success() && said.contains("--into-profile needs the file of a profile"), "{said}");
}
