//! The first hours of the surface grinder, with devices on Modbus and on OPC UA: the corrections are equal.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use super::rig::python;
use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm::virtual_machine::{PlantSpec, Setup, TruthRow, VirtualMachine};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Profile, parse};

const GRINDER: &str = include_str!("../../../profiles/surface-grinder.toml");
const SPAN: Duration = Duration::from_hours(2);
/// Shorter span, for the virtual server.
const SHORT: Duration = Duration::from_hours(1);
/// One count of the registers: 0.1 µm.
const COUNT: i64 = 1;

/// Devices of a run.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Devices {
    Modbus,
    /// asyncua, in front of the Modbus devices.
    Bridge,
    /// OPC UA server of the virtual machine.
    VirtualServer,
}

/// Result of a run.
struct Run {
    /// True error of the machine and its correction, every ten seconds.
    course: Vec<TruthRow>,
    /// Written values, by device and time.
    written: BTreeMap<(usize, Moment), i64>,
}

/// Returns the profile of the grinder with the longest possible periods, and without keys that nodes do not support.
/// Virtual time stops during an answer, so that the speed of this computer has no effect.
fn grinder() -> String {
    let (before, heartbeat) = GRINDER.split_once("[heartbeat]").unwrap();
    let text = format!("{before}[web]{}", heartbeat.split_once("[web]").unwrap().1);
    let text = ["\"500ms\"\n", "\"1s\"\n"].iter().fold(text, |text, every| text.replace(every, "\"2s\"\n"));
    text.replace("max_age    = \"2s\"", "max_age    = \"5s\"").replace("\"300ms\"", "\"10s\"")
}

fn profile(text: &str) -> Profile {
    parse(Path::new("machine.toml"), text, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Returns the profile with a node for each register, and the names of the nodes. It has a placeholder for the port.
fn in_nodes(text: &str) -> (String, Vec<String>) {
    let mut names = Vec::new();
    let tables = text.split_inclusive("\n\n").map(|table| {
        let value = |key: &str| {
            let line =
                table.lines().find(|line| line.split('=').next().is_some_and(|name| name.trim() == key))?;
            line.split('"').nth(1)
        };
        let name = value("register").map(|register| {
            let kind = value("type").unwrap();
            let order = value("word_order").unwrap_or("msw-first");
            format!("{}/{}/{kind}/{order}", value("device").unwrap(), register.replace(':', "/"))
        });
        let lines = table.split_inclusive('\n').filter_map(|line| {
            let key = line.split('=').next().unwrap_or_default().trim();
            match key {
                "register" => Some(format!("node = \"ns=2;s={}\"\n", name.as_deref().unwrap())),
                "word_order" => None,
                "unit" if !line.contains('"') => None,
                "type" if line.contains("modbus-tcp") => {
                    Some("type = \"opcua\"\nsecurity = \"none\"\n".to_owned())
                }
                "address" => Some("address = \"opc.tcp://127.0.0.1:PORT\"\n".to_owned()),
                _ => Some(line.to_owned()),
            }
        });
        let table: String = lines.collect();
        names.extend(name);
        table
    });
    let text = tables.collect();
    (text, names)
}

/// OPC UA server that forwards to the devices of a machine. Dropping it ends the server.
struct Bridge(Child);

impl Bridge {
    fn start(devices: &[String], names: &[String]) -> (Bridge, String) {
        let mut command = python("opcua_bridge.py");
        command.args(devices).arg("--").args(names);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let mut says = BufReader::new(child.stdout.take().unwrap());
        let mut port = String::new();
        says.read_line(&mut port).unwrap();
        assert!(!port.is_empty(), "the bridge does not run");
        (Bridge(child), port.trim().to_owned())
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs the grinder as fast as possible.
fn run(on: Devices, span: Duration) -> Run {
    let text = grinder();
    let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
    let clock = Clock::simulated(plant.start(), None);
    let setup = Setup { journal: true, ..Setup::on_free_ports(plant, 7) };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let hold = clock.hold();
        let simulated = match on {
            Devices::VirtualServer => profile(&in_nodes(&text).0.replace("PORT", "4840")),
            _ => profile(&text),
        };
        let mut machine = VirtualMachine::start(&simulated, setup, &clock).await.unwrap();
        let window = machine.window();
        let mut last = clock.join();
        let (served, _bridge) = if on == Devices::Bridge {
            let at =
                simulated.devices.iter().map(|device| (&device.name, machine.address(device.bus).unwrap()));
            let devices: Vec<String> =
                at.map(|(name, address)| format!("{name}={}", address.port())).collect();
            let (text, names) = in_nodes(&text);
            let started = tokio::task::spawn_blocking(move || Bridge::start(&devices, &names));
            let (bridge, port) = started.await.unwrap();
            (profile(&text.replace("PORT", &port)), Some(bridge))
        } else {
            (machine.serving(simulated), None)
        };
        let gateway = Gateway::new(served, &clock, Options::default());
        drop(hold);
        let mut seen = None;
        let over = async {
            last.sleep(span).await;
            seen = Some((window.take_course(), window.requests()));
            drop(last);
        };
        tokio::select! {
            _ = gateway.run(over, std::future::pending()) => {}
            error = machine.failure() => panic!("{error}"),
        }
        let (course, requests) = seen.unwrap();
        let written = requests.into_iter().filter(|seen| seen.wanted.len() == 2).map(|seen| {
            let counts = i32::from(seen.wanted[0].cast_signed()) << 16 | i32::from(seen.wanted[1]);
            ((seen.device.0, seen.at), i64::from(counts))
        });
        Run { course, written: written.collect() }
    })
}

#[test]
fn the_grinder_is_corrected_over_opc_ua_as_over_modbus_within_a_tenth_of_a_micrometre() {
    let [modbus, opcua] = [Devices::Modbus, Devices::Bridge].map(|on| run(on, SPAN));
    let compensated = |row: &TruthRow| row.axes[0].error_um + row.axes[0].cz_um;
    let rows = || modbus.course.iter().zip(&opcua.course);
    assert!(modbus.course.len() >= 700 && opcua.course.len() == modbus.course.len());
    let worst = rows().map(|(a, b)| (compensated(a) - compensated(b)).abs()).fold(0.0, f64::max);
    let moved = modbus.course.iter().map(|row| row.axes[0].cz_um.abs()).fold(0.0, f64::max);
    let both: Vec<i64> = modbus
        .written
        .iter()
        .filter_map(|(at, counts)| Some((counts - opcua.written.get(at)?).abs()))
        .collect();
    let most = both.iter().copied().max().unwrap_or(i64::MAX);
    println!(
        "corrected by up to {moved:.1} µm; apart by {worst:.3} µm at most, registers by {most} counts in {} of {} writes",
        both.len(),
        modbus.written.len()
    );
    assert!(rows().all(|(a, b)| a.at == b.at));
    assert!(moved > 3.0, "nothing to correct: {moved}");
    assert!(worst <= 0.1, "{worst} µm");
    assert!(
        both.len() * 100 >= modbus.written.len() * 99 && most <= COUNT,
        "{} of {}",
        both.len(),
        modbus.written.len()
    );
}

#[test]
fn the_grinder_is_corrected_on_a_virtual_server_as_on_virtual_modbus_devices() {
    let [modbus, nodes] = [Devices::Modbus, Devices::VirtualServer].map(|on| run(on, SHORT));
    let compensated = |row: &TruthRow| row.axes[0].error_um + row.axes[0].cz_um;
    assert!(modbus.course.len() >= 350 && nodes.course.len() == modbus.course.len());
    for (a, b) in modbus.course.iter().zip(&nodes.course) {
        assert_eq!(a.at, b.at);
        assert!((compensated(a) - compensated(b)).abs() <= 0.1, "{a:?} {b:?}");
    }
    let moved = nodes.course.iter().map(|row| row.axes[0].cz_um.abs()).fold(0.0, f64::max);
    assert!(moved > 0.3, "nothing to correct: {moved}");
}
