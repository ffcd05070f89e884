//! `identify --into-profile`: the model is in the profile after a yes, and nothing else in it changes.

use std::io::{Read, Write};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Child, Command, Stdio};

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

fn start(home: &Path, arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home).current_dir(home);
    command.args(["identify", "bench.toml"]).args(rig::logs(home, &logs(&days(4, 11, 0.1))));
    command.arg("--into-profile").args(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Runs `identify --into-profile` with these answers. Returns its output, and whether it succeeded.
fn identify(home: &Path, arguments: &[&str], answers: &str) -> (String, bool) {
    let mut child = start(home, arguments);
    child.stdin.take().unwrap().write_all(answers.as_bytes()).unwrap();
    let ended = child.wait_with_output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (said, ended.status.success())
}

/// Files of the profile and its models.
fn left(home: &Path) -> Vec<String> {
    let names = std::fs::read_dir(home).unwrap().map(|entry| entry.unwrap().file_name());
    let mut left: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    left.retain(|name| name.starts_with("bench"));
    left.sort_unstable();
    left
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
    assert_eq!(left(home), ["bench.toml"], "no file of a model is left behind");
}

#[test]
fn a_profile_that_somebody_changes_meanwhile_is_not_overwritten() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("bench.toml"), bench()).unwrap();
    let mut child = start(home, &[]);
    let (mut out, mut said, mut byte) = (child.stdout.take().unwrap(), Vec::new(), [0_u8]);
    while !said.ends_with(b"Write the model to the profile?") {
        out.read_exact(&mut byte).unwrap();
        said.extend(byte);
    }
    let by_hand = bench() + "# by hand\n";
    std::fs::write(home.join("bench.toml"), &by_hand).unwrap();
    child.stdin.take().unwrap().write_all(b" yes\nnone\n").unwrap();
    out.read_to_end(&mut said).unwrap();
    let ended = child.wait_with_output().unwrap();
    let why = String::from_utf8(ended.stderr).unwrap();
    assert!(!ended.status.success() && why.contains("another program has changed it"), "{why}");
    assert_eq!(read(home, "bench.toml"), by_hand);
    assert_eq!(left(home), ["bench.toml"], "no file of a model is left behind");
}

#[test]
fn a_link_stays_the_local_file_applies_and_the_profile_before_is_as_secret_as_the_profile() {
    let home = tempfile::tempdir().unwrap();
    let (home, plant) = (home.path(), home.path().join("plant"));
    std::fs::create_dir(&plant).unwrap();
    let address = "address = \"127.0.0.1:1502\"\n";
    assert!(bench().contains(address));
    std::fs::write(plant.join("seven.toml"), bench().replace(address, "")).unwrap();
    std::fs::set_permissions(plant.join("seven.toml"), PermissionsExt::from_mode(0o600)).unwrap();
    symlink(plant.join("seven.toml"), home.join("bench.toml")).unwrap();
    std::fs::write(home.join("bench.local.toml"), format!("[bus.b]\n{address}")).unwrap();
    let (said, is_good) = identify(home, &[], "yes\nrunning\n");
    assert!(is_good, "{said}");
    assert!(home.join("bench.toml").symlink_metadata().unwrap().is_symlink());
    assert!(std::fs::read_to_string(plant.join("seven.toml")).unwrap().contains("[[axis.z.model]]"));
    let loaded = isotherm_profile::load(&home.join("bench.toml"), &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert!(profile.axes[0].has_model(), "{said}");
    for name in ["bench.toml", "bench.toml.old"] {
        let mode = std::fs::metadata(home.join(name)).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{name}");
    }
}

#[test]
fn a_start_that_no_signal_shows_is_asked_for_and_may_stay_unknown() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("bench.toml"), bench()).unwrap();
    let (said, is_good) = identify(home, &[], "y\nruning\nnone\n");
    assert!(is_good && said.contains("did you mean `running`?"), "{said}");
    assert!(
        said.contains("while the machine is on (running), or none"),
        "a temperature is not offered: {said}"
    );
    let loaded = isotherm_profile::load(&home.join("bench.toml"), &[], &[]).unwrap();
    assert!(loaded.profile.machine.on.is_none() && loaded.profile.axes[0].has_model());
}

#[test]
fn a_profile_that_does_not_exist_gets_the_name_that_was_probably_meant() {
    let home = tempfile::tempdir().unwrap();
    std::fs::write(home.path().join("benches.toml"), bench()).unwrap();
    let (said, is_good) = identify(home.path(), &[], "");
    assert!(!is_good && said.contains("the profile cannot be read: No such file or directory"), "{said}");
    assert!(said.contains("did you mean `benches.toml`?") && !said.contains("is none"), "{said}");
}

#[test]
fn a_shipped_machine_has_no_file_to_change() {
    let home = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home.path()).current_dir(home.path());
    let ended = command.args(["identify", "surface-grinder", "day.csv", "--into-profile"]).output().unwrap();
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(!ended.status.success() && said.contains("surface-grinder is part of the program"), "{said}");
}
