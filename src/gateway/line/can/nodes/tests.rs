use std::path::Path;

use super::*;
use isotherm_profile::BusId;

const PROFILE: &str = r#"
[machine]
name = "nodes"
[bus.can]
type = "can"
interface = "can0"
[device.module]
bus = "can"
node = 5
heartbeat = "2s"
setup = [{ sdo = "1800:05", type = "u16", value = 20 }]
[device.sender]
bus = "can"
[signal.bed]
device = "module"
pdo = { cob_id = 0x185, start = 0, length = 16 }
unit = "degC"
max_age = "9s"
range = "none"
max_rate = "none"
[signal.room]
device = "sender"
frame = { id = 0x300, start = 0, length = 16, order = "little" }
unit = "degC"
max_age = "3s"
range = "none"
max_rate = "none"
[axis.z]
limit = 40.0
step = 1.0
rate = 20.0
every = "1s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "one"
kind = "linear"
terms = [{ signal = "bed", gain = 1.0, reference = 20.0 }, { signal = "room", gain = 1.0, reference = 20.0 }]
"#;

const MODULE: DeviceId = DeviceId(0);
const SENDER: DeviceId = DeviceId(1);

fn at(seconds: u64) -> Moment {
    Moment::default().after(Duration::from_secs(1000 + seconds))
}

fn nodes() -> Nodes {
    let loaded = isotherm_profile::parse(Path::new("nodes.toml"), PROFILE, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    Nodes::new(&profile, BusId(0), at(0))
}

fn frame(id: u32, data: &[u8]) -> Frame {
    Frame::classic(CanId::standard(id).unwrap(), data).unwrap()
}

/// Each reaction in a few words.
fn reported(follows: &[Reaction]) -> Vec<String> {
    let words = |follow: &Reaction| match follow {
        Reaction::Send(frame) => format!("send {frame}"),
        Reaction::Node(device, event) => format!("{} {event}", device.0),
        Reaction::Silent(device, patience, was_heard) => {
            format!("{} silent for {patience:?}, heard before: {was_heard}", device.0)
        }
        Reaction::Emergency(device, emergency) => format!("{} complains {:04x}", device.0, emergency.code),
        Reaction::EmergencyOver(device, count) => format!("{} content after {count}", device.0),
    };
    follows.iter().map(words).collect()
}

#[test]
fn a_node_is_started_when_it_is_set_up_and_again_after_each_boot_up() {
    let mut nodes = nodes();
    assert_eq!(reported(&nodes.tick(vec![], at(0))), [""; 0]);
    assert_eq!(reported(&nodes.tick(vec![MODULE], at(1))), ["send 000#0105"]);
    assert_eq!(nodes.speaker(&frame(0x705, &[0])), Some(MODULE));
    let booted = reported(&nodes.take(&frame(0x705, &[0]), at(2)));
    assert!(booted.len() == 1 && booted[0].contains("booted up"), "{booted:?}");
    assert_eq!(reported(&nodes.tick(vec![MODULE], at(2))), ["send 000#0105"]);
}

#[test]
fn silence_is_reported_once_by_heartbeat_or_by_age_also_of_what_was_never_heard() {
    let mut nodes = nodes();
    assert_eq!(nodes.due(), Some(at(2)));
    let lost = reported(&nodes.tick(vec![], at(2)));
    assert!(lost.len() == 1 && lost[0].starts_with("0 was never seen"), "{lost:?}");
    assert_eq!(reported(&nodes.tick(vec![], at(3))), ["1 silent for 3s, heard before: false"]);
    assert!(nodes.is_lost(MODULE) && nodes.is_lost(SENDER));
    assert_eq!(reported(&nodes.tick(vec![], at(60))), [""; 0]);
    nodes.heard(SENDER, at(61));
    assert!(!nodes.is_lost(SENDER));
    // Values of a node do not replace its heartbeat.
    nodes.heard(MODULE, at(61));
    assert!(nodes.is_lost(MODULE));
    assert_eq!(reported(&nodes.tick(vec![], at(64))), ["1 silent for 3s, heard before: true"]);
}

#[test]
fn an_emergency_is_reported_once_a_code_until_all_are_over() {
    let mut nodes = nodes();
    let mut say = |code: u16| {
        let [low, high] = code.to_le_bytes();
        reported(&nodes.take(&frame(0x085, &[low, high, 1, 0, 0, 0, 0, 0]), at(1)))
    };
    assert_eq!(say(0), [""; 0]);
    assert_eq!(say(0x5031), ["0 complains 5031"]);
    assert_eq!(say(0x5031), [""; 0]);
    assert_eq!(say(0x8130), ["0 complains 8130"]);
    assert_eq!(say(0), ["0 content after 3"]);
    assert_eq!(say(0x5031), ["0 complains 5031"]);
    // Not every code of a node that sends very many is recorded.
    let counted = (0x6000..0x6100).filter(|code| !say(*code).is_empty()).count();
    assert_eq!(counted, MOST_CODES - 1);
}

#[test]
fn the_kernel_lets_through_what_is_listened_to_and_nothing_else() {
    let nodes = nodes();
    let wanted: Vec<u32> = nodes.wanted().map(|one| one.id.raw()).collect();
    assert_eq!(wanted, [0x085, 0x705, 0x605, 0x585]);
    assert!(nodes.is_sdo(CanId::standard(0x585).unwrap()));
    assert_eq!(nodes.speaker(&frame(0x706, &[5])), None);
    assert_eq!(nodes.speaker(&frame(0x185, &[5])), None);
}
