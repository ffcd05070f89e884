//! Demo of the lathe with thermocouples and encoder on CAN and its control on Modbus, as a user would run it.

use std::process::{Command, Output};

use serde_json::Value;

use crate::can::interface;

fn demo(machine: &str, arguments: &[&str]) -> Output {
    let home = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home.path());
    command.args(["demo", machine, "--speed", "1000000", "--listen", "127.0.0.1:0", "--json"]);
    command.args(arguments).output().unwrap()
}

fn on_can(span: &str, seed: &str) -> Value {
    let on = format!("bus.field.interface={}", interface());
    reported(demo("xc100-lathe-can", &["--for", span, "--seed", seed, "--set", &on]))
}

#[track_caller]
fn reported(output: Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn range(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap()
}

/// Both runs simulate one machine on one day. The drift is equal, and the residual errors differ by the rounding of the
/// modules.
#[test]
fn the_lathe_on_can_keeps_what_the_lathe_on_modbus_keeps() {
    let (can, modbus) =
        (on_can("30min", "1"), reported(demo("xc100-lathe", &["--for", "30min", "--seed", "1"])));
    println!("CAN {can}\nModbus {modbus}");
    let (before, after) = (range(&can, "uncompensated_range_um"), range(&can, "compensated_range_um"));
    assert!(
        before > 7.0 && before.total_cmp(&range(&modbus, "uncompensated_range_um")).is_eq(),
        "{before} µm"
    );
    assert!(after > 0.0 && after < 2.0, "{after} µm");
    assert!((after - range(&modbus, "compensated_range_um")).abs() < 0.5, "{after} µm");
}

/// Frames pass through the kernel without an acknowledgement. The virtual time stops until they have been received.
#[test]
fn a_seed_is_the_same_day_again_on_can() {
    let day = on_can("5min", "7");
    assert_eq!(day, on_can("5min", "7"));
    assert_ne!(day, on_can("5min", "8"));
}

#[test]
fn without_its_interface_the_demo_says_what_to_do() {
    for (name, down, message) in [
        ("vcan77", false, ["vcan77 is not usable: no such interface", "ip link add dev vcan77 type vcan"]),
        ("vcan78", true, ["vcan78 is not usable: down", "ip link set dev vcan78 up"]),
    ] {
        let _kept = down.then(|| {
            let interface = crate::can::rig::Interface::new(name);
            interface.down();
            interface
        });
        let output = demo("xc100-lathe-can", &["--set", &format!("bus.field.interface={name}")]);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(message.iter().all(|part| said.contains(part)), "{said}");
    }
}
