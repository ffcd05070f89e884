//! Effect of the compensation. The shipped machines run over real sockets, on days that were not used to identify their
//! coefficients.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::sync::Mutex;

use serde_json::Value;

use crate::support::process;

use process::{Running, isotherm};

/// Runs one demo as fast as possible.
fn demo(machine: &str, span: &str, seed: u64) -> Value {
    demo_at("1000000", machine, span, seed)
}

fn demo_at(speed: &str, machine: &str, span: &str, seed: u64) -> Value {
    let home = tempfile::tempdir().unwrap();
    let seed = seed.to_string();
    let arguments = [
        "demo",
        machine,
        "--for",
        span,
        "--seed",
        &seed,
        "--speed",
        speed,
        "--listen",
        "127.0.0.1:0",
        "--json",
    ];
    let output = isotherm(home.path()).args(arguments).output().unwrap();
    assert!(output.status.success(), "{machine}, seed {seed}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Number of days for each machine; `TEST_DAYS=20` tests more.
const DAYS: u64 = 1;

fn number_of_days() -> u64 {
    let Ok(text) = std::env::var("TEST_DAYS") else { return DAYS };
    text.parse().unwrap_or_else(|_| panic!("TEST_DAYS={text}: say 20"))
}

/// Runs several days of a machine, two at a time. Checks the worst axis without and with compensation, µm.
fn days(machine: &str, span: &str, least: f64, most: f64) {
    let days = number_of_days();
    let seeds = Mutex::new(1..=days);
    let figures = Mutex::new(Vec::new());
    let next = || seeds.lock().unwrap().next();
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(seed) = next() {
                    let report = demo(machine, span, seed);
                    let range = |key: &str| report[key].as_f64().unwrap();
                    let figure = (seed, range("uncompensated_range_um"), range("compensated_range_um"));
                    figures.lock().unwrap().push(figure);
                }
            });
        }
    });
    let mut figures = figures.into_inner().unwrap();
    figures.sort_by_key(|(seed, ..)| *seed);
    println!("{machine}: {figures:?}");
    assert_eq!(u64::try_from(figures.len()), Ok(days));
    for (seed, uncompensated, compensated) in figures {
        assert!(uncompensated >= least, "{machine}, seed {seed}: {uncompensated} µm uncompensated");
        assert!(
            compensated > 0.0 && compensated <= most,
            "{machine}, seed {seed}: {compensated} µm compensated"
        );
    }
}

#[test]
fn the_surface_grinder_stays_within_three_microns_on_days_it_never_saw() {
    days("surface-grinder", "8h", 15.0, 3.0);
}

#[test]
fn the_sinker_edm_stays_within_two_microns_on_days_it_never_saw() {
    days("sinker-edm", "12h", 15.0, 2.0);
}

#[test]
fn the_lathe_stays_within_three_microns_where_its_source_has_eight() {
    days("xc100-lathe", "8h", 15.0, 3.0);
}

#[test]
fn the_ram_stays_within_five_microns_in_all_three_axes() {
    days("ram-mc", "12h", 150.0, 5.0);
}

#[test]
fn the_parts_machine_keeps_a_twentieth_of_its_twelve_hours_of_drift() {
    days("parts-vmc", "12h", 50.0, 2.5);
}

#[test]
fn the_long_spindle_stays_within_three_microns() {
    days("spindle-hmc", "12h", 75.0, 3.0);
}

#[test]
fn the_machining_centre_stays_within_the_two_microns_of_its_source() {
    days("jcs018a-vmc", "8h", 7.0, 2.0);
}

#[test]
fn the_screw_stays_within_single_figures_at_every_position() {
    days("screw-axis", "8h", 90.0, 7.5);
}

#[test]
fn the_column_keeps_a_tenth_by_a_matrix_and_places_that_saw_no_day_at_all() {
    days("column-hmc", "12h", 75.0, 11.0);
}

#[test]
fn a_seed_is_the_same_day_again_at_any_speed() {
    let day = demo("surface-grinder", "2h", 7);
    assert_eq!(day, demo("surface-grinder", "2h", 7));
    assert_eq!(day, demo_at("1500", "surface-grinder", "2h", 7));
    assert_ne!(day, demo("surface-grinder", "2h", 8));
}

/// Counterpart with LinuxCNC: `tests/linuxcnc/run -- demo`.
#[test]
fn a_machine_under_linuxcnc_says_how_to_install_it_where_it_is_missing() {
    let home = tempfile::tempdir().unwrap();
    let output =
        isotherm(home.path()).env("PATH", home.path()).args(["demo", "linuxcnc-mill"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains(
            "apt-get install --no-install-recommends linuxcnc-uspace python3-pymodbus python3-serial-asyncio"
        ),
        "{said}"
    );
}

/// Counterpart on a CAN interface: `tests/vcan/run can -- demo`.
#[test]
fn a_machine_on_can_says_what_it_lacks_where_there_is_no_interface() {
    let home = tempfile::tempdir().unwrap();
    let elsewhere = ["demo", "xc100-lathe-can", "--set", "bus.field.interface=nocan0"];
    let output = isotherm(home.path()).args(elsewhere).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    for part in
        ["nocan0 is not usable: no such interface", "ip link set dev nocan0", "--set bus.field.interface="]
    {
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn after_the_day_the_page_stays_open_until_somebody_presses_enter() {
    let home = tempfile::tempdir().unwrap();
    let mut command = isotherm(home.path());
    command.args(["demo", "--for", "20min", "--speed", "100000", "--stay", "--listen", "127.0.0.1:0"]);
    let mut demo = Running::start(&mut command);
    let page = demo.receives("the web page stays open at http://");
    assert!(demo.said.iter().any(|line| line.contains("µm compensated")), "{:?}", demo.said);
    let address = page.rsplit("http://").next().unwrap().split(' ').next().unwrap().to_owned();
    let status = || {
        let mut stream = std::net::TcpStream::connect(&address).unwrap();
        let head = format!("GET /api/status HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let status: Value = serde_json::from_str(text.split_once("\r\n\r\n").unwrap().1).unwrap();
        status["uptime_s"].as_f64().unwrap()
    };
    let first = status();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!((status() - first).abs() < 1e-9, "the day is over, and nothing goes on");
    demo.stdin().write_all(b"\n").unwrap();
    assert!(demo.ends_within(process::PATIENCE).success(), "{:?}", demo.said);
}
