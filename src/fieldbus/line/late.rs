//! Waiting for late answers of units whose answers do not name their question.
//!
//! On a line of RTU frames the wire receives a late answer and discards it. A gateway from Modbus TCP to a serial line may
//! stamp it with the transaction that is open when it arrives. Then nothing distinguishes it from the answer to that question.
//! So after a missed answer no question of the same form goes to that unit while the late answer may arrive. It then finds no
//! open transaction.
//!
//! A gateway that keeps a late answer until the next question comes is not cured by waiting: see `order.rs`.

use std::time::Duration;

use super::DeviceLine;
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::wire::Request;
use isotherm_core::quantity::Moment;

impl DeviceLine {
    /// Waits until no late answer of the unit could be taken for the answer to this request.
    pub(super) async fn hear_out(&mut self, place: usize, request: Request<'_>) -> Result<(), Fault> {
        let spans = self.spans();
        let (number, is_behind_gateway) =
            (self.units.at(place).number, self.units.at(place).is_behind_gateway);
        let Some(connection) = &mut self.wire else { return Err(Fault::Link(LinkFault::Down)) };
        let owed = self.units.owed.of(number);
        loop {
            // On a new connection nothing waits yet of what is said out of turn. A gateway says nothing out of turn.
            let least = if self.has_answered || is_behind_gateway { Duration::ZERO } else { self.timeout };
            let anything = owed.left_of_anything(spans).map(|left| left.max(least));
            let left = anything.unwrap_or_else(|| owed.left(request, spans));
            if anything.is_none() && left.is_zero() {
                break;
            }
            self.departure.away_for(left + self.timeout);
            let heard = if is_behind_gateway {
                tokio::time::sleep(left).await;
                Ok(())
            } else {
                connection.wire().listen(number, left, self.timeout).await
            };
            self.departure.look();
            if connection.wire().heard_late().contains(&number) {
                owed.distrust();
            }
            heard?;
            if anything.is_some() {
                owed.is_quiet();
            }
        }
        let has_ids = connection.wire().has_transaction_id();
        if !has_ids {
            connection.wire().pass_over(self.units.owed.marks().collect());
        }
        if !has_ids || is_behind_gateway {
            self.units.owed.each().for_each(|owed| owed.forget(spans));
        }
        Ok(())
    }

    /// Notes that the unit has not answered in time, and that its answer may still come.
    pub(super) fn note_miss(&mut self, place: usize, request: Request<'_>, fault: Fault, now: Moment) {
        let asked = self.departure.asked().unwrap_or(now);
        // A gateway answers for the unit after a timeout of its own, and the late answer has its time from then on.
        let missed = if fault.is_of_a_gateway() { self.departure.looked() } else { now.after(self.timeout) };
        self.units.misses(place, (request, asked, missed), fault, now, self.spans());
    }
}
