//! Simulated lines: the fate of each request, and of its reply.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rand::RngExt;
use rand_pcg::Pcg32;

use crate::framing::Framing;
use crate::laws::Rests;
use crate::machine::{
    Brief, CNC, EXPECTED, LINES, Machine, OPEN, PLC, Question, SCALE, SENSORS, TYPE_CODE, channel, value,
};
use crate::nodes::Servers;
use crate::script::left_of_storm;
use crate::second_master::{self, Content, OtherExchange, OtherMaster};
use crate::serial_side::{Delay, PATIENCE, SerialSide};
use crate::time::Passage;

/// Maximum delay of a request. The profile allows 30 s.
pub(crate) const LATE: Duration = Duration::from_millis(29_500);
const SECOND: Duration = Duration::from_secs(1);
const MILLI: Duration = Duration::from_millis(1);

/// Fate of one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Fate {
    /// Executed and answered.
    Done,
    /// Executed at once; the reply takes this time.
    Slow(Duration),
    /// Lost.
    Lost,
    /// Executed, and the reply is lost.
    AnswerLost,
    /// Delayed: executed and answered after this time.
    Held(Duration),
    /// Executed, and answered with this exception.
    DoneAndDenied(u8),
    /// Not executed, and answered with this exception.
    Refused(u8),
    /// Executed, and this byte of the reply is changed.
    Corrupted(u8),
    /// Executed, and the reply is five invalid bytes.
    Garbled,
    /// Not executed; the connection ends before.
    CutBefore,
    /// Executed; the connection ends after that.
    CutAfter,
    /// Executed; the unit answers this long after the timeout of its Modbus gateway, which sends this exception or
    /// nothing.
    Late(Duration, Option<u8>),
    /// Executed; the computer sleeps for this time before it reads the reply.
    Asleep(Duration),
    /// Not executed; the gateway is killed before.
    KilledBefore,
    /// Executed; the gateway is killed after that.
    KilledAfter,
}

/// Condition of a line, which affects all its requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Weather {
    Fair,
    Silent,
    /// This percentage of requests or replies is lost.
    Lossy(u32),
    /// All requests are executed at the end of this condition.
    Jammed,
    Slow(Duration),
    /// This percentage is executed and answered with this exception.
    Denying(u32, u8),
    Garbling(u32),
    Refusing(u8),
    Closing(u32),
    /// This percentage is answered after the timeout of the Modbus gateway, which sends this exception or nothing.
    Shifting(u32, Option<u8>),
    Unreachable,
}

/// Delayed request.
#[derive(Clone, Copy, Debug)]
struct Flight {
    due: Duration,
    asked_at: Duration,
    connection: u64,
    transaction: [u8; 2],
    asked: Question,
    rests: Rests,
}

/// Reply under way to the gateway.
#[derive(Clone, Debug)]
struct Coming {
    at: Duration,
    bytes: Vec<u8>,
    asked_at: Duration,
    asked: Question,
    content: Content,
    /// Request to which the device sent it, and the time of the device's state.
    answers: Question,
    seen_at: Duration,
    /// Whether the reply is unchanged.
    is_sound: bool,
}

pub(crate) struct Line {
    pub(crate) weather: Weather,
    pub(crate) until: Duration,
    /// Fate of the next write, or of the next request to a measuring device.
    pub(crate) next: Option<Fate>,
    timeout: Duration,
    pub(crate) framing: Framing,
    flights: Vec<Flight>,
    connection: u64,
    is_open: bool,
    coming: VecDeque<Coming>,
    /// Time of the last request.
    pub(crate) used_at: Duration,
    /// End of the time in which the gateway may wait for a missing reply to a write, or for the control to take it.
    waits_until: Duration,
}

/// Event in a compact form, which is stored each time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Note {
    Asked(usize, Brief, Fate),
    Arrived(usize, Brief),
    Dialled(usize, bool),
    Weather(usize, Weather, u64),
    Did(&'static str, i64),
}

/// Number of events of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) exchanges: u64,
    pub(crate) writes: u64,
    pub(crate) faults: u64,
    pub(crate) runs: u64,
    pub(crate) arrived_late: u64,
    /// Changes of the settings at the panel of the thermocouple module.
    pub(crate) settings: u64,
    /// Replies of that module that came after the timeout of the Modbus gateway.
    pub(crate) late_answers: u64,
    /// Replies of another master used for requests of the gateway, and how often a gateway must have detected it.
    pub(crate) foreign_answers: u64,
    pub(crate) noticed: u64,
}

/// Everything outside the gateway.
pub(crate) struct World {
    pub(crate) machine: Machine,
    pub(crate) lines: [Line; LINES.len()],
    /// Serial side of the thermocouple module.
    serial: SerialSide,
    pub(crate) other: OtherMaster,
    pub(crate) random: Pcg32,
    pub(crate) passage: Passage,
    pub(crate) counts: Counts,
    /// First connection of the running gateway. Connections of a killed gateway have no effect.
    oldest_alive: u64,
    newest: u64,
    /// Whether the gateway was killed. Its actions then have no effect.
    pub(crate) is_killed: bool,
    disk_is_dead: Arc<AtomicBool>,
    pub(crate) notes: VecDeque<(Duration, Note)>,
    pub(crate) fingerprint: u64,
    pub(crate) servers: Servers,
    /// Whether notes are printed immediately.
    is_traced: bool,
}

impl World {
    pub(crate) fn new(
        machine: Machine,
        random: Pcg32,
        passage: Passage,
        disk_is_dead: Arc<AtomicBool>,
    ) -> World {
        let line = |timeout| Line {
            weather: Weather::Fair,
            until: Duration::ZERO,
            next: None,
            timeout,
            framing: Framing::Tcp,
            flights: Vec::new(),
            connection: 0,
            is_open: false,
            coming: VecDeque::new(),
            used_at: Duration::ZERO,
            waits_until: Duration::ZERO,
        };
        World {
            machine,
            lines: [200, 200, 200, 80, 80].map(|timeout| line(timeout * MILLI)),
            serial: SerialSide::default(),
            other: OtherMaster::default(),
            random,
            passage,
            counts: Counts::default(),
            oldest_alive: 1,
            newest: 0,
            is_killed: false,
            disk_is_dead,
            notes: VecDeque::with_capacity(256),
            fingerprint: 14_695_981_039_346_656_037,
            servers: Servers::default(),
            is_traced: std::env::var_os("SIMULATION_TRACE").is_some(),
        }
    }

    pub(crate) fn note(&mut self, now: Duration, note: Note) {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        (self.fingerprint, now, note).hash(&mut hasher);
        self.fingerprint = hasher.finish();
        if self.is_traced {
            println!("{:>14.3} s  {note:?}", now.as_secs_f64());
        }
        if self.notes.len() == 200 {
            self.notes.pop_front();
        }
        self.notes.push_back((now, note));
    }

    /// Records an event that is not a request, with a number.
    pub(crate) fn did(&mut self, now: Duration, what: &'static str, number: u64) {
        self.note(now, Note::Did(what, i64::try_from(number).unwrap_or(i64::MAX)));
    }

    /// Sets the condition of a line for this time.
    pub(crate) fn turns(&mut self, line: usize, weather: Weather, now: Duration, span: Duration) {
        (self.lines[line].weather, self.lines[line].until) = (weather, now + span);
        self.note(now, Note::Weather(line, weather, span.as_secs()));
    }

    /// Returns whether a request is delayed on a line.
    pub(crate) fn is_held(&self, line: usize) -> bool {
        !self.lines[line].flights.is_empty()
    }

    /// Delivers delayed requests that are due.
    pub(crate) fn pass(&mut self, now: Duration) {
        for place in 0..self.lines.len() {
            while let Some(first) =
                self.earliest(place).filter(|first| self.lines[place].flights[*first].due <= now)
            {
                let flight = self.lines[place].flights.remove(first);
                self.counts.arrived_late += u64::from(flight.asked.is_write());
                self.note(flight.due, Note::Arrived(place, flight.asked.brief()));
                if flight.asked.is_write() {
                    self.machine.laws.rests_on(place, flight.rests);
                }
                let answer = self.machine.answer(place, flight.asked, flight.due);
                let line = &mut self.lines[place];
                if line.connection == flight.connection && line.is_open {
                    let answer = answer.unwrap_or_else(|| denied(flight.asked, 2));
                    let coming = Coming {
                        at: flight.due,
                        bytes: line.framing.frame(flight.transaction, &answer),
                        asked_at: flight.asked_at,
                        asked: flight.asked,
                        content: Content::of(&answer),
                        answers: flight.asked,
                        seen_at: flight.due,
                        is_sound: true,
                    };
                    line.coming.push_back(coming);
                }
            }
        }
        while let Some(exchange) = self.other.asks_by(now, &mut self.random) {
            self.carries(exchange);
        }
    }

    /// Simulates an exchange of another master on the line of the module.
    fn carries(&mut self, exchange: OtherExchange) {
        let weather = self.weather(SENSORS, exchange.asked);
        let is_lost = match weather {
            Weather::Silent | Weather::Jammed | Weather::Unreachable => true,
            Weather::Lossy(share) => self.random.random_range(0..100u32) < share,
            _ => self.machine.is_without_module(exchange.asked),
        };
        let asked = second_master::QUESTION;
        let answer = self.machine.answer(SENSORS, asked, exchange.answered);
        let line = &mut self.lines[SENSORS];
        let Some(answer) = answer.filter(|_| !is_lost && line.is_open) else { return };
        let (asked_at, seen_at) = (exchange.asked, exchange.answered);
        for (content, at, message) in exchange.frames(answer) {
            let bytes = line.framing.frame([0; 2], &message);
            let (answers, is_sound) = (asked, true);
            line.coming.push_back(Coming { at, bytes, asked_at, asked, content, answers, seen_at, is_sound });
        }
    }

    fn earliest(&self, line: usize) -> Option<usize> {
        let flights = self.lines[line].flights.iter().enumerate();
        flights.min_by_key(|(_, flight)| flight.due).map(|(place, _)| place)
    }

    /// Kills the gateway. Its further actions have no effect.
    pub(crate) fn kill(&mut self) {
        self.is_killed = true;
        self.disk_is_dead.store(true, Ordering::Relaxed);
    }

    /// Removes the killed gateway and its connections. Delayed requests remain.
    pub(crate) fn bury(&mut self) {
        self.is_killed = false;
        self.disk_is_dead.store(false, Ordering::Relaxed);
        self.oldest_alive = self.newest + 1;
        self.lines.iter_mut().for_each(|line| line.is_open = false);
        self.other.loses_step();
    }

    /// Ends the connection on this line.
    pub(crate) fn cut(&mut self, line: usize) {
        self.lines[line].is_open = false;
    }

    /// Opens a connection; `None` if nothing accepts it.
    pub(crate) fn dial(&mut self, line: usize) -> Option<u64> {
        let now = self.passage.now();
        self.pass(now);
        let is_without = line == SENSORS && self.machine.is_without_module(now);
        let is_there = self.weather(line, now) != Weather::Unreachable && !is_without && !self.is_killed;
        self.note(now, Note::Dialled(line, is_there));
        if !is_there {
            return None;
        }
        self.newest += 1;
        self.machine.laws.connects(line);
        let line = &mut self.lines[line];
        (line.connection, line.is_open) = (self.newest, true);
        line.coming.clear();
        Some(self.newest)
    }

    fn weather(&mut self, line: usize, now: Duration) -> Weather {
        let line = &mut self.lines[line];
        if now >= line.until {
            line.weather = Weather::Fair;
        }
        line.weather
    }

    /// Returns whether nothing fails on this line, and the gateway need not wait on it.
    fn is_fair(&mut self, line: usize, now: Duration) -> bool {
        let has_fair_weather = self.weather(line, now) == Weather::Fair;
        has_fair_weather && self.lines[line].next.is_none() && now >= self.lines[line].waits_until
    }

    /// Records that a gateway may have to wait on this line until then, and for the maximum delay of a write after it.
    pub(crate) fn keeps_waiting(&mut self, line: usize, until: Duration) {
        let waits_until = &mut self.lines[line].waits_until;
        *waits_until = (*waits_until).max(until + LATE + 2 * SECOND);
    }

    fn fate(&mut self, line: usize, asked: Question, now: Duration) -> Fate {
        let weather = self.weather(line, now);
        if (asked.is_write() || [SENSORS, SCALE].contains(&line))
            && let Some(fate) = self.lines[line].next.take()
        {
            return fate;
        }
        let left = self.lines[line].until.saturating_sub(now);
        let percent = self.random.random_range(0..100u32);
        match weather {
            Weather::Fair | Weather::Unreachable if percent < 2 => {
                Fate::Slow(MILLI * self.random.random_range(1..20))
            }
            Weather::Fair | Weather::Unreachable => Fate::Done,
            Weather::Silent => Fate::Lost,
            Weather::Lossy(share) if percent < share && percent % 2 == 0 => Fate::AnswerLost,
            Weather::Lossy(share) if percent < share => Fate::Lost,
            // On a serial line, a reply that is later than four timeouts cannot be distinguished from the next one.
            Weather::Jammed if self.lines[line].framing.is_serial() => Fate::Lost,
            Weather::Jammed => Fate::Held(left),
            Weather::Slow(most) => Fate::Slow(most * percent / 100),
            Weather::Denying(share, code) if percent < share => Fate::DoneAndDenied(code),
            Weather::Garbling(share) if percent < share && percent % 3 == 0 => Fate::Garbled,
            Weather::Garbling(share) if percent < share => Fate::Corrupted(self.random.random_range(0..12)),
            Weather::Refusing(code) if asked.is_write() => Fate::Refused(code),
            Weather::Closing(share) if percent < share && percent % 2 == 0 => Fate::CutBefore,
            Weather::Closing(share) if percent < share => Fate::CutAfter,
            Weather::Shifting(share, code) if percent < share => {
                // A gateway that waits for late replies receives it within three further timeouts.
                Fate::Late(MILLI * self.random.random_range(10..540), code)
            }
            _ => Fate::Done,
        }
    }

    /// Simulates a request of the gateway on this connection.
    pub(crate) fn asks(&mut self, line: usize, connection: u64, frame: &[u8]) {
        if connection < self.oldest_alive || self.is_killed {
            return;
        }
        let now = self.passage.now();
        self.pass(now);
        self.lines[line].used_at = now;
        let framing = self.lines[line].framing;
        let asked = framing.message(frame).map_or(Question::Nonsense, |message| Question::of(&message));
        let transaction = framing.transaction(frame);
        let is_fair = self.is_fair(line, now);
        self.machine.laws.asks(line, now, is_fair);
        let fate = self.fate(line, asked, now);
        self.counts.exchanges += 1;
        self.counts.writes += u64::from(asked.is_write());
        self.counts.late_answers += u64::from(matches!(fate, Fate::Late(..)));
        self.note(now, Note::Asked(line, asked.brief(), fate));
        if line == SENSORS && self.machine.is_without_module(now) {
            self.lines[line].is_open = false;
            return;
        }
        let corrected = self.machine.laws.corrected;
        let wanted = self.machine.wanted(now);
        let rests = self.machine.laws.leaves(line, asked, wanted, now);
        if matches!(fate, Fate::Refused(_)) {
            // The readout still displays its last value.
            self.machine.laws.corrected = corrected;
        }
        let is_answered = match fate {
            Fate::Done => true,
            Fate::Slow(span) => span < self.lines[line].timeout,
            _ => false,
        };
        if asked.is_write() && !is_answered && [CNC, PLC].contains(&line) {
            self.keeps_waiting(line, now);
        }
        if let Fate::Held(span) = fate {
            let due = now + span.min(LATE);
            let flight = Flight { due, asked_at: now, connection, transaction, asked, rests };
            self.lines[line].flights.push(flight);
            return;
        }
        let is_done = !matches!(fate, Fate::Lost | Fate::Refused(_) | Fate::CutBefore | Fate::KilledBefore);
        let mut answer = denied(asked, 2);
        if is_done {
            if asked.is_write() {
                self.machine.laws.rests_on(line, rests);
            }
            answer = self.machine.answer(line, asked, now).unwrap_or(answer);
        }
        let (mut at, mut answers, mut seen_at) = (now, asked, now);
        if line == SENSORS
            && let Some(delay) = on_serial_side(fate)
        {
            // No reply: the Modbus gateway has given up silently.
            let Some(passed) = self.serial.pass(asked, answer, delay, now) else { return };
            (at, answer, (answers, seen_at)) = (passed.at, passed.message, passed.of);
            if answers != asked {
                let after = at.saturating_sub(now).subsec_millis();
                self.did(now, "the answer to another question comes after ms", u64::from(after));
            }
        }
        if framing.is_serial() {
            let meeting = self.other.meets(now, &mut self.random);
            meeting.exchange.into_iter().for_each(|exchange| self.carries(exchange));
            if meeting.is_destroyed {
                self.did(now, "another master's exchange destroys a question on line", line as u64);
                return;
            }
            at = meeting.from;
        }
        match fate {
            Fate::Slow(span) => at += span,
            Fate::DoneAndDenied(code) | Fate::Refused(code) => answer = denied(asked, code),
            Fate::Asleep(span) => self.passage.suspend(span.min(left_of_storm(now))),
            Fate::KilledBefore | Fate::KilledAfter => self.kill(),
            _ => {}
        }
        let content = Content::of(&answer);
        let mut bytes = framing.frame(transaction, &answer);
        match fate {
            Fate::Lost | Fate::AnswerLost | Fate::KilledBefore | Fate::KilledAfter => return,
            Fate::CutBefore | Fate::CutAfter => {
                self.lines[line].is_open = false;
                return;
            }
            Fate::Corrupted(place) => {
                let place = usize::from(place).min(8).min(bytes.len() - 1);
                bytes[place] ^= 0x55;
            }
            Fate::Garbled => bytes = vec![0x15, 0, 0, 0, 0],
            _ => {}
        }
        if self.lines[line].connection == connection {
            let is_sound = !matches!(fate, Fate::Corrupted(_) | Fate::Garbled);
            let coming = Coming { at, bytes, asked_at: now, asked, content, answers, seen_at, is_sound };
            self.lines[line].coming.push_back(coming);
            if framing.is_serial() {
                self.other.waits_for(at);
            }
        }
    }

    /// Returns what the gateway reads on this connection: bytes, the end, or the time of possible new data.
    pub(crate) fn hears(&mut self, line: usize, connection: u64) -> Heard {
        let now = self.passage.now();
        self.pass(now);
        let place = line;
        let line = &mut self.lines[line];
        if connection < self.oldest_alive || self.is_killed {
            return Heard::Nothing(None);
        }
        if connection != line.connection || !line.is_open {
            return Heard::End;
        }
        match line.coming.front() {
            Some(first) if first.at <= now => {
                let Some(coming) = line.coming.pop_front() else { return Heard::End };
                let is_in_time = now.saturating_sub(coming.asked_at) <= line.timeout + 2 * MILLI;
                // A late reply may be used for a repeated request. Its age counts from the first request.
                let is_serial = line.framing.is_serial();
                if coming.is_sound && is_serial {
                    let signs = &mut self.machine.laws.signs;
                    let is_foreign = signs.receives(coming.content, coming.answers, now);
                    self.counts.foreign_answers += u64::from(is_foreign);
                }
                if coming.is_sound && (is_in_time || is_serial) {
                    self.tell_laws(place, &coming, now);
                }
                Heard::Bytes(coming.bytes)
            }
            first => {
                let due = line
                    .flights
                    .iter()
                    .filter(|flight| flight.connection == connection)
                    .map(|flight| flight.due);
                let other = self.other.next_at().filter(|_| place == SENSORS);
                Heard::Nothing(first.map(|first| first.at).into_iter().chain(due).chain(other).min())
            }
        }
    }

    /// Passes a reply that the gateway accepts to the laws.
    fn tell_laws(&mut self, line: usize, coming: &Coming, now: Duration) {
        let Some(message) = self.lines[line].framing.message(&coming.bytes) else { return };
        let Question::Read { function, at, .. } = coming.asked else { return };
        // A reply to another request is not a value of this one.
        if message.first() != Some(&function) || message.len() < 4 || coming.answers != coming.asked {
            return;
        }
        let data = &message[2..];
        let is_of_other = self.machine.has_other_module(coming.seen_at);
        let is_set_otherwise = self.machine.has_other_settings(coming.seen_at);
        let asked_at = coming.asked_at.min(coming.seen_at);
        let laws = &mut self.machine.laws;
        let _ = (line == SENSORS).then(|| laws.panel.answers());
        match line {
            // A reading of another module does not count.
            SENSORS if function == 4 && !is_of_other => {
                for (channel, two) in (at..).map_while(channel).zip(data.chunks_exact(2)) {
                    match value(u16::from_be_bytes([two[0], two[1]])) {
                        OPEN => {}
                        _ if is_set_otherwise => laws.misread(channel, asked_at),
                        _ => laws.read(channel, asked_at),
                    }
                }
            }
            SENSORS if at == TYPE_CODE => {
                let is_expected = value(u16::from_be_bytes([data[0], data[1]])) == i64::from(EXPECTED);
                laws.checks(is_expected, coming.seen_at, now);
            }
            SCALE => {
                let position = data.iter().take(4).fold(0, |sum, byte| sum << 8 | i64::from(*byte));
                laws.saw_position(coming.asked_at, position);
            }
            _ if function == 3 => laws.shows(line, at, data, coming.seen_at, self.passage.awake()),
            _ => {}
        }
    }
}

/// Result of reading on a connection.
pub(crate) enum Heard {
    Bytes(Vec<u8>),
    End,
    /// Nothing yet, and the time of possible new data.
    Nothing(Option<Duration>),
}

/// Delay on the serial side for a request with this fate. `None` if the request does not reach it.
fn on_serial_side(fate: Fate) -> Option<Option<Delay>> {
    match fate {
        Fate::Done | Fate::Slow(_) => Some(None),
        Fate::Late(after, code) => Some(Some((PATIENCE + after, code))),
        _ => None,
    }
}

fn denied(asked: Question, code: u8) -> Vec<u8> {
    vec![asked.function() | 0x80, code]
}
