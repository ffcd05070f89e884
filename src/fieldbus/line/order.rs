//! Order of questions and answers of a unit behind a gateway from Modbus TCP to a serial line.
//!
//! Some gateways keep a late answer until the next question comes, and give it as the answer to that. From then on each question
//! gets the answer to the one before it. Waiting does not help, and an answer of the right length does not show it.
//!
//! So after an answer was missed, the next read that is answered is followed by a question for a similar read whose answer has
//! another length. If questions and answers are in order, it gets an answer of that length, or a refusal of these registers. If it
//! gets the answer to the read, they are not. Then the read is not used either, the connection is closed, and the unit rests.

use std::pin::pin;

use super::DeviceLine;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::Register;
use isotherm_core::quantity::Moment;
use isotherm_profile::Quirks;

/// Control questions in a row without a usable answer, after which a unit that never gave one is not asked any more.
const ATTEMPTS: u8 = 3;

/// Knowledge about one unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fieldbus) enum Order {
    /// An answer may be kept somewhere. So many control questions in a row were of no use, if none was ever answered.
    InDoubt(Control),
    /// Nothing was missed since it was last shown.
    Shown,
    /// The unit does not answer control questions.
    NotShowable,
}

/// Experience with control questions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::fieldbus) enum Control {
    /// None was answered, and so many in a row were of no use.
    Untried(u8),
    /// One was answered.
    Works,
}

impl Order {
    /// Order of a unit that nobody has asked yet. What a former gateway process asked may be kept.
    pub(in crate::fieldbus) const UNKNOWN: Order = Order::InDoubt(Control::Untried(0));

    /// Notes that a question has left and has no answer of its own.
    pub(super) fn misses(&mut self, fault: Fault) {
        *self = match *self {
            Order::Shown => Order::InDoubt(Control::Works),
            // The answer to another question shows that the unit is not to blame for unusable control questions.
            Order::InDoubt(Control::Untried(_)) if matches!(fault, Fault::Peer(_)) => Order::UNKNOWN,
            other => other,
        };
    }

    /// Returns whether order must be shown before an answer is used.
    pub(super) fn is_in_doubt(self) -> bool {
        matches!(self, Order::InDoubt(_))
    }

    /// Notes the answer to the control question that followed a read. `is_refused` says that the read was refused.
    ///
    /// # Errors
    /// The answer to the read may be that to another question.
    pub(super) fn judge(&mut self, is_refused: bool, answer: Result<(), Fault>) -> Result<(), Fault> {
        match answer {
            // An answer of the length that was asked for.
            Ok(()) => *self = Order::Shown,
            // A refusal after data: there is no such register, or this is no valid count.
            Err(Fault::Exception(2 | 3)) if !is_refused => *self = Order::Shown,
            // A refusal after a refusal does not show which is which. The read is refused either way.
            Err(fault @ Fault::Exception(_)) if is_refused && !fault.is_of_a_gateway() => {}
            Err(fault) => {
                *self = self.after_no_use();
                return Err(match fault {
                    Fault::Peer(_) => Fault::Peer(PeerFault::OutOfOrder),
                    _ => fault,
                });
            }
        }
        Ok(())
    }

    fn after_no_use(self) -> Order {
        match self {
            Order::InDoubt(Control::Untried(unusable)) if unusable + 1 < ATTEMPTS => {
                Order::InDoubt(Control::Untried(unusable + 1))
            }
            Order::InDoubt(Control::Untried(_)) => Order::NotShowable,
            other => other,
        }
    }
}

/// Returns a read whose answer has another length than that of this one, and which needs as few other registers as can be. `None`
/// where it would need registers behind those that were asked for, and the unit must not be asked for such.
fn similar_read(request: Request<'_>, quirks: Quirks) -> Option<Request<'static>> {
    let Request::Read { from, count } = request else { return None };
    // Eight bits are one byte of an answer.
    let step = if from.table.is_bits() { 8 } else { 1 };
    let count = if count > step {
        count - step
    } else if quirks.max_gap >= step && count < quirks.max_registers_per_request {
        count + step
    } else {
        return None;
    };
    let control = Request::Read { from, count };
    control.fits().then_some(control)
}

impl DeviceLine {
    /// Returns the question that must follow this request before its answer is used.
    pub(super) fn control_question(&self, place: usize, request: Request<'_>) -> Option<Request<'static>> {
        let unit = self.units.at(place);
        let is_in_doubt = || self.units.owed.get(unit.number).is_some_and(|owed| owed.order.is_in_doubt());
        // A connection that is closed after each answer would be made once more for it.
        let is_asked = unit.is_behind_gateway && !unit.quirks.close_after_each && is_in_doubt();
        is_asked.then(|| similar_read(request, unit.quirks)).flatten()
    }

    /// Returns the answer to this request. Where order is in doubt, the control question is asked first; a fault of that takes the
    /// place of the answer.
    pub(super) async fn in_order(
        &mut self,
        place: usize,
        request: Request<'_>,
        answer: Result<Answer, Fault>,
        now: Moment,
    ) -> Result<Answer, Fault> {
        let is_refused = match &answer {
            Ok(_) => false,
            Err(fault @ Fault::Exception(_)) if !fault.is_of_a_gateway() => true,
            Err(_) => return answer,
        };
        match self.control_question(place, request) {
            Some(control) => self.show_order(place, control, is_refused, now).await.and(answer),
            None => answer,
        }
    }

    async fn show_order(
        &mut self,
        place: usize,
        control: Request<'static>,
        is_refused: bool,
        now: Moment,
    ) -> Result<(), Fault> {
        let (device, number) = (self.units.at(place).device, self.units.at(place).number);
        let begun = self.tap.begin();
        self.departure.next(control, Leave::Whenever);
        self.make_ready(place, control, now).await?;
        let Some(connection) = &mut self.wire else { return Ok(()) };
        let span = self.timeout + connection.wire().time_under_way(control);
        self.departure.begins(span);
        let exchanged = {
            let exchange = pin!(connection.exchange(number, control, &mut self.departure));
            self.patience.within(span, exchange).await
        };
        let answered = match exchanged {
            Some(answered) if self.departure.took() <= span => answered,
            _ => Err(connection.wire().missed()),
        };
        if let Some(begun) = begun {
            self.tap.tell(begun, (device, number), control, &answered);
        }
        self.look_for_a_break(place, &answered, now);
        let judged = self.units.owed.of(number).order.judge(is_refused, answered.map(drop));
        judged.or_else(|fault| self.settle(place, control, Err(fault), now).map(drop))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::Table;

    const LENGTH: Fault = Fault::Peer(PeerFault::Length);

    fn read(table: Table, offset: u16, count: u16) -> Request<'static> {
        Request::Read { from: Register { table, offset }, count }
    }

    #[test]
    fn a_control_question_has_an_answer_of_another_length_and_needs_few_other_registers() {
        let usual = Quirks::default();
        let tight = Quirks { max_gap: 0, ..usual };
        for (table, offset, count, quirks, control) in [
            (Table::Input, 5, 4, usual, Some(3)),
            (Table::Input, 5, 2, tight, Some(1)),
            (Table::Input, 5, 1, usual, Some(2)),
            (Table::Input, 5, 1, tight, None),
            (Table::Holding, 65535, 1, usual, None),
            (Table::Coil, 0, 9, usual, Some(1)),
            (Table::Coil, 0, 3, usual, Some(11)),
            (Table::Coil, 0, 3, tight, None),
        ] {
            let expected = control.map(|count| read(table, offset, count));
            assert_eq!(
                similar_read(read(table, offset, count), quirks),
                expected,
                "{table:?} {offset} {count}"
            );
        }
        assert_eq!(similar_read(Request::WriteSingle { at: 1, value: 2 }, usual), None);
    }

    #[test]
    fn order_is_in_doubt_from_the_start_and_after_each_miss_until_it_is_shown() {
        for refusal in [Ok(()), Err(Fault::Exception(2)), Err(Fault::Exception(3))] {
            let mut order = Order::UNKNOWN;
            assert!(order.is_in_doubt());
            assert_eq!(order.judge(false, refusal), Ok(()));
            assert!(!order.is_in_doubt());
            order.misses(Fault::Timeout);
            assert!(order.is_in_doubt());
        }
    }

    #[test]
    fn an_answer_of_another_length_says_out_of_order_and_each_other_fault_says_itself() {
        let out_of_order = Fault::Peer(PeerFault::OutOfOrder);
        for (fault, expected) in [
            (LENGTH, out_of_order),
            (Fault::Peer(PeerFault::Function), out_of_order),
            (Fault::Timeout, Fault::Timeout),
            (Fault::Exception(6), Fault::Exception(6)),
            (Fault::Exception(11), Fault::Exception(11)),
        ] {
            let mut order = Order::UNKNOWN;
            assert_eq!(order.judge(false, Err(fault)), Err(expected));
            assert!(order.is_in_doubt());
        }
    }

    #[test]
    fn a_refused_read_stays_refused_if_its_control_question_is_refused_and_order_stays_in_doubt() {
        for (answer, judged, is_in_doubt) in [
            (Err(Fault::Exception(2)), Ok(()), true),
            (Err(Fault::Exception(6)), Ok(()), true),
            (Ok(()), Ok(()), false),
            (Err(LENGTH), Err(Fault::Peer(PeerFault::OutOfOrder)), true),
            (Err(Fault::Exception(11)), Err(Fault::Exception(11)), true),
        ] {
            let mut order = Order::UNKNOWN;
            assert_eq!((order.judge(true, answer), order.is_in_doubt()), (judged, is_in_doubt), "{answer:?}");
        }
    }

    #[test]
    fn a_unit_that_never_answers_control_questions_is_spared_them_and_one_that_did_is_not() {
        let mut order = Order::UNKNOWN;
        let left: Vec<_> =
            (0..4).map(|_| (order.judge(false, Err(Fault::Timeout)), order.is_in_doubt()).1).collect();
        assert_eq!(left, [true, true, false, false]);
        let mut order = Order::UNKNOWN;
        assert_eq!(order.judge(false, Ok(())), Ok(()));
        order.misses(Fault::Timeout);
        assert!((0..9).all(|_| order.judge(false, Err(Fault::Timeout)).is_err() && order.is_in_doubt()));
    }

    #[test]
    fn a_gateway_that_stays_one_answer_behind_is_not_taken_for_a_unit_without_control_questions() {
        let mut order = Order::UNKNOWN;
        for _ in 0..99 {
            // The read gets the answer to an earlier read, the control question that to the read, the next read that to the control question.
            assert!(order.judge(false, Err(LENGTH)).is_err());
            order.misses(LENGTH);
            assert!(order.is_in_doubt());
        }
    }
}
