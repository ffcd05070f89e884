//! Lines of text on real pseudo-terminals and sockets, with virtual devices and their faults.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::{Fault, PeerFault};
use isotherm::fieldbus::explain::explain_on;
use isotherm::fieldbus::kinds::kind::{ScanKind, ScanReport};
use isotherm::fieldbus::kinds::serial_ascii::OVER_TCP;
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::Request;
use isotherm::virtual_machine::{FaultScript, Ports, Setup, VirtualMachine};
use isotherm_core::reading::Reason;
use isotherm_profile::{BusId, DeviceId, Profile, Transport};

use crate::support::process::{Running, file, free_port, isotherm};

const OVER_A_PORT: &str =
    "port = \"/dev/isotherm-none\"\nbaud = 9600\ndata_bits = 7\nparity = \"even\"\nstop_bits = 2";
const THROUGH_TCP: &str = "address = \"127.0.0.1:4001\"";
const MALFORMED: Fault = Fault::Peer(PeerFault::Malformed);

/// Module that answers requests.
const MODULE: &str = r##"
[device.module]
bus  = "gauges"
unit = 4

[signal.bed]
device  = "module"
text    = ">{number.3}{any}{sum}"
request = "#{unit}{sum}\r"
unit    = "degC"

[signal.column]
device  = "module"
text    = ">{skip}{number.3}{any}{sum}"
request = "#{unit}{sum}\r"
unit    = "degC"
"##;

/// Readout that sends without a request.
const READOUT: &str = r#"
[device.readout]
bus   = "gauges"
every = "100ms"

[signal.z]
device = "readout"
text   = "Z={number.4} mm"
unit   = "mm"
"#;

/// Readout that answers the command of GIVI readouts.
const ON_REQUEST: &str = r#"
[device.readout]
bus = "gauges"

[signal.z]
device  = "readout"
text    = "{number.2}"
request = "Q\r\n"
unit    = "mm"
"#;

fn text(line: &str, device: &str) -> String {
    format!("[machine]\nname = \"text\"\n[bus.gauges]\ntype = \"serial-ascii\"\n{line}\n{device}")
}

fn profile(line: &str, device: &str) -> Profile {
    let text = text(line, device);
    let loaded = isotherm_profile::parse(Path::new("text.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Virtual devices with a line of the gateway to them.
struct Bench {
    profile: Profile,
    line: DeviceLine,
    machine: VirtualMachine,
}

impl Bench {
    async fn new(line: &str, device: &str, faults: &str) -> Bench {
        let profile = profile(line, device);
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let setup = Setup { ports: Ports::Free, faults, ..Setup::default() };
        let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
        let profile = machine.serving(profile);
        let bus = &profile.buses[0];
        let devices: Vec<_> =
            profile.devices.iter().enumerate().map(|(place, device)| (DeviceId(place), device)).collect();
        let line = DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall());
        Bench { profile, line, machine }
    }

    async fn read(&mut self) -> Result<Vec<Result<f64, Reason>>, Fault> {
        self.line.revive(None);
        let request = &self.profile.requests(DeviceId(0))[0];
        let answered =
            self.line.request(DeviceId(0), Request::from(&request.asks), SendDeadline::None).await?;
        let value = |field: &isotherm_profile::plan::Field| {
            answered.answer.decode(field, &self.profile.signal(field.signal).encoding)
        };
        Ok(request.fields.iter().map(value).collect())
    }

    /// Reads until a read succeeds. Returns the result of the last of at most `most` reads.
    async fn read_within(&mut self, most: u32) -> Result<Vec<Result<f64, Reason>>, Fault> {
        let mut last = self.read().await;
        for _ in 1..most {
            if last.is_err() {
                last = self.read().await;
            }
        }
        last
    }
}

fn fault(kind: &str) -> String {
    format!("[[fault]]\ndevice = \"module\"\nkind = \"{kind}\"\nfor = 1\n")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn devices_are_read_on_a_port_and_through_a_socket() {
    for line in [OVER_A_PORT, THROUGH_TCP] {
        for (device, count) in [(MODULE, 2), (READOUT, 1)] {
            let mut bench = Bench::new(line, device, "").await;
            for _ in 0..3 {
                let values = bench.read().await.unwrap();
                assert!(values.len() == count && values.iter().all(Result::is_ok), "{line}: {values:?}");
            }
            bench.machine.stop().await.unwrap();
        }
    }
}

/// Each fault costs one read, and no value is wrong.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_faulty_text_has_no_value_and_the_next_one_has() {
    for (kind, expected) in [
        ("kind = \"silent\"", Err(Fault::Timeout)),
        ("kind = \"late\"\ndelay = \"1500ms\"", Err(Fault::Timeout)),
        ("kind = \"wrong-checksum\"", Err(Fault::Peer(PeerFault::Checksum))),
        ("kind = \"short-read\"", Err(MALFORMED)),
        // A `"` follows the checksum.
        ("kind = \"wrong-unit\"", Err(Fault::Peer(PeerFault::Checksum))),
        ("kind = \"exception\"\ncode = 2", Err(MALFORMED)),
        ("kind = \"one-byte-at-a-time\"", Ok(())),
    ] {
        let script = fault("KIND").replace("kind = \"KIND\"", kind);
        let mut bench = Bench::new(THROUGH_TCP, MODULE, &script).await;
        assert_eq!(bench.read().await.map(|_| ()), expected, "{kind}");
        let values = bench.read_within(4).await.unwrap_or_else(|fault| panic!("{kind}: {fault}"));
        assert!(
            values.iter().all(|value| value.is_ok_and(|value| (0.0..40.0).contains(&value))),
            "{kind}: {values:?}"
        );
        bench.machine.stop().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_readout_that_is_switched_to_inch_is_reported_with_what_to_do() {
    let script = "[[fault]]\ndevice = \"readout\"\nkind = \"wrong-unit\"\n";
    let mut bench = Bench::new(THROUGH_TCP, READOUT, script).await;
    let fault = bench.read().await.unwrap_err();
    assert_eq!(fault, MALFORMED);
    let said = explain_on(Transport::AsciiOverTcp, fault).to_string();
    assert!(said.contains("for example inch") && said.contains("isotherm trace"), "{said}");
    bench.machine.stop().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_port_that_is_unplugged_is_a_fault_of_the_link_and_is_found_again() {
    let script = "[[fault]]\ndevice = \"module\"\nkind = \"refuse\"\nat = \"5s\"\nfor_time = \"2s\"\n";
    let mut bench = Bench::new(OVER_A_PORT, MODULE, script).await;
    // A busy computer hands the bytes of a port on after the timeout.
    bench.read_within(10).await.unwrap();
    let (mut was_lost, begun, clock) = (false, Clock::wall().now(), Clock::wall());
    while clock.now().since(begun) < Duration::from_secs(30) {
        let found = bench.read().await;
        was_lost |= matches!(found, Err(Fault::Link(_)));
        if was_lost && found.is_ok() {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("the port was lost: {was_lost}, and is not found again");
}

async fn scanned(bench: &Bench) -> ScanReport {
    let ScanKind::Other { scan: Some(scan), .. } = OVER_TCP.scan else { panic!("no scan") };
    scan(bench.profile.bus(BusId(0)), Some(Duration::from_millis(60))).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_scan_shows_the_text_of_a_readout_and_the_name_of_a_module() {
    let bench = Bench::new(THROUGH_TCP, READOUT, "").await;
    let report = scanned(&bench).await;
    let (_, lines) = report.profile.unwrap();
    assert!(lines.contains("text = \"Z={number.4} mm\""), "{lines}");
    bench.machine.stop().await.unwrap();
    let bench = Bench::new(THROUGH_TCP, ON_REQUEST, "").await;
    let (_, lines) = scanned(&bench).await.profile.unwrap();
    assert!(lines.contains("text = \"{number.2}\"\nrequest = \"Q\\r\\n\""), "{lines}");
    bench.machine.stop().await.unwrap();
    let second = ON_REQUEST.split_once("[signal.z]").unwrap().1.replace("{number.2}", "Y{number.2}");
    let bench = Bench::new(THROUGH_TCP, &format!("{ON_REQUEST}\n[signal.y]{second}"), "").await;
    let report = scanned(&bench).await;
    assert!(report.text.starts_with("2 lines") && report.text.contains("\"Y"), "{}", report.text);
    bench.machine.stop().await.unwrap();
    let bench = Bench::new(THROUGH_TCP, MODULE, "").await;
    let report = scanned(&bench).await;
    assert!(report.text.contains("DCON module 7018 at address 04"), "{}", report.text);
    bench.machine.stop().await.unwrap();
}

#[test]
fn the_verbs_read_a_virtual_module() {
    let home = tempfile::tempdir().unwrap();
    let line = format!("address = \"127.0.0.1:{}\"", free_port());
    let profile = file(home.path(), "text.toml", &text(&line, MODULE));
    let mut devices = isotherm(home.path());
    let mut devices = Running::start(devices.arg("virtual").arg(&profile));
    devices.receives("stop with Ctrl-C");
    let read = isotherm(home.path()).arg("read").arg(&profile).arg("--json").output().unwrap();
    let said = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{said}\n{}", String::from_utf8_lossy(&read.stderr));
    let document: serde_json::Value = serde_json::from_str(&said).unwrap();
    let signals = document["signals"].as_array().unwrap();
    let is_warm = |signal: &serde_json::Value| {
        signal["value"].as_f64().is_some_and(|value| (10.0..40.0).contains(&value))
    };
    assert!(signals.len() == 2 && signals.iter().all(is_warm), "{said}");
    let check = isotherm(home.path()).arg("check").arg(&profile).arg("--online").output().unwrap();
    let said = String::from_utf8_lossy(&check.stdout);
    assert!(check.status.success(), "{said}\n{}", String::from_utf8_lossy(&check.stderr));
    assert!(said.contains("send \"#04") && said.contains("receive 2 texts"), "{said}");
}
