//! Order of requests and answers of a unit behind a gateway from Modbus TCP to a serial line.
//!
//! Some gateways keep a late answer until the next request, and send it as the answer to that. From then on, each
//! request gets the answer to the one before it. Waiting does not help, and an answer of the correct length does not
//! show it.
//!
//! After a missing answer, a read that is answered is therefore followed by a control question: another read that the
//! unit has answered before, whose answer has another form. If an answer of a wrong form comes instead, order is lost.
//! The line then rejects the first read too, closes the connection, and the unit backs off. A control question that is
//! refused or not answered shows nothing, and the first read is used.
//!
//! Limits. Not detected are: a gateway that keeps two answers or more, that loses the answer to the first read, or that
//! keeps an answer although no answer to this unit was missing. Nor is a unit protected while it refuses requests, if only
//! reads of one form are sent to it, or with a connection for each request. The answer to a write has no control question.

use super::error::{Fault, PeerFault};
use super::mark::Mark;
use super::request::Request;

/// Maximum number of doublings of the pause after lost order.
const LONGEST_PAUSE: u8 = 5;

/// State of the order check of one unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Order {
    doubt: Doubt,
    /// Last two reads with data, whose answers have different forms.
    answered: [Option<Request<'static>>; 2],
    /// Control questions in a row that showed lost order.
    pub(super) lost: u8,
}

/// Whether the gateway may keep an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doubt {
    /// The gateway may keep one.
    Open,
    /// No answer was missing since order was confirmed.
    Closed,
}

/// Conclusion from the result of a control question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    InOrder,
    OutOfOrder,
    Nothing,
}

impl Order {
    /// Returns the state of a unit without requests so far. The gateway may keep an answer to an earlier process.
    pub(super) fn unknown() -> Order {
        Order { doubt: Doubt::Open, answered: [None; 2], lost: 0 }
    }

    /// Records a request that was sent, and got no answer of its own.
    pub(super) fn record_miss(&mut self) {
        self.doubt = Doubt::Open;
    }

    /// Records that a read was answered with data. It becomes a candidate for control questions.
    pub(super) fn record_answer(&mut self, request: Request<'_>) {
        let Request::Read { from, count } = request else { return };
        let read = Some(Request::Read { from, count });
        let [last, before] = self.answered;
        self.answered = match last {
            Some(last) if Mark::of(last) != Mark::of(request) => [read, Some(last)],
            _ => [read, before.filter(|before| Mark::of(*before) != Mark::of(request))],
        };
    }

    /// Returns the control question for this read, to ask before its answer is used. The forms of the two answers
    /// differ. `None` if order is not in doubt, or if the unit has not answered such a read.
    pub(super) fn control(&self, request: Request<'_>) -> Option<Request<'static>> {
        let is_asked = self.doubt == Doubt::Open && matches!(request, Request::Read { .. });
        let of_another_form = |read: &Request<'static>| Mark::of(*read) != Mark::of(request);
        self.answered.iter().flatten().copied().filter(|_| is_asked).find(of_another_form)
    }

    /// Records the result of a control question. One that shows nothing is not asked again until the unit has answered it
    /// as an ordinary read.
    pub(super) fn judge(&mut self, control: Request<'_>, answer: Result<(), Fault>) -> Verdict {
        match answer {
            Ok(()) => {
                (self.doubt, self.lost) = (Doubt::Closed, 0);
                Verdict::InOrder
            }
            Err(Fault::Peer(PeerFault::Length | PeerFault::Function)) => {
                self.lost = LONGEST_PAUSE.min(self.lost + 1);
                Verdict::OutOfOrder
            }
            Err(_) => {
                for read in &mut self.answered {
                    *read = read.filter(|read| Mark::of(*read) != Mark::of(control));
                }
                self.lost = 0;
                Verdict::Nothing
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{Register, Table};

    const LENGTH: Fault = Fault::Peer(PeerFault::Length);

    fn read(table: Table, offset: u16, count: u16) -> Request<'static> {
        Request::Read { from: Register { table, offset }, count }
    }

    /// Returns the order of a unit that has answered these reads.
    fn after(answered: &[Request<'static>]) -> Order {
        let mut order = Order::unknown();
        answered.iter().for_each(|read| order.record_answer(*read));
        order
    }

    #[test]
    fn a_control_question_asks_for_nothing_that_the_unit_has_not_answered() {
        let (bed, oil) = (read(Table::Input, 0, 1), read(Table::Input, 100, 1));
        let (block, kind) = (read(Table::Input, 5, 4), read(Table::Holding, 90, 1));
        for (answered, request, control) in [
            (&[][..], bed, None),
            (&[], block, None),
            (&[block], block, None),
            (&[bed, oil], bed, None),
            (&[block, bed, oil], bed, Some(block)),
            (&[kind, bed, oil], oil, Some(kind)),
            (&[bed, kind, block], block, Some(kind)),
            (&[bed], Request::WriteSingle { at: 1, value: 2 }, None),
        ] {
            assert_eq!(after(answered).control(request), control, "{request:?} after {answered:?}");
        }
    }

    #[test]
    fn order_is_in_doubt_from_the_start_and_after_each_miss_until_it_is_confirmed() {
        let (bed, block) = (read(Table::Input, 0, 1), read(Table::Input, 5, 4));
        let mut order = after(&[bed, block]);
        for _ in 0..2 {
            assert_eq!(order.control(block), Some(bed));
            assert_eq!(order.judge(bed, Ok(())), Verdict::InOrder);
            assert_eq!(order.control(block), None);
            order.record_miss();
        }
    }

    #[test]
    fn only_an_answer_of_a_wrong_form_shows_that_order_is_lost() {
        let (bed, block) = (read(Table::Input, 0, 1), read(Table::Input, 5, 4));
        for (fault, verdict) in [
            (LENGTH, Verdict::OutOfOrder),
            (Fault::Peer(PeerFault::Function), Verdict::OutOfOrder),
            (Fault::Peer(PeerFault::Foreign), Verdict::Nothing),
            (Fault::Timeout, Verdict::Nothing),
            (Fault::Exception(2), Verdict::Nothing),
            (Fault::Exception(11), Verdict::Nothing),
        ] {
            let mut order = after(&[bed, block]);
            assert_eq!(order.judge(bed, Err(fault)), verdict);
            assert_eq!(order.control(block).is_some(), verdict == Verdict::OutOfOrder, "{fault:?}");
            order.record_answer(bed);
            assert_eq!(order.control(block), Some(bed), "it has been answered again");
        }
    }

    #[test]
    fn a_gateway_that_stays_one_answer_behind_is_found_each_time() {
        let (pair, one) = (read(Table::Input, 5, 2), read(Table::Input, 9, 1));
        let mut order = after(&[pair, one]);
        for request in [pair, one].into_iter().cycle().take(99) {
            let control = order.control(request).unwrap();
            assert_eq!(order.judge(control, Err(LENGTH)), Verdict::OutOfOrder);
        }
        assert_eq!(order.lost, LONGEST_PAUSE);
    }
}
