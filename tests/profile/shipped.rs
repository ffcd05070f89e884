//! The coefficients of the shipped profiles are those that `profiles/identify` finds. All machines: `tests/run
//! profiles`.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::process::{Command, Output};

/// Runs the script on these profiles. It stores its logs next to their directory.
fn check(profiles: &Path, machine: &str) -> Output {
    let out = profiles.with_file_name("out");
    let mut command = Command::new("bash");
    command.arg(profiles.join("identify")).args(["--check", machine]);
    command.env("OUT", out).env("ISOTHERM", env!("CARGO_BIN_EXE_isotherm")).output().unwrap()
}

/// Copies the profiles, so that a gain can be changed.
fn copied(home: &Path) -> std::path::PathBuf {
    let (from, to) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles"), home.join("profiles"));
    std::fs::create_dir(&to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file()) {
        std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
    to
}

#[test]
fn the_grinders_numbers_are_found_again_but_for_a_gain_that_was_changed() {
    let home = tempfile::tempdir().unwrap();
    let profiles = copied(home.path());
    let profile = profiles.join("surface-grinder.toml");
    let text = std::fs::read_to_string(&profile).unwrap();
    let gain = text.split("signal = \"bed\",").nth(1).and_then(|rest| rest.split("gain = ").nth(1)).unwrap();
    let gain = gain.split(',').next().unwrap().trim();
    let changed = format!("{:.4}", gain.parse::<f64>().unwrap() * 1.003);
    std::fs::write(&profile, text.replacen(gain, &changed, 1)).unwrap();
    let checked = check(&profiles, "surface-grinder");
    let said = String::from_utf8(checked.stdout).unwrap();
    let reported = String::from_utf8(checked.stderr).unwrap();
    let (wrong, right): (Vec<&str>, Vec<&str>) =
        said.lines().filter(|line| line.contains("shipped")).partition(|line| line.starts_with("  !"));
    assert_eq!((wrong.len(), right.len()), (1, 7), "{said}{reported}");
    assert!(wrong[0].starts_with("  ! bed") && wrong[0].contains(&changed), "{said}");
    assert!(!checked.status.success() && reported.contains("a profile differs"), "{reported}");
}

#[test]
fn what_the_screw_was_recorded_and_identified_with_is_found_again() {
    let home = tempfile::tempdir().unwrap();
    let checked = check(&copied(home.path()), "screw-axis");
    let said = String::from_utf8(checked.stdout).unwrap();
    let reported = String::from_utf8(checked.stderr).unwrap();
    assert!(checked.status.success(), "{said}{reported}");
    assert_eq!(said.lines().filter(|line| line.contains("found ")).count(), 3, "{said}");
}
