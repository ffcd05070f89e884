//! Observed state of the Modbus gateway (from TCP to a serial line) in front of the units of a line.
//!
//! A Modbus gateway has one request at a time on its serial line. While it waits for a silent unit, it answers no other
//! request. Its own timeout may be longer than `timeout`:
//!
//! ```text
//! line:             request to 1 ── timeout ── request to 2 ── timeout       2 seems to be dead
//! Modbus gateway:   waits for 1 ······································ exception 11 of 1 ── answer of 2
//! ```
//!
//! The line therefore learns the timeout of the Modbus gateway. The line sends a request to another unit only
//! after this timeout has ended. Some Modbus gateways send an exception at the end of their timeout, with the
//! transaction number of the given up request. Others send nothing: the line then learns the timeout from the
//! answer of the next unit.
//!
//! Waiting also keeps requests apart: while the late answer of one unit may arrive, no request to another
//! unit is open on the connection. Some Modbus gateways send each answer with the transaction number of the
//! newest request. While the line waits, the newest request is the unanswered request, so this number is
//! correct. If the late answer does not arrive, the line drops the connection instead of sending a request to
//! another unit on it. Otherwise a Modbus gateway that keeps a late answer could send it as the answer to
//! that request. If the Modbus gateway has refused another connection, the line keeps the present one.
//!
//! This module decides only. `gateway_turns` sends, waits and reports.

use std::time::Duration;

use crate::fieldbus::kinds::modbus::wire::LateReply;
use isotherm_core::quantity::Moment;

/// Longest time for which the line waits for a Modbus gateway whose timeout is not known.
pub(super) const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// Longest observed time that the line accepts as the timeout of a Modbus gateway. A longer time may have
/// another cause, for example a stop of this computer.
const LONGEST_OWN: Duration = Duration::from_secs(10);
/// Maximum time by which one request takes longer because the line waits for a Modbus gateway.
pub const LONGEST_GATEWAY_WAIT: Duration = Duration::from_secs(16);
/// Additional time in which an exception of the Modbus gateway may arrive.
const LATER: Duration = Duration::from_millis(100);
/// Time after which a dead unit gets a request in any case, even if readings of other units become too old.
const SELDOM: Duration = Duration::from_secs(300);
/// After a missing answer, a dead unit gets no request for this time, unless another unit answers. After this time,
/// probably no other unit can answer.
const PROOF: Duration = Duration::from_secs(30);
/// Limit of the time for dead units: requests to dead units occupy the line for at most 1/`SHARE` of the time.
const SHARE: u32 = 4;

/// State of the Modbus gateway of one line.
#[derive(Debug, Default)]
pub(super) struct ModbusGateway {
    giving_up: GivingUp,
    numbers: TransactionNumbers,
    renewal: Renewal,
    occupied: Option<SilentRequest>,
    proof: Proof,
    /// Earliest time of the next request to a dead unit (a unit that has missed two answers in a row).
    dead_not_before: Moment,
    /// Own timeout of the Modbus gateway, as last reported to the observer; `None` if it was never reported.
    reported: Option<Duration>,
    /// End of the last wait for the Modbus gateway.
    waited_until: Moment,
}

/// Behaviour of the Modbus gateway when its own timeout for a silent unit ends, and the length of this timeout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum GivingUp {
    #[default]
    Unknown,
    /// The Modbus gateway sends an exception when its own timeout ends, after this time.
    WithException(Duration),
    /// The Modbus gateway sends nothing when its own timeout ends.
    Silently(SilentTimeout),
}

/// Own timeout of a Modbus gateway that gives up silently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SilentTimeout {
    Unknown,
    /// Upper limit: another unit answered without a delay after this time, so the Modbus gateway had already given up.
    AtMost(Duration),
    /// Approximate value: the delayed answer of another unit arrived after this time.
    About(Duration),
}

/// Whether the Modbus gateway returns the transaction number of each request in its answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum TransactionNumbers {
    #[default]
    Right,
    /// A request got the answer to another request.
    Wrong,
}

/// Whether the Modbus gateway accepts a new connection directly after the line has closed the old one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Renewal {
    #[default]
    Accepted,
    /// The Modbus gateway refused the connection: it accepts only one client at a time, and needs more time to accept
    /// the next client.
    Refused,
}

/// Request that was not answered in time. The Modbus gateway may still wait for the unit of this request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SilentRequest {
    unit: u8,
    asked: Moment,
    /// Whether the line has waited for the Modbus gateway without knowing its timeout. If so, a prompt answer of
    /// another unit gives no information about this timeout.
    was_awaited: bool,
}

/// Proof that the units behind the Modbus gateway can answer: whether a unit has answered since the last missing
/// answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Proof {
    #[default]
    Given,
    /// No unit has answered since this time.
    AwaitedSince(Moment),
}

/// Action of the line before it sends a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wait {
    /// The line sends the request at once.
    None,
    /// The line waits for the late answer of the Modbus gateway to the unanswered request, at most until this time.
    Until(Moment),
    /// The line opens another connection before it sends the request.
    Renew,
}

impl ModbusGateway {
    /// Returns whether the Modbus gateway has returned the right transaction numbers so far.
    pub(super) fn returns_numbers(&self) -> bool {
        self.numbers == TransactionNumbers::Right
    }

    /// Records that the Modbus gateway sent an answer with the transaction number of another request.
    pub(super) fn confuses_numbers(&mut self) {
        self.numbers = TransactionNumbers::Wrong;
    }

    /// Records that the Modbus gateway has not accepted a connection, or has closed the connection before an answer.
    /// This has an effect only if the line has opened the connection because of a silent unit.
    pub(super) fn refuses_connection(&mut self) {
        if self.occupied.is_some() {
            self.renewal = Renewal::Refused;
        }
    }

    /// Returns the unit and the time of the request for which the Modbus gateway may still wait; `None` if there is no
    /// such request.
    pub(super) fn occupied(&self) -> Option<(u8, Moment)> {
        self.occupied.map(|silent| (silent.unit, silent.asked))
    }

    /// Returns the timeout of the Modbus gateway if it must be reported, otherwise `None`. It must be
    /// reported if it is longer than `timeout`, and differs from the last reported value by more than a
    /// quarter.
    pub(super) fn news(&mut self, timeout: Duration) -> Option<Duration> {
        let is_news = |own: &Duration| self.reported.is_none_or(|last| own.abs_diff(last) > last / 4);
        let own = self.longer_timeout().filter(|own| *own > timeout).filter(is_news)?;
        self.reported = Some(own);
        Some(own)
    }

    /// Returns the observed timeout of the Modbus gateway; `None` if the line has not observed it.
    fn longer_timeout(&self) -> Option<Duration> {
        match self.giving_up {
            GivingUp::WithException(own) | GivingUp::Silently(SilentTimeout::About(own)) => Some(own),
            GivingUp::Unknown | GivingUp::Silently(_) => None,
        }
    }

    /// Returns the time until which the line expects the Modbus gateway to wait for the silent unit. `None`
    /// if the Modbus gateway waits for no unit, or its timeout is not known.
    pub(super) fn occupied_until(&self) -> Option<Moment> {
        let span = self.waiting_time()?;
        self.occupied.map(|silent| silent.asked.after(span))
    }

    /// Returns how long the line waits for the Modbus gateway after a request to a silent unit; `None` if the
    /// timeout of the Modbus gateway is not known.
    fn waiting_time(&self) -> Option<Duration> {
        self.own_timeout().map(|own| own + own / 8 + LATER)
    }

    /// Returns the timeout of the Modbus gateway, or an upper limit of this timeout; `None` if both are
    /// unknown.
    fn own_timeout(&self) -> Option<Duration> {
        match self.giving_up {
            GivingUp::Silently(SilentTimeout::AtMost(most)) => Some(most),
            _ => self.longer_timeout(),
        }
    }

    /// Records that a request to the unit, sent at `asked`, was not answered in time.
    pub(super) fn missed(&mut self, unit: u8, asked: Moment, now: Moment) {
        // The line has waited for the Modbus gateway, so the learnt timeout is no longer correct.
        if self.occupied.is_some_and(|silent| silent.unit != unit) {
            self.giving_up = match self.giving_up {
                GivingUp::Silently(_) => GivingUp::Silently(SilentTimeout::Unknown),
                GivingUp::Unknown | GivingUp::WithException(_) => GivingUp::Unknown,
            };
        }
        self.occupied = Some(SilentRequest { unit, asked, was_awaited: false });
        self.proof = Proof::AwaitedSince(now);
    }

    /// Records that the Modbus gateway has given up a unit, and has sent an exception within `timeout`.
    pub(super) fn gave_up(&mut self, now: Moment) {
        self.occupied = None;
        self.proof = Proof::AwaitedSince(now);
    }

    /// Records that a request to a dead unit was sent at `asked`, and not answered.
    pub(super) fn spent_on_dead(&mut self, asked: Moment, timeout: Duration) {
        self.dead_not_before = asked.after(self.cost(timeout) * SHARE);
    }

    /// Records an answer of a unit. `is_after_timeout`: the answer arrived only because the line has waited longer than
    /// `timeout`.
    pub(super) fn answered(&mut self, unit: u8, is_after_timeout: bool, now: Moment) {
        self.proof = Proof::Given;
        if is_after_timeout {
            self.wait_ended(now);
        }
        let Some(silent) = self.occupied.take().filter(|silent| silent.unit != unit) else { return };
        let passed = now.since(silent.asked);
        let learns = match self.giving_up {
            GivingUp::WithException(_) => false,
            GivingUp::Silently(SilentTimeout::Unknown) => is_after_timeout || !silent.was_awaited,
            GivingUp::Unknown | GivingUp::Silently(_) => is_after_timeout,
        };
        if learns && passed <= LONGEST_OWN {
            let own =
                if is_after_timeout { SilentTimeout::About(passed) } else { SilentTimeout::AtMost(passed) };
            self.giving_up = GivingUp::Silently(own);
        }
    }

    /// Records that a late answer to an earlier request has arrived and was discarded.
    pub(super) fn received_late(&mut self, late: &LateReply) {
        self.occupied = self.occupied.filter(|silent| (silent.unit, silent.asked) != (late.unit, late.asked));
        let own = late.received.map(|received| received.since(late.asked));
        if let Some(own) = own.filter(|own| late.is_of_a_gateway && *own <= LONGEST_OWN) {
            self.giving_up = GivingUp::WithException(own);
        }
    }

    /// Returns what the line does before it sends a request to the unit. `expects_late`: a late answer to the
    /// unanswered request can still arrive on this connection. `latest`: end of the wait if the timeout of the Modbus
    /// gateway is not known.
    pub(super) fn wait(&self, unit: u8, expects_late: bool, latest: Moment, now: Moment) -> Wait {
        let Some(silent) = self.occupied else { return Wait::None };
        let until = match (self.occupied_until(), self.giving_up) {
            (Some(until), _) => until,
            // The unit itself has waited for its late answer.
            (None, giving_up)
                if expects_late
                    && silent.unit != unit
                    && (giving_up == GivingUp::Unknown || self.renewal == Renewal::Refused) =>
            {
                latest
            }
            (None, _) if expects_late && self.renewal == Renewal::Accepted => return Wait::Renew,
            // The line does not know for how long it should wait. It sends the request, and waits longer for the
            // answer.
            (None, _) => return Wait::None,
        };
        if until > now {
            Wait::Until(until)
        } else if self.is_to_renew(silent, unit, expects_late) {
            Wait::Renew
        } else {
            Wait::None
        }
    }

    /// Returns whether the line must open another connection before it sends a request to the unit. The late answer to
    /// the unanswered request has not arrived.
    fn is_to_renew(&self, silent: SilentRequest, unit: u8, expects_late: bool) -> bool {
        self.renewal == Renewal::Accepted && expects_late && silent.unit != unit
    }

    /// Records that a wait for the Modbus gateway has ended.
    pub(super) fn wait_ended(&mut self, now: Moment) {
        self.waited_until = now;
    }

    /// Returns the end of the last wait for the Modbus gateway.
    pub(super) fn waited_until(&self) -> Moment {
        self.waited_until
    }

    /// Records the end of the wait that [`ModbusGateway::wait`] has requested before a request to the unit. Returns
    /// true if the line must open another connection, because the Modbus gateway has sent no answer.
    pub(super) fn has_waited(&mut self, unit: u8, expects_late: bool) -> bool {
        let Some(silent) = self.occupied else { return false };
        let is_renewed = self.is_to_renew(silent, unit, expects_late);
        if self.giving_up == GivingUp::Unknown {
            self.occupied = Some(SilentRequest { was_awaited: is_renewed, ..silent });
            self.giving_up = GivingUp::Silently(SilentTimeout::Unknown);
        }
        is_renewed
    }

    /// Returns the additional time, beyond `timeout`, for which the line waits for the answer of a unit. The Modbus
    /// gateway may still wait for another unit meanwhile.
    pub(super) fn patience(&self, unit: u8, now: Moment) -> Duration {
        let Some(silent) = self.occupied.filter(|silent| silent.unit != unit) else { return Duration::ZERO };
        let longest = self.own_timeout().map_or(LONGEST_WAIT, |own| own + own / 2 + LATER);
        silent.asked.after(longest).since(now)
    }

    /// Returns whether a dead unit must get no request until another unit has answered.
    pub(super) fn awaits_proof(&self, now: Moment) -> bool {
        matches!(self.proof, Proof::AwaitedSince(since) if now.since(since) < PROOF)
    }

    /// Returns whether a dead unit gets a request. The last request to it was sent at `tried`. `live`: for
    /// each other unit that answers, the time of its readings and the age at which they are too old.
    ///
    /// If no other unit answers, the result is true. Otherwise a dead unit gets a request only after another
    /// unit has answered, or after [`PROOF`]. Dead units get at most 1/[`SHARE`] of the time, and no request
    /// if a reading would become too old meanwhile. The last two conditions end after [`SELDOM`].
    pub(super) fn may_try_dead(
        &self,
        tried: Moment,
        timeout: Duration,
        live: impl Iterator<Item = (Moment, Duration)>,
        now: Moment,
    ) -> bool {
        let mut live = live.peekable();
        if live.peek().is_none() {
            return true;
        }
        if self.awaits_proof(now) {
            return false;
        }
        // After the request to the dead unit, there must be time for the answer of the other unit.
        let until = now.after(self.waiting_time().unwrap_or_default().max(timeout) + timeout);
        now.since(tried) >= SELDOM
            || (now >= self.dead_not_before
                && live.all(|(received, max_age)| received.after(max_age) >= until))
    }

    /// Returns the time for which one request to a dead unit occupies the line.
    fn cost(&self, timeout: Duration) -> Duration {
        self.own_timeout().unwrap_or_default().max(timeout)
    }
}

#[cfg(test)]
mod tests;
