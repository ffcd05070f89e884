//! Layers above the profile. The environment of a gateway cannot loosen a guard or change what is written to the
//! machine. All outputs list the settings that it changes.

use std::process::Output;

use serde_json::Value;

use crate::on_time::OnTime;
use crate::process::{PATIENCE, Running, file, isotherm, until};
use crate::rig::{EVERY, Machine, walker};

const MACHINE: &str = include_str!("../interop/machine.toml");

fn both(output: &Output) -> (String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_limit_that_the_environment_makes_larger_keeps_the_gateway_from_starting_with_a_sentence() {
    let _beside = Machine::beside();
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "machine.toml", MACHINE);
    for (name, value, words) in [
        ("ISOTHERM__AXIS__Z__LIMIT", "5000", "5000 is more than the 40.0 of the profile"),
        ("ISOTHERM__AXIS__Z__ON_FAULT__ACTION", "hold", "\"hold\" differs from \"ramp\" in the profile"),
        ("ISOTHERM__AXIS__Z__LIMTI", "30", "did you mean `limit`?"),
        ("ISOTHERM__OUTPUT__CNC_Z__SCALE", "0.001", "allow_override = [\"output.cnc_z.scale\"]"),
        ("ISOTHERM__AXIS__Z__DIAMETER", "true", "allow_override = [\"axis.z.diameter\"]"),
    ] {
        let mut run = Running::start(isotherm(home.path()).env(name, value).arg("run").arg(&profile));
        let status = run.ends_within(PATIENCE);
        let said = run.said.join("\n");
        assert_eq!(status.code(), Some(64), "{name}: {said}");
        assert!(said.contains(&format!("environment {name}: ")) && said.contains(words), "{said}");
    }
}

#[test]
fn what_is_set_above_the_profile_is_in_the_log_in_check_in_status_and_where_the_page_reads() {
    let home = tempfile::tempdir().unwrap();
    let (device, text) = walker();
    let address = device.address().to_string();
    let profile = file(home.path(), "machine.toml", &text.replace(&address, "127.0.0.1:1"));
    file(home.path(), "machine.local.toml", &format!("[bus.cell]\naddress = \"{address}\"\n"));
    let variables = [("ISOTHERM__AXIS__Z__LIMIT", "30"), ("ISOTHERM_PORT_8080_TCP", "tcp://10.0.0.1:8080")];
    let moved = format!("bus.cell.address = \"{address}\" instead of the profile's \"127.0.0.1:1\", from ");
    let lines = [
        "axis.z.limit = 30 instead of the profile's 2000.0, from environment ISOTHERM__AXIS__Z__LIMIT",
        &moved,
        "device.cnc.quirks.max_gap = 3, from --set device.cnc.quirks.max_gap (not in the profile)",
    ];
    let set = ["--set", "device.cnc.quirks.max_gap=3"];
    let checked =
        isotherm(home.path()).envs(variables).arg("check").arg(&profile).args(set).output().unwrap();
    let (shown, said) = both(&checked);
    lines.iter().for_each(|line| assert!(shown.contains(line), "{line}\nis not in\n{shown}{said}"));
    assert!(shown.contains("machine.local.toml:2\n"), "{shown}");
    assert!(
        said.contains("ignored, because they are not settings of isotherm: ISOTHERM_PORT_8080_TCP"),
        "{said}"
    );

    let state = home.path().join("state");
    let mut run = isotherm(home.path());
    run.envs(variables)
        .arg("run")
        .arg(&profile)
        .args(set)
        .args(["--listen", "127.0.0.1:0", "--state"])
        .arg(&state);
    let mut gateway = Running::start(&mut run);
    gateway.receives("the gateway runs");
    let _on_time = OnTime::from_now(&device, EVERY, gateway.id());
    let said = gateway.said.join("\n");
    lines.iter().for_each(|line| assert!(said.contains(line), "{line}\nis not in\n{said}"));
    let status = |more: &[&str]| {
        let mut status = isotherm(home.path());
        status.arg("status").arg(&profile).arg("--state").arg(&state).args(more).output().unwrap()
    };
    let (shown, said) = both(&status(&[]));
    let line = "axis.z.limit = 30, in the profile 2000.0, from environment ISOTHERM__AXIS__Z__LIMIT";
    assert!(shown.contains("settings that override the profile\n") && shown.contains(line), "{shown}{said}");
    until("the document of the status has it too", || {
        let document: Value = serde_json::from_str(&both(&status(&["--json"])).0).unwrap_or_default();
        let first = document["overridden"][0].clone();
        let is_told = first["key"] == "axis.z.limit" && first["profile"] == "2000.0" && first["now"] == "30";
        if is_told { Ok(()) } else { Err(first.to_string()) }
    });
}
