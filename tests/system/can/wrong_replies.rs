//! Frames that must not be accepted as the reply to an SDO request. They are received before the request, are wrong, or
//! are late.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::kinds::can::{CanDial, Images, Link, ReceivedFrame};
use isotherm::fieldbus::line::DeviceLine;
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::Request;
use isotherm::observe::status::{GatewayApi, Status};
use isotherm_core::codec::{CanId, CanMatch};
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use socketcan::{CanFrame, CanSocket, EmbeddedFrame, ExtendedId, Frame, Socket};

use crate::can::node::frame;
use crate::can::rig::{Interface, load, receive, with_source};

const TIMEOUT: Duration = Duration::from_millis(60);
/// Maximum duration of each half of a case. On a busy computer, right replies arrive after the timeout too, and the gateway
/// then waits up to 30 s before the next request to that node.
const PATIENCE: Duration = Duration::from_secs(180);
const MILLI: Duration = Duration::from_millis(1);
const IDLE: Duration = Duration::from_millis(50);
/// Correct and wrong values of the nodes: 21.5 and 77.7 °C.
const TRUTH: [u8; 2] = [215, 0];
const LIE: [u8; 2] = [9, 3];
/// Command byte of an expedited reply with two bytes.
const READ: u8 = 0x4b;
const OBJECT: (u16, u8) = (0x2100, 1);
/// Least number of attempts of a case, of all its nodes together.
const ATTEMPTS: u32 = 100;
/// Number of requests after which a wrong value that counted as a reply is no longer displayed.
const EXCUSED: u32 = 3;

/// Wrong replies of a node to a request, each with its delay.
type Answers = fn(&Question) -> Vec<(Duration, CanFrame)>;

struct Case {
    name: &'static str,
    /// Wrong replies. They answer every second request, or, with `is_beside`, follow the correct reply to each request.
    answers: Answers,
    /// Reply to a request for a segment.
    segment: [u8; 8],
    /// Whether the correct reply is sent first.
    is_beside: bool,
    /// Number of nodes.
    nodes: u32,
    /// Period of the requests, ms.
    every: u32,
}

struct Question {
    node: u32,
    index: u16,
    sub: u8,
}

impl Question {
    fn data(&self, command: u8, rest: &[u8]) -> Vec<u8> {
        let [low, high] = self.index.to_le_bytes();
        let mut data = vec![command, low, high, self.sub];
        data.extend(rest);
        data.resize(8, 0);
        data
    }

    fn frame(&self, data: &[u8]) -> CanFrame {
        frame(0x580 + self.node, data)
    }

    fn says(&self, command: u8, rest: &[u8]) -> Vec<(Duration, CanFrame)> {
        vec![(Duration::ZERO, self.frame(&self.data(command, rest)))]
    }

    fn lie_after(&self, span: Duration) -> Vec<(Duration, CanFrame)> {
        vec![(span, self.frame(&self.data(READ, &LIE)))]
    }

    /// The same request for another object.
    fn other(&self, index: u16, sub: u8) -> Question {
        Question { node: self.node, index: self.index ^ index, sub: self.sub ^ sub }
    }
}

const fn wrong(name: &'static str, answers: Answers) -> Case {
    Case { name, answers, segment: [0x0b, 9, 3, 0, 0, 0, 0, 0], is_beside: false, nodes: 25, every: 300 }
}

const fn segmented(name: &'static str, answers: Answers, segment: [u8; 8]) -> Case {
    Case { segment, ..wrong(name, answers) }
}

/// A case with one node only: its unsolicited frames would have no effect while another node is queried.
const fn beside_it(name: &'static str, answers: Answers) -> Case {
    Case { is_beside: true, nodes: 1, every: 60, ..wrong(name, answers) }
}

const WRONG: [Case; 20] = [
    wrong("another index", |asked| asked.other(0x0100, 0).says(READ, &LIE)),
    wrong("another sub-index", |asked| asked.other(0, 1).says(READ, &LIE)),
    wrong("the index the wrong way round", |asked| asked.other(0x2121, 0).says(READ, &LIE)),
    wrong("four bytes", |asked| asked.says(0x43, &LIE)),
    wrong("three bytes", |asked| asked.says(0x47, &LIE)),
    wrong("one byte", |asked| asked.says(0x4f, &LIE)),
    wrong("the answer to a write", |asked| asked.says(0x60, &LIE)),
    wrong("a segment", |asked| vec![(Duration::ZERO, asked.frame(&[0x0b, 9, 3, 0, 0, 0, 0, 0]))]),
    wrong("the answer to a segment that is written", |asked| asked.says(0x20, &LIE)),
    wrong("the beginning of a block", |asked| asked.says(0xc2, &LIE)),
    wrong("a specifier that there is not", |asked| asked.says(0xe3, &LIE)),
    wrong("an abort of another object", |asked| asked.other(0x0100, 0).says(0x80, &[0, 0, 2, 6])),
    wrong("seven bytes of frame", |asked| vec![(Duration::ZERO, asked.frame(&asked.data(READ, &LIE)[..7]))]),
    wrong("an empty frame", |asked| vec![(Duration::ZERO, asked.frame(&[]))]),
    wrong("another node", |asked| {
        vec![(Duration::ZERO, frame(0x580 + asked.node + 50, &asked.data(READ, &LIE)))]
    }),
    wrong("an identifier of 29 bits", |asked| {
        let id = ExtendedId::new(0x580 + asked.node).unwrap();
        vec![(Duration::ZERO, CanFrame::new(id, &asked.data(READ, &LIE)).unwrap())]
    }),
    segmented(
        "a segment with the wrong toggle",
        |asked| asked.says(0x41, &[2, 0, 0, 0]),
        [0x1b, 9, 3, 0, 0, 0, 0, 0],
    ),
    segmented(
        "more than was announced",
        |asked| asked.says(0x41, &[2, 0, 0, 0]),
        [0x01, 9, 3, 0, 0, 0, 0, 0],
    ),
    segmented(
        "less than was announced",
        |asked| asked.says(0x41, &[4, 0, 0, 0]),
        [0x0b, 9, 3, 0, 0, 0, 0, 0],
    ),
    segmented("announced as nothing", |asked| asked.says(0x41, &[0, 0, 0, 0]), [0x0b, 9, 3, 0, 0, 0, 0, 0]),
];

const BEFORE: [Case; 2] = [
    beside_it("ahead by one, 1 ms after its answer", |asked| asked.lie_after(Duration::from_millis(1))),
    beside_it("ahead by one, 20 ms after its answer", |asked| asked.lie_after(Duration::from_millis(20))),
];

const LATE: [Case; 4] = [
    wrong("after 1.2 timeouts", |asked| asked.lie_after(TIMEOUT.mul_f64(1.2))),
    wrong("after 2 timeouts", |asked| asked.lie_after(TIMEOUT.mul_f64(2.0))),
    wrong("after 3 timeouts", |asked| asked.lie_after(TIMEOUT.mul_f64(3.0))),
    wrong("after 5 timeouts", |asked| asked.lie_after(TIMEOUT.mul_f64(5.0))),
];

/// Simulated nodes of one interface.
#[derive(Default)]
struct Nodes {
    source: OnceLock<Arc<dyn GatewayApi>>,
    /// Requests, attempts and correct replies of each node.
    counts: Mutex<BTreeMap<u32, [u32; 3]>>,
    accepted: AtomicU32,
    /// Number of requests until every displayed value comes from a regular reply again.
    excused: AtomicU32,
    behave: AtomicBool,
    is_over: AtomicBool,
}

impl Nodes {
    /// Simulates all nodes until the end of the case.
    fn live(&self, socket: &CanSocket, case: &Case) {
        let clock = Clock::wall();
        let mut pending: Vec<(Moment, CanFrame)> = Vec::new();
        while !self.is_over.load(Ordering::SeqCst) {
            // A shorter interval would occupy a small computer.
            let next = pending.first().map_or(IDLE, |(due, _)| due.since(clock.now()).clamp(MILLI, IDLE));
            let heard = socket.read_frame_timeout(next);
            let now = clock.now();
            if let Ok(heard) = heard {
                if case.is_beside {
                    // After a request, no frame may precede it.
                    pending.clear();
                }
                let answers = self.answers(&heard, case);
                pending.extend(answers.into_iter().map(|(after, frame)| (now.after(after), frame)));
            }
            pending.sort_by_key(|(due, _)| *due);
            while pending.first().is_some_and(|(due, _)| clock.now() >= *due) {
                let frame = pending.remove(0).1;
                if case.is_beside && frame.data()[4..6] == LIE {
                    self.lies_before(socket, &frame);
                } else {
                    let _ = socket.write_frame(&frame);
                }
            }
        }
    }

    /// Sends a wrong value that must arrive before the next request. If the request came first, on a busy computer, the
    /// attempt does not count: the wrong value is then a reply that cannot be distinguished.
    fn lies_before(&self, socket: &CanSocket, lie: &CanFrame) {
        let excused = self.excused.load(Ordering::SeqCst);
        let mut is_in_time = !is_asked(socket);
        if is_in_time {
            // It must be set before the value can be displayed.
            self.excused.store(EXCUSED, Ordering::SeqCst);
            let _ = socket.write_frame(lie);
            is_in_time = !is_asked(socket);
        }
        if is_in_time {
            self.excused.store(excused, Ordering::SeqCst);
        } else if let Some([_, tries, _]) = self.counts.lock().unwrap().get_mut(&(lie.raw_id() - 0x580)) {
            *tries = tries.saturating_sub(1);
        }
    }

    fn is_excused(&self) -> bool {
        self.excused.load(Ordering::SeqCst) > 0
    }

    fn answers(&self, heard: &CanFrame, case: &Case) -> Vec<(Duration, CanFrame)> {
        let (id, Ok(data)) = (heard.raw_id(), <[u8; 8]>::try_from(heard.data())) else { return Vec::new() };
        let node = id.wrapping_sub(0x600);
        if !(1..=case.nodes).contains(&node) {
            return Vec::new();
        }
        let question = Question { node, index: u16::from_le_bytes([data[1], data[2]]), sub: data[3] };
        match (data[0], (question.index, question.sub)) {
            (0x60 | 0x70, _) => vec![(Duration::ZERO, question.frame(&case.segment))],
            (0x40, OBJECT) => self.reads(&question, case),
            // A request that tests whether the node still processes an older request.
            (0x40, _) => question.says(0x43, &[0; 4]),
            _ => Vec::new(),
        }
    }

    fn reads(&self, question: &Question, case: &Case) -> Vec<(Duration, CanFrame)> {
        // Result of the attempt before.
        let is_open = {
            let [questions, tries, _] = self.count(question.node);
            tries > 0 && (case.is_beside || questions % 2 == 1)
        };
        let shown = self.source.get().filter(|_| is_open);
        let is_accepted = shown.is_some_and(|source| lie(&source.status(), question.node).is_some());
        if is_accepted && !self.is_excused() {
            self.accepted.fetch_add(1, Ordering::SeqCst);
        } else if !is_accepted {
            let _ = self.excused.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
        }
        let mut counts = self.counts.lock().unwrap();
        let [questions, tries, right] = counts.entry(question.node).or_default();
        *questions += 1;
        let lies = !self.behave.load(Ordering::SeqCst) && (case.is_beside || *questions % 2 == 1);
        let mut answers = Vec::new();
        if !lies || case.is_beside {
            *right += 1;
            answers = question.says(READ, &TRUTH);
        }
        if lies {
            *tries += 1;
            answers.extend((case.answers)(question));
        }
        answers
    }

    /// Returns the number of attempts of all nodes.
    fn tries(&self) -> u32 {
        self.counts.lock().unwrap().values().map(|[_, tries, _]| tries).sum()
    }

    fn count(&self, node: u32) -> [u32; 3] {
        self.counts.lock().unwrap().get(&node).copied().unwrap_or_default()
    }
}

/// Returns whether a request waits in the socket, so that a frame sent now would follow it.
fn is_asked(socket: &CanSocket) -> bool {
    let mut polled = [PollFd::new(socket, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).unwrap() > 0
}

/// Displayed value of this node that no correct reply contained.
fn lie(status: &Status, node: u32) -> Option<f64> {
    let signal = status.signals.iter().find(|signal| signal.name == format!("s{node}")).unwrap();
    signal.value.filter(|value| (value - 21.5).abs() > 0.01)
}

fn profile(interface: &Interface, case: &Case) -> isotherm_profile::Profile {
    let mut text = format!(
        "[machine]\nname = \"believers\"\n[bus.can]\ntype = \"can\"\ninterface = \"INTERFACE\"\ntimeout = \"{}ms\"\n",
        TIMEOUT.as_millis()
    );
    let every = case.every;
    for node in 1..=case.nodes {
        write!(
            text,
            "[device.n{node}]\nbus = \"can\"\nnode = {node}\nevery = \"{every}ms\"\n[signal.s{node}]\ndevice = \"n{node}\"\n\
             sdo = \"2100:01\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"\nmax_age = \"30s\"\n"
        )
        .unwrap();
    }
    load(&text, interface)
}

/// Runs a case on its own interface. Returns the number of attempts, the number of accepted wrong values, and a
/// description of other errors.
fn run(case: &Case, interface: &Interface) -> (u32, u32, String) {
    let nodes = Arc::new(Nodes::default());
    let socket = CanSocket::open(interface.name()).unwrap();
    socket.set_nonblocking(false).unwrap();
    std::thread::scope(|scope| {
        let living = nodes.clone();
        scope.spawn(move || living.live(&socket, case));
        let (tell, reported) = std::sync::mpsc::channel();
        let (watched, number) = (nodes.clone(), case.nodes);
        with_source(profile(interface, case), false, move |source| {
            drop(watched.source.set(source.clone()));
            tell.send(watch(source.as_ref(), &watched, number)).unwrap();
        });
        nodes.is_over.store(true, Ordering::SeqCst);
        (nodes.tries(), nodes.accepted.load(Ordering::SeqCst), reported.recv().unwrap_or_default())
    })
}

/// Observes the status until there were enough attempts, and then until every node is accepted again.
fn watch(source: &dyn GatewayApi, nodes: &Nodes, number: u32) -> String {
    let (clock, mut wrong) = (Clock::wall(), BTreeMap::new());
    let mut look = |until: &dyn Fn(&Status) -> bool| {
        let begun = clock.now();
        loop {
            let status = source.status();
            for node in (1..=number).filter(|_| !nodes.is_excused()) {
                lie(&status, node).into_iter().for_each(|value| {
                    wrong.insert(format!("s{node}"), value);
                });
            }
            if until(&status) {
                return true;
            }
            if clock.now().since(begun) > PATIENCE {
                return false;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    let is_tried = look(&|_| nodes.tries() >= ATTEMPTS);
    nodes.behave.store(true, Ordering::SeqCst);
    let right: Vec<u32> = (1..=number).map(|node| nodes.count(node)[2]).collect();
    let is_accepted = look(&|status| {
        (1..=number).zip(&right).all(|(node, before)| {
            let signal = status.signals.iter().find(|signal| signal.name == format!("s{node}")).unwrap();
            signal.quality == "good" && nodes.count(node)[2] > before + 1
        })
    });
    let mut reported = String::new();
    if !wrong.is_empty() {
        write!(reported, "read {wrong:?}").unwrap();
    }
    if !is_tried {
        let tries: Vec<_> = (1..=number).map(|node| nodes.count(node)).collect();
        write!(reported, " asked too seldom: {tries:?}").unwrap();
    }
    if !is_accepted {
        let faults: Vec<_> = source.status().devices.into_iter().map(|device| device.fault).collect();
        write!(reported, " good nodes are not believed: {faults:?}").unwrap();
    }
    reported
}

fn none_is_believed(letter: char, cases: &[Case]) {
    let mut failed = Vec::new();
    // A small computer can serve this number of cases in parallel.
    for (round, cases) in cases.chunks(5).enumerate() {
        let ended: Vec<_> = std::thread::scope(|scope| {
            let running = cases.iter().enumerate().map(|(number, case)| {
                let interface = Interface::new(&format!("early{letter}{round}{number}"));
                scope.spawn(move || run(case, &interface))
            });
            let running: Vec<_> = running.collect();
            running.into_iter().map(|one| one.join().unwrap()).collect()
        });
        for (case, (tried, accepted, wrong)) in cases.iter().zip(ended) {
            let reported = format!("SDO, {}: {accepted} of {tried} believed {wrong}", case.name);
            println!("{reported}");
            if !wrong.is_empty() || accepted > 0 {
                failed.push(reported);
            }
        }
    }
    assert!(failed.is_empty(), "{} of {}:\n{}", failed.len(), cases.len(), failed.join("\n"));
}

#[test]
fn an_sdo_answer_that_was_there_before_its_question_is_no_reading() {
    none_is_believed('b', &BEFORE);
}

const OF_NODE_1: Question = Question { node: 1, index: OBJECT.0, sub: OBJECT.1 };

/// Returns whether the node, on a busy computer, sent its wrong value after the request. The value is then a reply that
/// cannot be distinguished. The frames are in the order of the line.
fn was_late_itself(line: &CanSocket) -> bool {
    line.set_nonblocking(true).unwrap();
    let lie = OF_NODE_1.lie_after(Duration::ZERO)[0].1;
    let [low, high] = OBJECT.0.to_le_bytes();
    let mut was_asked = false;
    let mut is_late = false;
    while let Ok(passed) = line.read_frame() {
        was_asked |= passed.raw_id() == 0x601 && passed.data().starts_with(&[0x40, low, high, OBJECT.1]);
        is_late |= was_asked && passed.raw_id() == lie.raw_id() && passed.data() == lie.data();
    }
    is_late
}

/// The process stops while the frame arrives. The frame waits in the kernel when the request is sent, and the listener
/// has not read it yet.
#[test]
fn an_sdo_answer_that_waits_in_the_kernel_before_its_question_is_no_reading() {
    let interface = Interface::new("early0");
    let machine = load(
        "[machine]\nname = \"believers\"\n[bus.can]\ntype = \"can\"\ninterface = \"INTERFACE\"\ntimeout = \"5s\"\n\
         [device.n1]\nbus = \"can\"\nnode = 1\nevery = \"10s\"\n[signal.s1]\ndevice = \"n1\"\nsdo = \"2100:01\"\ntype = \"i16\"\n\
         scale = 0.1\nunit = \"degC\"\nmax_age = \"30s\"\n",
        &interface,
    );
    let (node, other) =
        (CanSocket::open(interface.name()).unwrap(), CanSocket::open(interface.name()).unwrap());
    node.set_nonblocking(false).unwrap();
    let is_over = Arc::new(AtomicBool::new(false));
    let over = is_over.clone();
    let living = std::thread::spawn(move || {
        while !over.load(Ordering::SeqCst) {
            let Ok(heard) = node.read_frame_timeout(IDLE) else { continue };
            let Ok([0x40, low, high, sub, ..]) = <[u8; 8]>::try_from(heard.data()) else { continue };
            let asked = Question { node: 1, index: u16::from_le_bytes([low, high]), sub };
            // The node answers a request that tests for an older request, and sends a wrong value after it.
            let answers = match (asked.index, asked.sub) {
                OBJECT => asked.says(READ, &TRUTH),
                _ => [asked.says(0x43, &[0; 4]), OF_NODE_1.lie_after(Duration::ZERO)].concat(),
            };
            answers.iter().for_each(|(_, frame)| node.write_frame(frame).unwrap());
        }
    });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let (bus, clock) = (machine.bus(BusId(0)), Clock::wall());
        let wanted = [0x601, 0x581].map(|id| CanMatch::exactly(CanId::standard(id).unwrap()));
        let link = Arc::new(Link::new(&bus.address, wanted.to_vec(), Images::default()));
        let (socket, listened) = (link.open().unwrap(), link.clone());
        tokio::spawn(async move {
            loop {
                if let Ok(ReceivedFrame::Frame(frame)) = receive(&socket).await {
                    listened.passed(&frame);
                }
            }
        });
        let dial = Box::new(CanDial::new(link, bus.timeout));
        let mut line = DeviceLine::new(bus, &[(DeviceId(0), machine.device(DeviceId(0)))], dial, &clock);
        let requests = machine.requests(DeviceId(0));
        let asked = Request::from(&requests[0].asks);
        const ENOUGH: u32 = 100;
        let mut tried = 0;
        for _ in 0..4 * ENOUGH {
            if tried == ENOUGH {
                break;
            }
            other.write_frame(&OF_NODE_1.lie_after(Duration::ZERO)[0].1).unwrap();
            std::thread::sleep(Duration::from_millis(30));
            let answered = line.request(DeviceId(0), asked, SendDeadline::None).await.unwrap();
            if !was_late_itself(&other) {
                assert_eq!(answered.answer.registers(), [215]);
                tried += 1;
            }
        }
        assert_eq!(tried, ENOUGH, "the node was late itself too often");
    });
    is_over.store(true, Ordering::SeqCst);
    living.join().unwrap();
}

#[test]
fn no_wrong_sdo_answer_is_ever_a_reading() {
    none_is_believed('w', &WRONG);
}

#[test]
fn an_sdo_answer_after_its_timeout_is_no_reading() {
    none_is_believed('l', &LATE);
}
