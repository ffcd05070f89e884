//! Test of a whole gateway with a sensor that hangs, and with a machine on another line.

use std::net::TcpListener;
use std::time::Duration;

use super::device::gateway::{beside, wait_until};
use super::device::{Device, Times, What, profile};
use super::process::{PATIENCE, Running, file, isotherm};
use super::tree::{PROBE, Tree};
use isotherm::clock::Clock;
use isotherm::gateway::Options;
use isotherm::observe::status::Status;

/// Timeout of the sensor. A task that waited for the sensor would be late by this time.
const HANGS: Duration = Duration::from_secs(15);

const SENSORS: &str = r#"
[bus.pc]
type = "sysfs"
address = "ROOT"
timeout = "15s"
[device.probes]
bus = "pc"
every = "200ms"
[signal.cabinet]
device = "probes"
sensor = "hwmon:lm75"
[signal.probe]
device = "probes"
sensor = "w1:28-0316a2794f01"
"#;

fn machine(device: &Device, tree: &Tree) -> String {
    let times = Times {
        timeout: Duration::from_secs(3),
        every: Duration::from_millis(900),
        max_age: Duration::from_secs(30),
    };
    profile(device.address(), times) + &SENSORS.replace("ROOT", tree.root().to_str().unwrap())
}

fn quality<'s>(status: &'s Status, name: &str) -> &'s str {
    status.signals.iter().find(|signal| signal.name == name).map_or("", |signal| signal.quality)
}

fn served() -> (Device, Tree) {
    let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
    let tree = Tree::new();
    tree.hwmon(0, "lm75", "1-0048", &[("temp1_input", "21500")]);
    (device, tree)
}

#[test]
fn a_sensor_that_hangs_holds_no_other_line_and_no_end() {
    let (device, tree) = served();
    tree.hangs(&Tree::one_wire(PROBE));
    device.asks(30);
    let (clock, seen) = (Clock::wall(), device.clone());
    let (ends, ended) = std::sync::mpsc::channel();
    let by = clock.clone();
    beside(&machine(&device, &tree), Options::default(), move |source| {
        wait_until(source, "it hangs, and its neighbour is read", |status| {
            quality(status, "probe") == "timeout" && quality(status, "cabinet") == "good"
        });
        assert!(
            seen.wait(PATIENCE, |state| (state.offset() == 30).then_some(())).is_some(),
            "the axis follows"
        );
        let seen = seen.state().seen.clone();
        let asked = seen.iter().filter(|seen| matches!(seen.what, What::Asked { .. }));
        let asked: Vec<_> = asked.map(|seen| seen.at).collect();
        let longest = asked.windows(2).map(|pair| pair[1].since(pair[0])).max().unwrap();
        assert!(longest < HANGS - Duration::from_secs(3), "the machine was not asked for {longest:?}");
        ends.send(by.now()).unwrap();
    });
    let took = clock.now().since(ended.recv().unwrap());
    assert!(took < Duration::from_secs(40), "{took:?}");
}

#[test]
fn the_program_ends_in_time_while_a_sensor_hangs() {
    let (device, tree) = served();
    tree.hangs(&Tree::one_wire(PROBE));
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "machine.toml", &machine(&device, &tree));
    let mut running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
    assert!(device.wait(PATIENCE, |state| (state.seen.len() > 5).then_some(())).is_some());
    running.signal("TERM");
    assert!(running.ends_within(PATIENCE / 2).success(), "{:?}", running.said);
}

#[test]
fn a_sensor_at_power_on_and_one_that_is_disturbed_are_bad_until_they_are_well() {
    let (device, tree) = served();
    tree.measures(PROBE, 85_000);
    beside(&machine(&device, &tree).replace("15s", "8s"), Options::default(), move |source| {
        wait_until(source, "85 °C at power-on", |status| quality(status, "probe") == "power-on-value");
        tree.measures(PROBE, 23_125);
        wait_until(source, "it has measured", |status| quality(status, "probe") == "good");
        tree.put(&Tree::one_wire(PROBE), &super::tree::pad(23_125).replace("YES", "NO"));
        wait_until(source, "it is disturbed", |status| quality(status, "probe") == "checksum");
        std::fs::remove_dir_all(tree.root().join("bus/w1")).unwrap();
        wait_until(source, "it is gone", |status| quality(status, "probe") == "not-found");
    });
}
