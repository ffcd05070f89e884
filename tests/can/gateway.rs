//! The gateway on a real kernel CAN: nodes that are reset, silent or wrong, frames that are too short, an interface that
//! comes and goes.

use std::time::Duration;

use isotherm::observe::status::Status;

use crate::node::{Node, State};
use crate::rig::{Interface, beside, count, events, load, shell, signal, told, wait_until};

const PROFILE: &str = r#"
[machine]
name = "can"
arm = "auto"

[bus.can]
type = "can"
interface = "INTERFACE"
timeout = "200ms"

[device.module]
bus = "can"
node = 5
heartbeat = "400ms"
setup = [{ sdo = "1800:05", type = "u16", value = 20 }, { sdo = "1017:00", type = "u16", value = 100 }]
verify = [{ sdo = "6110:01", type = "u16", expect = 10 }]
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
bad = [{ raw = -512, means = "open circuit" }]
[signal.room]
device = "sender"
frame = { id = 0x18FF0105, start = 8, length = 16, order = "big", signed = true }
scale = 0.1
unit = "degC"
max_age = "1s"
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
every = "100ms"
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
sdo = "2000:01"
type = "i16"
scale = 0.1
"#;

/// The thermocouples: 25.0 °C, and a second frame.
fn module() -> State {
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

fn cnc() -> State {
    let objects = [((0x1000, 0), vec![0; 4]), ((0x2000, 1), vec![0, 0])];
    State { number: 9, objects: objects.into(), ..State::default() }
}

/// A sensor that only sends: 24.0 °C.
fn sender() -> State {
    State { is_operational: true, pdos: [(0x18FF_0105, vec![7, 0, 240])].into(), ..State::default() }
}

fn is_active(status: &Status) -> bool {
    status.axes[0].state == "active" && status.axes[0].cz_um > 4.9
}

fn offset(cnc: &Node) -> i16 {
    let bytes = cnc.state().objects[&(0x2000, 1)].clone();
    i16::from_le_bytes([bytes[0], bytes[1]])
}

#[test]
fn a_node_is_set_up_then_started_then_believed_and_what_it_says_is_written_to_another() {
    let interface = Interface::new("node");
    let (module, cnc) = (Node::new(interface.name(), module()), Node::new(interface.name(), cnc()));
    beside(load(PROFILE, &interface), false, move |source| {
        let status = wait_until(source, "the axis follows", is_active);
        assert_eq!(signal(&status, "bed").value, Some(25.0));
        assert_eq!(signal(&status, "serial").value, Some(123_456_789.0));
        wait_until(source, "the offset is written", |_| offset(&cnc) == 50);
        let log = module.state().log.clone();
        assert_eq!(log, ["1800:05=1400", "1017:00=6400", "start"]);
        assert_eq!(
            (count(&status, "device-lost"), count(&status, "node-reset")),
            (0, 0),
            "{:#?}",
            events(&status)
        );
        let _ = interface;
    });
}
