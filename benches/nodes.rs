//! Benchmark of 500 values, ten times per second, from OPC UA nodes and from Modbus registers: processor time and
//! memory of the gateway.
//!
//! A second part measures the OPC UA server of the gateway: the same 500 nodes change ten times per second, and clients
//! subscribe to all of them. The limit: one subscriber costs at most 5 % of a core, and no poll is later than without.
//!
//! `isotherm run` is a separate process here, as on a machine. So are its devices: a server of asyncua, and
//! `isotherm virtual`. The limits: the values arrive ten times per second. OPC UA takes at most three times the
//! processor time of Modbus, and 20 MB more.
//!
//! Run it with `cargo bench --features opcua --bench nodes`. An argument sets the seconds of a measurement. It requires
//! asyncua (`tests/run opcua`).

#![allow(clippy::unwrap_used, reason = "a bench may stop where it stands")]

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use isotherm::clock::Clock;

#[path = "process/mod.rs"]
mod process;

use process::Process;

const VALUES: usize = 500;
/// Polls per second.
const RATE: f64 = 10.0;
const WARM_UP: Duration = Duration::from_secs(5);
const MOST_TIMES: f64 = 3.0;
const MOST_MB_MORE: f64 = 20.0;
/// Largest share of a core that the OPC UA server may cost with one subscriber, in percent.
const MOST_SERVING: f64 = 5.0;
/// Largest lateness of a poll, in milliseconds, that does not count as late.
const LATE_MS: f64 = 5.0;

fn main() {
    let seconds = std::env::args().skip(1).find(|word| word != "--bench");
    let span = Duration::from_secs(seconds.map_or(20, |seconds| seconds.parse().unwrap()));
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path();
    println!("{:<52}{:>10}{:>8}{:>16}", "500 values, 10 Hz", "% of core", "MB", "polls a second");

    let port = free();
    let profile = registers(place, port);
    let devices = Process::start(isotherm("virtual", &profile).stdout(Stdio::null()));
    let modbus = measure("Modbus TCP, four requests", &profile, span);
    drop(devices);
    for (name, subscribed, changing) in [
        ("OPC UA, asked for by one Read", false, false),
        ("OPC UA, subscribed to, all of them changing", true, true),
        ("OPC UA, subscribed to, none of them changing", true, false),
    ] {
        let (server, port) = server(changing);
        let found = measure(name, &nodes(place, port, subscribed, ""), span);
        drop(server);
        if !subscribed {
            let is_reached = found.core < MOST_TIMES * modbus.core
                && found.memory < modbus.memory + MOST_MB_MORE
                && found.rate > 0.98 * RATE;
            let reached = if is_reached { "reached" } else { "MISSED" };
            println!(
                "    at most {MOST_TIMES} times the processor time, {MOST_MB_MORE} MB more than Modbus: {:.2} times, {:.1} MB: {reached}",
                found.core / modbus.core,
                found.memory - modbus.memory
            );
        }
    }
    serving(place, span);
}

/// Measures the OPC UA server of the gateway, with no, one and ten subscribers to all values.
fn serving(place: &Path, span: Duration) {
    let (server, port) = server(true);
    let own = free();
    let table = format!(
        "[opcua_server]\nlisten = \"127.0.0.1:{own}\"\nsecurity = \"none\"\nanonymous = true\nevery = \"100ms\"\n"
    );
    let without = measure("OPC UA, all changing, not served", &nodes(place, port, false, ""), span);
    for clients in [0, 1, 10] {
        let profile = nodes(place, port, false, &table);
        let name = format!("… and served to {clients} OPC UA clients");
        let found = measured(&name, &profile, span, || (0..clients).map(|_| subscriber(own, span)).collect());
        if clients == 1 {
            let more = found.core - without.core;
            let is_reached = more < MOST_SERVING && found.late <= without.late + 0.002;
            let reached = if is_reached { "reached" } else { "MISSED" };
            println!(
                "    at most {MOST_SERVING} % of a core more, and no more late polls: {more:.2} %, {:.2} % of polls more \
                 than {LATE_MS} ms late instead of {:.2} %: {reached}",
                100.0 * found.late,
                100.0 * without.late
            );
        }
    }
    drop(server);
}

/// Starts a client of asyncua that subscribes to all values, for as long as a measurement takes.
fn subscriber(port: u16, span: Duration) -> Process {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = Path::new(PROGRAM).parent().unwrap().parent().unwrap();
    let mut command = Command::new(target.join("tools/venv/bin/python"));
    command.arg(here.join("tests/interop/opcua_client.py")).arg(format!("opc.tcp://127.0.0.1:{port}"));
    command.args(["watch-all", &(span + 10 * WARM_UP).as_secs().to_string()]);
    Process::start(command.stdout(Stdio::null()).stderr(Stdio::null()))
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_isotherm");

/// Command line of a verb; verbs other than `virtual` get a state directory.
fn isotherm(verb: &str, profile: &Path) -> Command {
    let mut command = Command::new(PROGRAM);
    command.arg(verb).arg(profile).stderr(Stdio::null());
    if verb != "virtual" {
        command.arg("--state").arg(profile.parent().unwrap());
    }
    command
}

fn free() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Starts a server of asyncua, and returns its process and port.
fn server(changing: bool) -> (Process, u16) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = Path::new(PROGRAM).parent().unwrap().parent().unwrap();
    let port = free();
    let mut command = Command::new(target.join("tools/venv/bin/python"));
    command.arg(here.join("tests/interop/opcua_server.py")).args(["--port", &port.to_string()]);
    command.args(["--many", &VALUES.to_string()]);
    if changing {
        command.arg("--changing");
    }
    // The server ends when its input closes. Nothing is ever written to the input.
    let (receives, said) = std::io::pipe().unwrap();
    let (told, tells) = std::io::pipe().unwrap();
    let process = Process::start(command.stdin(told).stdout(said));
    std::mem::forget(tells);
    let mut line = String::new();
    BufReader::new(receives).read_line(&mut line).unwrap();
    (process, line.trim().parse().unwrap())
}

struct Found {
    core: f64,
    memory: f64,
    rate: f64,
    /// Share of the polls that were more than [`LATE_MS`] late.
    late: f64,
}

fn measure(name: &str, profile: &Path, span: Duration) -> Found {
    measured(name, profile, span, Vec::new)
}

/// Measures a gateway with these clients, which start after it.
fn measured(name: &str, profile: &Path, span: Duration, clients: impl FnOnce() -> Vec<Process>) -> Found {
    let process = Process::start(isotherm("run", profile).stdout(Stdio::null()));
    std::thread::sleep(WARM_UP);
    let clients = clients();
    if !clients.is_empty() {
        // Each client browses and subscribes first.
        std::thread::sleep(3 * WARM_UP);
    }
    let (begun, busy, before) = (Clock::wall().now(), process.busy(), polls(profile));
    std::thread::sleep(span);
    let passed = Clock::wall().now().since(begun).as_secs_f64();
    let core = 100.0 * (process.busy() - busy) / passed;
    let found = Found {
        core,
        memory: process.memory_mb(),
        rate: (polls(profile) - before) / passed,
        late: late(profile),
    };
    drop(clients);
    println!("{name:<52}{:>10.2}{:>8.1}{:>16.2}", found.core, found.memory, found.rate);
    found
}

fn status(profile: &Path) -> serde_json::Value {
    let said = isotherm("status", profile).arg("--json").output().unwrap().stdout;
    serde_json::from_slice(&said).unwrap()
}

/// Share of the polls so far that were more than [`LATE_MS`] late.
fn late(profile: &Path) -> f64 {
    let status = status(profile);
    let (mut late, mut all) = (0.0, 0.0);
    for bucket in status["buses"][0]["jitter_ms"].as_array().unwrap() {
        let count = bucket[1].as_f64().unwrap();
        all += count;
        if bucket[0].as_f64().is_none_or(|bound| bound > LATE_MS) {
            late += count;
        }
    }
    late / all
}

/// Number of polls so far. All values must be good.
fn polls(profile: &Path) -> f64 {
    let status = status(profile);
    let signals = status["signals"].as_array().unwrap();
    let bad: Vec<_> = signals.iter().filter(|signal| signal["quality"] != "good").collect();
    assert!(bad.is_empty() && signals.len() == VALUES, "{} are bad, as {:?}", bad.len(), bad.first());
    status["buses"][0]["cycles"].as_f64().unwrap()
}

fn registers(place: &Path, port: u16) -> PathBuf {
    let bus = format!("type = \"modbus-tcp\"\naddress = \"127.0.0.1:{port}\"\n");
    let signal = |number| format!("register = \"input:{number}\"\ntype = \"i16\"\nscale = 0.1\n");
    written(place, &bus, "unit = 1\n", "", signal)
}

/// Profile of the nodes, with these further tables.
fn nodes(place: &Path, port: u16, is_subscribed: bool, tables: &str) -> PathBuf {
    let bus = format!("type = \"opcua\"\naddress = \"opc.tcp://127.0.0.1:{port}\"\nsecurity = \"none\"\n");
    let read = if is_subscribed { "read = \"subscription\"\n" } else { "" };
    let device = format!("source_time = \"changed\"\n{read}");
    written(place, &bus, &device, tables, |number| format!("node = \"ns=2;s=many{number}\"\n"))
}

fn written(place: &Path, bus: &str, device: &str, tables: &str, signal: impl Fn(usize) -> String) -> PathBuf {
    let mut text = format!(
        "[machine]\nname = \"nodes\"\n[web]\nlisten = \"127.0.0.1:{}\"\n{tables}[bus.b]\n{bus}timeout = \"1s\"\n\
         [device.d]\nbus = \"b\"\nevery = \"100ms\"\n{device}",
        free()
    );
    for number in 0..VALUES {
        let own = signal(number);
        write!(text, "[signal.s{number}]\ndevice = \"d\"\n{own}unit = \"degC\"\nmax_age = \"5s\"\n").unwrap();
    }
    let path = place.join("nodes.toml");
    std::fs::write(&path, text).unwrap();
    path
}
