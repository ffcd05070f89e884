//! One physical line. The line sends one request at a time, with a timeout and a send deadline, and connects again
//! after a failure. Each device has its own back-off. [`DeviceLine::request`] is the only way to send a request to a
//! device, over Modbus, CAN or OPC UA.
//!
//! ```text
//! request ─► ready: connected, quiet, paused ─► exchange: clock sample, request, answer ─► checked
//!    │                                                                                        │
//!    └──── back-off, retry, reconnection, report to the observer ◄────────────────────────────┘
//! ```
//!
//! The age of an answer counts from the time at which its request was sent. An answer that arrives after its timeout is
//! discarded.
//!
//! After a wrong answer the line drops the connection. Otherwise every later request on the connection could
//! get the answer to the request before. After a timeout over TCP the line keeps the connection: a late
//! answer has the transaction number of its request, and is discarded. The line drops the connection after
//! several timeouts in a row. If a Modbus gateway has returned a wrong transaction number before, the line
//! drops the connection after each timeout, see `line/settle.rs`.
//!
//! On RTU, answers have no transaction number. A new connection does not help, because a late answer may also
//! arrive on the new connection. The line therefore sends no request to the unit until [`GRACE`] further
//! timeouts have passed. This applies to all devices of the profile with this unit number. Input that arrives
//! until then is discarded. For a unit that is known to answer promptly, the line waits less, see
//! [`super::kinds::modbus::pending_replies`].
//!
//! An answer that arrives even later cannot be distinguished from the answer to the next request. The timeout
//! must therefore be at least a quarter of the longest answer time of a device. After two timeouts in a row
//! the line opens the port again, because an adapter may hang. For a unit behind a Modbus gateway (from TCP
//! to a serial line), the line waits in the same way, see `line/late_replies.rs`. The line also checks that
//! the answers of such a unit are in order, see `line/control.rs`.
//!
//! A device that failed gets no request during a pause that doubles with each failure. During the pause the
//! line serves its other devices. A dead unit therefore delays the other devices by at most one timeout per
//! pause. A dead unit behind a Modbus gateway may delay them by the longer timeout of the Modbus gateway, see
//! `line/gateway_turns.rs`. A line that cannot connect backs off in the same way. `line/retry.rs` decides
//! which requests are repeated.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use super::backoff::Backoff;
use super::connection::{Connection, Dial};
use super::error::{CallerFault, Fault, LinkFault, PeerFault};
use super::kinds::modbus::pending_replies::{PendingReplies, Spans};
use super::kinds::modbus::pipeline::Pipeline;
use super::kinds::modbus::reply_signature::ReplySignature;
use super::send_guard::{SendDeadline, SendGuard};
use super::trace::Tap;
use super::wire::{Answer, Request};
use crate::clock::{Clock, WallTimeout};
use closing_habit::ClosingHabit;
use continuity::Evidence;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, Device, DeviceId};
use modbus_gateway::ModbusGateway;
use other_masters::OtherMasters;
use units::{FIRST_PAUSE, Units};

mod closing_habit;
mod connecting;
mod continuity;
mod control;
mod gateway_turns;
mod late_replies;
mod modbus_gateway;
mod other_masters;
mod request_observer;
mod retry;
mod settle;
mod units;

pub use modbus_gateway::LONGEST_GATEWAY_WAIT;
pub use request_observer::RequestObserver;

/// Time after a timeout during which a late answer may still arrive, in multiples of the timeout. The unit
/// gets no request until this time has passed.
pub const GRACE: u32 = 3;
/// Number of timeouts in a row after which the line opens the port again, if answers have no transaction number. With
/// transaction numbers, a line with several units allows more timeouts.
const MISSES: u32 = 2;

/// Limit below which an idle time of the line counts as short. If many tasks wait for the clock, the line
/// moves the timer of its timeout during a short idle time, instead of replacing the timer. This takes less
/// processor time. The old deadline may wake the computer once more, but the other tasks wake the computer in
/// any case.
const SHORT_REST: Duration = Duration::from_millis(250);

/// One physical bus line. Only the task that owns this value sends requests on the line.
pub struct DeviceLine {
    dial: Box<dyn Dial>,
    /// Clock samples, and the deadline for sending the present request.
    pub send_guard: SendGuard,
    observer: Option<Arc<dyn RequestObserver>>,
    wire: Option<Connection>,
    patience: WallTimeout,
    timeout: Duration,
    pause_after_connect: Duration,
    redial: Backoff,
    refused: Fault,
    units: Units,
    /// Whether the transport has no transaction numbers, so that an answer does not show to which request it belongs.
    is_nameless: bool,
    pipeline: Pipeline,
    /// Duration of the last exchange, from the request to the end of its answer.
    took: Duration,
    misses: u32,
    /// Whether the gateway closed the connection after an answer, because the device accepts only one client at a time.
    is_put_down: bool,
    tap: Tap,
    history: ConnectionHistory,
    /// Number of connections in a row that the other end closed soon after they were opened.
    short_lives: u32,
    /// Back-off that leaves the only connection of a device to another client for a time, if two clients seem to
    /// compete for this connection.
    yielding: Backoff,
    evidence: Evidence,
    others: OtherMasters,
    after_timeout: AfterTimeout,
    /// State of the Modbus gateway (from TCP to a serial line) in front of the units, if there is one.
    gateway: ModbusGateway,
    closing_habit: ClosingHabit,
    /// Whether a device loses the first request of each connection (`quirks.loses_first_request`).
    loses_first_request: bool,
    /// Number of connections that the line has opened so far. The number shows whether a connection was replaced.
    connections: u64,
}

/// Treatment of a connection after a timeout, if the line can recognise and discard late answers on this connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AfterTimeout {
    /// The line keeps the connection, and discards the late answer.
    Keep,
    /// The line drops the connection. Most of the units may not exist, so the line never waits for a Modbus gateway.
    Renew,
}

/// Record of the requests on the present connection.
#[derive(Clone, Copy, Debug, Default)]
struct ConnectionHistory {
    /// Time at which the connection was opened.
    opened_at: Moment,
    /// Whether the next request must wait for the pause of its unit, because another request was sent before.
    needs_pause: bool,
    /// Whether at least one request on this connection was completed.
    has_answered: bool,
    /// Whether the first request, which the device may lose, was sent on the connection.
    is_opened: bool,
    /// Number of complete answers on the connection.
    answers: u32,
}

/// Answer that was checked against its request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedAnswer {
    /// Content of the answer.
    pub answer: Answer,
    /// Time at which the request was sent. The age of the answer counts from here.
    pub asked: Moment,
    /// Whether the answer may be an answer to another master.
    pub attribution: Attribution,
}

/// Assignment of an answer to the gateway or to another master on the line, as far as the frame shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribution {
    /// The answer belongs to the gateway's request.
    Ours,
    /// The answer belongs to the gateway or to another master, because that master requests the same function and
    /// length from the same unit.
    Ambiguous,
    /// A second answer of the same unit, function and length followed. Either of the two answers may be the answer to
    /// the gateway.
    Contested,
}

impl DeviceLine {
    /// Returns a line for these devices of a profile. The line is not connected yet.
    pub fn new(bus: &Bus, devices: &[(DeviceId, &Device)], dial: Box<dyn Dial>, clock: &Clock) -> DeviceLine {
        let pauses = devices.iter().map(|(_, device)| device.quirks.pause_after_connect);
        let pause_after_connect = pauses.fold(bus.quirks.pause_after_connect, Duration::max);
        let mut quirks = devices.iter().map(|(_, device)| &device.quirks).chain([&bus.quirks]);
        DeviceLine {
            dial,
            send_guard: SendGuard::without_deadline(clock),
            observer: None,
            wire: None,
            patience: WallTimeout::by(clock),
            timeout: bus.timeout,
            pause_after_connect,
            redial: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            refused: Fault::Link(LinkFault::Down),
            units: Units::of(bus.transport, devices),
            is_nameless: false,
            pipeline: Pipeline::new(
                bus.pipeline > 1 && devices.iter().all(|(_, device)| device.quirks.support_two()),
            ),
            took: Duration::ZERO,
            misses: 0,
            is_put_down: false,
            tap: Tap::default(),
            history: ConnectionHistory::default(),
            short_lives: 0,
            yielding: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            evidence: Evidence::default(),
            others: OtherMasters::default(),
            after_timeout: AfterTimeout::Keep,
            gateway: ModbusGateway::default(),
            closing_habit: ClosingHabit::default(),
            loses_first_request: quirks.any(|quirks| quirks.loses_first_request),
            connections: 0,
        }
    }

    /// Sets the tap: the recorder that copies the frames of the line to a log.
    pub fn tapped(mut self, tap: &Tap) -> DeviceLine {
        self.tap = tap.clone();
        self
    }

    /// Sets the observer, which gets the result of each request.
    pub fn witnessed(mut self, observer: Arc<dyn RequestObserver>) -> DeviceLine {
        self.observer = Some(observer);
        self
    }

    /// Sets the age at which readings are too old to be used. If two clock samples are further apart than this age, the
    /// computer counts as stopped in between.
    pub fn aged(mut self, max_age: Duration) -> DeviceLine {
        self.send_guard = self.send_guard.aged(max_age);
        self
    }

    /// Sets the age at which the readings of each device are too old. A dead unit behind a Modbus gateway gets a
    /// request only if the readings of the other units do not become too old meanwhile.
    pub fn with_ages(mut self, max_age_of: impl Fn(DeviceId) -> Duration) -> DeviceLine {
        self.units.set_ages(max_age_of);
        self
    }

    /// Makes the line drop the connection after each timeout, and never wait for a Modbus gateway. A scan uses this
    /// setting, because most units to which a scan sends requests do not exist.
    pub fn renewed_after_timeouts(mut self) -> DeviceLine {
        self.after_timeout = AfterTimeout::Renew;
        self
    }

    /// Makes the line keep the connection after a timeout again. Reverses [`DeviceLine::renewed_after_timeouts`].
    pub fn kept_after_timeouts(mut self) -> DeviceLine {
        self.after_timeout = AfterTimeout::Keep;
        self
    }

    /// Switches off the rule that the age of an answer counts from its request. Tests use this to show why the rule is
    /// necessary.
    #[doc(hidden)]
    pub fn unchecked(mut self) -> DeviceLine {
        self.send_guard = self.send_guard.unchecked();
        self
    }

    /// Samples the clock, and returns the time. The line uses this time until the next sample.
    pub fn sample(&mut self) -> Moment {
        self.send_guard.sample()
    }

    /// Announces that the line gets no request for the time `span`. The gap between two clock samples then does not
    /// count as a stop of the computer.
    pub fn idle_for(&mut self, span: Duration) {
        self.send_guard.away_for(span);
        if span < SHORT_REST && self.send_guard.is_busy() {
            self.patience.move_by(span + self.timeout);
        } else {
            self.patience.put_off(span + self.timeout);
        }
    }

    /// Returns the time of the last clock sample.
    pub fn last_sample(&self) -> Moment {
        self.send_guard.last_sample()
    }

    /// Returns whether the line has a connection. A connection that the gateway itself closed after an answer also
    /// counts.
    pub fn is_connected(&self) -> bool {
        self.wire.is_some() || self.is_put_down
    }

    /// Ends the back-off of a device, so that the device can get a request at once. `None` ends the back-off of the
    /// line and of all its devices.
    pub fn revive(&mut self, device: Option<DeviceId>) {
        self.units.revive(device);
        if device.is_none() {
            self.redial.succeed();
            self.yielding.succeed();
        }
    }

    /// Returns the number of failed attempts to connect since the last success, and the fault of the last failed
    /// attempt.
    pub fn refusals(&self) -> (u32, Fault) {
        (self.redial.failures(), self.refused)
    }

    /// Returns whether this device backs off after a failure, or is dead and gets no request now.
    pub fn is_backing_off(&self, device: DeviceId, now: Moment) -> bool {
        self.units.place(device).is_some_and(|place| !self.may_try(place, now))
    }

    /// Returns the expected end of an exchange (request and answer) that begins now. Reads that are due by then may be
    /// sent together with the request. Returns `None` if the line sends one request at a time.
    pub fn follow_up_until(&self, now: Moment) -> Option<Moment> {
        self.pipeline.is_on().then(|| now.after(self.took))
    }

    /// Sets the read that is sent directly after the next request, if that request finds an open connection. A later
    /// request for the same read returns its answer. `None`: no read is sent.
    pub fn set_follow_up(&mut self, read: Option<(DeviceId, Request<'static>)>) {
        let now = self.send_guard.last_sample();
        let allowed = |device: DeviceId, request: Request<'_>| {
            let place = self.units.place(device)?;
            let unit = self.units.at(place);
            let is_to_wait = |pending: &PendingReplies| {
                pending.has_pending() || pending.order.control(request, |_| true).is_some()
            };
            let is_to_wait = self.units.pending.get(unit.number).is_some_and(is_to_wait)
                || self.gateway.occupied().is_some();
            let must_wait = (unit.is_behind_gateway && is_to_wait) || !self.may_try(place, now);
            (unit.functions.allow(request.function()) && !must_wait).then_some(unit.number)
        };
        let read = read.and_then(|(device, request)| Some((allowed(device, request)?, request)));
        self.pipeline.ask(read);
    }

    fn spans(&self) -> Spans {
        Spans { timeout: self.timeout, grace: self.timeout * GRACE }
    }

    /// Sends a request to a device, and waits for its answer for at most the timeout of the line. Connecting may take
    /// the same time again, and so may a control question (extra read, see `line/control.rs`). Immediately before the
    /// first byte is sent, the line checks the deadline `leave`.
    ///
    /// # Errors
    /// See [`Fault`]; [`Fault::outcome`] tells whether a failed write was executed. While a device backs off, the call
    /// fails at once with the device's last fault. A device whose checks have not passed gets no request.
    pub async fn request(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        leave: SendDeadline,
    ) -> Result<CheckedAnswer, Fault> {
        self.ask(device, request, leave, false).await
    }

    /// Sends a request to a device even if its checks (comparisons with expected values, key `verify`) have not passed.
    /// The checks themselves use this function. Polls also use this function, and discard their readings until the
    /// checks have passed.
    ///
    /// # Errors
    /// Same as for [`DeviceLine::request`].
    pub async fn request_unverified(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
    ) -> Result<CheckedAnswer, Fault> {
        self.ask(device, request, SendDeadline::None, true).await
    }

    async fn ask(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        leave: SendDeadline,
        may_be_unverified: bool,
    ) -> Result<CheckedAnswer, Fault> {
        let Some(place) = self.units.place(device) else {
            return Err(Fault::Caller(CallerFault::Extent));
        };
        let unit = self.units.at(place);
        if !unit.functions.allow(request.function()) {
            return Err(Fault::Caller(CallerFault::Function));
        }
        if !request.fits() {
            return Err(Fault::Caller(CallerFault::Extent));
        }
        let mut now = self.send_guard.sample();
        if !self.may_try(place, now) {
            return Err(unit.last_fault);
        }
        if matches!(leave, SendDeadline::OnConnection(_)) && !self.is_connected() {
            return Err(Fault::CLOSED);
        }
        if !may_be_unverified && self.is_unverified(place) {
            return Err(Fault::UNVERIFIED);
        }
        let (number, is_behind_gateway) =
            (self.units.at(place).number, self.units.at(place).is_behind_gateway);
        // Exception 10 or 11 of a Modbus gateway: the unit itself may still answer late.
        let is_missing = |fault: Fault| is_behind_gateway && fault.is_of_a_gateway();
        let not_before =
            self.units.pending.get(number).and_then(|pending| pending.not_before(request, self.spans()));
        if not_before.is_some_and(|moment| now < moment) {
            let last_fault = self.units.at(place).last_fault;
            return Err(if request.is_read() { last_fault } else { Fault::Caller(CallerFault::Owed) });
        }
        let mut was_connected = self.wire.is_some();
        let mut first_asked = None;
        let mut is_contested = false;
        // Whether a control question was answered or refused. It is asked once.
        let mut is_controlled = false;
        // The request that was sent last is a control question, or `request` itself.
        let (sent, answer) = loop {
            let (mut are_two, mut is_second, mut may_keep) = (false, false, true);
            let begun = self.tap.begin();
            let before = self.wire.is_some().then_some(self.connections);
            let mut answer = self.make_ready(place, request, now).await;
            self.send_guard.next(request, leave);
            if matches!(leave, SendDeadline::OnConnection(_))
                && before.is_some_and(|it| it != self.connections)
            {
                return Err(Fault::CLOSED);
            }
            if answer.is_ok() && !may_be_unverified && self.is_unverified(place) {
                break (request, Err(Fault::UNVERIFIED));
            }
            let control = self.control_question(place, request).filter(|_| answer.is_ok() && !is_controlled);
            let sent = control.unwrap_or(request);
            let patience = self.patience_for(place);
            if answer.is_ok()
                && let Some(connection) = &mut self.wire
            {
                if self.pipeline.is_on()
                    && let Some(modbus) = connection.modbus()
                {
                    // Either this request was already sent after the one before, or another read is sent after this
                    // one.
                    is_second = modbus.has_follow_up();
                    // Two requests whose answers a Modbus gateway could confuse are not sent together.
                    let is_like_it = |(unit, read): &(u8, Request<'_>)| {
                        is_behind_gateway
                            && *unit == number
                            && ReplySignature::of(*read) == ReplySignature::of(request)
                    };
                    let read = self.pipeline.take().filter(|read| control.is_none() && !is_like_it(read));
                    modbus.set_follow_up(read);
                    are_two = is_second || modbus.has_follow_up();
                }
                let span = self.timeout + connection.wire().time_under_way(sent) + patience;
                self.send_guard.begins(span);
                let exchanged = {
                    // A future that is pinned here need not be moved.
                    let exchange = pin!(connection.exchange(number, sent, &mut self.send_guard));
                    self.patience.within(span, exchange).await
                };
                let took = self.send_guard.took();
                self.took = took;
                for late in connection.modbus().into_iter().flat_map(|modbus| modbus.received_late()) {
                    self.units.pending.of(late).reset_timing();
                }
                if let Some(asked) = self.send_guard.asked() {
                    self.units.at_mut(place).tried = asked;
                }
                let pending = self.units.pending.of(number);
                first_asked = pending.first_asked(sent);
                let may_be_late = pending.has_pending();
                // The answer may belong to the first attempt. The answer to the second one may then still arrive.
                may_keep = exchanged.is_none() || first_asked.is_none() || pending.is_likely_after(took);
                answer = match exchanged {
                    // An answer that is found after its timeout is late, even if the timer has not fired yet.
                    Some(answer)
                        if answer
                            .as_ref()
                            .err()
                            .is_none_or(|fault| fault.is_refusal() && !is_missing(*fault))
                            && (took > span || (first_asked.is_some() && !pending.is_likely_after(took))) =>
                    {
                        Err(connection.wire().missed())
                    }
                    Some(answer) => answer,
                    None => Err(connection.wire().missed()),
                };
                if is_behind_gateway && self.send_guard.asked().is_some() {
                    let outcome = answer.as_ref().map(|_| ()).map_err(|fault| *fault);
                    let received = connection.modbus().and_then(|modbus| modbus.received_form());
                    if pending.order.assess(sent, outcome, received, may_be_late) {
                        answer = Err(Fault::Peer(PeerFault::OutOfOrder));
                    }
                }
                match answer {
                    Err(fault) if is_missing(fault) => {}
                    // The answer to a control question shows nothing about the read that waits for it. Time beyond
                    // the timeout was spent on waiting for the Modbus gateway.
                    Ok(_) | Err(Fault::Exception(_)) if control.is_none() => {
                        pending.answers(sent, took.min(span - patience));
                    }
                    _ => {}
                }
                self.note_gateway(place, &answer, may_be_late, took + patience > span);
            }
            if let Some(begun) = begun {
                self.tap.tell(begun, (device, number), sent, &answer);
            }
            if are_two
                && self.pipeline.assess(is_second, &answer)
                && let (Some(observer), Err(fault)) = (&self.observer, &answer)
            {
                observer.gives_up_pipeline(*fault);
            }
            if let (Some(observer), Some(connection)) = (&self.observer, &mut self.wire)
                && let Some(what) = connection.wire().news()
            {
                observer.subscribes(device, what);
            }
            self.note_others(now);
            let is_repeated = first_asked.is_some();
            is_contested =
                answer.is_ok() && self.is_followed_by_another(number, sent, is_repeated, now).await;
            self.check_for_break(place, &answer, now);
            if !std::mem::take(&mut was_connected) || !matches!(answer, Err(Fault::BROKEN | Fault::CLOSED)) {
                let breaker = control.map(|_| self.units.at(place).breaker.clone());
                let answer = self.settle(place, sent, answer, may_keep, now);
                if !control.is_some_and(|control| self.may_follow(place, control, &answer)) {
                    break (sent, answer);
                }
                if let Some(breaker) = breaker {
                    self.units.at_mut(place).breaker = breaker;
                }
                self.report(device, sent, &answer);
                // Some Modbus gateways close the connection after an answer. The request may then need another
                // connection.
                (is_controlled, was_connected, now) = (true, true, self.send_guard.last_sample());
                continue;
            }
            let has_ids = self.wire.as_mut().is_some_and(Connection::has_transaction_id);
            let ending = self.end_of_connection();
            self.drop_connection();
            // It is unknown whether a write that was sent was executed. This is more important than the back-off of the
            // line.
            let may_be_done = answer == Err(Fault::BROKEN) && !request.is_read();
            if has_ids && self.is_contested(ending, now) {
                break (sent, if may_be_done { answer } else { Err(Fault::Link(LinkFault::Contested)) });
            }
            let may_be_asked = may_be_unverified || !self.is_unverified(place);
            if may_be_asked && DeviceLine::is_repeated(request, leave, &answer, has_ids) {
                continue;
            }
            let _ = self.connect(now).await;
            if !has_ids && answer == Err(Fault::BROKEN) {
                self.units.back_off(place, Fault::BROKEN, now, self.spans());
            }
            break (sent, answer);
        };
        // A request that was not sent has no answer. After a repetition, the answer may belong to the first request.
        let asked = first_asked.or(self.send_guard.asked()).unwrap_or(now);
        if answer.as_ref().is_ok_and(|answer| request.is_answered() && answer.is_of_use()) {
            self.report_delivery(device, sent);
        } else {
            self.report(device, sent, &answer);
        }
        let attribution = match self.others.attribute(number, request) {
            Attribution::Ambiguous if is_contested => Attribution::Contested,
            attribution => attribution,
        };
        Ok(CheckedAnswer { answer: answer?, asked, attribution })
    }
}

/// Returns a seed for the jitter of pauses, calculated from a name. The same name always gives the same seed.
fn seed(name: &str) -> u64 {
    name.bytes().fold(14_695_981_039_346_656_037, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(1_099_511_628_211)
    })
}

#[cfg(test)]
mod tests;
