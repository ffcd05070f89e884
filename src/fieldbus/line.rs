//! One physical line: at most one request under way, a timeout for each, a breaker for each device, reconnection.
//!
//! After a timeout or a wrong answer the connection is dropped: a reused one would stay one reply behind for ever.
//! A device that failed is left alone for a pause that doubles; while it rests, the others on the line are served, so
//! a dead unit costs them at most one timeout per pause. A line that cannot be connected rests in the same way.

use std::time::Duration;

use super::backoff::Backoff;
use super::error::{CallerFault, Fault, LinkFault};
use super::wire::{Answer, Connection, Dial, Request};
use crate::clock::Patience;
use crate::profile::{Bus, Device, DeviceId, Functions};
use crate::quantity::Moment;

/// The first pause after a failure.
const FIRST_PAUSE: Duration = Duration::from_secs(1);

/// The owner of a line: nobody else speaks on it.
pub struct Line {
    dial: Box<dyn Dial>,
    wire: Option<Connection>,
    patience: Patience,
    timeout: Duration,
    redial: Backoff,
    refused: Fault,
    units: Vec<Unit>,
    spoke: bool,
}

/// One device on the line.
#[derive(Debug)]
struct Unit {
    device: DeviceId,
    number: u8,
    functions: Functions,
    pause_between_requests: Duration,
    breaker: Backoff,
    last_fault: Fault,
}

impl Line {
    /// A line that has not been connected yet, for these devices of a profile.
    pub fn new(bus: &Bus, devices: &[(DeviceId, &Device)], dial: Box<dyn Dial>) -> Line {
        let units = devices
            .iter()
            .map(|(id, device)| Unit {
                device: *id,
                number: device.unit,
                functions: device.functions,
                pause_between_requests: device.quirks.pause_between_requests,
                breaker: Backoff::new(FIRST_PAUSE, seed(&device.name)),
                last_fault: Fault::Link(LinkFault::Down),
            })
            .collect();
        Line {
            dial,
            wire: None,
            patience: Patience::new(),
            timeout: bus.timeout,
            redial: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            refused: Fault::Link(LinkFault::Down),
            units,
            spoke: false,
        }
    }

    /// There is a connection.
    pub fn is_connected(&self) -> bool {
        self.wire.is_some()
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
        let (number, pause) = (unit.number, unit.pause_between_requests);
        let was_connected = self.is_connected();
        let mut answer = self.exchange(number, pause, request, now).await;
        if was_connected && answer == Err(Fault::Link(LinkFault::Broken)) {
            // Some gateways close a connection that was idle for a while: that is no reason to lose a reading. A write
            // is not repeated; but where nobody listens any more, that is what is wrong.
            self.wire = None;
            if request.is_read() {
                answer = self.exchange(number, pause, request, now).await;
            } else {
                self.connect(now).await?;
                return answer;
            }
        }
        if self.wire.is_none() {
            return answer;
        }
        let unit = &mut self.units[place];
        match &answer {
            Err(fault) if fault.spoils_connection() => {
                self.wire = None;
                // The pause begins when the timeout is over, else several dead units would have none left.
                let waited = if *fault == Fault::Timeout { self.timeout } else { Duration::ZERO };
                unit.breaker.fail(now.after(waited));
                unit.last_fault = *fault;
            }
            _ => unit.breaker.succeed(),
        }
        answer
    }

    async fn exchange(
        &mut self,
        unit: u8,
        pause: Duration,
        request: Request<'_>,
        now: Moment,
    ) -> Result<Answer, Fault> {
        self.connect(now).await?;
        let Some(wire) = &mut self.wire else { return Err(Fault::Link(LinkFault::Down)) };
        if self.spoke && !pause.is_zero() {
            tokio::time::sleep(pause).await;
        }
        self.spoke = true;
        let answer = self.patience.within(self.timeout, wire.call(unit, request)).await;
        answer.unwrap_or(Err(Fault::Timeout))
    }

    async fn connect(&mut self, now: Moment) -> Result<(), Fault> {
        if self.wire.is_some() {
            return Ok(());
        }
        if !self.redial.allows(now) {
            return Err(Fault::Link(LinkFault::Down));
        }
        let dialled = self.patience.within(self.timeout, self.dial.dial()).await;
        match dialled.unwrap_or(Err(Fault::Link(LinkFault::Unreachable))) {
            Ok(wire) => {
                self.wire = Some(wire);
                self.spoke = false;
                self.redial.succeed();
                Ok(())
            }
            Err(fault) => {
                self.redial.fail(now);
                self.refused = fault;
                Err(fault)
            }
        }
    }
}

impl Functions {
    /// Whether this function code may be sent.
    pub const fn allow(&self, function: u8) -> bool {
        match function {
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

/// Different names rest for different times; the same name always for the same.
fn seed(name: &str) -> u64 {
    name.bytes().fold(14_695_981_039_346_656_037, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(1_099_511_628_211)
    })
}

#[cfg(test)]
mod tests;
