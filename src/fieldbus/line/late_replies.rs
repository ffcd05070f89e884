//! Waiting for late answers of units whose answers have no reliable transaction number.
//!
//! On an RTU line the wire receives a late answer and discards it. A Modbus gateway (from TCP to a serial line) may
//! send a late answer with the transaction number of a later request. The line cannot distinguish such an answer from
//! the answer to the later request. After a missing answer, the line therefore sends no request of the same form to
//! that unit while the late answer may arrive. A late answer then finds no open request.
//!
//! A Modbus gateway may also keep a late answer until it gets the next request. Waiting does not help against
//! that: see `control.rs`.
//!
//! `place` is the index of a unit in the list of the line.

use std::time::Duration;

use super::DeviceLine;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::wire::Request;
use isotherm_core::quantity::Moment;

impl DeviceLine {
    /// Waits until no late answer of the unit can be mistaken for the answer to this request. Returns an error if there
    /// is no connection, or if the connection fails during the wait.
    pub(super) async fn wait_for_late(&mut self, place: usize, request: Request<'_>) -> Result<(), Fault> {
        let spans = self.spans();
        let (number, is_behind_gateway) =
            (self.units.at(place).number, self.units.at(place).is_behind_gateway);
        let Some(connection) = &mut self.wire else { return Err(Fault::Link(LinkFault::Down)) };
        let Some(modbus) = connection.modbus() else { return Ok(()) };
        let pending = self.units.pending.of(number);
        loop {
            // On a new connection, unsolicited input has not had time to arrive yet. A Modbus gateway sends no such
            // input.
            let least =
                if self.history.has_answered || is_behind_gateway { Duration::ZERO } else { self.timeout };
            let anything = pending.remaining_for_any(spans).map(|left| left.max(least));
            let left = anything.unwrap_or_else(|| pending.left(request, spans));
            if anything.is_none() && left.is_zero() {
                break;
            }
            self.send_guard.away_for(left + self.timeout);
            let received = if is_behind_gateway {
                tokio::time::sleep(left).await;
                Ok(())
            } else {
                modbus.listen(number, left, self.timeout).await
            };
            self.send_guard.sample();
            if modbus.received_late().contains(&number) {
                pending.reset_timing();
            }
            received?;
            if anything.is_some() {
                pending.is_quiet();
            }
        }
        let has_ids = modbus.has_transaction_id();
        if !has_ids {
            modbus.pass_over(self.units.pending.marks().collect());
        }
        if !has_ids || is_behind_gateway {
            self.units.pending.each().for_each(|pending| pending.forget(spans));
        }
        Ok(())
    }

    /// Records that the unit has not answered `request` in time. The answer may still arrive late.
    pub(super) fn note_miss(&mut self, place: usize, request: Request<'_>, fault: Fault, now: Moment) {
        let asked = self.send_guard.asked().unwrap_or(now);
        // The Modbus gateway has its own timeout. The late answer may arrive for some time after that timeout.
        let missed =
            if fault.is_of_a_gateway() { self.send_guard.last_sample() } else { now.after(self.timeout) };
        self.units.misses(place, (request, asked, missed), fault, now, self.spans());
    }

    /// Records that a connection was lost before a follow-up read was answered (a read that is sent directly after
    /// another request). The answer to the follow-up read may arrive late.
    pub(super) fn note_lost_read(
        &mut self,
        (number, read, asked): (u8, Request<'static>, Moment),
        now: Moment,
    ) {
        let place = self.units.place_of(number).filter(|place| self.units.at(*place).is_behind_gateway);
        if let Some(place) = place {
            let missed = now.after(self.timeout);
            self.units.misses(place, (read, asked, missed), Fault::Timeout, now, self.spans());
        }
    }
}
