//! Tests of the gateway with servers of other projects, and of the virtual machine with a client of another project.
//!
//! They need pymodbus and libmodbus; `tests/run interop` installs both. Without them these tests fail with a message.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::certificates;
use crate::support::process;

use process::{PATIENCE, Running, file, free_port, isotherm, until};

const PROFILE: &str = include_str!("../interop/machine.toml");

fn here(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop").join(name)
}

/// Directory of the tools that `tests/run` installs for these tests.
fn tools() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().join("tools")
}

/// Returns a command that runs a script in Python with pymodbus.
fn python(script: &str) -> Command {
    let python = tools().join("venv/bin/python");
    assert!(
        python.exists(),
        "pymodbus is not installed at {}: `tests/run interop` does it",
        python.display()
    );
    let mut command = Command::new(python);
    command.arg("-u").arg(here(script));
    command
}

/// Compiles the server of libmodbus from its C source, and returns the command to run it.
fn compiled(directory: &Path) -> Command {
    let program = directory.join("server");
    let mut compile = Command::new("cc");
    compile.args(["-Wall", "-Wextra", "-Werror", "-O1", "-o"]).arg(&program);
    let built = compile.arg(here("server.c")).arg("-lmodbus").output();
    let built =
        built.unwrap_or_else(|error| panic!("no C compiler ({error}): `tests/run interop` installs it"));
    let said = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "libmodbus is needed; `tests/run interop` installs it:\n{said}");
    Command::new(program)
}

/// Server or client that reads commands as lines, and answers each with a line.
struct Foreign(Running);

impl Foreign {
    /// Starts a server. Returns it with its port number or the path of its serial port.
    fn serves(mut command: Command) -> (Foreign, String) {
        let mut running = Running::start(&mut command);
        let place = running.receives("listening ").trim_start_matches("listening ").to_owned();
        (Foreign(running), place)
    }

    /// Starts a server over TCP. Returns it with the lines of a profile that describe it.
    fn server(command: Command) -> (Foreign, String) {
        let (server, port) = Foreign::serves(command);
        (server, format!("type = \"modbus-tcp\"\naddress = \"127.0.0.1:{port}\""))
    }

    #[track_caller]
    fn ask(&mut self, line: &str) -> String {
        // Written in one piece, because the C server takes each read for a whole line.
        self.0.stdin().write_all(format!("{line}\n").as_bytes()).unwrap();
        // Lines of its log may be between the answers.
        loop {
            if let Some(answer) = self.0.receives("> ").strip_prefix("> ") {
                return answer.to_owned();
            }
        }
    }

    #[track_caller]
    fn set(&mut self, what: &str, words: &[u16]) {
        let words: Vec<String> = words.iter().map(u16::to_string).collect();
        assert_eq!(self.ask(&format!("set {what} {}", words.join(" "))), "ok");
    }

    #[track_caller]
    fn words(&mut self, question: &str) -> Vec<u16> {
        let answer = self.ask(question);
        answer
            .split(' ')
            .map(|word| word.parse().unwrap_or_else(|_| panic!("{question}: {answer}")))
            .collect()
    }

    /// Reads a 32-bit value, high word first.
    #[track_caller]
    fn number(&mut self, what: &str) -> i32 {
        let words = self.words(&format!("get {what} 2"));
        i32::from_be_bytes([words[0].to_be_bytes(), words[1].to_be_bytes()].concat().try_into().unwrap())
    }

    fn temperatures(&mut self, bed: i16, wheelhead: i16) {
        self.set("1 input 0", &[bed.cast_unsigned(), wheelhead.cast_unsigned()]);
    }

    /// Sets the position. The counter has its low word first.
    fn position(&mut self, counts: i32) {
        let bytes = counts.to_be_bytes();
        let (high, low) =
            (u16::from_be_bytes([bytes[0], bytes[1]]), u16::from_be_bytes([bytes[2], bytes[3]]));
        self.set("2 holding 84", &[low, high]);
    }
}

/// Returns the profile with another line.
fn profile(line: &str) -> String {
    let written = "type    = \"modbus-tcp\"\naddress = \"127.0.0.1:1\"              # the test says where its server listens";
    assert!(PROFILE.contains(written));
    // Longer than a foreign server needs on a busy computer. On a serial port, the line listens for some timeouts
    // before use.
    let timeout = if line.contains("port = ") { "timeout = \"1s\"" } else { "timeout = \"3s\"" };
    PROFILE.replace(written, line).replace("timeout = \"300ms\"", timeout)
}

/// Runs the gateway with a machine on this server, and checks the registers of the server.
fn follows_the_machine(server: &mut Foreign, line: &str) {
    let home = tempfile::tempdir().unwrap();
    let profile = file(home.path(), "machine.toml", &profile(line));
    server.temperatures(275, 240);
    server.position(0);
    server.set("4 discrete 1", &[1]);
    let read = isotherm(home.path()).arg("read").arg(&profile).arg("--json").output().unwrap();
    let text = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{text}\n{}", String::from_utf8_lossy(&read.stderr));
    let document: Value = serde_json::from_str(&text).unwrap();
    let signals = document["signals"].as_array().unwrap();
    let value = |name: &str| signals.iter().find(|signal| signal["name"] == name).unwrap()["value"].clone();
    assert_eq!((value("bed"), value("cnc_on")), (27.5.into(), 1.0.into()));

    let check = isotherm(home.path()).arg("check").arg(&profile).arg("--online").output().unwrap();
    let text = String::from_utf8_lossy(&check.stdout);
    assert!(check.status.success(), "{text}\n{}", String::from_utf8_lossy(&check.stderr));
    assert!(text.contains("output cnc_z at holding:104 (40105): holds 0.0000 µm"), "{text}");

    let mut gateway = isotherm(home.path());
    let mut gateway = Running::start(gateway.arg("run").arg(&profile));
    gateway.receives("axis z: armed");
    // Temperatures in 0.1 °C and the position in 0.1 µm, beginning with the reference case.
    let cases: [(i16, i16, i32); 5] = [
        (275, 240, 1_234_567),
        (281, 240, 1_234_567),
        (281, 243, -987_654),
        (240, 252, 65_535),
        (-12, -10, 0),
    ];
    for (bed, wheelhead, position) in cases {
        server.temperatures(bed, wheelhead);
        server.position(position);
        // Cz = 2.4 µm/K · (A − B); both registers count 0.1 µm.
        let cz = 2.4 * f64::from(bed - wheelhead);
        until(&format!("A {bed}, B {wheelhead}, D {position}"), || {
            let offset = f64::from(server.number("4 holding 104"));
            let shown = f64::from(server.number("3 holding 10"));
            let good = (offset - cz).abs() <= 1.0 && (shown - (f64::from(position) + cz)).abs() <= 1.0;
            if good { Ok(()) } else { Err(format!("Cz {cz}, the offset is {offset}, the readout {shown}")) }
        });
    }
    let beat = server.words("get 4 holding 100 1");
    until("the heartbeat counts", || {
        if server.words("get 4 holding 100 1") == beat { Err("it stands".to_owned()) } else { Ok(()) }
    });
    gateway.signal("TERM");
    assert!(gateway.ends_within(PATIENCE).success(), "{}", gateway.said.join("\n"));
    assert_eq!(server.number("4 holding 104"), 0, "the fault action went to zero");
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves() {
    let (mut server, line) = Foreign::server(python("server.py"));
    follows_the_machine(&mut server, &line);
    // Each unit of this server has its own registers: nothing was written to another unit.
    assert_eq!(server.words("get 1 holding 104 2"), [0, 0]);
    assert_eq!(server.words("get 2 holding 10 2"), [0, 0]);
    assert_eq!(server.words("get 4 holding 106 2"), [0, 0]);
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves_inside_tls() {
    let directory = tempfile::tempdir().unwrap();
    let authority = certificates::Authority::new();
    let (device, gateway) =
        (authority.signs("localhost", (2020, 2099)), authority.signs("gateway", (2020, 2099)));
    let files = [
        ("ca.pem", &authority.cert),
        ("device.pem", &device.cert),
        ("device.key", &device.key),
        ("gw.pem", &gateway.cert),
        ("gw.key", &gateway.key),
    ];
    let [ca, _, _, cert, key] = files.map(|(name, text)| file(directory.path(), name, text));
    let mut command = python("server.py");
    command.arg("tls").arg(directory.path());
    let (mut server, port) = Foreign::serves(command);
    let tls = format!("tls = {{ ca = {ca:?}, cert = {cert:?}, key = {key:?}, name = \"localhost\" }}");
    let line = format!("type = \"modbus-tcp\"\naddress = \"127.0.0.1:{port}\"\n{tls}");
    follows_the_machine(&mut server, &line);
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves_as_rtu_over_tcp() {
    let mut command = python("server.py");
    command.arg("rtu-over-tcp");
    let (mut server, port) = Foreign::serves(command);
    let line = format!("type = \"modbus-rtu-over-tcp\"\naddress = \"127.0.0.1:{port}\"");
    follows_the_machine(&mut server, &line);
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves_on_a_serial_line_of_9600_baud() {
    let mut command = python("server.py");
    command.arg("rtu");
    let (mut server, path) = Foreign::serves(command);
    follows_the_machine(&mut server, &format!("type = \"modbus-rtu\"\nport = \"{path}\"\nbaud = 9600"));
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves_as_ascii_over_tcp() {
    let mut command = python("server.py");
    command.arg("ascii-over-tcp");
    let (mut server, port) = Foreign::serves(command);
    follows_the_machine(&mut server, &format!("type = \"modbus-ascii\"\naddress = \"127.0.0.1:{port}\""));
}

#[test]
fn the_gateway_follows_a_machine_that_pymodbus_serves_as_ascii_on_a_serial_line_of_9600_baud() {
    let mut command = python("server.py");
    command.arg("ascii");
    let (mut server, path) = Foreign::serves(command);
    let settings = "baud = 9600\ndata_bits = 8\nparity = \"none\"";
    follows_the_machine(&mut server, &format!("type = \"modbus-ascii\"\nport = \"{path}\"\n{settings}"));
}

#[test]
fn the_gateway_follows_a_machine_that_libmodbus_serves() {
    let directory = tempfile::tempdir().unwrap();
    let (mut server, line) = Foreign::server(compiled(directory.path()));
    follows_the_machine(&mut server, &line);
}

#[test]
fn a_foreign_client_reads_and_writes_the_virtual_machine() {
    let home = tempfile::tempdir().unwrap();
    let address = format!("127.0.0.1:{}", free_port());
    reads_and_writes(home.path(), &address, &format!("type = \"modbus-tcp\"\naddress = \"{address}\""));
}

#[test]
fn a_foreign_client_reads_and_writes_the_virtual_machine_on_a_serial_line_of_9600_baud() {
    let home = tempfile::tempdir().unwrap();
    let port = home.path().join("port").to_str().unwrap().to_owned();
    reads_and_writes(home.path(), &port, &format!("type = \"modbus-rtu\"\nport = \"{port}\"\nbaud = 9600"));
    assert!(!Path::new(&port).is_symlink(), "the port is left behind");
}

/// Runs the virtual machine on this line, and accesses it with a foreign client.
fn reads_and_writes(home: &Path, place: &str, line: &str) {
    let profile = file(home, "machine.toml", &profile(line));
    let mut devices = isotherm(home);
    let mut devices = Running::start(devices.arg("virtual").arg(&profile));
    devices.receives("stop with Ctrl-C");
    let mut python = python("client.py");
    let mut client = Foreign(Running::start(python.arg(place)));
    client.0.receives("ready");
    let temperatures = client.words("read 1 input 0 2");
    assert!(temperatures.iter().all(|raw| (50..600).contains(raw)), "{temperatures:?}");
    assert_eq!(client.words("read 4 discrete 1 1").len(), 1);
    assert_eq!(client.ask("write 4 104 65535 65452"), "ok", "an offset of −8.4 µm");
    assert_eq!(client.words("read 4 holding 104 2"), [65535, 65452]);
    assert_eq!(client.ask("write 4 100 7"), "ok", "the heartbeat");
    assert_eq!(client.ask("read 1 input 50 1"), "exception 2", "no such register");
    assert_eq!(client.ask("write 3 10 1"), "exception 1", "the readout has no function 06");
    devices.signal("TERM");
    assert!(devices.ends_within(PATIENCE).success());
}
