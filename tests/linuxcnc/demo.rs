//! The demo beside LinuxCNC, as a person starts it.

use crate::process::isotherm;

#[test]
fn the_demo_holds_the_machine_with_a_real_control_in_the_loop() {
    let home = tempfile::tempdir().unwrap();
    let mut demo = isotherm(home.path());
    demo.env("TMPDIR", home.path());
    let output =
        demo.args(["demo", "linuxcnc-mill", "--for", "12min", "--speed", "80", "--json"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let range = |name: &str| report[name].as_f64().unwrap();
    let (without, with) = (range("uncompensated_range_um"), range("compensated_range_um"));
    println!("{without} µm uncompensated, {with} µm compensated");
    assert!(without > 3.0 && with < 2.0, "{report}");
    let left: Vec<_> =
        std::fs::read_dir(home.path()).unwrap().flatten().map(|entry| entry.file_name()).collect();
    let left = left.iter().filter(|name| name.to_string_lossy().starts_with("isotherm-"));
    assert_eq!(left.count(), 0, "it tidies up");
}
