//! Control questions: requests that show whether the answers of a unit behind a gateway belong to their requests. See
//! [`crate::fieldbus::order`].

use std::pin::pin;

use super::DeviceLine;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::order::Verdict;
use crate::fieldbus::wire::{Answer, Request};

impl DeviceLine {
    /// Returns the control question that must follow this request.
    pub(super) fn control_question(&self, place: usize, request: Request<'_>) -> Option<Request<'static>> {
        let unit = self.units.at(place);
        // If each answer ends its connection, the control question would need another connection.
        if !unit.is_behind_gateway || unit.quirks.close_after_each {
            return None;
        }
        let owed = self.units.owed.get(unit.number)?;
        // A late answer would be taken for the answer to the control question.
        let control = owed.order.control(request).filter(|_| !owed.is_owing())?;
        unit.functions.allow(control.function()).then_some(control)
    }

    /// Returns the answer to this request, after a control question if order is in doubt. `is_repeated` means that the
    /// answer may also be the late answer to the first attempt of this request.
    pub(super) async fn in_order(
        &mut self,
        place: usize,
        request: Request<'_>,
        answer: Result<Answer, Fault>,
        is_repeated: bool,
    ) -> Result<Answer, Fault> {
        let is_of_unit = match &answer {
            Ok(_) => true,
            Err(fault) => matches!(fault, Fault::Exception(_)) && !fault.is_of_a_gateway(),
        };
        if !is_of_unit || !self.units.at(place).is_behind_gateway {
            return answer;
        }
        if let Some(control) = self.control_question(place, request).filter(|_| !is_repeated) {
            self.ask_control(place, control).await?;
        }
        if answer.is_ok() {
            self.units.owed(place).order.record_answer(request);
        }
        answer
    }

    /// Asks a control question.
    ///
    /// # Errors
    /// Order is lost.
    async fn ask_control(&mut self, place: usize, request: Request<'static>) -> Result<(), Fault> {
        let (device, number) = (self.units.at(place).device, self.units.at(place).number);
        // The pause after a fault counts from the start of the request.
        let now = self.departure.looked();
        let begun = self.tap.begin();
        self.departure.next(request, Leave::Whenever);
        if self.make_ready(place, request, now).await.is_err() {
            return Ok(());
        }
        let Some(connection) = &mut self.wire else { return Ok(()) };
        let span = self.timeout + connection.wire().time_under_way(request);
        self.departure.begins(span);
        let exchanged = {
            let exchange = pin!(connection.exchange(number, request, &mut self.departure));
            self.patience.within(span, exchange).await
        };
        let answered = match exchanged {
            Some(answered) if self.departure.took() <= span => answered,
            _ => Err(connection.wire().missed()),
        };
        if let Some(begun) = begun {
            self.tap.tell(begun, (device, number), request, &answered);
        }
        self.look_for_a_break(place, &answered, now);
        let order = &mut self.units.owed(place).order;
        let verdict = order.judge(request, answered.as_ref().map(|_| ()).map_err(|fault| *fault));
        let lost = order.lost;
        let fault = match (verdict, answered) {
            (Verdict::InOrder, _) | (Verdict::Nothing, Ok(_)) => return Ok(()),
            (Verdict::OutOfOrder, _) => Fault::Peer(PeerFault::OutOfOrder),
            (Verdict::Nothing, Err(fault)) => fault,
        };
        // The pause is doubled first: the wait for a late answer is not shortened by it.
        (0..lost).for_each(|_| self.units.at_mut(place).breaker.fail(now));
        // The connection and the unit are treated as after any other request.
        let _ = self.settle(place, request, Err(fault), now);
        if verdict == Verdict::OutOfOrder { Err(fault) } else { Ok(()) }
    }
}
