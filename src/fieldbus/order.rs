//! Order of requests and answers of a unit behind a gateway from Modbus TCP to a serial line.
//!
//! Some gateways keep a late answer until the next request, and send it as the answer to that. From then on, each
//! request gets the answer to the one before it. Waiting does not help, and an answer of the correct length does not
//! show it.
//!
//! After a missing answer, the next read that is answered is therefore followed by a control question: a read whose
//! answer has another form. If it gets the answer to the first read, order is lost. The line then rejects the first
//! read too, closes the connection, and the unit backs off. Any other result of a control question is no reason to
//! reject the first read.
//!
//! Limits: the check does not detect a gateway that keeps two answers or more. It also does not detect a kept answer if
//! no answer to this line was missing.

use super::error::{Fault, PeerFault};
use super::mark::Mark;
use super::request::Request;

/// Control questions in a row without a result, after which the line sends no more until the next missing answer.
const ATTEMPTS: u8 = 3;
/// Maximum number of doublings of the pause after lost order.
const LONGEST_PAUSE: u8 = 5;

/// State of the order check of one unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Order {
    doubt: Doubt,
    shorter_reads: ShorterReads,
    /// Last two reads with data, whose answers have different forms.
    answered: [Option<Request<'static>>; 2],
    /// Control questions in a row that showed lost order.
    pub(super) lost: u8,
}

/// Whether the gateway may keep an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Doubt {
    /// The gateway may keep one. `attempts` counts the control questions without a result.
    Open { attempts: u8 },
    /// No answer was missing since order was confirmed, or the attempts to confirm it have ended.
    Closed,
}

/// Whether the unit answers control questions for fewer registers than a read has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ShorterReads {
    Untried,
    Answered,
    /// The unit did not answer such control questions.
    Unusable,
}

/// Control question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Control {
    /// Read that the unit has answered before.
    Answered(Request<'static>),
    /// First read again, with fewer registers.
    Shorter(Request<'static>),
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
        Order {
            doubt: Doubt::Open { attempts: 0 },
            shorter_reads: ShorterReads::Untried,
            answered: [None; 2],
            lost: 0,
        }
    }

    /// Records a request that was sent, and got no answer of its own.
    pub(super) fn misses(&mut self) {
        self.doubt = Doubt::Open { attempts: 0 };
    }

    /// Records a read with data.
    pub(super) fn is_answered(&mut self, request: Request<'_>) {
        let Request::Read { from, count } = request else { return };
        let read = Some(Request::Read { from, count });
        let [last, before] = self.answered;
        self.answered = match last {
            Some(last) if Mark::of(last) != Mark::of(request) => [read, Some(last)],
            _ => [read, before.filter(|before| Mark::of(*before) != Mark::of(request))],
        };
    }

    /// Returns the control question for this read, to ask before its answer is used. The forms of the two answers
    /// differ.
    pub(super) fn control(&self, request: Request<'_>) -> Option<Control> {
        let Request::Read { from, count } = request else { return None };
        if self.doubt == Doubt::Closed {
            return None;
        }
        let of_another_form = |read: &&Request<'static>| Mark::of(**read) != Mark::of(request);
        if let Some(read) = self.answered.iter().flatten().find(of_another_form) {
            return Some(Control::Answered(*read));
        }
        // Eight bits are one byte of an answer.
        let step = if from.table.is_bits() { 8 } else { 1 };
        (self.shorter_reads != ShorterReads::Unusable && count > step)
            .then(|| Control::Shorter(Request::Read { from, count: count - step }))
    }

    /// Records the result of a control question.
    pub(super) fn judge(&mut self, control: Control, answer: Result<(), Fault>) -> Verdict {
        let is_shorter = matches!(control, Control::Shorter(_));
        match answer {
            Ok(()) => {
                (self.doubt, self.lost) = (Doubt::Closed, 0);
                if is_shorter {
                    self.shorter_reads = ShorterReads::Answered;
                }
                Verdict::InOrder
            }
            Err(Fault::Peer(PeerFault::Length | PeerFault::Function)) => {
                self.lost = LONGEST_PAUSE.min(self.lost + 1);
                Verdict::OutOfOrder
            }
            Err(_) => {
                self.doubt = match self.doubt {
                    Doubt::Open { attempts } if attempts + 1 < ATTEMPTS => {
                        Doubt::Open { attempts: attempts + 1 }
                    }
                    _ => Doubt::Closed,
                };
                if self.doubt == Doubt::Closed && is_shorter && self.shorter_reads == ShorterReads::Untried {
                    self.shorter_reads = ShorterReads::Unusable;
                }
                Verdict::Nothing
            }
        }
    }
}

impl Control {
    /// Returns the request of this control question.
    pub(super) fn request(self) -> Request<'static> {
        match self {
            Control::Answered(request) | Control::Shorter(request) => request,
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

    /// Returns the state of a unit that has answered these reads.
    fn after(answered: &[Request<'static>]) -> Order {
        let mut order = Order::unknown();
        answered.iter().for_each(|read| order.is_answered(*read));
        order
    }

    #[test]
    fn a_control_question_asks_for_nothing_that_the_unit_has_not_answered() {
        let (bed, oil) = (read(Table::Input, 0, 1), read(Table::Input, 100, 1));
        let (block, kind) = (read(Table::Input, 5, 4), read(Table::Holding, 90, 1));
        let shorter = |table, offset, count| Some(Control::Shorter(read(table, offset, count)));
        for (answered, request, control) in [
            (&[][..], bed, None),
            (&[], block, shorter(Table::Input, 5, 3)),
            (&[], read(Table::Coil, 0, 8), None),
            (&[], read(Table::Coil, 0, 9), shorter(Table::Coil, 0, 1)),
            (&[bed, oil], bed, None),
            (&[block, bed, oil], bed, Some(Control::Answered(block))),
            (&[kind, bed, oil], oil, Some(Control::Answered(kind))),
            (&[bed, kind, block], block, Some(Control::Answered(kind))),
            (&[bed], Request::WriteSingle { at: 1, value: 2 }, None),
        ] {
            assert_eq!(after(answered).control(request), control, "{request:?} after {answered:?}");
        }
    }

    #[test]
    fn order_is_in_doubt_from_the_start_and_after_each_miss_until_it_is_shown() {
        let block = read(Table::Input, 5, 4);
        let mut order = Order::unknown();
        for _ in 0..2 {
            let control = order.control(block).unwrap();
            assert_eq!(order.judge(control, Ok(())), Verdict::InOrder);
            assert_eq!(order.control(block), None);
            order.misses();
        }
    }

    #[test]
    fn only_an_answer_of_another_form_shows_that_order_is_lost() {
        for (fault, verdict) in [
            (LENGTH, Verdict::OutOfOrder),
            (Fault::Peer(PeerFault::Function), Verdict::OutOfOrder),
            (Fault::Peer(PeerFault::Foreign), Verdict::Nothing),
            (Fault::Timeout, Verdict::Nothing),
            (Fault::Exception(2), Verdict::Nothing),
            (Fault::Exception(11), Verdict::Nothing),
        ] {
            let mut order = Order::unknown();
            let control = order.control(read(Table::Input, 5, 4)).unwrap();
            assert_eq!(order.judge(control, Err(fault)), verdict);
        }
    }

    #[test]
    fn a_unit_that_never_answers_shorter_reads_is_spared_them_and_one_that_did_is_asked_after_the_next_miss()
    {
        let block = read(Table::Input, 5, 4);
        for (was_answered, asked_again) in [(false, false), (true, true)] {
            let mut order = Order::unknown();
            if was_answered {
                let control = order.control(block).unwrap();
                assert_eq!(order.judge(control, Ok(())), Verdict::InOrder);
                order.misses();
            }
            for _ in 0..ATTEMPTS {
                let control = order.control(block).unwrap();
                assert_eq!(order.judge(control, Err(Fault::Timeout)), Verdict::Nothing);
            }
            assert_eq!(order.control(block), None);
            order.misses();
            assert_eq!(order.control(block).is_some(), asked_again);
        }
    }

    #[test]
    fn a_gateway_that_stays_one_answer_behind_is_found_each_time_whatever_the_unit_answers() {
        let (pair, one) = (read(Table::Input, 5, 2), read(Table::Input, 9, 1));
        let mut order = after(&[pair, one]);
        for request in [pair, one].into_iter().cycle().take(99) {
            let control = order.control(request).unwrap();
            assert_eq!(order.judge(control, Err(LENGTH)), Verdict::OutOfOrder);
            order.misses();
        }
    }
}
