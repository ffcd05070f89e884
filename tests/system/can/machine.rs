//! Nodes of the virtual machine on CAN of a real kernel. They run with the gateway at any speed, alone, and on an
//! interface that disappears and returns.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::kinds::can::error_frame::ErrorSeverity;
use isotherm::fieldbus::kinds::can::{ReceivedFrame, Socket};
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::status::Status;
use isotherm::virtual_machine::{FaultScript, PlantSpec, SeenRequest, Setup, Summary, VirtualMachine};
use isotherm_core::codec::{CanId, CanMatch, Frame};
use isotherm_profile::Profile;

use crate::can::rig::{Interface, count, events, load, receive};

/// Surface grinder on CAN: a node and a sender for the temperatures, an encoder, a display, and a control.
const PROFILE: &str = r#"
[machine]
name = "grinder-can"
arm = "auto"

[bus.can]
type = "can"
interface = "INTERFACE"

[device.module]
bus = "can"
node = 5
heartbeat = "3s"
setup = [{ sdo = "1800:05", type = "u16", value = 1000 }, { sdo = "1017:00", type = "u16", value = 1000 }]
verify = [{ sdo = "6110:01", type = "u16", equals = 10 }]
[device.sender]
bus = "can"
[device.encoder]
bus = "can"
node = 7
setup = [{ sdo = "6200:00", type = "u16", value = 1000 }]
[device.display]
bus = "can"
node = 12
[device.cnc]
bus = "can"
node = 9

[signal.bed]
device = "module"
pdo = { number = 1, start = 0, length = 16, signed = true }
scale = 0.0625
unit = "degC"
max_rate = "none"
bad = [-1, { raw = -512, means = "open circuit" }]
[signal.wheelhead]
device = "sender"
frame = { id = 0x18FF0105, start = 10, length = 22, order = "little" }
scale = 0.0078125
offset = -16384.0
unit = "degC"
max_rate = "none"
[signal.scale_z]
device = "encoder"
pdo = { number = 1, start = 0, length = 32, signed = true }
scale = 0.0001
unit = "mm"

[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
deadband = 0.1
every = "10s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "difference"
kind = "linear"
terms = [
  { signal = "bed", gain = 2.6244, reference = "start" },
  { signal = "wheelhead", gain = -2.3112, reference = "start" },
]
[[axis.z.model]]
name = "wheelhead only"
kind = "formula"
formula = "k*sqrt(t) + c - Kz * B"
inputs = { B = "wheelhead" }
constants = { Kz = 2.3112, k = 0.25144, c = 36.983 }

[output.display_z]
axis = "z"
device = "display"
writes = "corrected"
position = "scale_z"
pdo = { cob_id = 0x20C, start = 0, length = 32, signed = true, fill = "00 00 00 00 00 00 01 00" }
scale = 0.0001
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
sdo = "2000:01"
type = "i32"
scale = 0.1
"#;

/// Result of a run on virtual time.
struct Run {
    summary: Summary,
    written: Vec<SeenRequest>,
    /// State of the axis at the end of each second.
    states: Vec<&'static str>,
    status: Status,
}

impl Run {
    /// Runs the profile at full speed.
    fn of(interface: &Interface, faults: &str, seconds: u64) -> Run {
        Run::with(load(PROFILE, interface), faults, seconds)
    }

    fn with(profile: Profile, faults: &str, seconds: u64) -> Run {
        let faults = FaultScript::parse(faults, &profile).unwrap();
        let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
        let clock = Clock::simulated(plant.start(), None);
        let setup = Setup { faults, journal: true, ..Setup::on_free_ports(plant, 1) };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let hold = clock.hold();
            let mut machine = VirtualMachine::start(&profile, setup, &clock).await.unwrap();
            let window = machine.window();
            let mut last = clock.join();
            let gateway = Gateway::new(machine.serving(profile), &clock, Options::default());
            let source = gateway.source();
            drop(hold);
            let mut seen = None;
            let over = async {
                let mut states = Vec::new();
                for _ in 0..seconds {
                    last.sleep(Duration::from_secs(1)).await;
                    states.push(source.status().axes[0].state);
                }
                seen = Some((window.summary(), window.requests(), states, source.status()));
                drop(last);
            };
            tokio::select! {
                _ = gateway.run(over, std::future::pending()) => {}
                error = machine.failure() => panic!("{error}"),
            }
            let (summary, written, states, status) = seen.unwrap();
            Run { summary, written, states, status }
        })
    }

    /// Offsets that the control received, in units of 0.1 µm.
    fn offsets(&self) -> Vec<i32> {
        let of_control = self.written.iter().filter(|seen| seen.device.0 == 4 && seen.is_write());
        of_control
            .map(|seen| i32::from(seen.wanted[0].cast_signed()) << 16 | i32::from(seen.wanted[1]))
            .collect()
    }

    fn no_step_is_larger_than_one_micrometre(&self) {
        let offsets = self.offsets();
        let steps = offsets.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.max() <= Some(10), "{offsets:?}");
    }
}

/// The same machine, ten times slower. It still covers the warm-up of several hours.
fn slowly(interface: &Interface) -> Profile {
    let slow = PROFILE.replace("value = 1000 }", "value = 10000 }").replace("\"3s\"", "\"30s\"");
    load(&slow.replace("bus = \"can\"", "bus = \"can\"\nevery = \"10s\""), interface)
}

#[test]
fn on_virtual_time_one_seed_is_one_run_and_the_axis_is_compensated() {
    // Long enough for the machine to warm up.
    const SECONDS: u64 = 3 * 3600;
    let interface = Interface::new("vm-run");
    let wall = Clock::wall();
    let begun = wall.now();
    let first = Run::with(slowly(&interface), "", SECONDS);
    println!("three hours of machine time took {:.1} s", wall.now().since(begun).as_secs_f64());
    let axis = &first.summary.axes[0];
    let (without, with) = (axis.uncompensated.range_um(), axis.compensated.range_um());
    println!("error range {without:.2} µm uncompensated, {with:.2} µm compensated");
    assert!(without > 8.0 && with < 0.2 * without, "{without} {with}: {:#?}", events(&first.status));
    first.no_step_is_larger_than_one_micrometre();
    let second = Run::with(slowly(&interface), "", SECONDS);
    assert_eq!(first.summary, second.summary);
    let differs = first.written.iter().zip(&second.written).find(|(one, other)| one != other);
    assert!(first.written == second.written, "{differs:#?}");
    assert!(first.written.len() > 900, "the display is written whenever the encoder speaks");
}

#[test]
fn a_node_that_is_reset_in_the_middle_of_a_run_is_started_again_and_the_axis_makes_no_step() {
    let interface = Interface::new("vm-reset");
    let reset = "[[fault]]\ndevice = \"module\"\nkind = \"restart\"\nat = \"900s\"\n";
    let run = Run::of(&interface, reset, 1200);
    let reported = events(&run.status);
    assert_eq!(count(&run.status, "node-reset"), 1, "{reported:#?}");
    assert_eq!(run.states[890..899], ["active"; 9], "{reported:#?}");
    // Within a heartbeat of three seconds; the axis decides every ten seconds.
    assert_eq!(run.states[915..], ["active"; 285], "{:?} {reported:#?}", &run.states[895..930]);
    assert_eq!(count(&run.status, "device-lost"), 0, "{reported:#?}");
    run.no_step_is_larger_than_one_micrometre();
}

#[test]
fn a_node_that_is_silent_for_a_while_is_missed_and_followed_again() {
    let interface = Interface::new("vm-silent");
    let silent = "[[fault]]\ndevice = \"module\"\nkind = \"silent\"\nat = \"900s\"\nfor_time = \"60s\"\n";
    let run = Run::of(&interface, silent, 1200);
    let reported = events(&run.status);
    let counts = ["device-lost", "device-back"].map(|kind| count(&run.status, kind));
    assert_eq!(counts, [1, 1], "{reported:#?}");
    assert!(run.states[920..955].iter().all(|state| *state == "degraded"), "{:?}", &run.states[900..960]);
    assert_eq!(run.states[1000..], ["active"; 200], "{reported:#?}");
    run.no_step_is_larger_than_one_micrometre();
}

/// Runs a virtual machine on real time, in parallel to a test.
fn alone(interface: &Interface, faults: &str, test: impl AsyncFnOnce(&VirtualMachine)) {
    let profile = load(PROFILE, interface);
    let setup = Setup { faults: FaultScript::parse(faults, &profile).unwrap(), ..Setup::default() };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
        test(&machine).await;
        machine.stop().await.unwrap();
    });
}

fn exactly(id: CanId) -> CanMatch {
    CanMatch::exactly(id)
}

fn standard(raw: u16) -> CanId {
    CanId::of_11_bits(raw)
}

/// Next frame, or an error of the bus. Errors of the link are ignored.
async fn heard(socket: &Socket) -> ReceivedFrame {
    let heard = async {
        loop {
            if let Ok(heard) = receive(socket).await {
                return heard;
            }
        }
    };
    let heard = tokio::time::timeout(Duration::from_secs(60), heard).await;
    heard.unwrap_or_else(|_| panic!("nothing was heard for 60 s"))
}

async fn tell(socket: &Socket, id: u16, bytes: [u8; 8]) {
    socket.send_now(&Frame::short(standard(id), bytes)).unwrap();
}

#[test]
fn a_node_is_heard_again_after_its_interface_was_down_and_after_there_was_a_new_one() {
    let interface = Interface::new("vm-down");
    alone(&interface, "", async |_| {
        let sender = CanId::extended(0x18ff_0105).unwrap();
        let open = || Socket::open(interface.name(), &[exactly(sender)]).unwrap();
        let socket = open();
        heard(&socket).await;
        interface.down();
        tokio::time::sleep(Duration::from_millis(1500)).await;
        interface.up();
        heard(&socket).await;
        interface.vanishes();
        tokio::time::sleep(Duration::from_millis(1500)).await;
        interface.appears();
        let socket = open();
        heard(&socket).await;
        // It also receives on the new interface.
        let socket = Socket::open(interface.name(), &[exactly(standard(0x585))]).unwrap();
        tell(&socket, 0x605, [0x40, 0x10, 0x61, 1, 0, 0, 0, 0]).await;
        let answer = Frame::short(standard(0x585), [0x4b, 0x10, 0x61, 1, 10, 0, 0, 0]);
        assert_eq!(heard(&socket).await, ReceivedFrame::Frame(answer));
    });
}

#[test]
fn error_frames_of_a_script_are_heard_as_those_of_a_controller() {
    let interface = Interface::new("vm-errors");
    let faults = |error: &str, at: &str| {
        format!(
            "[[fault]]\ndevice = \"module\"\nkind = \"error-frame\"\nerror = \"{error}\"\nat = \"{at}\"\n"
        )
    };
    let script = faults("passive", "300ms") + &faults("bus-off", "400ms") + &faults("restarted", "500ms");
    alone(&interface, &script, async |_| {
        let socket = Socket::open(interface.name(), &[]).unwrap();
        for gravity in [ErrorSeverity::Passive, ErrorSeverity::BusOff, ErrorSeverity::Over] {
            match heard(&socket).await {
                ReceivedFrame::Error(trouble) => assert_eq!(trouble.gravity(), gravity, "{trouble}"),
                ReceivedFrame::Frame(frame) => panic!("nothing is let through, yet {frame} came"),
            }
        }
    });
}

#[test]
fn a_babbling_node_is_heard_only_by_those_who_want_to() {
    let interface = Interface::new("vm-babble");
    let babble = "[[fault]]\ndevice = \"cnc\"\nkind = \"babbling\"\nid = 0x7F0\nfor = 2000\n";
    alone(&interface, babble, async |_| {
        let all = Socket::open(interface.name(), &[exactly(standard(0x7f0))]).unwrap();
        let sender = CanId::extended(0x18ff_0105).unwrap();
        let wanted = Socket::open(interface.name(), &[exactly(sender)]).unwrap();
        let mut count = 0;
        while count < 1000 {
            assert!(matches!(heard(&all).await, ReceivedFrame::Frame(frame) if frame.data().len() == 8));
            count += 1;
        }
        assert_eq!(all.lost(), 0);
        assert!(matches!(heard(&wanted).await, ReceivedFrame::Frame(frame) if frame.id() == sender));
        while let Some(also) = wanted.receive_now().unwrap() {
            assert!(matches!(also, ReceivedFrame::Frame(frame) if frame.id() == sender));
        }
    });
}

#[test]
fn isotherm_virtual_serves_the_nodes_of_a_profile_and_says_where() {
    let interface = Interface::new("vm-cli");
    let directory = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let path = directory.path().join("grinder.toml");
    std::fs::write(&path, PROFILE.replace("INTERFACE", interface.name())).unwrap();
    let mut virtual_machine = Command::new(env!("CARGO_BIN_EXE_isotherm"))
        .arg("virtual")
        .arg(&path)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(virtual_machine.stdout.take().unwrap()).lines();
    let reported: Vec<String> =
        lines.map_while(Result::ok).take_while(|line| !line.starts_with("stop")).collect();
    let named = "bus can is on the CAN interface vm-cli: module (node 5), sender (frames), encoder (node 7), \
                 display (node 12), cnc (node 9)";
    assert!(reported.contains(&named.to_owned()), "{reported:#?}");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let name = runtime.block_on(async {
        let socket = Socket::open(interface.name(), &[exactly(standard(0x585))]).unwrap();
        tell(&socket, 0x605, [0x40, 0x08, 0x10, 0, 0, 0, 0, 0]).await;
        let first = heard(&socket).await;
        assert_eq!(
            first,
            ReceivedFrame::Frame(Frame::short(standard(0x585), [0x41, 0x08, 0x10, 0, 6, 0, 0, 0]))
        );
        tell(&socket, 0x605, [0x60, 0, 0, 0, 0, 0, 0, 0]).await;
        heard(&socket).await
    });
    virtual_machine.kill().unwrap();
    virtual_machine.wait().unwrap();
    let segment = [0x03, b'm', b'o', b'd', b'u', b'l', b'e', 0];
    assert_eq!(name, ReceivedFrame::Frame(Frame::short(standard(0x585), segment)));
}

#[test]
fn a_machine_whose_interface_is_missing_says_how_to_make_one() {
    let interface = Interface::absent("vm-none");
    let profile = load(PROFILE, &interface);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let clock = Clock::wall();
    let started = VirtualMachine::start(&profile, Setup::default(), &clock);
    let error = runtime.block_on(started).unwrap_err();
    // With the error of the operating system, which is a separate cause.
    let mut reported = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(error) = cause {
        reported += &format!(": {error}");
        cause = error.source();
    }
    assert_eq!(
        reported,
        "cannot listen at vm-none (bus `can`): there is no such interface; create a virtual one with: \
         ip link add dev vm-none type vcan && ip link set vm-none up"
    );
}
