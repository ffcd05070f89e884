//! Tests of the texts of `scan`, `read`, `check --online` and `virtual` about sensors of this computer.

use std::path::Path;
use std::process::Output;

use super::process::{Running, file, isotherm};
use super::tree::{PROBE, Tree};

const PROFILE: &str = r#"
[machine]
name = "pc"
[bus.pc]
type = "sysfs"
address = "ROOT"
[device.probes]
bus = "pc"
every = "2s"
[signal.bed]
device = "probes"
sensor = "w1:28-0316a2794f01"
[signal.cabinet]
device = "probes"
sensor = "hwmon:lm75/temp1"
"#;

fn tree() -> Tree {
    let tree = Tree::new();
    tree.measures(PROBE, 23_125);
    tree.measures("28-ffff64d0f1a2", 85_000);
    tree.hwmon(0, "lm75", "i2c-1/1-0048", &[("temp1_input", "20000")]);
    tree
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[track_caller]
fn says(output: &Output, is_well: bool, words: &[&str]) {
    let said = said(output);
    assert_eq!(output.status.success(), is_well, "{said}");
    for word in words {
        assert!(said.contains(word), "`{word}` is not in:\n{said}");
    }
}

fn profile(home: &Path, tree: &Tree) -> std::path::PathBuf {
    file(home, "pc.toml", &PROFILE.replace("ROOT", tree.root().to_str().unwrap()))
}

#[test]
fn scan_lists_what_there_is_with_lines_for_a_profile() {
    let (home, tree) = (tempfile::tempdir().unwrap(), tree());
    let root = tree.root().to_str().unwrap();
    let scanned = isotherm(home.path()).args(["scan", "--bus", root]).output().unwrap();
    let listed = [
        "hwmon:lm75/temp1",
        "20.000 °C",
        "w1:28-0316a2794f01",
        "23.125 °C",
        "85 °C, which the sensor shows at power-on",
    ];
    says(&scanned, true, &listed);
    says(&scanned, true, &["type = \"sysfs\"", "sensor = \"hwmon:lm75/temp1\""]);
    let scanned = isotherm(home.path()).args(["scan", "--json", "--bus", root]).output().unwrap();
    let document: serde_json::Value = serde_json::from_slice(&scanned.stdout).unwrap();
    assert_eq!(document["sensors"][1]["sensor"], "w1:28-0316a2794f01");
    let nothing = isotherm(home.path()).args(["scan", "--bus", "/nowhere"]).output().unwrap();
    says(
        &nothing,
        false,
        &["no temperature was found in /nowhere", "are the drivers of the sensors loaded?"],
    );
}

#[test]
fn check_online_says_where_a_sensor_was_found_and_what_there_is_instead_of_one_that_was_not() {
    let (home, tree) = (tempfile::tempdir().unwrap(), tree());
    let path = profile(home.path(), &tree);
    let check = || isotherm(home.path()).arg("check").arg(&path).arg("--online").output().unwrap();
    says(&check(), true, &["signal bed at sensor w1:28-0316a2794f01: ", "/w1_slave", "23.1250 degC"]);
    std::fs::remove_dir_all(tree.root().join("bus/w1/devices").join(PROBE)).unwrap();
    let instead =
        "this computer has no sensor of this name; present sensors of this kind: w1:28-ffff64d0f1a2";
    says(&check(), false, &[instead]);
    tree.hwmon(1, "lm75", "i2c-1/1-0049", &[("temp1_input", "21000")]);
    tree.measures(PROBE, 23_125);
    says(
        &check(),
        false,
        &["several sensors of this name: write one of hwmon:lm75@1-0048/temp1, hwmon:lm75@1-0049/temp1"],
    );
}

#[test]
fn a_register_of_it_is_refused_with_what_shows_its_sensors() {
    let (home, tree) = (tempfile::tempdir().unwrap(), tree());
    let root = tree.root().to_str().unwrap();
    let read = isotherm(home.path())
        .args(["read", "--bus", root, "--unit", "1", "--register", "input:0", "--type", "i16"])
        .output();
    says(&read.unwrap(), false, &["sensors of this computer", "isotherm scan --bus"]);
    let read = isotherm(home.path()).arg("read").arg(profile(home.path(), &tree)).output().unwrap();
    says(&read, true, &["bed", "23.1250"]);
}

#[test]
fn virtual_hardware_says_that_the_real_sensors_are_read() {
    let (home, tree) = (tempfile::tempdir().unwrap(), tree());
    let mut running = Running::start(isotherm(home.path()).arg("virtual").arg(profile(home.path(), &tree)));
    running.receives("bus pc is not simulated: the gateway reads the real sensors in");
}
