//! Failures of thermometer, line and component.

use std::time::Duration;

use crate::linuxcnc::bench::{Bench, Way};
use crate::linuxcnc::mill::Mill;
use crate::linuxcnc::modbus;
use crate::linuxcnc::process::until;

fn with(um: f64) -> Bench {
    let mut bench = Bench::start();
    bench.wants(um);
    bench.arrives_at(um);
    bench.mill.records();
    bench
}

#[test]
fn without_its_thermometer_the_axis_holds_goes_to_zero_and_comes_back() {
    let mut bench = with(12.0);
    bench.thermometer_is_silent(true);
    bench.is_in_state("holding", "it holds");
    assert!((bench.mill.offset_um() - 12.0).abs() < 1e-3, "it keeps its value");
    bench.is_in_state("zeroed", "it goes to zero");
    bench.arrives_at(0.0);
    bench.thermometer_is_silent(false);
    bench.arrives_at(12.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}

#[test]
fn a_wire_that_breaks_is_no_temperature() {
    let mut bench = with(12.0);
    bench.thermometer_is_broken(true);
    bench.is_in_state("holding", "it holds");
    bench.thermometer_is_broken(false);
    bench.follows("it follows");
    bench.arrives_at(12.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}

/// A network device delays a write for seconds, and forwards it after the component has accepted others. The component
/// rejects it.
#[test]
fn a_write_that_comes_late_is_refused_and_moves_nothing() {
    let mill = Mill::start();
    let port = mill.port;
    let way = Way::to(port);
    let mut bench = Bench::by(mill, way.port);
    bench.wants(10.0);
    bench.arrives_at(10.0);
    bench.mill.records();
    let before = modbus::refused(port);
    for (round, um) in [14.0, 9.0, 10.0].into_iter().enumerate() {
        bench.wants(um);
        way.holds_a_write();
        let taken = modbus::sequence(port);
        until("another write is taken", || match modbus::sequence(port) {
            number if number == taken => Err(format!("{number}")),
            _ => Ok(()),
        });
        bench.wants(10.0);
        way.lets_it_go();
        let count = before + 1 + u16::try_from(round).unwrap();
        until("the late write is refused", || match modbus::refused(port) {
            refused if refused < count => Err(format!("{refused} of {count} at {um}")),
            _ => Ok(()),
        });
    }
    assert_eq!(modbus::refused(port), before + 3);
    bench.arrives_at(10.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}

#[test]
fn a_component_that_hangs_and_goes_on_moves_nothing_by_more_than_a_step() {
    let mut bench = with(10.0);
    bench.mill.command("hang-component");
    bench.wants(16.0);
    bench.is_in_state("holding", "nobody answers");
    bench.mill.command("resume-component");
    bench.arrives_at(16.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}

#[test]
fn a_component_that_is_loaded_anew_goes_on_from_the_offset_that_is_applied() {
    let mut bench = with(-20.0);
    bench.mill.command("kill-component");
    std::thread::sleep(Duration::from_secs(1));
    assert!((bench.mill.offset_um() + 20.0).abs() < 1e-3, "without it the machine stands");
    bench.mill.command("start-component");
    bench.follows("it follows");
    bench.wants(-14.0);
    bench.arrives_at(-14.0);
    bench.mill.recorded().never_jump();
    bench.blames_nobody();
}
