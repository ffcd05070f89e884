//! Errors that were measured while a compensation was active.

use std::fmt::Write;

use serde_json::Value;

use crate::end_to_end::plant::{HEADER, OUTPUT, PROFILE, READOUT, asked, day, identify, rows};

/// Log of a day as the gateway writes it while it compensates. Its Cz, which changes by at most 1 µm per row, is part
/// of the error.
fn compensated(number: u32, dry: bool) -> String {
    let (mut header, mut cz) = (HEADER.to_vec(), 0.0_f64);
    header.extend(["z_permit", "z_from_um", "z_raw_um", "z_cz_um", "z_model", "z_state", "z_acted"]);
    header.extend(["machine_memory", "machine_zero"]);
    let last = if dry { ",machine_dry_run" } else { "" };
    let mut text = format!("{}{last}\n", header.join(","));
    for (minute, row) in rows(number).into_iter().enumerate() {
        let acted = if dry { 0.0 } else { cz };
        let raw = -0.8 * row[5];
        cz += (raw - cz).clamp(-1.0, 1.0);
        let from = if minute == 0 { "0" } else { "" };
        let cells: Vec<String> = row[..5].iter().map(f64::to_string).collect();
        let flag = if dry { ",1" } else { "" };
        writeln!(text, "{},{},armed,{from},{raw},{cz},old,active,,,{flag}", cells.join(","), row[5] + acted)
            .unwrap();
    }
    text
}

fn gains(document: &str) -> Vec<f64> {
    let document: Value = serde_json::from_str(document).unwrap();
    document["terms"].as_array().unwrap().iter().map(|term| term["gain"].as_f64().unwrap()).collect()
}

#[test]
fn a_log_written_while_compensating_gives_the_model_of_the_bare_machine() {
    let home = tempfile::tempdir().unwrap();
    let of =
        |log: &dyn Fn(u32) -> String| vec![("one.csv", log(1)), ("two.csv", log(2)), ("three.csv", log(3))];
    let profile = format!("{PROFILE}{OUTPUT}");
    let reported = |profile: &str, logs: &[(&str, String)], more: &[&str]| {
        let answer = identify(home.path(), profile, logs, &[&["--method", "ols", "--json"], more].concat());
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        answer.out
    };
    let bare = gains(&reported(&profile, &of(&day), &[]));
    let near = |found: &[f64]| bare.iter().zip(found).all(|(one, other)| (one - other).abs() < 1e-6);
    let while_active = reported(&profile, &of(&|number| compensated(number, false)), &[]);
    assert!(near(&gains(&while_active)), "{bare:?} {while_active}");
    assert!(while_active.contains("The Cz was removed"), "{while_active}");
    // In a dry run, the decisions were never active.
    let dry = reported(&profile, &of(&|number| compensated(number, true)), &[]);
    assert!(near(&gains(&dry)) && !dry.contains("removed"), "{dry}");
    // With its Cz, the log describes another machine.
    let as_is = reported(&profile, &of(&|number| compensated(number, false)), &["--cz", "none"]);
    assert!(!near(&gains(&as_is)), "{bare:?} {as_is}");
    // Without the other columns, the active Cz cannot be determined. A readout does not move the machine.
    let foreign = of(&|number| compensated(number, false).replace("z_permit", "permission"));
    let logged = of(&|number| compensated(number, false));
    let readout = format!("{PROFILE}{READOUT}");
    for (profile, logs) in [(&profile, &foreign), (&readout, &logged)] {
        let refused = identify(home.path(), profile, logs, &[]);
        assert_eq!(refused.code, Some(1), "{}", refused.out);
        assert!(
            refused.said.contains("--cz z_cz_um") && refused.said.contains("--cz none"),
            "{}",
            refused.said
        );
        let named = reported(profile, logs, &["--cz", "z_cz_um"]);
        assert!(gains(&named).len() == bare.len() && named.contains("The Cz was removed"), "{named}");
    }
    let refused = asked(home.path(), &["select", "--error", "z_error_um"], &logged, &[]);
    assert!(refused.code == Some(1) && refused.said.contains("--cz z_cz_um"), "{}", refused.said);
    let drift = asked(home.path(), &["report", "--cz", "z_cz_um", "--json"], &logged, &[]);
    let drift: Value = serde_json::from_str(&drift.out).unwrap();
    let ranges = drift["runs"][0]["displacements"].as_array().unwrap();
    let of = |name: &str| {
        let found = ranges.iter().find(|moved| moved["name"] == name);
        found.unwrap_or_else(|| panic!("no {name} in {drift}"))["range_um"].as_f64().unwrap()
    };
    let errors: Vec<f64> = rows(1).iter().map(|row| row[5]).collect();
    let bare =
        errors.iter().copied().fold(f64::MIN, f64::max) - errors.iter().copied().fold(f64::MAX, f64::min);
    assert!((of("z_error_um without Cz") - bare).abs() < 1e-9 && of("z_error_um") < bare, "{drift}");
}
