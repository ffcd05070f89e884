//! One physical line: at most one request under way, a timeout for each, a breaker for each device, reconnection.
//!
//! After a timeout or a wrong answer the connection is dropped: a reused one would stay one reply behind for ever.
//! On a line whose answers do not name their question (RTU) a new connection would not help, as the late answer may
//! arrive on it: there the unit, under whatever name the profile has it, is not asked again before its answer has had
//! [`GRACE`] timeouts more, and whatever came until then is discarded. An answer that is later still cannot be told from
//! the next one: the timeout must be at least a quarter of the longest that a device ever takes. Two misses in a row
//! open the port again, for an adapter that has lost itself.
//! A device that failed is left alone for a pause that doubles; while it rests, the others on the line are served, so
//! a dead unit costs them at most one timeout per pause. A line that cannot be connected rests in the same way.

use std::pin::pin;
use std::time::Duration;

use super::backoff::Backoff;
use super::error::{CallerFault, Fault, LinkFault};
use super::trace::Tap;
use super::wire::{Answer, Connection, Dial, Request};
use crate::clock::{Patience, Silence};
use crate::profile::{Bus, Device, DeviceId, Functions, Quirks};
use crate::quantity::Moment;

/// How many timeouts a late answer is given, beyond the first, before its unit is asked again.
pub const GRACE: u32 = 3;
/// Misses in a row after which a line without transactions is opened again.
const MISSES: u32 = 2;
/// A connection that lives for less than this, after it has brought answers, was taken away by somebody.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// Short lives in a row after which we give way: a device that accepts one client drops the first for the second, and
/// two masters that both come back at once would keep each other from working for ever.
const SHORT_LIVES: u32 = 3;
/// The first pause after a failure.
const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// The owner of a line: nobody else speaks on it.
pub struct Line {
    dial: Box<dyn Dial>,
    wire: Option<Connection>,
    patience: Patience,
    timeout: Duration,
    pause_after_connect: Duration,
    redial: Backoff,
    refused: Fault,
    units: Vec<Unit>,
    spoke: bool,
    misses: u32,
    /// Closed by us after an answer.
    is_put_down: bool,
    tap: Tap,
    /// Since when there is a connection.
    connected_at: Moment,
    /// It has brought an answer.
    has_answered: bool,
    /// Connections in a row that were taken away soon.
    short_lives: u32,
    /// How long we give way.
    yielding: Backoff,
}

/// One device on the line.
#[derive(Debug)]
struct Unit {
    device: DeviceId,
    number: u8,
    functions: Functions,
    quirks: Quirks,
    breaker: Backoff,
    last_fault: Fault,
    /// Since when it may owe an answer that could be taken for another; `None` when that is over.
    owes: Option<Silence>,
}

impl Line {
    /// A line that has not been connected yet, for these devices of a profile.
    pub fn new(bus: &Bus, devices: &[(DeviceId, &Device)], dial: Box<dyn Dial>) -> Line {
        let pauses = devices.iter().map(|(_, device)| device.quirks.pause_after_connect);
        let pause_after_connect = pauses.fold(bus.quirks.pause_after_connect, Duration::max);
        let units = devices
            .iter()
            .map(|(id, device)| Unit {
                device: *id,
                number: device.unit,
                functions: device.functions,
                quirks: device.quirks,
                breaker: Backoff::new(FIRST_PAUSE, seed(&device.name)),
                last_fault: Fault::Link(LinkFault::Down),
                // Its answer to a gateway that ended a moment ago may be under way.
                owes: Some(Silence::begin()),
            })
            .collect();
        Line {
            dial,
            wire: None,
            patience: Patience::new(),
            timeout: bus.timeout,
            pause_after_connect,
            redial: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            refused: Fault::Link(LinkFault::Down),
            units,
            spoke: false,
            misses: 0,
            is_put_down: false,
            tap: Tap::default(),
            connected_at: Moment::default(),
            has_answered: false,
            short_lives: 0,
            yielding: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
        }
    }

    /// The same line, listened to at this tap.
    pub fn tapped(mut self, tap: &Tap) -> Line {
        self.dial.tap(tap);
        self.tap = tap.clone();
        self
    }

    /// There is a connection.
    pub fn is_connected(&self) -> bool {
        self.wire.is_some() || self.is_put_down
    }

    /// What this device is, or the line without one, begins anew: whatever rests there need rest no longer.
    pub fn revive(&mut self, device: Option<DeviceId>) {
        for unit in self.units.iter_mut().filter(|unit| device.is_none_or(|one| one == unit.device)) {
            unit.breaker.succeed();
        }
        if device.is_none() {
            self.redial.succeed();
        }
    }

    /// Attempts to connect that failed since the last one that succeeded, and the last fault.
    pub fn refusals(&self) -> (u32, Fault) {
        (self.redial.failures(), self.refused)
    }

    /// Whether this device is left alone now, after a failure.
    pub fn is_resting(&self, device: DeviceId, now: Moment) -> bool {
        self.units.iter().any(|unit| unit.device == device && !unit.breaker.allows(now))
    }

    /// Asks a device and waits for its answer, at most for the line's timeout (twice, where it must connect first).
    ///
    /// # Errors
    /// Every request fails here and nowhere else: see [`Fault`]. A resting device fails at once, with its last fault.
    pub async fn call(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        now: Moment,
    ) -> Result<Answer, Fault> {
        let Some(place) = self.units.iter().position(|unit| unit.device == device) else {
            return Err(Fault::Caller(CallerFault::Extent));
        };
        let unit = &self.units[place];
        if !unit.functions.allow(request.function()) {
            return Err(Fault::Caller(CallerFault::Function));
        }
        if !request.fits() {
            return Err(Fault::Caller(CallerFault::Extent));
        }
        if !unit.breaker.allows(now) {
            return Err(unit.last_fault);
        }
        let was_connected = self.wire.is_some();
        let mut answer = self.exchange(place, request, now).await;
        let fault = answer.as_ref().err().copied();
        let is_closed = fault == Some(Fault::Link(LinkFault::Closed));
        if was_connected && (is_closed || fault == Some(BROKEN)) {
            // Some gateways close a connection that was idle for a while: that is no reason to lose a reading. A write
            // is not repeated, unless nothing was sent; but where nobody listens any more, that is what is wrong.
            let is_told_apart = self.wire.as_mut().is_some_and(|wire| wire.wire().names_its_question());
            self.wire = None;
            if is_told_apart && self.is_contested(now) {
                return Err(Fault::Link(LinkFault::Contested));
            }
            if is_closed || (request.is_read() && is_told_apart) {
                answer = self.exchange(place, request, now).await;
            } else {
                self.connect(now).await?;
                if !is_told_apart {
                    self.rest(place, BROKEN, now);
                }
                return answer;
            }
        }
        let Some(connection) = &mut self.wire else { return answer };
        match &answer {
            Err(fault) if fault.spoils_connection() => {
                let is_told_apart = connection.wire().names_its_question();
                self.misses += 1;
                if is_told_apart || self.misses >= MISSES || matches!(fault, Fault::Link(_)) {
                    self.wire = None;
                    self.misses = 0;
                }
                if is_told_apart {
                    // The pause begins when the timeout is over, else several dead units would have none left.
                    let waited = if *fault == Fault::Timeout { self.timeout } else { Duration::ZERO };
                    self.units[place].breaker.fail(now.after(waited));
                    self.units[place].last_fault = *fault;
                } else {
                    self.rest(place, *fault, now);
                }
            }
            _ => {
                self.misses = 0;
                let unit = &mut self.units[place];
                unit.breaker.succeed();
                if unit.quirks.close_after_each {
                    self.wire = None;
                    self.is_put_down = true;
                }
            }
        }
        answer
    }

    /// The connection was closed by the other end: whether that happens too often to come back at once.
    fn is_contested(&mut self, now: Moment) -> bool {
        if now.since(self.connected_at) >= SHORT_LIFE {
            self.short_lives = 0;
            self.yielding.succeed();
            return false;
        }
        self.short_lives += 1;
        let is_contested = self.short_lives >= SHORT_LIVES;
        if is_contested {
            self.yielding.fail(now);
        }
        is_contested
    }

    /// A unit whose answer may still come, and would not say what it answers, is left alone for as long as that takes:
    /// by each of the devices that are this unit.
    fn rest(&mut self, place: usize, fault: Fault, now: Moment) {
        let quiet = now.after(self.timeout * (1 + GRACE));
        self.units[place].breaker.fail(now.after(self.timeout));
        let number = self.units[place].number;
        for unit in self.units.iter_mut().filter(|unit| unit.number == number) {
            unit.owes = Some(Silence::begin());
            unit.breaker.not_before_either(quiet);
            unit.last_fault = fault;
        }
    }

    /// Puts the question, and shows what came of it to whoever listens.
    async fn exchange(&mut self, place: usize, request: Request<'_>, now: Moment) -> Result<Answer, Fault> {
        let begun = self.tap.begin();
        let answer = self.ask(place, request, now).await;
        if let Some(begun) = begun {
            let unit = &self.units[place];
            self.tap.tell(begun, (unit.device, unit.number), request, &answer);
        }
        answer
    }

    async fn ask(&mut self, place: usize, request: Request<'_>, now: Moment) -> Result<Answer, Fault> {
        if self.wire.is_none() {
            self.connect(now).await?;
        }
        let unit = &mut self.units[place];
        let Some(connection) = &mut self.wire else { return Err(Fault::Link(LinkFault::Down)) };
        if let Some(quiet) = unit.owes {
            let owed = quiet.left_of(self.timeout * GRACE);
            if !owed.is_zero() {
                connection.wire().listen(owed).await?;
            }
            unit.owes = None;
        }
        let pause = unit.quirks.pause_between_requests;
        if self.spoke && !pause.is_zero() {
            tokio::time::sleep(pause).await;
        }
        self.spoke = true;
        let span = self.timeout + connection.time_under_way(request);
        let answer = {
            // Pinned here, it need not be moved.
            let call = pin!(connection.call(unit.number, request));
            self.patience.within(span, call).await
        };
        let answer = answer.unwrap_or_else(|| Err(connection.wire().missed()));
        if !self.has_answered && answer == Err(BROKEN) && connection.wire().names_its_question() {
            return Err(self.dial.turned_away());
        }
        self.has_answered = true;
        answer
    }

    async fn connect(&mut self, now: Moment) -> Result<(), Fault> {
        if !self.yielding.allows(now) {
            return Err(Fault::Link(LinkFault::Contested));
        }
        if !self.redial.allows(now) {
            return Err(Fault::Link(LinkFault::Down));
        }
        let span = self.timeout + self.dial.takes();
        let dialled = self.patience.within(span, self.dial.dial()).await;
        match dialled.unwrap_or(Err(Fault::Link(LinkFault::Unreachable))) {
            Ok(wire) => {
                if !self.pause_after_connect.is_zero() {
                    tokio::time::sleep(self.pause_after_connect).await;
                }
                self.wire = Some(wire);
                self.spoke = self.is_put_down;
                self.is_put_down = false;
                (self.connected_at, self.has_answered) = (now, false);
                self.redial.succeed();
                Ok(())
            }
            Err(fault) => {
                self.is_put_down = false;
                self.redial.fail(now);
                self.refused = fault;
                Err(fault)
            }
        }
    }
}

impl Functions {
    /// Whether this function code may be sent; 0 is none, which CAN has none of.
    pub const fn allow(&self, function: u8) -> bool {
        match function {
            0 => true,
            1 => self.read_coils,
            2 => self.read_discrete,
            3 => self.read_holding,
            4 => self.read_input,
            5 => self.write_coil,
            6 => self.write_single,
            15 => self.write_coils,
            16 => self.write_multiple,
            _ => false,
        }
    }
}

const BROKEN: Fault = Fault::Link(LinkFault::Broken);

/// Different names rest for different times; the same name always for the same.
fn seed(name: &str) -> u64 {
    name.bytes().fold(14_695_981_039_346_656_037, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(1_099_511_628_211)
    })
}

#[cfg(test)]
mod tests;
