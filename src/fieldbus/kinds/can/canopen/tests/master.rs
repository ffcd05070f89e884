use super::super::master::{Master, NodeEvent, Output, Start, Supervision};
use super::*;
use isotherm_core::quantity::Moment;
use isotherm_profile::Sync;

const SECOND: Duration = Duration::from_secs(1);

fn at(seconds: u32) -> Moment {
    Moment::default().after(SECOND * seconds)
}

pub(super) fn of_three_nodes() -> Master {
    let care = |heartbeat, start| Supervision { heartbeat, start };
    let nodes = [
        (node(1), care(Some(SECOND * 2), Start::AtOnce)),
        (node(2), care(Some(SECOND * 5), Start::WhenSetUp)),
        (node(3), care(None, Start::Never)),
    ];
    Master::new(nodes, None, at(0))
}

/// Master under test, with the outputs that it returned since the last call.
struct Led {
    master: Master,
    outputs: Vec<Output>,
}

impl Led {
    fn new() -> Led {
        let mut led = Led { master: of_three_nodes(), outputs: Vec::new() };
        led.master.tick(at(0), &mut led.outputs);
        led
    }

    fn receive(&mut self, raw: u16, data: &[u8], seconds: u32) -> Vec<Output> {
        self.master.take(&frame(raw, data), at(seconds), &mut self.outputs);
        std::mem::take(&mut self.outputs)
    }

    fn tick(&mut self, seconds: u32) -> Vec<Output> {
        self.master.tick(at(seconds), &mut self.outputs);
        std::mem::take(&mut self.outputs)
    }
}

fn started(number: u8) -> Output {
    Output::Send(frame(0, &[1, number]))
}

fn reported(number: u8, event: NodeEvent) -> Output {
    Output::Tell(node(number), event)
}

const UP: &[u8] = &[0x00];
const OPERATIONAL: &[u8] = &[0x05];
const PRE: &[u8] = &[0x7f];

#[test]
fn nodes_are_started_at_the_beginning_and_after_every_boot_up() {
    let mut led = Led::new();
    assert_eq!(
        led.outputs,
        [started(1)],
        "not the one that is set up first, and not the one that is left alone"
    );
    led.outputs.clear();
    assert_eq!(led.receive(0x701, UP, 1), [reported(1, NodeEvent::BootedUp { again: false }), started(1)]);
    assert_eq!(led.receive(0x701, OPERATIONAL, 1), []);
    assert_eq!(led.receive(0x701, UP, 2), [reported(1, NodeEvent::BootedUp { again: true }), started(1)]);
    assert_eq!(led.receive(0x703, UP, 2), [reported(3, NodeEvent::BootedUp { again: false })]);
    assert_eq!(led.receive(0x704, UP, 2), [], "no node of ours");
}

#[test]
fn a_node_with_a_setup_list_is_started_when_it_is_written() {
    let mut led = Led::new();
    led.outputs.clear();
    assert_eq!(led.receive(0x702, UP, 1), [reported(2, NodeEvent::BootedUp { again: false })]);
    assert_eq!(led.receive(0x702, PRE, 1), [], "it waits");
    led.master.set_up(node(2), &mut led.outputs);
    assert_eq!(std::mem::take(&mut led.outputs), [started(2)]);
    assert_eq!(led.receive(0x702, OPERATIONAL, 2), []);
    assert_eq!(
        led.receive(0x702, PRE, 3),
        [reported(2, NodeEvent::FellBack)],
        "it waits for its setup again"
    );
    assert_eq!(led.receive(0x702, PRE, 4), [], "told once");
}

#[test]
fn a_start_that_was_lost_is_sent_again_with_the_next_heartbeat() {
    let mut led = Led::new();
    led.outputs.clear();
    assert_eq!(led.receive(0x701, PRE, 1), [started(1)]);
    assert_eq!(led.receive(0x701, PRE, 2), [started(1)]);
    assert_eq!(led.receive(0x701, OPERATIONAL, 3), []);
}

#[test]
fn a_node_that_somebody_stopped_is_reported_once_and_not_fought_for() {
    let mut led = Led::new();
    led.outputs.clear();
    led.receive(0x701, OPERATIONAL, 1);
    assert_eq!(led.receive(0x701, &[0x04], 2), [reported(1, NodeEvent::Stopped)]);
    assert_eq!(led.receive(0x701, &[0x04], 3), []);
    assert_eq!(led.tick(3), []);
}

#[test]
fn a_missed_heartbeat_and_one_that_never_came_are_reported_once() {
    let mut led = Led::new();
    led.outputs.clear();
    led.receive(0x701, OPERATIONAL, 1);
    assert_eq!(led.master.due(), Some(at(3)));
    assert_eq!(led.tick(2), []);
    let lost = NodeEvent::Lost { never_seen: false, after: SECOND * 2 };
    assert_eq!(led.tick(3), [reported(1, lost)]);
    assert!(led.master.is_lost(node(1)));
    assert_eq!(led.tick(4), []);
    let never = NodeEvent::Lost { never_seen: true, after: SECOND * 5 };
    assert_eq!(led.tick(9), [reported(2, never)]);
    assert_eq!(led.master.due(), None, "there is nobody left to be missed");
    assert_eq!(led.receive(0x701, OPERATIONAL, 11), [reported(1, NodeEvent::Back { after: SECOND * 10 })]);
    assert_eq!(never.to_string(), "was never seen: no heartbeat for 5s");
    assert_eq!(lost.to_string(), "is silent: no heartbeat for 2s");
}

#[test]
fn an_emergency_is_handed_on_with_its_node() {
    let mut led = Led::new();
    led.outputs.clear();
    let emergency = Emergency { code: 0x5030, register: ErrorRegister(0x81), detail: [1, 0, 0, 0, 0] };
    assert_eq!(
        led.receive(0x083, &[0x30, 0x50, 0x81, 1, 0], 1),
        [reported(3, NodeEvent::Emergency(emergency))]
    );
    assert_eq!(led.receive(0x084, &[0x30, 0x50, 0x81, 1, 0], 1), []);
}

#[test]
fn it_hears_what_its_nodes_say_and_nothing_else() {
    let received: Vec<_> = of_three_nodes().identifiers().map(CanId::raw).collect();
    assert_eq!(received, [0x081, 0x701, 0x082, 0x702, 0x083, 0x703]);
}

#[test]
fn sync_is_sent_in_its_time_and_missed_ones_are_skipped() {
    let sync = Sync { id: CanId::of_11_bits(0x80), every: SECOND };
    let mut master = Master::new([], Some(sync), at(0));
    let mut sent = |seconds| {
        let mut outputs = Vec::new();
        master.tick(at(seconds), &mut outputs);
        (outputs.len(), master.due())
    };
    assert_eq!(sent(0), (1, Some(at(1))));
    assert_eq!(sent(0), (0, Some(at(1))));
    assert_eq!(sent(1), (1, Some(at(2))));
    assert_eq!(sent(7), (1, Some(at(8))), "five were missed");
    let mut outputs = Vec::new();
    master.tick(at(8), &mut outputs);
    assert_eq!(outputs, [Output::Send(frame(0x80, &[]))]);
}
