//! Tests of the gateway's CANopen master and SDO client with these nodes.

use super::*;
use crate::fieldbus::kinds::can::canopen::NodeId;
use crate::fieldbus::kinds::can::canopen::master::{Master, NodeEvent, Output, Start, Supervision};
use crate::fieldbus::kinds::can::canopen::sdo::{Client, Progress};
use isotherm_core::codec::Entry;

const AXTC: u8 = 5;

struct Bus {
    rig: Rig,
    master: Master,
    events: Vec<(u64, NodeEvent)>,
}

impl Bus {
    fn new(faults: &str, start: Start) -> Bus {
        let care = Supervision { heartbeat: Some(Duration::from_secs(3)), start };
        let master = Master::new([(NodeId::new(AXTC).unwrap(), care)], None, at(0));
        Bus { rig: Rig::new(faults), master, events: Vec::new() }
    }

    /// Runs both ends until this time. Returns the number of frames with measured values.
    fn run(&mut self, from: u64, until: u64) -> usize {
        let mut measured = 0;
        for now in from..=until {
            let mut outputs = Vec::new();
            for (_, sent) in self.rig.until(now) {
                let Sent::Frame(frame, _) = sent else { continue };
                measured += usize::from(frame.id().raw() == 0x185);
                self.master.take(&frame, at(now), &mut outputs);
            }
            self.master.tick(at(now), &mut outputs);
            self.carry_out(outputs, now);
        }
        measured
    }

    fn carry_out(&mut self, outputs: Vec<Output>, now: u64) {
        for output in outputs {
            match output {
                Output::Send(frame) => {
                    self.rig.hardware.can_take(&self.rig.places, &frame, at(now));
                }
                Output::Tell(_, event) => self.events.push((now, event)),
            }
        }
    }

    /// Writes the setup list. The node is started afterwards.
    fn set_up(&mut self, now: u64) {
        let mut client = Client::new(NodeId::new(AXTC).unwrap());
        let mut asking = Some(client.write(Entry::new(0x1800, 5), &200_u16.to_le_bytes()));
        while let Some(frame) = asking.take() {
            for sent in self.rig.hardware.can_take(&self.rig.places, &frame, at(now)) {
                let Sent::Frame(frame, _) = sent else { continue };
                match client.take(&frame) {
                    Some(Progress::Send(frame) | Progress::Begin(frame)) => asking = Some(frame),
                    Some(Progress::Written) => {}
                    other => panic!("{other:?}"),
                }
            }
        }
        let mut outputs = Vec::new();
        self.master.set_up(NodeId::new(AXTC).unwrap(), &mut outputs);
        self.carry_out(outputs, now);
    }
}

#[test]
fn a_node_that_is_reset_in_the_middle_is_set_up_and_started_again() {
    let reset = "[[fault]]\ndevice = \"axtc\"\nkind = \"restart\"\nat = \"5s\"\n";
    let mut bus = Bus::new(reset, Start::WhenSetUp);
    bus.run(0, 100);
    assert_eq!(bus.events, [(0, NodeEvent::BootedUp { again: false })]);
    bus.set_up(101);
    assert_eq!(bus.run(101, 5000), 25, "each 200 ms from the start on");
    assert_eq!(bus.events[1..], [(5000, NodeEvent::BootedUp { again: true })]);
    assert_eq!(bus.run(5001, 5500), 0);
    bus.set_up(5501);
    assert_eq!(bus.run(5502, 6501), 6);
    assert_eq!(bus.events.len(), 2);
}

#[test]
fn a_node_that_falls_silent_is_missed_and_started_again_when_it_is_back() {
    let silent = "[[fault]]\ndevice = \"axtc\"\nkind = \"silent\"\nat = \"4500ms\"\nfor_time = \"6s\"\n";
    let mut bus = Bus::new(silent, Start::AtOnce);
    bus.run(0, 12_000);
    let after = Duration::from_secs(3);
    assert_eq!(
        bus.events,
        [
            (0, NodeEvent::BootedUp { again: false }),
            (7000, NodeEvent::Lost { never_seen: false, after }),
            (11_000, NodeEvent::Back { after: Duration::from_secs(7) }),
        ]
    );
}

#[test]
fn a_node_that_was_never_there_is_missed() {
    let mut bus = Bus::new("[[fault]]\ndevice = \"axtc\"\nkind = \"silent\"\n", Start::AtOnce);
    bus.run(0, 5000);
    let lost = NodeEvent::Lost { never_seen: true, after: Duration::from_secs(3) };
    assert_eq!(bus.events, [(3000, lost)]);
}
