//! Check that the answers of a unit behind a Modbus gateway belong to their requests. Such a Modbus gateway connects
//! Modbus TCP to a serial line.
//!
//! Some Modbus gateways keep a late answer until the next request, and send it as the answer to that request. From then
//! on, each request gets the answer to the request before. Waiting does not help. Such an answer can have the correct
//! length, so the length does not show the mistake.
//!
//! After a missing answer, the order is in doubt. The Modbus gateway may keep the missing answer, and the answers to
//! the reads since then. If a good answer has another form (function and length) than all of these, it belongs to its
//! request. It also shows that the Modbus gateway keeps nothing. A good answer of one of these forms may be a kept
//! answer. In this case the Modbus gateway now keeps the answer to the present request.
//!
//! Some reads have an answer that could be confused with a kept answer. Before such a read, the line sends a control
//! question: another read that the unit has answered before, and whose answer has another form. If the answer to the
//! control question has the form of a kept answer instead, the order is lost. The line then does not send the first
//! read and closes the connection, and the unit backs off. If the unit refuses the control question, the line sends the
//! first read, because a kept answer to the control question has another form. If the unit does not answer the control
//! question, it may be dead. The line then sends the next read of another form without a control question.
//!
//! Limits: a Modbus gateway that keeps two or more answers is not always detected. The same applies to a Modbus gateway
//! that keeps an answer although no answer of this unit was missing. A unit is not protected before it has answered
//! reads of two forms. It is not protected if it gets only reads of one form, or if each request has its own
//! connection. After a control question has failed twice in a row, the unit is not protected until it has answered the
//! same read as an ordinary read. Answers to writes are not checked by control questions.

use super::reply_signature::ReplySignature;
use super::request::ModbusRequest;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::request::Request;

/// Maximum number of times that the pause of a unit doubles. The pause begins after an answer that belongs to an
/// earlier request.
const LONGEST_PAUSE: u8 = 5;

/// State of the order check of one unit. The check detects a Modbus gateway that answers each request with the answer
/// to an earlier request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::fieldbus) struct OrderCheck {
    doubt: AnswerUse,
    /// Last two reads that were answered with data. Their answers differ in form (function and length).
    answered: [Option<Request<'static>>; 2],
    /// Last control question (read that checks the order of the answers), if it was not answered with data. `None`
    /// after the next request.
    failed: Option<Request<'static>>,
    /// Control question (read that checks the order of the answers) that has failed once. After a second failure in a
    /// row, the line no longer uses this control question.
    unsure: Option<Request<'static>>,
    /// Number of consecutive answers that belonged to an earlier request.
    pub(in crate::fieldbus) lost: u8,
}

/// Knowledge about late answers that the Modbus gateway between TCP and the serial line may still keep. The
/// Modbus gateway would send such an answer as the answer to a later request.
#[derive(Clone, Debug, PartialEq, Eq)]
enum AnswerUse {
    /// The Modbus gateway may keep an answer to a request of an earlier process. No request of this process has ended
    /// yet.
    Unknown,
    /// The Modbus gateway may keep answers of these forms (function and length). The list is not empty.
    Kept(Vec<ReplySignature>),
    /// The Modbus gateway keeps no answer.
    Closed,
}

impl OrderCheck {
    /// Returns the state of a unit before its first request.
    pub(in crate::fieldbus) fn unknown() -> OrderCheck {
        OrderCheck { doubt: AnswerUse::Unknown, answered: [None; 2], failed: None, unsure: None, lost: 0 }
    }

    /// Returns whether the Modbus gateway may keep a late answer, so that the order of the answers is in doubt.
    pub(in crate::fieldbus) fn is_in_doubt(&self) -> bool {
        self.doubt != AnswerUse::Closed
    }

    /// Records that the Modbus gateway in front of the device may still hold back a late answer of this form (function
    /// and length).
    pub(in crate::fieldbus) fn suspect(&mut self, form: ReplySignature) {
        if let AnswerUse::Kept(forms) = &mut self.doubt {
            if !forms.contains(&form) {
                forms.push(form);
            }
        } else {
            self.doubt = AnswerUse::Kept(vec![form]);
        }
    }

    /// Returns the control question: another read, to be sent before this one, which checks the order of the answers.
    /// Its answer differs in form (function and length) from the answer to this read, and if possible from every kept
    /// answer. Returns `None` if the answer to this read cannot be confused with a kept answer. Returns `None` also if
    /// the unit has answered no suitable read for which `is_allowed` is true.
    pub(in crate::fieldbus) fn control(
        &self,
        request: Request<'_>,
        is_allowed: impl Fn(Request<'static>) -> bool,
    ) -> Option<Request<'static>> {
        let form = ReplySignature::of(request);
        // The answer to the failed control question may be kept, and has another form.
        let follows_failed = self.failed.is_some_and(|failed| ReplySignature::of(failed) != form);
        if !matches!(request, Request::Modbus(ModbusRequest::Read { .. }))
            || !self.may_be_kept(form)
            || follows_failed
        {
            return None;
        }
        let others = self.answered.iter().flatten().copied();
        let others = others.filter(|read| ReplySignature::of(*read) != form && is_allowed(*read));
        others.min_by_key(|read| self.may_be_kept(ReplySignature::of(*read)))
    }

    /// Records the result of a request that was sent. `received` is the form (function and length) of the received
    /// answer; `None` if no answer to a read was received. `may_be_late` says whether a late answer may still arrive at
    /// the line. Returns true if the answer belongs to an earlier request.
    pub(in crate::fieldbus) fn assess(
        &mut self,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        received: Option<ReplySignature>,
        may_be_late: bool,
    ) -> bool {
        let form = ReplySignature::of(request);
        let failed = self.failed.take();
        match outcome {
            Ok(()) => {
                // A single lost answer is chance. After two, the unit is silent only for the control question, or
                // refuses only that.
                let is_dead = failed.is_some() && self.unsure == failed;
                if is_dead {
                    self.answered
                        .iter_mut()
                        .for_each(|read| *read = read.filter(|read| Some(*read) != failed));
                }
                self.unsure = match failed {
                    Some(_) => failed.filter(|_| !is_dead),
                    None => self.unsure.filter(|read| *read != request),
                };
                self.record_answer(request);
                self.confirm(form);
                false
            }
            Err(Fault::Peer(PeerFault::Length | PeerFault::Function))
                if received.is_some_and(|received| self.may_be_kept(received)) && self.has_answered(form) =>
            {
                self.suspect(form);
                if !may_be_late {
                    self.lost = LONGEST_PAUSE.min(self.lost + 1);
                }
                true
            }
            Err(fault) => {
                let is_missing = fault.spoils_connection() || fault.is_of_a_gateway();
                let is_in_doubt = self.is_in_doubt();
                // The echo of a write is never mistaken for the answer to a read. One such form in the list is enough
                // to show the doubt.
                let is_kept =
                    if request.is_read() { is_missing || is_in_doubt } else { is_missing && !is_in_doubt };
                if is_kept {
                    self.suspect(form);
                }
                false
            }
        }
    }

    /// Records that a control question (read that checks the order of the answers) failed with this fault. The next
    /// read of another form is then sent without a control question, except if the fault shows that the order is lost.
    /// If a control question fails twice in a row while other reads are answered, the line no longer uses it. The line
    /// uses it again after the unit has answered the same read as an ordinary read.
    pub(in crate::fieldbus) fn record_failed_control(&mut self, control: Request<'static>, fault: Fault) {
        if !matches!(fault, Fault::Caller(_) | Fault::Peer(PeerFault::OutOfOrder)) {
            self.failed = Some(control);
        }
    }

    /// Records that a valid answer of this form (function and length) arrived. Removes the doubt that this answer
    /// disproves.
    fn confirm(&mut self, form: ReplySignature) {
        match &mut self.doubt {
            AnswerUse::Closed => {}
            // The answer may be an old one. Then the Modbus gateway keeps the answer to the present request.
            AnswerUse::Kept(forms) if forms.contains(&form) => forms.retain(|kept| *kept == form),
            AnswerUse::Kept(_) => (self.doubt, self.lost) = (AnswerUse::Closed, 0),
            AnswerUse::Unknown => self.doubt = AnswerUse::Kept(vec![form]),
        }
    }

    /// Records that a read was answered with data. The line can then send this read as a control question, which checks
    /// the order of the answers.
    fn record_answer(&mut self, request: Request<'_>) {
        let Request::Modbus(ModbusRequest::Read { from, count }) = request else { return };
        let read = Some(Request::read_registers(from, count));
        let [last, before] = self.answered;
        self.answered = match last {
            Some(last) if ReplySignature::of(last) != ReplySignature::of(request) => [read, Some(last)],
            _ => [read, before.filter(|before| ReplySignature::of(*before) != ReplySignature::of(request))],
        };
    }

    fn may_be_kept(&self, form: ReplySignature) -> bool {
        matches!(&self.doubt, AnswerUse::Kept(forms) if forms.contains(&form))
    }

    fn has_answered(&self, form: ReplySignature) -> bool {
        self.answered.iter().flatten().any(|read| ReplySignature::of(*read) == form)
    }
}

#[cfg(test)]
mod tests;
