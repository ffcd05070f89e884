//! `scan`, `read --register` and `trace` with virtual devices on real sockets.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::support::process;

use process::{PATIENCE, Running, file, free_port, isotherm};

const MACHINE: &str = include_str!("../interop/machine.toml");

struct Ended {
    code: Option<i32>,
    out: String,
    said: String,
}

fn ended(command: &mut Command) -> Ended {
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ended { code: status.code(), out: text(stdout), said: text(stderr) }
}

/// Four units with one address: 1 to 4.
struct Bench {
    home: tempfile::TempDir,
    profile: PathBuf,
    line: String,
    _devices: Running,
}

impl Bench {
    fn start() -> Bench {
        let home = tempfile::tempdir().unwrap();
        let address = format!("127.0.0.1:{}", free_port());
        let text = MACHINE.replace("127.0.0.1:1\"", &format!("{address}\""));
        let profile = file(home.path(), "machine.toml", &text);
        let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&profile));
        devices.receives("stop with Ctrl-C");
        Bench { home, profile, line: format!("tcp://{address}"), _devices: devices }
    }

    fn home(&self) -> &Path {
        self.home.path()
    }

    fn scan(&self, more: &[&str]) -> Ended {
        ended(isotherm(self.home()).args(["scan", "--bus", &self.line, "--timeout", "200ms"]).args(more))
    }

    fn read(&self, more: &[&str]) -> Ended {
        ended(isotherm(self.home()).args(["read", "--bus", &self.line]).args(more))
    }
}

#[test]
fn a_scan_finds_the_units_that_answer_also_with_an_exception_and_writes_lines_that_a_profile_takes() {
    let bench = Bench::start();
    let scan = bench.scan(&["--units", "1..6"]);
    assert_eq!(scan.code, Some(0), "{}", scan.said);
    assert!(scan.said.contains("scanning units 1 to 6 on tcp://127.0.0.1:"), "{}", scan.said);
    assert!(
        scan.said.contains("by reading holding:0 (40001); at most 200ms for each answer, 3s in total"),
        "{}",
        scan.said
    );
    assert!(scan.out.contains("unit 1 answers (exception 2: no such register)"), "{}", scan.out);
    assert!(scan.out.contains("unit 4 answers: holding:0 = "), "{}", scan.out);
    assert!(!scan.out.contains("unit 5") && !scan.out.contains("unit 6"), "{}", scan.out);

    let lines = scan.out.split("# for a profile:").nth(1).unwrap();
    let tail = "\n[signal.t]\ndevice = \"unit1\"\nregister = \"input:0\"\ntype = \"i16\"\nunit = \"degC\"\nmax_age = \"5s\"\n";
    let text = format!("[machine]\nname = \"pasted\"\n{lines}{tail}");
    let pasted = file(bench.home(), "pasted.toml", &text);
    let check = ended(isotherm(bench.home()).arg("check").arg(&pasted));
    assert_eq!(check.code, Some(0), "{}\n{text}", check.said);

    let document: Value = serde_json::from_str(&bench.scan(&["--units", "1..2", "--json"]).out).unwrap();
    assert_eq!(document["units"][0]["found"]["unit"], 1, "{document}");
    assert_eq!(document["units"].as_array().unwrap().len(), 2, "{document}");

    let named = ["scan", "machine.toml", "--bus", "cell", "--units", "4..6", "--timeout", "100ms"];
    let named = ended(isotherm(bench.home()).current_dir(bench.home()).args(named));
    assert!(named.out.contains("# unit 4 is the profile's device cnc"), "{}{}", named.out, named.said);
}

#[test]
fn a_scan_of_registers_tells_which_a_unit_has() {
    let bench = Bench::start();
    let scan = bench.scan(&["--units", "1", "--register", "input:0", "--registers", "input:0..40"]);
    assert_eq!(scan.code, Some(0), "{}", scan.said);
    assert!(scan.out.contains("unit 1  input:0 (30001)  "), "{}", scan.out);
    assert!(scan.out.contains("(30003), 39 of them: exception 2 (illegal data address)"), "{}", scan.out);
}

#[test]
fn a_scan_that_is_stopped_says_how_far_it_came_and_what_it_found() {
    let home = tempfile::tempdir().unwrap();
    let mut scan = isotherm(home.path());
    scan.args(["scan", "--bus", &careless_device(4), "--timeout", "10s"]);
    let mut scan = Running::start(&mut scan);
    scan.receives("unit 4 answers");
    scan.signal("INT");
    assert_eq!(scan.ends_within(PATIENCE).code(), Some(1), "{}", scan.said.join("\n"));
    let said = scan.said.join("\n");
    assert!(said.contains("stopped after 4 of 247 requests"), "{said}");
    assert!(said.contains("[device.unit4]"), "{said}");
}

#[test]
fn where_nobody_answers_a_scan_fails_and_says_what_to_try() {
    let home = tempfile::tempdir().unwrap();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let line = format!("tcp://{}", silent.local_addr().unwrap());
    let scan =
        ended(isotherm(home.path()).args(["scan", "--bus", &line, "--units", "1..2", "--timeout", "50ms"]));
    assert_eq!(scan.code, Some(1));
    assert!(scan.said.contains("no unit answered. Try another port"), "{}", scan.said);
    let line = format!("tcp://127.0.0.1:{}", free_port());
    let refused = ended(isotherm(home.path()).args(["scan", "--bus", &line]));
    assert_eq!(refused.code, Some(1));
    assert!(refused.said.contains(&format!("{line}: no program listens at this port")), "{}", refused.said);
}

/// Starts a device that gives the same answer for all units up to `last`, and none for the others.
fn careless_device(last: u8) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut asked = [0; 12];
            // The client has one connection at a time.
            while stream.read_exact(&mut asked).is_ok() {
                if asked[6] > last {
                    continue;
                }
                let reply = [asked[0], asked[1], 0, 0, 0, 5, asked[6], asked[7], 2, 0, 42];
                if stream.write_all(&reply).is_err() {
                    break;
                }
            }
        }
    });
    format!("tcp://{address}")
}

#[test]
fn a_device_that_heeds_no_unit_number_is_taken_for_one() {
    let home = tempfile::tempdir().unwrap();
    let scan = ended(isotherm(home.path()).args(["scan", "--bus", &careless_device(255), "--units", "1..9"]));
    assert_eq!(scan.code, Some(0), "{}", scan.said);
    assert!(scan.out.contains("one device that ignores the unit number"), "{}", scan.out);
    assert_eq!(scan.out.matches("[device.").count(), 1, "{}", scan.out);
}

#[test]
fn a_register_is_read_without_a_signal_in_both_numbers_and_with_its_raw_words() {
    let bench = Bench::start();
    let read = bench.read(&["--unit", "2", "--register", "40085", "--type", "i32"]);
    assert_eq!(read.code, Some(0), "{}", read.said);
    assert!(read.out.contains("holding:84 (40085)  ") && read.out.contains("msw-first "), "{}", read.out);
    assert!(read.out.contains("lsw-first ") && read.said.contains("add --word-order"), "{}", read.said);

    let more =
        ["--device", "counter", "--register", "holding:84", "--type", "i32", "--word-order", "lsw-first"];
    let mut named = isotherm(bench.home());
    named.arg("read").arg(&bench.profile).args(more).args(["--scale", "0.0001", "--json", "--trace"]);
    let named = ended(&mut named);
    assert_eq!(named.code, Some(0), "{}", named.said);
    let document: Value = serde_json::from_str(&named.out).unwrap();
    let value = &document["values"][0];
    assert_eq!((value["register"].as_str(), value["modicon"].as_str()), (Some("holding:84"), Some("40085")));
    let millimetres: f64 = value["readings"][0]["value"].as_str().unwrap().parse().unwrap();
    assert!(millimetres.abs() < 500.0, "{document}");
    assert!(named.said.contains("00 06 02 03 00 54 00 02   unit 2 read holding:84..85"), "{}", named.said);
    assert!(named.said.contains("2 registers: "), "{}", named.said);
}

#[test]
fn reading_one_register_again_and_again_goes_on_after_a_fault() {
    let bench = Bench::start();
    let mut watch = isotherm(bench.home());
    let place = ["--unit", "1", "--register", "input:0", "--watch", "--every", "50ms"];
    let mut watch = Running::start(watch.args(["read", "--bus", &bench.line]).args(place));
    watch.receives("input:0 (30001)");
    watch.receives("input:0 (30001)");
    let mut missing = isotherm(bench.home());
    let place = ["--unit", "1", "--register", "input:9", "--watch", "--every", "50ms"];
    let mut missing = Running::start(missing.args(["read", "--bus", &bench.line]).args(place));
    missing.receives("input:9 (30010): exception 2");
    missing.receives("input:9 (30010): exception 2");
}

#[test]
fn what_is_wrong_with_a_reading_is_reported_with_a_remedy() {
    let bench = Bench::start();
    for (arguments, code, words) in [
        (
            &["--unit", "1", "--register", "30010"][..],
            1,
            "unit 1, input:9 (30010): exception 2 (illegal data address): the device has no such register",
        ),
        (&["--unit", "9", "--register", "input:0", "--timeout", "50ms"], 1, "unit 9: exception 11"),
        (&["--unit", "1", "--register", "input:0", "--type", "i32", "--count", "63"], 2, "at most 62 values"),
        (&["--unit", "1", "--register", "coil:0", "--type", "i16"], 2, "a single bit"),
        (&["--unit", "1", "--register", "input:65535", "--count", "2"], 2, "exceed the last register"),
        (&["--unit", "1", "--register", "register:1"], 2, "coil, discrete, input, holding"),
        (&["--unit", "1", "--register", "input:0", "--scale", "0"], 2, "a scale of 0"),
        (&["--unit", "1", "--register", "input:0", "--type", "int"], 2, "allowed: bool, u16"),
        (&["--register", "input:0"], 2, "--unit is missing"),
        (&["--unit", "1"], 2, "--register"),
    ] {
        let read = bench.read(arguments);
        assert_eq!(read.code, Some(code), "{arguments:?}: {}{}", read.out, read.said);
        assert!(read.said.contains(words), "{arguments:?}: {}", read.said);
    }
    let alone = |arguments: &[&str]| ended(isotherm(bench.home()).args(arguments));
    for (arguments, words) in [
        (&["read"][..], "give a PROFILE"),
        (&["read", "--register", "input:0"], "needs a unit"),
        (&["scan"], "give a bus line"),
        (&["scan", "--bus", "tcp://x", "--baud", "9600"], "are for a serial line"),
        (&["scan", "--bus", "ascii:///dev/ttyUSB0", "--baud", "9600"], "write them in its address: ascii://"),
        (&["scan", "--bus", "tcp://x", "--units", "9..1"], "write 1..247 or 3"),
        (&["scan", "--bus", "tcp://x", "--registers", "holding:9..1"], "holding:0..99"),
    ] {
        let refused = alone(arguments);
        assert_eq!(refused.code, Some(2), "{arguments:?}: {}", refused.said);
        assert!(refused.said.contains(words), "{arguments:?}: {}", refused.said);
    }
    let nowhere = alone(&["read", "--bus", "modbus://192.168.0.10", "--unit", "1", "--register", "input:0"]);
    assert!(nowhere.said.contains("write tcp://192.168.0.10:502"), "{}", nowhere.said);
}

#[test]
fn the_frames_of_one_device_of_a_running_gateway_can_be_had_while_it_runs() {
    let bench = Bench::start();
    let state = bench.home().display().to_string();
    let mut gateway = isotherm(bench.home());
    let mut gateway = Running::start(gateway.arg("run").arg(&bench.profile).args(["--state", &state]));
    gateway.receives("axis z: armed");
    let trace = |device: &str, more: &[&str]| {
        let mut trace = isotherm(bench.home());
        trace.arg("trace").arg(&bench.profile).args(["--state", &state, "--device", device]).args(more);
        ended(&mut trace)
    };
    let heard = trace("thermocouples", &["--for", "2s"]);
    assert_eq!(heard.code, Some(0), "{}", heard.said);
    let asked = heard.out.lines().filter(|line| line.contains("unit 1 read input:0..1")).count();
    assert!((3..=6).contains(&asked), "two seconds at two a second: {}", heard.out);
    assert!(heard.out.contains(" 00 00 00 06 01 04 00 00 00 02   unit 1"), "{}", heard.out);
    assert!(heard.out.contains("2 registers: ") && !heard.out.contains("unit 4"), "{}", heard.out);
    assert!(heard.said.contains(&format!("{asked} exchanges")), "{}", heard.said);

    let out = bench.home().join("cnc.log");
    let written = trace("cnc", &["--for", "1s", "--json", "--out", &out.display().to_string()]);
    assert_eq!(written.code, Some(0), "{}", written.said);
    let lines = std::fs::read_to_string(&out).unwrap();
    let first: Value = serde_json::from_str(lines.lines().next().unwrap()).unwrap();
    assert_eq!(first["unit"], 4, "{first}");
    let again = trace("cnc", &["--for", "1s", "--out", &out.display().to_string()]);
    assert!(again.code == Some(1) && again.said.contains("is not overwritten"), "{}", again.said);
    assert!(trace("lathe", &[]).said.contains("there is no device `lathe`; there are: "));

    // A user ends the trace early. The gateway continues, and another trace is possible.
    let mut left = isotherm(bench.home());
    left.arg("trace").arg(&bench.profile).args(["--state", &state, "--device", "cnc"]);
    let mut left = Running::start(&mut left);
    left.receives("unit 4 ");
    left.signal("INT");
    left.ends_within(PATIENCE);
    assert_eq!(trace("cnc", &["--for", "1s"]).code, Some(0));
    gateway.signal("TERM");
    assert_eq!(gateway.ends_within(PATIENCE).code(), Some(0), "{}", gateway.said.join("\n"));
    let alone = trace("cnc", &[]);
    assert!(alone.said.contains("no gateway of this machine is running here"), "{}", alone.said);
}

#[test]
fn on_a_serial_line_scan_finds_units_and_settings_and_the_frames_are_shown_with_their_checksums() {
    let home = tempfile::tempdir().unwrap();
    let port = home.path().join("port").display().to_string();
    let line = format!("type = \"modbus-rtu\"\nport = \"{port}\"\nbaud = 9600\n");
    let text = MACHINE.replace("type    = \"modbus-tcp\"\n", &line);
    let text: Vec<&str> = text.lines().filter(|line| !line.starts_with("address = ")).collect();
    let profile = file(home.path(), "machine.toml", &text.join("\n"));
    let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&profile));
    devices.receives("stop with Ctrl-C");
    let bus = format!("rtu://{port}");
    // On a busy computer the kernel may take longer to move the bytes between both ends of the port.
    let attempt = |timeout: &str| {
        let scan = ["--units", "3..6", "--timeout", timeout, "--baud", "9600,19200", "--parity", "none"];
        let scan = ended(isotherm(home.path()).args(["scan", "--bus", &bus]).args(scan));
        let words = format!("in 2 settings; at most {timeout} for each answer");
        assert!(scan.said.contains(&words), "{}", scan.said);
        scan
    };
    let scan = attempt("150ms");
    let scan = if scan.code == Some(0) { scan } else { attempt("2s") };
    assert_eq!(scan.code, Some(0), "{}", scan.said);
    assert!(
        scan.out.contains(&format!("unit 4 answers on {port} at 9600 baud 8N1: holding:0 = ")),
        "{}",
        scan.out
    );
    assert!(
        scan.out.contains("type = \"modbus-rtu\"\nport = ")
            && scan.out.contains("baud = 9600\nparity = \"none\"")
    );
    assert!(!scan.out.contains("unit 5"), "{}", scan.out);
    let place = ["--unit", "1", "--register", "input:0", "--count", "2", "--trace"];
    let read = ended(isotherm(home.path()).args(["read", "--bus", &bus]).args(place));
    assert_eq!(read.code, Some(0), "{}", read.said);
    assert!(read.said.contains("→ 01 04 00 00 00 02 71 cb   unit 1 read input:0..1"), "{}", read.said);
    assert!(read.said.contains("← 01 04 04 ") && read.said.contains("2 registers: "), "{}", read.said);
    let absent = ["read", "--bus", "rtu:///dev/not-there", "--unit", "1", "--register", "input:0"];
    let absent = ended(isotherm(home.path()).args(absent));
    assert!(
        absent.code == Some(1) && absent.said.contains("/dev/not-there at 9600 baud 8N1: no such"),
        "{}",
        absent.said
    );
}
