//! Decision when a unit behind a Modbus gateway (from TCP to a serial line) may get a request, and waiting
//! for the Modbus gateway. The module `modbus_gateway` describes why this is necessary.
//!
//! `place` is the index of a unit in the list of the line.

use std::time::Duration;

use super::modbus_gateway::{LONGEST_WAIT, Wait};
use super::{AfterTimeout, DeviceLine};
use crate::fieldbus::connection::Connection;
use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use crate::fieldbus::wire::Answer;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

impl DeviceLine {
    /// Returns whether the unit may get a request now. A unit that backs off after a failure gets no request. A dead
    /// unit behind a Modbus gateway seldom gets a request, because the other units wait meanwhile.
    pub(super) fn may_try(&self, place: usize, now: Moment) -> bool {
        let unit = self.units.at(place);
        if !unit.breaker.allows(now) {
            return false;
        }
        if !unit.is_behind_gateway || self.after_timeout == AfterTimeout::Renew || !self.units.is_dead(place)
        {
            return true;
        }
        let others = self.units.live().filter(|other| other.number != unit.number);
        let others = others.map(|other| (other.read_since(), other.max_age));
        self.gateway.may_try_dead(unit.tried, self.timeout, others, now)
    }

    /// Records that a round of reads (one read of all signals) of the device has ended. The round began at `begun`.
    pub fn note_round(&mut self, device: DeviceId, begun: Moment) {
        if let Some(place) = self.units.place(device) {
            self.units.at_mut(place).round = Some(begun);
        }
    }

    /// Returns the device that must get the next request, after a unit behind a Modbus gateway has not answered.
    /// `None`: any device may get it.
    ///
    /// The result is the device that answered last, because it most probably still answers. Otherwise several units
    /// that fail together would occupy the Modbus gateway one after another.
    pub fn first_after_miss(&self, now: Moment) -> Option<DeviceId> {
        if !self.gateway.awaits_proof(now) {
            return None;
        }
        let first = self.units.live().max_by_key(|unit| unit.received)?;
        first.breaker.allows(now).then_some(first.device)
    }

    /// Returns the time until which a request to the device would be delayed, because the Modbus gateway
    /// still waits for a silent unit. `None`: there is no delay, or the timeout of the Modbus gateway is not
    /// known.
    pub fn occupied_until(&self, device: DeviceId, now: Moment) -> Option<Moment> {
        let until = self.gateway.occupied_until().filter(|until| *until > now)?;
        // Under a virtual clock, requests do not wait.
        let waits = self.after_timeout == AfterTimeout::Keep && !self.send_guard.is_virtual();
        (waits && self.units.get(device)?.is_behind_gateway).then_some(until)
    }

    /// Returns whether the line has waited for a Modbus gateway since `due`. A request that was due at that time is
    /// then late, although the line is not overloaded.
    pub fn has_waited_since(&self, due: Moment) -> bool {
        self.gateway.occupied_until().max(Some(self.gateway.waited_until())) > Some(due)
    }

    /// Waits until the Modbus gateway has given up the silent unit, if the Modbus gateway may still wait for that unit.
    /// If the time of giving up is not known, the line opens another connection.
    pub(super) async fn wait_for_gateway(&mut self, place: usize) -> Result<(), Fault> {
        let unit = self.units.at(place);
        let (number, is_behind_gateway) = (unit.number, unit.is_behind_gateway);
        if self.gateway.occupied().is_none() {
            return Ok(());
        }
        let Some(connection) = &mut self.wire else { return Err(Fault::Link(LinkFault::Down)) };
        let has_gateway = is_behind_gateway && connection.has_transaction_id();
        if !has_gateway || self.after_timeout == AfterTimeout::Renew {
            return Ok(());
        }
        // The late answer may have arrived while the line was idle, so that the time of its arrival is not known.
        let arrived = connection.modbus().map_or(Ok(()), |modbus| modbus.discard_arrived());
        self.take_late_replies();
        let now = self.send_guard.sample();
        self.gateway.wait_ended(now);
        if let Err(fault) = arrived {
            return self.renew_after(fault, now).await;
        }
        let Some(silent) = self.gateway.occupied() else { return Ok(()) };
        let modbus = self.wire.as_mut().and_then(Connection::modbus);
        let expects_late = modbus.is_some_and(|modbus| modbus.expects_late(silent.0, silent.1));
        let latest = self.latest_wait(silent.1);
        let until = match self.gateway.wait(number, expects_late, latest, now) {
            Wait::None => return Ok(()),
            Wait::Renew => return self.renew(now).await,
            Wait::Until(until) => until,
        };
        // Virtual time does not pass while a task waits, so the wait would never end.
        let span = if self.send_guard.is_virtual() { Duration::ZERO } else { until.since(now) };
        let received = self.listen_for_late(silent, expects_late, span).await;
        let now = self.send_guard.sample();
        self.gateway.wait_ended(now);
        self.take_late_replies();
        if let Err(fault) = received {
            return self.renew_after(fault, now).await;
        }
        if self.gateway.has_waited(number, expects_late) { self.renew(now).await } else { Ok(()) }
    }

    /// Waits for `span`, or until the late answer to the unanswered request has arrived, if this answer is expected.
    async fn listen_for_late(
        &mut self,
        silent: (u8, Moment),
        expects_late: bool,
        span: Duration,
    ) -> Result<(), Fault> {
        self.send_guard.away_for(span + self.timeout);
        match self.wire.as_mut().and_then(Connection::modbus).filter(|_| expects_late) {
            Some(modbus) => {
                let late = modbus.await_late(silent, &mut self.send_guard);
                self.patience.within(span, late).await.unwrap_or(Ok(()))
            }
            None => {
                tokio::time::sleep(span).await;
                Ok(())
            }
        }
    }

    /// Returns the latest end of a wait for a Modbus gateway whose timeout is not known. The request was sent
    /// at `asked`. If possible, the wait ends before a reading becomes too old.
    fn latest_wait(&self, asked: Moment) -> Moment {
        let usable = self.units.live().map(|unit| unit.read_since().after(unit.max_age));
        let latest = usable.min().map(|usable| usable.before(self.timeout));
        let latest = latest.map_or(Moment::END, |latest| latest.max(asked.after(2 * self.timeout)));
        latest.min(asked.after(LONGEST_WAIT.max(2 * self.timeout)))
    }

    /// Replaces the connection, because unexpected input arrived before a request. `fault` is the fault of this input,
    /// and does not concern the unit of the request.
    ///
    /// # Errors
    /// The other end has closed the connection, or there is no other connection.
    async fn renew_after(&mut self, fault: Fault, now: Moment) -> Result<(), Fault> {
        match fault {
            Fault::Link(_) => Err(fault),
            _ => self.renew(now).await,
        }
    }

    /// Closes the connection, and opens another one to the same address.
    async fn renew(&mut self, now: Moment) -> Result<(), Fault> {
        self.drop_connection();
        let connected = self.connect(now).await;
        if connected.is_err() {
            self.gateway.refuses_connection();
        }
        connected
    }

    /// Returns the additional time, beyond `timeout`, for which the line waits for the answer of a unit, because the
    /// Modbus gateway may be occupied. A unit that has not answered its last request gets no additional time.
    pub(super) fn patience_for(&self, place: usize) -> Duration {
        let unit = self.units.at(place);
        let is_waited_for = unit.is_behind_gateway && self.after_timeout == AfterTimeout::Keep;
        if !is_waited_for || self.gateway.occupied().is_none() || !self.units.is_live(place) {
            return Duration::ZERO;
        }
        self.gateway.patience(unit.number, self.send_guard.last_sample())
    }

    /// Updates the state of the Modbus gateway with the result of a request to a unit. `may_be_late`: an earlier answer
    /// of the unit was missing. `is_after_timeout`: the line has waited longer than `timeout` for the answer.
    pub(super) fn note_gateway(
        &mut self,
        place: usize,
        answer: &Result<Answer, Fault>,
        may_be_late: bool,
        is_after_timeout: bool,
    ) {
        self.take_late_replies();
        let unit = self.units.at(place);
        if !unit.is_behind_gateway {
            return;
        }
        let now = self.send_guard.last_sample();
        match answer {
            Err(Fault::Peer(PeerFault::OutOfOrder)) => self.gateway.confuses_numbers(),
            // The answer of another unit has the transaction number of the present request.
            Err(Fault::Peer(PeerFault::Unit(from))) if self.units.place_of(*from).is_some() => {
                self.gateway.confuses_numbers();
            }
            Err(Fault::Peer(PeerFault::Length | PeerFault::Function | PeerFault::Echo)) if may_be_late => {
                self.gateway.confuses_numbers();
            }
            Err(fault) if !fault.is_refusal() || fault.is_of_a_gateway() => {}
            _ => {
                self.gateway.answered(unit.number, is_after_timeout, now);
                self.report_longer_timeout();
            }
        }
    }

    /// Records that a unit behind the Modbus gateway has not answered a request, which ended with `fault`.
    pub(super) fn note_gateway_miss(&mut self, place: usize, fault: Fault) {
        let Some(asked) = self.send_guard.asked() else { return };
        let (number, was_dead) = (self.units.at(place).number, self.units.is_dead(place));
        let now = self.send_guard.last_sample();
        match fault {
            Fault::Timeout => self.gateway.missed(number, asked, now),
            _ => self.gateway.gave_up(now),
        }
        if was_dead {
            self.gateway.spent_on_dead(asked, self.timeout);
        }
    }

    /// Processes the late answers that the wire has discarded.
    fn take_late_replies(&mut self) {
        let replies = self.wire.as_mut().and_then(Connection::modbus).map(|modbus| modbus.late_replies());
        for late in replies.into_iter().flatten() {
            // The connection works, although answers are missing.
            self.misses = 0;
            self.gateway.received_late(&late);
            if !late.is_of_a_gateway {
                self.units.pending.of(late.unit).reset_timing();
            }
            self.report_longer_timeout();
        }
    }

    /// Reports to the observer that the timeout of the Modbus gateway is longer than the timeout of the line.
    /// The report is repeated if the timeout of the Modbus gateway changes by more than a quarter.
    fn report_longer_timeout(&mut self) {
        if let (Some(own), Some(observer)) = (self.gateway.news(self.timeout), &self.observer) {
            observer.waits_for_gateway(own);
        }
    }
}
