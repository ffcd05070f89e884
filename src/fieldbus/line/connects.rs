//! Making a connection, closing it, and giving way to another client of the device.

use std::time::Duration;

use super::DeviceLine;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::owed::Owed;
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;

/// A connection that lives for less than this, after it has brought answers, was taken away by somebody.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// Short lives in a row after which we give way: a device that accepts one client drops the first for the second, and
/// two masters that both come back at once would keep each other from working for ever.
const SHORT_LIVES: u32 = 3;

impl DeviceLine {
    /// Closes the connection after an answer of a device that lets in one client at a time.
    pub(super) fn put_down(&mut self, place: usize) {
        if self.units.at(place).quirks.close_after_each {
            self.wire = None;
            self.is_put_down = true;
        }
    }

    /// Hangs up: what is on its way on the connection belongs to a time that is over.
    pub fn hang_up(&mut self) {
        self.wire = None;
        self.units.owed.each().for_each(Owed::anything);
    }

    /// Takes leave of the other end, for no longer than it is waited for an answer.
    pub async fn close(&mut self) {
        let Some(mut connection) = self.wire.take() else { return };
        self.departure.away_for(self.timeout);
        let _ = self.patience.within(self.timeout, connection.wire().close()).await;
    }

    /// The connection was closed by the other end: whether that happens too often to come back at once.
    pub(super) fn is_contested(&mut self, now: Moment) -> bool {
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

    pub(super) async fn connect(&mut self, now: Moment) -> Result<(), Fault> {
        if !self.yielding.allows(now) {
            return Err(Fault::Link(LinkFault::Contested));
        }
        if !self.redial.allows(now) {
            return Err(Fault::Link(LinkFault::Down));
        }
        let span = self.timeout + self.dial.takes();
        self.departure.away_for(span);
        let dialled = self.patience.within(span, self.dial.dial(&self.tap)).await;
        self.departure.look();
        match dialled.unwrap_or(Err(Fault::Link(LinkFault::Unreachable))) {
            Ok(wire) => {
                if !self.pause_after_connect.is_zero() {
                    self.departure.away_for(self.pause_after_connect);
                    tokio::time::sleep(self.pause_after_connect).await;
                    self.departure.look();
                }
                self.wire = Some(wire);
                self.spoke = self.is_put_down;
                self.is_put_down = false;
                (self.connected_at, self.has_answered) = (now, false);
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
                self.refused = fault;
                self.all_break(Break::Refused);
                Err(fault)
            }
        }
    }
}
