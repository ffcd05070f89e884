//! Opening and closing of a connection, and back-off in favour of another client of the device.

use std::time::Duration;

use super::{ConnectionHistory, DeviceLine};
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::kinds::modbus::pending_replies::PendingReplies;
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::wire::Request;
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;

/// Shortest normal duration of a connection. If the other end closes a connection sooner, it probably did so for
/// another client.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// Number of short connections in a row after which the line backs off. A device that accepts one client drops the
/// first client for the second. Two masters that reconnect at once would interrupt each other for ever.
const SHORT_LIVES: u32 = 3;

impl DeviceLine {
    /// Closes the connection after an answer, if the device at `place` accepts one client at a time
    /// (`quirks.close_after_each`).
    pub(super) fn put_down(&mut self, place: usize) {
        if self.units.at(place).quirks.close_after_each {
            self.wire = None;
            self.is_put_down = true;
        }
    }

    /// Drops the connection without an orderly close. From now on any late answer of any unit is expected.
    pub fn hang_up(&mut self) {
        self.drop_connection();
        self.units.pending.each().for_each(PendingReplies::anything);
    }

    /// Drops the connection. If a read was sent directly after another request and is unanswered, returns its unit, the
    /// read, and its time of sending.
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

    /// Records that the other end closed the connection. Returns true if the last connections were so short that the
    /// line must back off before it connects again.
    pub(super) fn is_contested(&mut self, now: Moment) -> bool {
        if now.since(self.history.opened_at) >= SHORT_LIFE {
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
                self.history =
                    ConnectionHistory { opened_at: now, needs_pause: self.is_put_down, has_answered: false };
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
                self.redial.fail(now);
                self.redial.not_before_either(now.after(self.dial.pause_after(fault)));
                self.refused = fault;
                self.all_break(Break::Refused);
                Err(fault)
            }
        }
    }
}
