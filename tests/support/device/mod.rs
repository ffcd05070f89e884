//! Modbus TCP device that records every read and every write, with its time and its connection.
//!
//! `holding:0` is a temperature, `holding:10` an offset. [`PROFILE`] requests as many counts of offset as the
//! temperature has. A test that sets the temperature therefore knows the target of the offset.

#![allow(dead_code, reason = "each of the tests uses its part")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Result, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

pub(crate) mod gate;
pub(crate) mod gateway;
pub(crate) mod server;

use gate::{At, Gate, Of, Place};
use server::Question;

/// Counts of one step of the axis.
pub(crate) const STEP: i16 = 10;
/// Pause of the gateway before each of its requests. It leaves time to act between two of them.
const PAUSE: &str = "100ms";

const TEMPERATURE: u16 = 0;
const OFFSET: u16 = 10;
const HEARTBEAT: u16 = 20;

/// Times of a machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Times {
    /// Timeout of a request.
    pub(crate) timeout: Duration,
    /// Period of the reading and of the axis. It is long enough for four requests, each after its pause.
    pub(crate) every: Duration,
    /// Largest age of a reading that may be used.
    pub(crate) max_age: Duration,
}

/// Profile of a machine with only this device, whose axis moves one step in each period.
pub(crate) fn profile(address: SocketAddr, times: Times) -> String {
    let spans = [("MAX_AGE", times.max_age), ("TIMEOUT", times.timeout), ("EVERY", times.every)];
    let text = PROFILE.replace("ADDRESS", &address.to_string()).replace("PAUSE", PAUSE);
    spans.iter().fold(text, |text, (name, span)| text.replace(name, &format!("{}ms", span.as_millis())))
}

const PROFILE: &str = r#"
[machine]
name = "walker"
arm = "auto"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "TIMEOUT"
[device.cnc]
bus = "cell"
unit = 1
every = "EVERY"
quirks = { pause_between_requests = "PAUSE" }
[signal.bed]
device = "cnc"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "MAX_AGE"
range = "none"
max_rate = "none"
[axis.z]
limit = 2000.0
step = 1.0
rate = 1000.0
every = "EVERY"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 0.0 } ]
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:10"
type = "i16"
scale = 0.1
"#;

/// Request that has reached the device.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub(crate) at: Moment,
    /// Number of the connection, in the order of acceptance.
    pub(crate) connection: usize,
    pub(crate) what: What,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    /// The temperature was requested. `None` while that is not answered.
    Asked { answered: Option<i16> },
    /// The offset was read.
    Looked,
    /// The offset was written.
    Wrote { from: i16, to: i16 },
}

/// Device, shared with the threads that answer.
#[derive(Clone)]
pub(crate) struct Device(Arc<Inner>);

struct Inner {
    clock: Clock,
    address: SocketAddr,
    /// Delay before each answer.
    delay: Duration,
    state: Mutex<State>,
    changed: Condvar,
    gate: Gate,
}

#[derive(Default)]
pub(crate) struct State {
    temperature: i16,
    offset: i16,
    pub(crate) seen: Vec<Seen>,
    hangs_up: bool,
    is_down: bool,
    /// Temperatures are not answered at present.
    holds: bool,
    /// Number of requests that wait for that.
    pub(crate) held: usize,
    /// Times of the heartbeats, if the profile has one.
    pub(crate) beats: Vec<Moment>,
}

impl Device {
    /// Serves all clients of this listener until the process ends.
    pub(crate) fn listen(listener: TcpListener, delay: Duration) -> Device {
        Device::by(Clock::wall(), listener, delay)
    }

    /// Serves all clients. The times of what it records are by this clock.
    pub(crate) fn by(clock: Clock, listener: TcpListener, delay: Duration) -> Device {
        let device = Device(Arc::new(Inner {
            clock,
            address: listener.local_addr().unwrap(),
            delay,
            state: Mutex::default(),
            changed: Condvar::new(),
            gate: Gate::default(),
        }));
        let (accepting, answering) = (device.clone(), device.clone());
        server::listen(
            listener,
            move |_| {
                accepting.0.gate.passes(Place(Of::Connection, At::Come));
                if accepting.state().is_down { server::hang_up() } else { Ok(()) }
            },
            move |question: &Question, stream: &mut TcpStream| answering.answer(question, stream),
        );
        device
    }

    pub(crate) fn address(&self) -> SocketAddr {
        self.0.address
    }

    /// Present time, by the clock of all recorded requests.
    pub(crate) fn now(&self) -> Moment {
        self.0.clock.now()
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap()
    }

    /// Sets the temperature so that the axis moves to this offset, in counts.
    pub(crate) fn asks(&self, offset: i16) {
        self.state().temperature = offset;
    }

    /// Present offset.
    pub(crate) fn offset(&self) -> i16 {
        self.state().offset()
    }

    /// Writes this value to the register of the offset, like another client.
    pub(crate) fn puts(&self, offset: i16) {
        self.state().offset = offset;
    }

    /// Delays all requests of the temperature from now on.
    pub(crate) fn hold(&self) {
        self.state().holds = true;
    }

    /// Answers the delayed requests.
    pub(crate) fn release(&self) {
        self.state().holds = false;
        self.0.changed.notify_all();
    }

    /// Waits until `found` returns a value. It is called again at each request. Returns `None` after `most`.
    pub(crate) fn wait<T>(&self, most: Duration, found: impl Fn(&State) -> Option<T>) -> Option<T> {
        let until = self.now().after(most);
        let mut state = self.state();
        loop {
            if let Some(found) = found(&state) {
                return Some(found);
            }
            let now = self.now();
            if now >= until {
                return None;
            }
            state = self.0.changed.wait_timeout(state, until.since(now)).unwrap().0;
        }
    }

    /// Closes the connection of every client that connects or sends a request, until it is up again.
    pub(crate) fn is_down(&self, is_down: bool) {
        self.state().is_down = is_down;
    }

    /// Closes the connection of the next request.
    pub(crate) fn hangs_up(&self) {
        self.state().hangs_up = true;
    }

    /// Gate that makes the device wait in the middle of an exchange.
    pub(crate) fn gate(&self) -> &Gate {
        &self.0.gate
    }

    fn answer(&self, question: &Question, stream: &mut TcpStream) -> Result<()> {
        // A write had arrived before a busy computer let this thread take it.
        let at = if question.is_read() { self.now() } else { self.now().before(question.waited) };
        let hangs_up = {
            let mut state = self.state();
            std::mem::take(&mut state.hangs_up) || state.is_down
        };
        if hangs_up {
            return server::hang_up();
        }
        let has_written = matches!(self.state().seen.last(), Some(Seen { what: What::Wrote { .. }, .. }));
        let of = match (question.is_read(), question.from()) {
            (true, TEMPERATURE) => Of::Temperature,
            (true, _) if has_written => Of::ReadBack,
            (true, _) => Of::Look,
            (false, _) => Of::Write,
        };
        let gate = &self.0.gate;
        gate.passes(Place(of, At::Come));
        let answer = question.answer(&self.carry_out(&question.pdu, at, question.connection));
        gate.passes(Place(of, At::CarriedOut));
        let half = if gate.is_closed_at(Place(of, At::Half)) { answer.len() / 2 } else { 0 };
        stream.write_all(&answer[..half])?;
        gate.passes(Place(of, At::Half));
        stream.write_all(&answer[half..])?;
        gate.passes(Place(of, At::Answered));
        Ok(())
    }

    fn carry_out(&self, pdu: &[u8], at: Moment, connection: usize) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
        let register = word(1);
        let value = match (pdu[0], register, word(3)) {
            (3, TEMPERATURE, 1) => self.temperature(at, connection),
            (3, OFFSET, 1) => {
                self.keep(Seen { at, connection, what: What::Looked });
                self.think();
                self.state().offset
            }
            (6, OFFSET, to) => {
                self.write(at, connection, to.cast_signed());
                return pdu.to_vec();
            }
            (16, OFFSET, 1) => {
                self.write(at, connection, word(6).cast_signed());
                return pdu[..5].to_vec();
            }
            (6, HEARTBEAT, _) => {
                self.state().beats.push(at);
                self.0.changed.notify_all();
                return pdu.to_vec();
            }
            // This register does not exist.
            _ => return vec![pdu[0] | 0x80, 2],
        };
        [&[3, 2][..], &value.to_be_bytes()].concat()
    }

    fn temperature(&self, at: Moment, connection: usize) -> i16 {
        let place = self.keep(Seen { at, connection, what: What::Asked { answered: None } });
        self.think();
        let mut state = self.state();
        state.held += 1;
        self.0.changed.notify_all();
        state = self.0.changed.wait_while(state, |state| state.holds).unwrap();
        state.held -= 1;
        self.0.changed.notify_all();
        let value = state.temperature;
        state.seen[place].what = What::Asked { answered: Some(value) };
        value
    }

    fn write(&self, at: Moment, connection: usize, to: i16) {
        let from = std::mem::replace(&mut self.state().offset, to);
        self.keep(Seen { at, connection, what: What::Wrote { from, to } });
        self.think();
    }

    fn keep(&self, seen: Seen) -> usize {
        let mut state = self.state();
        state.seen.push(seen);
        self.0.changed.notify_all();
        state.seen.len() - 1
    }

    fn think(&self) {
        std::thread::sleep(self.0.delay);
    }
}

impl State {
    /// Present offset.
    pub(crate) fn offset(&self) -> i16 {
        self.offset
    }

    /// Number of writes to the offset.
    pub(crate) fn writes(&self) -> usize {
        self.seen.iter().filter(|seen| matches!(seen.what, What::Wrote { .. })).count()
    }

    /// Returns whether a write comes next while the axis moves: temperature and offset were read, the offset last.
    pub(crate) fn is_about_to_write(&self) -> bool {
        let last = self.seen.last_chunk::<2>().map(|last| last.map(|seen| seen.what));
        matches!(last, Some([What::Asked { .. }, What::Looked]))
    }
}

/// Additional time for which a write may be under way, compared with its request.
const UNDER_WAY: Duration = Duration::from_millis(100);

/// Returns writes that were not requested by a reading younger than `max_age` at their arrival, and writes of more than
/// one step.
pub(crate) fn acted_wrongly(seen: &[Seen], max_age: Duration) -> Vec<String> {
    let mut wrong = Vec::new();
    for (place, one) in seen.iter().enumerate() {
        let What::Wrote { from, to } = one.what else { continue };
        // A repeated value moves nothing.
        if from == to {
            continue;
        }
        if (to - from).abs() > STEP {
            wrong.push(format!("{from} → {to} in one write"));
        }
        let asks = |seen: &&Seen| match seen.what {
            What::Asked { answered: Some(asked) } => (asked - from).signum() == (to - from).signum(),
            _ => false,
        };
        let reading = seen[..place].iter().rev().find(asks);
        let age = reading.map(|reading| one.at.since(reading.at));
        if age.is_none_or(|age| age > max_age + UNDER_WAY) {
            wrong.push(format!("{from} → {to} rests on a reading that was asked for {age:?} before"));
        }
    }
    wrong
}
