//! Modbus ASCII on real pseudo-terminals and sockets, with virtual devices and their faults.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::{Fault, PeerFault};
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::{Answer, Request};
use isotherm::virtual_machine::{FaultScript, Ports, Setup, UnknownUnit, VirtualMachine};
use isotherm_core::codec::{Register, Table};
use isotherm_profile::{DeviceId, Functions, Profile};

const OVER_A_PORT: &str = "port = \"/dev/isotherm-none\"\nbaud = 19200";
const THROUGH_TCP: &str = "address = \"127.0.0.1:4001\"";

const DEVICES: &str = r#"
[device.module]
bus  = "line"
unit = 3

[signal.bed]
device   = "module"
register = "input:0"
type     = "i16"
scale    = 0.1
unit     = "degC"

[signal.memory]
device     = "module"
register   = "holding:10"
type       = "i32"
word_order = "msw-first"
"#;

fn profile(line: &str) -> Profile {
    let text = format!(
        "[machine]\nname = \"ascii\"\n[bus.line]\ntype = \"modbus-ascii\"\ntimeout = \"1s\"\n{line}\n{DEVICES}"
    );
    let loaded = isotherm_profile::parse(Path::new("ascii.toml"), &text, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Virtual devices with a line of the gateway to them.
struct Bench {
    line: DeviceLine,
    machine: VirtualMachine,
}

impl Bench {
    async fn new(line: &str, faults: &str) -> Bench {
        let profile = profile(line);
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let setup =
            Setup { ports: Ports::Free, faults, unknown_unit: UnknownUnit::Silence, ..Setup::default() };
        let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
        let profile = machine.serving(profile);
        let bus = &profile.buses[0];
        let devices = [(DeviceId(0), &profile.devices[0])];
        let line = DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall());
        Bench { line, machine }
    }

    async fn asks(&mut self, request: Request<'_>) -> Result<Answer, Fault> {
        self.line.revive(None);
        let answered = self.line.request(DeviceId(0), request, SendDeadline::None).await;
        answered.map(|answered| answered.answer)
    }
}

fn read(table: Table, offset: u16, count: u16) -> Request<'static> {
    Request::read_registers(Register { table, offset }, count)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn registers_are_read_and_written_on_a_port_and_through_a_socket() {
    for line in [OVER_A_PORT, THROUGH_TCP] {
        let mut bench = Bench::new(line, "").await;
        let Ok(Answer::Registers(bed)) = bench.asks(read(Table::Input, 0, 1)).await else {
            panic!("no answer on {line}")
        };
        assert!((0..400).contains(&bed[0]), "{bed:?}");
        let write = Request::write_holding(10, &[1, 0xfffe], Functions::ALL);
        assert_eq!(bench.asks(write).await, Ok(Answer::Done), "{line}");
        let refused = bench.asks(read(Table::Input, 500, 1)).await;
        assert_eq!(refused, Err(Fault::Exception(2)), "{line}");
        bench.machine.stop().await.unwrap();
    }
}

/// Each fault costs one read, as on an RTU line.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_wrong_answer_is_a_fault_and_the_next_one_is_right() {
    for (kind, expected) in [
        ("silent", Err(Fault::Timeout)),
        ("wrong-checksum", Err(Fault::Peer(PeerFault::Malformed))),
        ("wrong-unit", Err(Fault::Peer(PeerFault::Foreign))),
        ("one-byte-at-a-time", Ok(())),
    ] {
        let script = format!("[[fault]]\ndevice = \"module\"\nkind = \"{kind}\"\nfor = 1\n");
        let mut bench = Bench::new(THROUGH_TCP, &script).await;
        assert_eq!(bench.asks(read(Table::Input, 0, 1)).await.map(|_| ()), expected, "{kind}");
        let mut last = Err(Fault::Timeout);
        for _ in 0..20 {
            last = bench.asks(read(Table::Input, 0, 1)).await;
            if last.is_ok() {
                break;
            }
            tokio::time::sleep(std::time::Duration::from_millis(500)).await;
        }
        assert!(last.is_ok(), "{kind}: {last:?}");
        bench.machine.stop().await.unwrap();
    }
}
