//! The gateway on CAN of a real kernel. Nodes are reset, silent or wrong, frames are too short, and an interface
//! disappears and returns.

use std::time::Duration;

use isotherm::observe::status::{GatewayApi, Status};

use crate::can::node::{Node, Power, State};
use crate::can::rig::{Interface, beside, count, events, load, reported, shell, signal, wait_until};

pub(crate) const PROFILE: &str = r#"
[machine]
name = "can"
arm = "auto"

[bus.can]
type = "can"
interface = "INTERFACE"
timeout = "150ms"

[device.module]
bus = "can"
node = 5
heartbeat = "400ms"
setup = [{ sdo = "1800:05", type = "u16", value = 20 }, { sdo = "1017:00", type = "u16", value = 100 }]
verify = [{ sdo = "6110:01", type = "u16", equals = 10 }]
emergency = [{ code = 0x5031, means = "sensor 1 broken" }]
[device.sender]
bus = "can"
[device.cnc]
bus = "can"
node = 9

[signal.bed]
device = "module"
pdo = { cob_id = 0x185, start = 0, length = 16, signed = true }
scale = 0.1
unit = "degC"
max_age = "1s"
max_rate = "none"
bad = [{ raw = -512, means = "open circuit" }]
[signal.room]
device = "sender"
frame = { id = 0x18FF0105, start = 15, length = 16, order = "big", signed = true }
scale = 0.1
unit = "degC"
max_age = "1s"
max_rate = "none"
[signal.serial]
device = "module"
sdo = "1018:04"
type = "u32"
unit = "1"
max_age = "5s"

[axis.z]
limit = 40.0
step = 1.0
rate = 20.0
every = "200ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "full"
kind = "linear"
terms = [{ signal = "bed", gain = 1.0, reference = 20.0 }]
[[axis.z.model]]
name = "plain"
kind = "linear"
terms = [{ signal = "room", gain = 1.0, reference = 20.0 }]

[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
sdo = "2000:01"
type = "i16"
scale = 0.1
"#;

/// Profile with timeouts that nodes on a busy computer do not exceed.
fn patient() -> String {
    let text = PROFILE.replace("\"150ms\"", "\"1s\"").replace("\"400ms\"", "\"4s\"");
    text.replace("max_age = \"1s\"", "max_age = \"5s\"")
}

/// Thermocouple module: 25.0 °C, and a second frame.
pub(crate) fn module() -> State {
    State {
        number: 5,
        pdos: [(0x185, vec![250, 0, 0, 0])].into(),
        heartbeat: Some(Duration::from_millis(100)),
        objects: [
            ((0x1000, 0), vec![4, 4, 0, 0]),
            ((0x1017, 0), vec![0, 0]),
            ((0x1018, 4), vec![0x15, 0xcd, 0x5b, 0x07]),
            ((0x1800, 5), vec![0, 0]),
            ((0x6110, 1), vec![10, 0]),
        ]
        .into(),
        ..State::default()
    }
}

pub(crate) fn cnc() -> State {
    let objects = [((0x1000, 0), vec![0; 4]), ((0x2000, 1), vec![0, 0])];
    State { number: 9, objects: objects.into(), ..State::default() }
}

/// Sensor that only sends: 24.0 °C.
pub(crate) fn sender() -> State {
    State { is_operational: true, pdos: [(0x18FF_0105, vec![7, 0, 240])].into(), ..State::default() }
}

fn is_active(status: &Status) -> bool {
    status.axes[0].state == "active" && status.axes[0].cz_um > 4.9
}

/// A gateway with a module, a sender and a control on an interface.
struct Cell {
    interface: Interface,
    module: Node,
    sender: Node,
    cnc: Node,
}

impl Cell {
    fn new(name: &str, module: State) -> Cell {
        let interface = Interface::new(name);
        let nodes = [module, sender(), cnc()].map(|state| Node::new(interface.name(), state));
        let [module, sender, cnc] = nodes;
        Cell { interface, module, sender, cnc }
    }

    fn run(self, script: impl FnOnce(&Cell, &dyn GatewayApi) + Send + 'static) {
        let profile = load(&patient(), &self.interface);
        beside(profile, false, move |source| script(&self, source));
    }

    fn offset(&self) -> i16 {
        let bytes = self.cnc.state().objects[&(0x2000, 1)].clone();
        i16::from_le_bytes([bytes[0], bytes[1]])
    }

    /// Log of the module. A heartbeat that passes the start command on the bus looks as if the command was lost.
    /// Therefore the command may occur twice.
    fn heard(&self) -> Vec<String> {
        let mut log = self.module.state().log.clone();
        log.dedup();
        log
    }

    /// Values written to the control, in order.
    fn written(&self) -> Vec<i16> {
        let log = self.cnc.state().log.clone();
        let values = log.iter().filter_map(|line| line.strip_prefix("2000:01="));
        values.map(|hex| i16::from_str_radix(&format!("{}{}", &hex[2..], &hex[..2]), 16).unwrap()).collect()
    }
}

#[test]
fn a_node_is_set_up_then_started_then_believed_and_what_it_says_is_written_to_another() {
    Cell::new("cell", module()).run(|cell, source| {
        let status = wait_until(source, "the axis follows", is_active);
        assert_eq!(signal(&status, "bed").value, Some(25.0));
        assert_eq!(signal(&status, "room").value, Some(24.0));
        assert_eq!(signal(&status, "serial").value, Some(123_456_789.0));
        wait_until(source, "the offset is written", |_| cell.offset() == 50);
        let log = cell.heard();
        // A node that boots while the gateway runs is configured again, also during its configuration.
        let before: Vec<&String> = log.iter().take_while(|word| *word != "start").collect();
        let is_set = |setting: &str| before.iter().any(|word| *word == setting);
        assert!(is_set("1800:05=1400") && is_set("1017:00=6400"), "{log:?}");
        assert_eq!(log.last().map(String::as_str), Some("start"), "{log:?}");
        let (lost, reset) = (count(&status, "device-lost"), count(&status, "node-reset"));
        assert_eq!((lost, reset), (0, 0), "{:#?}", events(&status));
        // A status code in the same bytes is not read as a temperature.
        cell.module.state().pdos.insert(0x185, vec![0x00, 0xfe, 0, 0]);
        let status = wait_until(source, "it is open", |status| signal(status, "bed").value.is_none());
        assert_eq!(signal(&status, "bed").quality, "open-circuit");
    });
}

#[test]
fn a_node_that_is_reset_is_set_up_and_started_again_within_a_heartbeat_and_the_axis_makes_no_step() {
    Cell::new("reset", module()).run(|cell, source| {
        wait_until(source, "the axis follows", |status| is_active(status) && cell.offset() == 50);
        cell.module.state().log.clear();
        // The first conversion takes time.
        cell.module.state().first_after = Duration::from_secs(3);
        cell.module.reset();
        wait_until(source, "it does without", |status| status.axes[0].state == "degraded");
        let status = wait_until(source, "it follows again", is_active);
        assert_eq!(cell.heard(), ["reset", "1800:05=1400", "1017:00=6400", "start"]);
        reported(&status, "device module (node 5): was reset");
        assert_eq!(count(&status, "node-reset"), 1, "{:#?}", events(&status));
        assert_eq!(count(&status, "device-lost"), 0, "{:#?}", events(&status));
        let written = cell.written();
        let steps = written.windows(2).map(|pair| (pair[1] - pair[0]).abs()).max();
        assert!(steps <= Some(10), "no step beyond 1 µm: {written:?}");
    });
}

#[test]
fn a_silent_node_is_reported_once_its_readings_are_bad_and_it_returns_by_itself() {
    Cell::new("silent", module()).run(|cell, source| {
        wait_until(source, "the axis follows", is_active);
        cell.module.state().power = Power::Off;
        let status = wait_until(source, "it is missed", |status| count(status, "device-lost") == 1);
        reported(&status, "device module");
        wait_until(source, "its reading is bad", |status| signal(status, "bed").value.is_none());
        wait_until(source, "the axis does without", |status| status.axes[0].state == "degraded");
        std::thread::sleep(Duration::from_secs(1));
        cell.module.state().power = Power::On;
        wait_until(source, "it follows again", is_active);
        let status = wait_until(source, "it is reported", |status| count(status, "device-back") == 1);
        assert_eq!(count(&status, "device-lost"), 1, "{:#?}", events(&status));
    });
}

#[test]
fn a_node_that_never_was_there_is_missed_like_one_that_is_there_no_more() {
    let absent = State { power: Power::Off, ..module() };
    Cell::new("never", absent).run(|cell, source| {
        let status = wait_until(source, "it is missed", |status| count(status, "device-lost") == 1);
        let state = status.devices.iter().find(|device| device.name == "module").unwrap().state;
        assert_eq!(state, "lost");
        assert!(!status.axes[0].arming.armed, "what has not been verified is not armed with");
        // A sensor without a heartbeat counts as lost when its values are too old.
        cell.sender.state().power = Power::Off;
        let status = wait_until(source, "both are missed", |status| count(status, "device-lost") == 2);
        reported(&status, "device sender");
        cell.sender.state().power = Power::On;
        cell.module.state().power = Power::On;
        wait_until(source, "both are back", is_active);
    });
}

#[test]
fn a_frame_that_is_too_short_is_bad_and_one_that_is_longer_is_fine() {
    Cell::new("short", module()).run(|cell, source| {
        wait_until(source, "the axis follows", is_active);
        cell.module.state().pdos.insert(0x185, vec![250]);
        let status = wait_until(source, "it is bad", |status| signal(status, "bed").value.is_none());
        assert_eq!(signal(&status, "bed").quality, "short-frame");
        cell.module.state().pdos.insert(0x185, vec![252, 0, 1, 2, 3, 4, 5, 6]);
        wait_until(source, "it is good", |status| signal(status, "bed").value == Some(25.2));
    });
}

#[test]
fn answers_to_another_question_are_not_taken_and_a_refusal_is_reported_in_words() {
    let state = State { speaks_of_others: true, ..module() };
    Cell::new("others", state).run(|cell, source| {
        let status = wait_until(source, "the axis follows", is_active);
        assert_eq!(signal(&status, "serial").value, Some(123_456_789.0));
        cell.module.state().refuses = Some(((0x1018, 4), 0x0800_0022));
        let status = wait_until(source, "it is refused", |status| signal(status, "serial").value.is_none());
        assert_eq!(signal(&status, "serial").quality, "refused");
        // The node is present, and its process data arrive.
        let status = wait_until(source, "the axis follows", is_active);
        assert_eq!(count(&status, "device-lost"), 0, "{:#?}", events(&status));
    });
    let state = State { refuses: Some(((0x1800, 5), 0x0609_0030)), ..module() };
    Cell::new("refused", state).run(|cell, source| {
        let kind = "not-as-expected";
        let status = wait_until(source, "the setup is refused", |status| count(status, kind) == 1);
        reported(&status, "1800:05");
        reported(&status, "the value is not allowed");
        assert_eq!(cell.module.times("start"), 0, "it is not started before it is set up");
        cell.module.state().refuses = None;
        wait_until(source, "somebody has put it right", is_active);
    });
}

#[test]
fn a_node_that_is_set_otherwise_is_not_believed() {
    let mut state = module();
    state.objects.insert((0x6110, 1), vec![11, 0]);
    Cell::new("otherwise", state).run(|_, source| {
        let status = wait_until(source, "it is reported", |status| count(status, "not-as-expected") == 1);
        reported(&status, "6110:01");
        wait_until(source, "the reading says so", |status| {
            signal(status, "bed").quality == "not-as-expected"
        });
    });
}

#[test]
fn an_emergency_is_reported_once_in_the_device_s_words_until_it_is_over() {
    Cell::new("emergency", module()).run(|cell, source| {
        wait_until(source, "the axis follows", is_active);
        for _ in 0..5 {
            cell.interface.send("085#3150010000000000");
        }
        let status = wait_until(source, "it is reported", |status| count(status, "emergency") == 1);
        reported(&status, "sensor 1 broken");
        cell.interface.send("085#0000000000000000");
        let status = wait_until(source, "it is over", |status| count(status, "emergency-over") == 1);
        reported(&status, "5 messages");
        assert_eq!(count(&status, "emergency"), 1, "{:#?}", events(&status));
    });
}

#[test]
fn an_interface_that_goes_down_is_reported_once_and_everything_on_it_returns_when_it_is_up() {
    Cell::new("down", module()).run(|cell, source| {
        wait_until(source, "the axis follows", |status| is_active(status) && cell.offset() == 50);
        // Heartbeats that the gateway has not read yet when the interface goes down.
        cell.interface.goes_down_after("cangen INTERFACE -i -g 0 -I 705 -L 1 -D 05 -n 500");
        let status = wait_until(source, "it is reported", |status| count(status, "link-down") == 1);
        reported(&status, "the interface is down");
        wait_until(source, "the readings are bad", |status| {
            signal(status, "bed").quality == "link-down" && signal(status, "room").quality == "link-down"
        });
        std::thread::sleep(Duration::from_secs(3));
        // The nodes on it are not reported as lost in addition. After it is up, a node on a busy computer may take
        // longer than a real one.
        assert_eq!(count(&source.status(), "device-lost"), 0, "{:#?}", events(&source.status()));
        cell.interface.up();
        let status = wait_until(source, "it follows again", is_active);
        assert_eq!(
            ["link-down", "link-up"].map(|kind| count(&status, kind)),
            [1, 1],
            "{:#?}",
            events(&status)
        );
        // The gateway also writes to it again.
        cell.module.state().pdos.insert(0x185, vec![255, 0]);
        wait_until(source, "the offset is written", |_| cell.offset() == 55);
    });
}

#[test]
fn an_interface_that_is_missing_at_the_start_or_taken_away_is_taken_up_when_it_is_there() {
    let interface = Interface::absent("missing");
    beside(load(&patient(), &interface), false, move |source| {
        let status = wait_until(source, "it is reported", |status| count(status, "link-down") == 1);
        reported(&status, "no such interface");
        interface.appears();
        let nodes = [module(), sender(), cnc()].map(|state| Node::new(interface.name(), state));
        wait_until(source, "the axis follows", is_active);
        drop(nodes);
        interface.vanishes();
        let status = wait_until(source, "it is reported again", |status| count(status, "link-down") == 2);
        assert_eq!(count(&status, "link-up"), 1);
        interface.appears();
        let nodes = [module(), sender(), cnc()].map(|state| Node::new(interface.name(), state));
        wait_until(source, "the axis follows again", is_active);
        drop(nodes);
        // Removed and made again at once: the gateway may find another interface of this name up, and an old socket.
        interface.vanishes();
        interface.appears();
        let nodes = [module(), sender(), cnc()].map(|state| Node::new(interface.name(), state));
        nodes[0].state().pdos.insert(0x185, vec![255, 0]);
        wait_until(source, "a new socket is read", |status| {
            signal(status, "bed").value.is_some_and(|celsius| celsius > 25.4)
        });
        wait_until(source, "the axis follows once more", is_active);
    });
}

#[test]
fn error_frames_are_reported_when_they_begin_and_counted() {
    Cell::new("errors", module()).run(|cell, source| {
        wait_until(source, "the axis follows", is_active);
        for _ in 0..20 {
            cell.interface.send("20000008#0000801900000000");
        }
        let status = wait_until(source, "it is reported", |status| count(status, "bus-trouble") == 1);
        reported(&status, "no node acknowledges");
        cell.interface.send("20000040#0000000000000000");
        let status = wait_until(source, "it is worse", |status| count(status, "bus-trouble") == 2);
        reported(&status, "bus-off");
        cell.interface.send("20000100#0000000000000000");
        let status = wait_until(source, "it is over", |status| count(status, "bus-well") == 1);
        reported(&status, "21 error frames");
        assert_eq!(count(&status, "bus-trouble"), 2, "{:#?}", events(&status));
    });
}

#[test]
fn a_full_queue_is_reported_once_and_what_waits_in_it_arrives() {
    Cell::new("full", module()).run(|cell, source| {
        wait_until(source, "the axis follows", |status| is_active(status) && cell.offset() == 50);
        // A bus on which hardly any frame is sent.
        let name = cell.interface.name();
        let slow = format!("tc qdisc add dev {name} root tbf rate 2kbit burst 40 limit 80");
        let load = "insmod /usr/lib/uml/modules/$(uname -r)/kernel/net/sched/sch_tbf.ko";
        shell(&format!("{slow} 2>/dev/null || {{ {load}; {slow}; }}"));
        let status = wait_until(source, "it is reported", |status| count(status, "bus-trouble") >= 1);
        reported(&status, "queue is full");
        std::thread::sleep(Duration::from_secs(2));
        shell(&format!("tc qdisc del dev {name} root"));
        wait_until(source, "the axis follows", is_active);
        cell.module.state().pdos.insert(0x185, vec![255, 0]);
        wait_until(source, "the offset is written", |_| cell.offset() == 55);
        let status = wait_until(source, "it is over", |status| count(status, "bus-well") >= 1);
        let reported = (count(&status, "bus-trouble"), count(&status, "bus-well"));
        assert_eq!(reported, (1, 1), "{:#?}", events(&status));
    });
}

#[test]
fn in_a_dry_run_a_node_is_started_and_read_but_nothing_is_set_or_written() {
    let interface = Interface::new("dry");
    let mut prepared = module();
    prepared.objects.insert((0x1800, 5), vec![20, 0]);
    let nodes = [prepared, sender(), cnc()].map(|state| Node::new(interface.name(), state));
    beside(load(&patient(), &interface), true, move |source| {
        let status = wait_until(source, "it says what is not set", |status| {
            count(status, "not-as-expected") == 1 && signal(status, "bed").quality == "not-as-expected"
        });
        reported(&status, "1017:00");
        wait_until(source, "the other is read", |status| signal(status, "room").value == Some(24.0));
        nodes[0].state().objects.insert((0x1017, 0), vec![100, 0]);
        nodes[0].reset();
        wait_until(source, "it is read", |status| signal(status, "bed").value == Some(25.0));
        let written = nodes.iter().flat_map(|node| node.state().log.clone());
        let written: Vec<String> = written.filter(|line| line.contains('=')).collect();
        assert_eq!(written, [""; 0]);
        let _ = &interface;
    });
}

/// Two displays in one frame, and an offset that is read back from another object.
const SHOWN: &str = r#"
[device.scale]
bus = "can"
[device.display]
bus = "can"
node = 12
[signal.position]
device = "scale"
frame = { id = 0x300, start = 0, length = 32, order = "little", signed = true }
scale = 0.001
unit = "mm"
max_age = "5s"
[output.shown]
axis = "z"
device = "display"
writes = "corrected"
position = "position"
pdo = { cob_id = 0x20C, start = 0, length = 32, signed = true }
read_back = "6004:00"
scale = 0.001
"#;

#[test]
fn a_position_that_comes_in_a_frame_is_corrected_in_a_frame_and_read_back() {
    let interface = Interface::new("shown");
    let display = State {
        number: 12,
        objects: [((0x1000, 0), vec![0; 4]), ((0x6004, 0), vec![0; 4])].into(),
        received: Some((0x20c, (0x6004, 0))),
        ..State::default()
    };
    let states = [module(), sender(), cnc(), display];
    let nodes = states.map(|state| Node::new(interface.name(), state));
    beside(load(&format!("{}{SHOWN}", patient()), &interface), false, move |source| {
        let shown = || {
            let bytes = nodes[3].state().objects[&(0x6004, 0)].clone();
            i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        };
        wait_until(source, "the axis follows", is_active);
        // 100 mm and 5 µm.
        interface.send("300#A0860100");
        wait_until(source, "it is shown", |_| shown() == 100_005);
        interface.send("300#6079FEFF");
        let status = wait_until(source, "it is shown", |_| shown() == -99_995);
        let reported = ["verify-failed", "write-failed"].map(|kind| count(&status, kind));
        assert_eq!(reported, [0, 0], "{:#?}", events(&status));
    });
}
