//! Opening and closing of a connection, and back-off in favour of another client of the device.

use std::time::Duration;

use super::{ConnectionHistory, DeviceLine};
use crate::fieldbus::connection::Connection;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::kinds::modbus::pending_replies::PendingReplies;
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Ending, ModbusRequest, Request};
use isotherm_core::codec::{Register, Table};
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;

/// Shortest normal duration of a connection. If the other end closes a connection sooner, it probably accepts another
/// client instead.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// Number of short connections in a row after which the line backs off. A device that accepts one client drops the
/// first client when a second one connects. Two masters that reconnect at once would interrupt each other for ever.
const SHORT_LIVES: u32 = 3;

impl DeviceLine {
    /// Closes the connection after an answer, if the device with the index `place` accepts one client at a time
    /// (`quirks.close_after_each`). Also closes the connection if the server itself usually closes each connection
    /// after an answer.
    pub(super) fn put_down(&mut self, place: usize) {
        if self.units.at(place).quirks.close_after_each || self.closing_habit.is_after_each() {
            self.wire = None;
            self.is_put_down = true;
        }
    }

    /// Drops the connection without an orderly close. From now on, late answers of all units may arrive.
    pub fn hang_up(&mut self) {
        self.drop_connection();
        self.units.pending.each().for_each(PendingReplies::anything);
    }

    /// Returns whether the last request came back as an echo, and nothing else arrived before the timeout. Returns
    /// `false` if the connection was closed after the timeout.
    pub fn has_come_back(&mut self) -> bool {
        self.wire.as_mut().and_then(Connection::modbus).is_some_and(|modbus| modbus.has_come_back())
    }

    /// Drops the connection. If a read was sent directly after another request and is unanswered, returns its
    /// unit, the read, and its time of sending. Otherwise returns `None`.
    pub(super) fn drop_connection(&mut self) -> Option<(u8, Request<'static>, Moment)> {
        let mut connection = self.wire.take()?;
        let (number, read, asked) = connection.modbus()?.unanswered_behind()?;
        self.units.pending.of(number).order.suspect(ReplySignature::of(read));
        Some((number, read, asked))
    }

    /// Closes the connection in an orderly way. The call waits for the other end for at most the timeout of an answer.
    pub async fn close(&mut self) {
        let Some(mut connection) = self.wire.take() else { return };
        self.send_guard.away_for(self.timeout);
        let _ = self.patience.within(self.timeout, connection.wire().close()).await;
    }

    /// Returns how the present connection has ended, as far as its transport can show this.
    pub(super) fn end_of_connection(&mut self) -> Ending {
        self.wire.as_mut().map_or(Ending::Lost, |connection| connection.wire().ending())
    }

    /// Records that the other end closed the connection with this ending. Returns true if the last connections were so
    /// short that the line must back off before it connects again. An orderly close after a complete answer does not
    /// show another client.
    pub(super) fn is_contested(&mut self, ending: Ending, now: Moment) -> bool {
        let is_orderly = self.closing_habit.ended(self.history.answers, ending);
        if is_orderly || now.since(self.history.opened_at) >= SHORT_LIFE {
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

    /// Sends a read on a new connection, because a device loses the first request
    /// (`quirks.loses_first_request`). The read has the address of `request`. An answer is not required. A
    /// write is never sent first, because its outcome would be unknown.
    pub(super) async fn send_opening_read(
        &mut self,
        place: usize,
        request: Request<'_>,
    ) -> Result<(), Fault> {
        self.history.is_opened = true;
        let unit = self.units.at(place);
        let (number, is_behind_gateway) = (unit.number, unit.is_behind_gateway);
        let read = opening_read(request).filter(|read| unit.functions.allow(read.function()));
        let (Some(read), Some(connection)) = (read, &mut self.wire) else { return Ok(()) };
        let span = self.timeout + connection.wire().time_under_way(read);
        self.send_guard.next(read, SendDeadline::None);
        self.send_guard.begins(span);
        let answer =
            self.patience.within(span, connection.exchange(number, read, &mut self.send_guard)).await;
        self.send_guard.sample();
        self.history.has_answered = true;
        match answer {
            Some(Err(fault @ (Fault::Link(_) | Fault::Peer(_)))) => return Err(fault),
            Some(_) => return Ok(()),
            None => {}
        }
        let missed = connection.wire().missed();
        let has_ids = connection.has_transaction_id();
        if has_ids && connection.modbus().is_none_or(|modbus| !modbus.give_up()) {
            return Err(missed);
        }
        if !has_ids || is_behind_gateway {
            // The answer may still arrive, like any late answer.
            let pending = self.units.pending.of(number);
            pending.anything();
            pending.order.suspect(ReplySignature::of(read));
        }
        Ok(())
    }

    pub(super) async fn connect(&mut self, now: Moment) -> Result<(), Fault> {
        if !self.yielding.allows(now) {
            return Err(Fault::Link(LinkFault::Contested));
        }
        if !self.redial.allows(now) {
            return Err(Fault::Link(LinkFault::Down));
        }
        let span = self.timeout + self.dial.takes();
        self.send_guard.away_for(span);
        let dialled = self.patience.within(span, self.dial.dial(&self.tap)).await;
        self.send_guard.sample();
        match dialled.unwrap_or(Err(Fault::Link(LinkFault::Unreachable))) {
            Ok(wire) => {
                if !self.pause_after_connect.is_zero() {
                    self.send_guard.away_for(self.pause_after_connect);
                    tokio::time::sleep(self.pause_after_connect).await;
                    self.send_guard.sample();
                }
                self.wire = Some(wire);
                self.connections += 1;
                self.history = ConnectionHistory {
                    opened_at: now,
                    needs_pause: self.is_put_down,
                    is_opened: !self.loses_first_request,
                    ..ConnectionHistory::default()
                };
                self.is_put_down = false;
                self.redial.succeed();
                self.evidence.connected();
                if !self.dial.resumes() {
                    self.all_break(Break::NewConnection);
                }
                Ok(())
            }
            Err(fault) => {
                self.is_put_down = false;
                self.closing_habit.refused();
                self.redial.fail(now);
                self.redial.not_before_either(now.after(self.dial.pause_after(fault)));
                self.refused = fault;
                self.all_break(Break::Refused);
                Err(fault)
            }
        }
    }
}

/// Returns a read of one value at the address of `request`; `None` if `request` is not for a Modbus unit.
fn opening_read(request: Request<'_>) -> Option<Request<'static>> {
    let Request::Modbus(request) = request else { return None };
    let (from, count) = match request {
        ModbusRequest::Read { from, count } => (from, count),
        ModbusRequest::WriteCoil { at, .. } => (Register { table: Table::Coil, offset: at }, 1),
        ModbusRequest::WriteSingle { at, .. } | ModbusRequest::WriteMultiple { at, .. } => {
            (Register { table: Table::Holding, offset: at }, 1)
        }
    };
    Some(Request::read_registers(from, count))
}
