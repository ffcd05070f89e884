//! Simulated CANopen node. It executes commands, optionally with errors, and logs what it receives.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;
use socketcan::{CanFrame, CanSocket, EmbeddedFrame, ExtendedId, Frame, Id, Socket, StandardId};

/// A node on an interface, until it is dropped.
pub(crate) struct Node {
    state: Arc<Mutex<State>>,
    thread: Option<JoinHandle<()>>,
}

/// Settings and log of a node.
#[derive(Default)]
pub(crate) struct State {
    pub(crate) number: u8,
    /// Whether it sends process data.
    pub(crate) is_operational: bool,
    /// Data of each process data frame, by identifier. An identifier above 0x7FF has 29 bits.
    pub(crate) pdos: BTreeMap<u32, Vec<u8>>,
    /// Period of the heartbeat; `None` for no heartbeat.
    pub(crate) heartbeat: Option<Duration>,
    pub(crate) objects: BTreeMap<(u16, u8), Vec<u8>>,
    /// A frame with this identifier stores its first bytes in the object.
    pub(crate) received: Option<(u16, (u16, u8))>,
    /// Whether a reply for another index precedes every reply.
    pub(crate) speaks_of_others: bool,
    /// Object that is refused, and the abort code.
    pub(crate) refuses: Option<((u16, u8), u32)>,
    /// Time from its start to its first process data.
    pub(crate) first_after: Duration,
    pub(crate) power: Power,
    /// Log, in order: `start`, `1800:05=6400`.
    pub(crate) log: Vec<String>,
    pub(crate) wants_boot: bool,
}

/// Power of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Power {
    #[default]
    On,
    /// The node neither sends nor receives.
    Off,
    /// The thread of the node ends.
    Removed,
}

/// Period of the process data.
const PERIOD: Duration = Duration::from_millis(20);
/// Interval at which the node checks for changes by the test.
const IDLE: Duration = Duration::from_millis(10);

impl Node {
    /// Starts a node on this interface, with this state.
    pub(crate) fn new(interface: &str, state: State) -> Node {
        let socket = CanSocket::open(interface).unwrap();
        socket.set_nonblocking(false).unwrap();
        let state = Arc::new(Mutex::new(State { wants_boot: true, ..state }));
        let own = state.clone();
        let thread = std::thread::spawn(move || live(&socket, &own));
        Node { state, thread: Some(thread) }
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// Resets the node, as after a power failure. It loses its state, and sends a boot-up message.
    pub(crate) fn reset(&self) {
        let mut state = self.state();
        state.is_operational = false;
        state.wants_boot = true;
        state.log.push("reset".to_owned());
    }

    /// Number of occurrences in the log.
    pub(crate) fn times(&self, what: &str) -> usize {
        self.state().log.iter().filter(|line| *line == what).count()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.state().power = Power::Removed;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

pub(crate) fn frame(id: u32, data: &[u8]) -> CanFrame {
    let id: Id = match u16::try_from(id).ok().and_then(StandardId::new) {
        Some(short) => short.into(),
        None => ExtendedId::new(id).unwrap().into(),
    };
    CanFrame::new(id, data).unwrap()
}

impl State {
    /// Time of the next frame that it sends without a request.
    fn next(&self, beat_at: Moment, send_at: Moment) -> Option<Moment> {
        let boot = self.wants_boot.then(Moment::default);
        let beat = self.heartbeat.map(|_| beat_at);
        boot.into_iter().chain(beat).chain(self.is_operational.then_some(send_at)).min()
    }
}

fn live(socket: &CanSocket, state: &Mutex<State>) {
    let clock = Clock::wall();
    let (mut beat_at, mut send_at) = (clock.now(), clock.now());
    loop {
        // A shorter interval would occupy a small computer.
        let due = state.lock().unwrap().next(beat_at, send_at).map_or(IDLE, |due| due.since(clock.now()));
        let heard = socket.read_frame_timeout(due.clamp(Duration::from_millis(1), IDLE));
        let mut state = state.lock().unwrap();
        match state.power {
            Power::On => {}
            Power::Off => continue,
            Power::Removed => return,
        }
        let now = clock.now();
        // Errors are ignored, because the interface may be down.
        let send = |frame: CanFrame| drop(socket.write_frame(&frame));
        let number = u32::from(state.number);
        if std::mem::take(&mut state.wants_boot) {
            send(frame(0x700 + number, &[0]));
        }
        if let Ok(heard) = heard {
            let was_operational = state.is_operational;
            answers(&mut state, &heard).into_iter().for_each(send);
            if state.is_operational && !was_operational {
                send_at = now.after(state.first_after);
            }
        }
        if let Some(pause) = state.heartbeat.filter(|_| now >= beat_at) {
            send(frame(0x700 + number, &[if state.is_operational { 5 } else { 0x7f }]));
            beat_at = now.after(pause);
        }
        if state.is_operational && now >= send_at {
            state.pdos.iter().for_each(|(id, data)| send(frame(*id, data)));
            send_at = now.after(PERIOD);
        }
    }
}

fn answers(state: &mut State, heard: &CanFrame) -> Vec<CanFrame> {
    let (id, data) = (heard.raw_id(), heard.data().to_vec());
    let number = state.number;
    if let Some((_, object)) = state.received.filter(|(own, _)| u32::from(*own) == id) {
        if state.is_operational {
            let width = state.objects[&object].len();
            state.objects.insert(object, data[..width].to_vec());
        }
    } else if id == 0 && (data[1] == 0 || data[1] == number) {
        let command = match data[0] {
            1 => "start",
            2 => "stop",
            0x80 => "pre-operational",
            _ => "reset command",
        };
        state.is_operational = command == "start";
        state.log.push(command.to_owned());
    } else if id == 0x600 + u32::from(number) {
        return sdo(state, &data);
    }
    Vec::new()
}

fn sdo(state: &mut State, data: &[u8]) -> Vec<CanFrame> {
    let object = (u16::from_le_bytes([data[1], data[2]]), data[3]);
    let answer = |command: u8, index: u16, rest: &[u8]| {
        let [low, high] = index.to_le_bytes();
        let mut bytes = vec![command, low, high, object.1];
        bytes.extend_from_slice(rest);
        bytes.resize(8, 0);
        frame(0x580 + u32::from(state.number), &bytes)
    };
    let known = state.objects.get(&object);
    let refused = state.refuses.filter(|(refused, _)| *refused == object).map(|(_, code)| code);
    let refused = refused.or(known.is_none().then_some(0x0602_0000));
    let mut answers = Vec::new();
    if state.speaks_of_others {
        // Like a late reply to an older request.
        answers.push(answer(0x43, object.0 ^ 0x0100, &[0x11; 4]));
        answers.push(answer(0x60, object.0 ^ 0x0100, &[]));
    }
    match (data[0], refused) {
        (0x80, _) => answers.clear(),
        (_, Some(code)) => answers.push(answer(0x80, object.0, &code.to_le_bytes())),
        (0x40, None) => {
            let value = known.unwrap().clone();
            let empty = u8::try_from(4 - value.len()).unwrap();
            answers.push(answer(0x43 | empty << 2, object.0, &value));
        }
        (command, None) => {
            let value = data[4..8 - usize::from(command >> 2 & 3)].to_vec();
            let text: String = value.iter().map(|byte| format!("{byte:02x}")).collect();
            answers.push(answer(0x60, object.0, &[]));
            state.log.push(format!("{:04x}:{:02x}={text}", object.0, object.1));
            state.objects.insert(object, value);
        }
    }
    answers
}
