//! Tests of a line of sensors. A sensor that hangs is a timeout, costs only one, and is read again when it returns.

use std::time::Duration;

use super::tree::{PROBE, Tree, pad};
use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::{CallerFault, Fault};
use isotherm::fieldbus::explain::explain_on;
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::{ModbusRequest, Request};
use isotherm_core::reading::Reason;
use isotherm_profile::{DeviceId, Profile, Transport};

/// Long enough for sensors that do not hang, on a busy computer.
const TIMEOUT: Duration = Duration::from_secs(6);

const PROFILE: &str = r#"
[machine]
name = "pc"
[bus.pc]
type = "sysfs"
address = "ROOT"
timeout = "6s"
[device.probes]
bus = "pc"
every = "5s"
[signal.cabinet]
device = "probes"
sensor = "hwmon:lm75"
[signal.bed]
device = "probes"
sensor = "w1:28-0316a2794f01"
[signal.bed_again]
device = "probes"
sensor = "w1:28-0316a2794f01"
offset = -0.5
"#;

struct Line {
    profile: Profile,
    line: DeviceLine,
}

impl Line {
    fn to(tree: &Tree) -> Line {
        let text = PROFILE.replace("ROOT", tree.root().to_str().unwrap());
        let loaded = isotherm_profile::parse("machine.toml".as_ref(), &text, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        let devices: Vec<_> = profile.devices.iter().map(|device| (DeviceId(0), device)).collect();
        let line =
            DeviceLine::new(&profile.buses[0], &devices, dial(&profile.buses[0]).unwrap(), &Clock::wall());
        Line { line, profile }
    }

    async fn reads(&mut self) -> Result<Vec<Result<f64, Reason>>, Fault> {
        self.line.revive(None);
        let request = &self.profile.requests(DeviceId(0))[0];
        let answered =
            self.line.request(DeviceId(0), Request::from(&request.asks), SendDeadline::None).await?;
        let fields = request.fields.iter();
        Ok(fields
            .map(|field| answered.answer.decode(field, &self.profile.signal(field.signal).encoding))
            .collect())
    }
}

fn tree() -> Tree {
    let tree = Tree::new();
    tree.hwmon(0, "lm75", "1-0048", &[("temp1_input", "21500")]);
    tree
}

#[tokio::test]
async fn a_sensor_that_two_signals_name_is_read_once_for_both() {
    let tree = tree();
    tree.measures(PROBE, 23_125);
    assert_eq!(Line::to(&tree).reads().await, Ok(vec![Ok(21.5), Ok(23.125), Ok(22.625)]));
}

#[tokio::test]
async fn each_sensor_has_a_fault_of_its_own() {
    let tree = tree();
    let mut line = Line::to(&tree);
    assert_eq!(line.reads().await.unwrap()[..2], [Ok(21.5), Err(Reason::NotFound)]);
    for (milli, text, expected) in [
        (85_000, "YES", Err(Reason::PowerOnValue)),
        (23_125, "NO", Err(Reason::Checksum)),
        (84_937, "YES", Ok(84.937)),
    ] {
        tree.put(&Tree::one_wire(PROBE), &pad(milli).replace("YES", text));
        assert_eq!(line.reads().await.unwrap()[..2], [Ok(21.5), expected]);
    }
    tree.put(
        &Tree::one_wire(PROBE),
        "00 00 00 00 00 00 00 00 00 : crc=00 YES\n00 00 00 00 00 00 00 00 00 t=0\n",
    );
    assert_eq!(line.reads().await.unwrap()[1], Err(Reason::AllZero));
}

#[tokio::test]
async fn one_that_hangs_costs_one_timeout_and_is_not_asked_again_before_it_is_back() {
    let tree = tree();
    let pipe = tree.hangs(&Tree::one_wire(PROBE));
    let (mut line, clock) = (Line::to(&tree), Clock::wall());
    let hangs = Ok(vec![Ok(21.5), Err(Reason::Timeout), Err(Reason::Timeout)]);
    let begun = clock.now();
    assert_eq!(line.reads().await, hangs);
    assert!(clock.now().since(begun) >= TIMEOUT);
    let begun = clock.now();
    for _ in 0..5 {
        assert_eq!(line.reads().await, hangs);
    }
    let took = clock.now().since(begun);
    assert!(took < 5 * TIMEOUT, "a read that had begun anew would have been waited for: {took:?}");
    // The hanging read returns an old value, which is discarded. The next read is a new one.
    std::fs::write(&pipe, pad(99_000)).unwrap();
    std::fs::remove_file(&pipe).unwrap();
    tree.measures(PROBE, 23_125);
    for _ in 0..100 {
        let found = line.reads().await;
        if found != hangs {
            assert_eq!(found, Ok(vec![Ok(21.5), Ok(23.125), Ok(22.625)]));
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("it is back, and not asked again");
}

#[tokio::test]
async fn where_all_of_a_device_hang_it_does_not_answer_and_the_words_are_those_of_a_computer() {
    let tree = Tree::new();
    tree.hangs(&Tree::one_wire(PROBE));
    tree.hwmon(0, "lm75", "1-0048", &[]);
    let input = tree.root().join("devices/1-0048/hwmon/hwmon0/temp1_input");
    assert!(std::process::Command::new("mkfifo").arg(input).status().unwrap().success());
    let mut line = Line::to(&tree);
    assert_eq!(line.reads().await, Err(Fault::Timeout));
    let said = explain_on(Transport::Sysfs, Fault::Timeout).to_string();
    assert!(said.contains("dmesg"), "{said}");
}

#[tokio::test]
async fn nothing_is_written_to_it() {
    let tree = tree();
    let mut line = Line::to(&tree);
    let address = line.profile.signals[0].address.clone();
    let functions = line.profile.devices[0].functions;
    let write = Request::write(&address, &[0, 0, 0, 0], functions);
    let refused = line.line.request(DeviceId(0), write, SendDeadline::None).await.map(|_| ());
    assert_eq!(refused, Err(Fault::Caller(CallerFault::Extent)));
    let register = Request::Modbus(ModbusRequest::WriteSingle { at: 0, value: 1 });
    let refused = line.line.request(DeviceId(0), register, SendDeadline::None).await.map(|_| ());
    assert_eq!(refused, Err(Fault::Caller(CallerFault::Function)));
}
