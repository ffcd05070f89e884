//! One physical line: at most one request under way, a timeout and a last moment for each, a breaker for each device,
//! reconnection. [`DeviceLine::request`] is the one way to ask a device anything, over Modbus, CAN or OPC UA.
//!
//! ```text
//! request ─► ready: connected, quiet, paused ─► exchange: a look at the clock, the bytes, the answer ─► compared
//!    │                                                                                                    │
//!    └──── breaker, retry, reconnection, who hears of it ◄────────────────────────────────────────────────┘
//! ```
//!
//! An answer is as old as its question, and one that is found after its timeout is none.
//!
//! After a timeout or a wrong answer the connection is dropped: a reused one would stay one reply behind for ever.
//! On a line whose answers do not name their question (RTU) a new connection would not help, as the late answer may
//! arrive on it: there the unit, under whatever name the profile has it, is not asked again before its answer has had
//! [`GRACE`] timeouts more, and whatever came until then is discarded; unless it is known to be prompt, see
//! [`super::owed`]. An answer that is later still cannot be told from the next one: the timeout must be at least a
//! quarter of the longest that a device ever takes. Two misses in a row open the port again, for an adapter that has lost
//! itself. A unit behind a gateway from Modbus TCP to a serial line waits in the same way, see `line/late.rs`, and shows
//! that its answers are in order, see `line/order.rs`.
//!
//! A device that failed is left alone for a pause that doubles; while it rests, the others on the line are served, so
//! a dead unit costs them at most one timeout per pause. A line that cannot be connected rests in the same way.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use super::backoff::Backoff;
use super::connection::{Connection, Dial};
use super::departure::{Departure, Leave};
use super::error::{CallerFault, Fault, LinkFault, PeerFault};
use super::owed::{Mark, Owed, Spans};
use super::pipeline::Pipeline;
use super::trace::Tap;
use super::wire::{Answer, NodeRequest, Request};
use crate::clock::{Clock, Patience};
use continuity::Evidence;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, Device, DeviceId};
use others::Others;
use units::{FIRST_PAUSE, Units};

mod connects;
mod continuity;
mod late;
pub(super) mod order;
mod others;
mod units;
mod witness;

pub use witness::Witness;

/// How many timeouts a late answer is given, beyond the first, before its unit is asked again.
pub const GRACE: u32 = 3;
/// Misses in a row after which a line without transactions is opened again.
const MISSES: u32 = 2;

/// The owner of a line: nobody else speaks on it.
pub struct DeviceLine {
    dial: Box<dyn Dial>,
    /// The looks that it has at the clock.
    pub departure: Departure,
    witness: Option<Arc<dyn Witness>>,
    wire: Option<Connection>,
    patience: Patience,
    timeout: Duration,
    pause_after_connect: Duration,
    redial: Backoff,
    refused: Fault,
    units: Units,
    /// Answers do not name their questions.
    is_nameless: bool,
    pipeline: Pipeline,
    /// What the last answer took.
    took: Duration,
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
    evidence: Evidence,
    others: Others,
}

/// An answer that was checked against its question.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answered {
    /// What it brings.
    pub answer: Answer,
    /// When its question left: what it brings is no younger than that.
    pub asked: Moment,
    /// Whether it could be the answer to a question of another master.
    pub attribution: Attribution,
}

/// Attribution of an answer to a question, as far as its frame shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribution {
    /// Ours.
    Ours,
    /// Ours or another master's: another master on the line asks for answers of the same unit, function and length.
    Ambiguous,
    /// Not known: another such answer of the unit followed it. Either may be ours.
    Contested,
}

impl DeviceLine {
    /// A line that has not been connected yet, for these devices of a profile.
    pub fn new(bus: &Bus, devices: &[(DeviceId, &Device)], dial: Box<dyn Dial>, clock: &Clock) -> DeviceLine {
        let pauses = devices.iter().map(|(_, device)| device.quirks.pause_after_connect);
        let pause_after_connect = pauses.fold(bus.quirks.pause_after_connect, Duration::max);
        DeviceLine {
            dial,
            departure: Departure::whenever(clock),
            witness: None,
            wire: None,
            patience: Patience::by(clock),
            timeout: bus.timeout,
            pause_after_connect,
            redial: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            refused: Fault::Link(LinkFault::Down),
            units: Units::of(bus.transport, devices),
            is_nameless: false,
            pipeline: Pipeline::new(
                bus.pipeline > 1 && devices.iter().all(|(_, device)| device.quirks.bear_two()),
            ),
            took: Duration::ZERO,
            spoke: false,
            misses: 0,
            is_put_down: false,
            tap: Tap::default(),
            connected_at: Moment::default(),
            has_answered: false,
            short_lives: 0,
            yielding: Backoff::new(FIRST_PAUSE, seed(&bus.name)),
            evidence: Evidence::default(),
            others: Others::default(),
        }
    }

    /// The same line, listened to at this tap.
    pub fn tapped(mut self, tap: &Tap) -> DeviceLine {
        self.tap = tap.clone();
        self
    }

    /// The same line; this hears what becomes of each request.
    pub fn witnessed(mut self, witness: Arc<dyn Witness>) -> DeviceLine {
        self.witness = Some(witness);
        self
    }

    /// The same line on a machine whose readings are old after this long: a gap between two looks at the clock that is
    /// longer is one in which the computer stood still.
    pub fn aged(mut self, max_age: Duration) -> DeviceLine {
        self.departure = self.departure.aged(max_age);
        self
    }

    /// The same line without the rule that an answer is as old as its question: to show what that is for.
    #[doc(hidden)]
    pub fn credulous(mut self) -> DeviceLine {
        self.departure = self.departure.credulous();
        self
    }

    /// Looks at the clock.
    pub fn look(&mut self) -> Moment {
        self.departure.look()
    }

    /// Nobody is asked for so long.
    pub fn rests_for(&mut self, span: Duration) {
        self.departure.away_for(span);
        self.patience.put_off(span + self.timeout);
    }

    /// When the clock was last looked at.
    pub fn looked(&self) -> Moment {
        self.departure.looked()
    }

    /// There is a connection.
    pub fn is_connected(&self) -> bool {
        self.wire.is_some() || self.is_put_down
    }

    /// What this device is, or the line without one, begins anew: whatever rests there need rest no longer.
    pub fn revive(&mut self, device: Option<DeviceId>) {
        self.units.revive(device);
        if device.is_none() {
            self.redial.succeed();
            self.yielding.succeed();
        }
    }

    /// Attempts to connect that failed since the last one that succeeded, and the last fault.
    pub fn refusals(&self) -> (u32, Fault) {
        (self.redial.failures(), self.refused)
    }

    /// Whether this device is left alone now, after a failure.
    pub fn is_resting(&self, device: DeviceId, now: Moment) -> bool {
        self.units.get(device).is_some_and(|unit| !unit.breaker.allows(now))
    }

    /// When a request to this device that was not answered may be asked again, on a line where that says nothing yet of
    /// the device: an RTU line loses an answer now and then.
    pub fn again_at(&self, device: DeviceId) -> Option<Moment> {
        let unit = self.units.get(device).filter(|_| self.is_nameless)?;
        let owed = self.units.owed.get(unit.number).and_then(|owed| owed.again_at(self.spans()));
        let rests = unit.breaker.not_before().max(self.redial.not_before());
        Some(owed.max(rests).unwrap_or_default().max(self.looked()))
    }

    /// What is due by then may go out behind a question that leaves now: before that is answered it is its turn. `None`
    /// where nothing may.
    pub fn takes_along(&self, now: Moment) -> Option<Moment> {
        self.pipeline.is_on().then(|| now.after(self.took))
    }

    /// This read goes out behind the next question, if that leaves on a connection there is; whoever asks it next is given
    /// its answer. With `None` nothing does.
    pub fn ask_behind(&mut self, read: Option<(DeviceId, Request<'static>)>) {
        let now = self.departure.looked();
        let allowed = |device: DeviceId, request: Request<'_>| {
            let unit = self.units.get(device)?;
            let is_owing =
                unit.is_behind_gateway && self.units.owed.get(unit.number).is_some_and(Owed::is_owing);
            (unit.functions.allow(request.function()) && unit.breaker.allows(now) && !is_owing)
                .then_some(unit.number)
        };
        let read = read.and_then(|(device, request)| Some((allowed(device, request)?, request)));
        self.pipeline.ask(read);
    }

    fn spans(&self) -> Spans {
        Spans { timeout: self.timeout, grace: self.timeout * GRACE }
    }

    /// Asks a device and waits for its answer, at most for the line's timeout (twice, where it must connect first; once more for a
    /// control question, see `line/order.rs`). The
    /// question leaves as `leave` says, or not at all: that is looked at right before its first byte does.
    ///
    /// # Errors
    /// Every request fails here and nowhere else: see [`Fault`], and [`Fault::outcome`] for what that says of a write. A
    /// resting device fails at once, with its last fault. A device whose checks have not passed gets no request.
    pub async fn request(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        leave: Leave,
    ) -> Result<Answered, Fault> {
        self.ask(device, request, leave, false).await
    }

    /// Requests something of a device whose checks may not have passed. The checks themselves use it, and polls whose
    /// readings are discarded until then.
    ///
    /// # Errors
    /// Those of [`DeviceLine::request`].
    pub async fn request_unverified(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
    ) -> Result<Answered, Fault> {
        self.ask(device, request, Leave::Whenever, true).await
    }

    async fn ask(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        leave: Leave,
        may_be_unverified: bool,
    ) -> Result<Answered, Fault> {
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
        let now = self.departure.look();
        if !unit.breaker.allows(now) {
            return Err(unit.last_fault);
        }
        if matches!(leave, Leave::Here(_)) && !self.is_connected() {
            return Err(Fault::CLOSED);
        }
        if !may_be_unverified && self.is_unverified(place) {
            return Err(Fault::UNVERIFIED);
        }
        let (number, is_behind_gateway) =
            (self.units.at(place).number, self.units.at(place).is_behind_gateway);
        // A gateway answers for a unit that may answer late.
        let is_missing = |fault: Fault| is_behind_gateway && fault.is_of_a_gateway();
        let not_before = self.units.owed.get(number).and_then(|owed| owed.not_before(request, self.spans()));
        if not_before.is_some_and(|moment| now < moment) {
            let last_fault = self.units.at(place).last_fault;
            return Err(if request.is_read() { last_fault } else { Fault::Caller(CallerFault::Owed) });
        }
        let mut was_connected = self.wire.is_some();
        let mut first_asked = None;
        let mut is_contested = false;
        let is_in_order = self.control_question(place, request).is_none();
        let answer = loop {
            let (mut are_two, mut is_second, mut behind) = (false, false, None);
            let begun = self.tap.begin();
            self.departure.next(request, leave);
            let mut answer = self.make_ready(place, request, now).await;
            if answer.is_ok() && !may_be_unverified && self.is_unverified(place) {
                break Err(Fault::UNVERIFIED);
            }
            if answer.is_ok()
                && let Some(connection) = &mut self.wire
            {
                if self.pipeline.is_on() {
                    // What went out behind another question is asked for, or something goes out behind this one.
                    is_second = connection.wire().has_behind();
                    // Two answers that a gateway could take for each other are not under way together.
                    let is_like_it = |(unit, read): &(u8, Request<'_>)| {
                        is_behind_gateway && *unit == number && Mark::of(*read) == Mark::of(request)
                    };
                    let read = self.pipeline.take().filter(|read| is_in_order && !is_like_it(read));
                    behind = read.map(|(unit, _)| unit);
                    connection.wire().ask_behind(read);
                    are_two = is_second || connection.wire().has_behind();
                }
                let span = self.timeout + connection.wire().time_under_way(request);
                self.departure.begins(span);
                let exchanged = {
                    // Pinned here, it need not be moved.
                    let exchange = pin!(connection.exchange(number, request, &mut self.departure));
                    self.patience.within(span, exchange).await
                };
                let took = self.departure.took();
                self.took = took;
                for late in connection.wire().heard_late() {
                    self.units.owed.of(late).distrust();
                }
                let owed = self.units.owed.of(number);
                first_asked = owed.first_asked(request);
                answer = match exchanged {
                    // One that was found after its time comes too late, also where nobody looked in between.
                    Some(answer)
                        if answer
                            .as_ref()
                            .err()
                            .is_none_or(|fault| fault.is_refusal() && !is_missing(*fault))
                            && (took > span || (first_asked.is_some() && !owed.is_likely_after(took))) =>
                    {
                        Err(connection.wire().missed())
                    }
                    Some(answer) => answer,
                    None => Err(connection.wire().missed()),
                };
                match answer {
                    Err(fault) if fault.spoils_connection() || is_missing(fault) => {
                        if self.departure.asked().is_some() {
                            owed.order.misses();
                        }
                        // What went out behind it is lost with the connection.
                        if let Some(unit) = behind.filter(|_| fault.spoils_connection()) {
                            self.units.owed.of(unit).order.misses();
                        }
                    }
                    Ok(_) | Err(Fault::Exception(_)) => owed.answers(request, took),
                    Err(_) => {}
                }
            }
            if let Some(begun) = begun {
                self.tap.tell(begun, (device, number), request, &answer);
            }
            if are_two
                && self.pipeline.judge(is_second, &answer)
                && let (Some(witness), Err(fault)) = (&self.witness, &answer)
            {
                witness.gives_up_pipeline(*fault);
            }
            if matches!(request, Request::Nodes(NodeRequest::Latest(_)))
                && let (Some(witness), Some(connection)) = (&self.witness, &mut self.wire)
                && let Some(what) = connection.wire().subscription_news()
            {
                witness.subscribes(device, what);
            }
            self.note_others(now);
            let is_repeated = first_asked.is_some();
            is_contested =
                answer.is_ok() && self.is_followed_by_another(number, request, is_repeated, now).await;
            self.look_for_a_break(place, &answer, now);
            if !std::mem::take(&mut was_connected) || !matches!(answer, Err(Fault::BROKEN | Fault::CLOSED)) {
                break self.settle(place, request, answer, now);
            }
            // Some gateways close a connection that was idle for a while: that is no reason to lose a reading. What may
            // have been sent is not sent again, and nothing that goes by what was read on a connection which is lost.
            let has_ids = self.wire.as_mut().is_some_and(|wire| wire.wire().has_transaction_id());
            self.wire = None;
            // Of a write that was sent it is not known whether it was done: that says more than why the line gives way.
            let may_be_done = answer == Err(Fault::BROKEN) && !request.is_read();
            if has_ids && self.is_contested(now) {
                break if may_be_done { answer } else { Err(Fault::Link(LinkFault::Contested)) };
            }
            let is_free = !matches!(leave, Leave::Here(_));
            let may_be_asked = may_be_unverified || !self.is_unverified(place);
            if may_be_asked && (request.is_read() && has_ids || answer == Err(Fault::CLOSED) && is_free) {
                continue;
            }
            let _ = self.connect(now).await;
            if !has_ids && answer == Err(Fault::BROKEN) {
                self.units.rest(place, Fault::BROKEN, now, self.spans());
            }
            break answer;
        };
        // One that never left has no answer. One that was asked twice may answer the first question.
        let asked = first_asked.or(self.departure.asked()).unwrap_or(now);
        let answer = self.in_order(place, request, answer, first_asked.is_some()).await;
        if let Some(witness) = &self.witness
            && !matches!(answer, Err(Fault::Caller(_) | Fault::UNVERIFIED))
        {
            let outcome = answer.as_ref().map(|_| ()).map_err(|fault| *fault);
            witness.note(device, request, outcome, self.refusals());
            if answer.as_ref().is_ok_and(|answer| request.is_answered() && answer.is_of_use()) {
                witness.delivers(device);
            }
        }
        let attribution = match self.others.attribute(number, request) {
            Attribution::Ambiguous if is_contested => Attribution::Contested,
            attribution => attribution,
        };
        Ok(Answered { answer: answer?, asked, attribution })
    }

    /// What an answer, or its absence, means for the connection and the unit.
    fn settle(
        &mut self,
        place: usize,
        request: Request<'_>,
        answer: Result<Answer, Fault>,
        now: Moment,
    ) -> Result<Answer, Fault> {
        let Some(connection) = &mut self.wire else { return answer };
        let has_ids = connection.wire().has_transaction_id();
        self.is_nameless = !has_ids;
        let is_behind_gateway = self.units.at(place).is_behind_gateway;
        let has_left = self.departure.asked().is_some();
        let is_first = has_left && !self.has_answered;
        self.has_answered |= has_left;
        let answer = match answer {
            Err(Fault::BROKEN) if is_first && has_ids => Err(self.dial.turned_away()),
            answer => answer,
        };
        match &answer {
            // It never left the house, which says nothing of the device.
            Err(Fault::Caller(_)) => {}
            // The gateway has answered, and not the unit.
            Err(fault) if is_behind_gateway && fault.is_of_a_gateway() => {
                self.misses = 0;
                self.evidence.answered();
                self.note_miss(place, request, *fault, now);
                self.put_down(place);
            }
            Err(fault) if fault.spoils_connection() => {
                self.misses += 1;
                let is_lost = matches!(fault, Fault::Link(_) | Fault::Peer(PeerFault::Unasked));
                if has_ids || is_lost || self.misses >= MISSES {
                    self.wire = None;
                    self.misses = 0;
                }
                if has_ids && !(is_behind_gateway && has_left && !matches!(fault, Fault::Link(_))) {
                    // The pause begins when the timeout is over, else several dead units would have none left.
                    let waited = if *fault == Fault::Timeout { self.timeout } else { Duration::ZERO };
                    let unit = self.units.at_mut(place);
                    unit.breaker.fail(now.after(waited));
                    unit.last_fault = *fault;
                } else {
                    self.note_miss(place, request, *fault, now);
                }
            }
            _ => {
                self.misses = 0;
                self.evidence.answered();
                let unit = self.units.at_mut(place);
                unit.heard = now;
                unit.breaker.succeed();
                self.put_down(place);
            }
        }
        answer
    }

    /// There is a connection, nothing is on its way to us, and the unit has had its pause. `Done`, to begin with.
    async fn make_ready(&mut self, place: usize, request: Request<'_>, now: Moment) -> Result<Answer, Fault> {
        if self.wire.is_none() {
            self.connect(now).await?;
        }
        self.hear_out(place, request).await?;
        let unit = self.units.at(place);
        let pause = unit.quirks.pause_between_requests;
        if self.spoke && !pause.is_zero() {
            self.departure.away_for(pause);
            tokio::time::sleep(pause).await;
            self.departure.look();
        }
        self.spoke = true;
        Ok(Answer::Done)
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
