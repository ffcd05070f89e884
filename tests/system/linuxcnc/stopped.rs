//! Scenarios in which the machine is switched off, stopped and started, and in which the gateway is killed, stopped and
//! started.

use std::time::Duration;

use crate::linuxcnc::bench::Bench;
use crate::linuxcnc::modbus;
use crate::linuxcnc::process::until;
use crate::linuxcnc::samples::Samples;

/// Switches the machine off, waits until its offset is zero, switches it on, and waits until the offset is reached
/// again.
fn comes_back(goes: &[&str], comes: &[&str]) -> Samples {
    let mut bench = Bench::start();
    bench.wants(20.0);
    bench.arrives_at(20.0);
    bench.mill.records();
    for line in goes {
        bench.mill.command(line);
    }
    let port = bench.mill.port;
    until("the register is zero", || match modbus::z(&modbus::block(port)) {
        0 => Ok(()),
        counts => Err(counts.to_string()),
    });
    std::thread::sleep(Duration::from_millis(1500));
    for line in comes {
        bench.mill.command(line);
    }
    bench.arrives_at(20.0);
    let samples = bench.mill.recorded();
    let lowest = samples.0.iter().map(|one| one.request).fold(f64::INFINITY, f64::min);
    assert!(lowest.abs() < 1e-9, "it begins anew: {lowest}");
    bench.follows("it follows again");
    let said = bench.said();
    assert!(!said.iter().any(|line| line.contains("this gateway did not write")), "{said:#?}");
    samples
}

#[test]
fn a_machine_that_is_switched_off_and_on_does_not_move_by_its_offset_at_once() {
    comes_back(&["off"], &["on"]).joint_never_jumps();
}

#[test]
fn after_an_emergency_stop_the_offset_walks_in_again() {
    comes_back(&["estop"], &["reset", "on"]).joint_never_jumps();
}

/// Homing is a new start: the position at homing becomes zero.
#[test]
fn a_machine_that_is_not_homed_waits() {
    let mut bench = Bench::start();
    bench.wants(8.0);
    bench.arrives_at(8.0);
    bench.mill.command("unhome");
    bench.wants(14.0);
    until("the gateway has read that it waits", || {
        let status = bench.status()?;
        let mut signals = status["signals"].as_array().into_iter().flatten();
        match signals.find(|signal| signal["name"] == "taking") {
            Some(taking) if taking["value"] == 0.0 => Ok(()),
            other => Err(format!("{other:?}")),
        }
    });
    // Offsets that were under way when the gateway read the state.
    std::thread::sleep(Duration::from_secs(3));
    bench.mill.records();
    std::thread::sleep(Duration::from_millis(1500));
    let samples = bench.mill.recorded();
    let first = samples.0[0];
    assert!(
        samples.0.iter().all(|one| (one.request - first.request).abs() < 1e-9),
        "it moves unhomed: {first:?}"
    );
    assert!(first.request < 0.0135, "{first:?}");
    bench.mill.command("home");
    bench.mill.records();
    bench.arrives_at(14.0);
    bench.mill.recorded().never_jump();
    bench.follows("it follows again");
    bench.blames_nobody();
}

#[test]
fn after_a_restart_of_the_control_the_offset_walks_in_from_zero() {
    let mut bench = Bench::start();
    bench.wants(12.0);
    bench.arrives_at(12.0);
    bench.mill.restarts();
    bench.mill.records();
    bench.arrives_at(12.0);
    let samples = bench.mill.recorded();
    samples.never_jump();
    samples.joint_never_jumps();
    bench.follows("it follows again");
    let said = bench.said();
    assert!(!said.iter().any(|line| line.contains("this gateway did not write")), "{said:#?}");
}

#[test]
fn a_gateway_that_is_killed_in_a_walk_goes_on_from_where_the_joint_stands() {
    let mut bench = Bench::start();
    bench.mill.records();
    bench.wants(30.0);
    let mill = &mut bench.mill;
    until("it walks", || match mill.offset_um() {
        9.0.. => Ok(()),
        um => Err(um.to_string()),
    });
    bench.gateway_is_killed();
    std::thread::sleep(Duration::from_millis(1500));
    let stands = bench.mill.offset_um();
    assert!((9.0..30.0).contains(&stands), "it stands where it stood: {stands}");
    bench.gateway_starts();
    bench.arrives_at(30.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}

#[test]
fn a_gateway_that_is_asked_to_stop_takes_the_offset_out_and_its_control_word_back() {
    let mut bench = Bench::start();
    bench.wants(15.0);
    bench.arrives_at(15.0);
    bench.mill.records();
    bench.gateway_stops();
    bench.mill.recorded().never_jump();
    let block = modbus::block(bench.mill.port);
    assert_eq!((modbus::z(&block), block[modbus::CONTROL] & 1), (0, 0));
    assert!(bench.mill.offset_um().abs() < 1e-3);
    let said = bench.said();
    assert!(said.iter().any(|line| line.contains("mill_z holds 0.0")), "{said:#?}");
}

/// Without a heartbeat, the control first keeps the offset, and then reduces it to zero by itself.
#[test]
fn an_offset_that_nobody_looks_after_is_taken_out_slowly() {
    let mut bench = Bench::start();
    bench.wants(3.0);
    bench.arrives_at(3.0);
    bench.mill.records();
    bench.gateway_is_killed();
    let mill = &mut bench.mill;
    until("it is taken out", || match mill.offset_um().abs() {
        0.0..0.001 => Ok(()),
        um => Err(um.to_string()),
    });
    bench.mill.recorded().never_jump();
    bench.gateway_starts();
    bench.arrives_at(3.0);
}
