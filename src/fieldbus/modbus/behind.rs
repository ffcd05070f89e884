//! A read that goes out in one segment behind another question (`pipeline = 2`): while the device carries out the one, the
//! other is there already. Whoever asks that read next is given its answer, which is as old as its question.

use crate::fieldbus::departure::Departure;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::quantity::Moment;

/// At most one read behind a question.
#[derive(Debug, Default)]
pub(super) struct Behind {
    /// It goes out with the next question.
    next: Option<(u8, Request<'static>)>,
    open: Option<Open>,
}

/// One that has gone out.
#[derive(Debug)]
struct Open {
    unit: u8,
    request: Request<'static>,
    transaction: u16,
    asked: Moment,
    answer: Option<Result<Answer, Fault>>,
}

impl Behind {
    /// It goes out with the next question; with `None` nothing does. One that has not been answered is enough.
    pub(super) fn ask(&mut self, read: Option<(u8, Request<'static>)>) {
        self.next = read.filter(|_| self.unanswered().is_none());
    }

    /// One goes out with the next question, or has not been answered.
    pub(super) fn is_under_way(&self) -> bool {
        self.next.is_some() || self.unanswered().is_some()
    }

    pub(super) fn take_question(&mut self) -> Option<(u8, Request<'static>)> {
        self.next.take()
    }

    pub(super) fn left(&mut self, unit: u8, request: Request<'static>, transaction: u16, asked: Moment) {
        self.open = Some(Open { unit, request, transaction, asked, answer: None });
    }

    /// What is still to be answered.
    pub(super) fn unanswered(&self) -> Option<(u16, u8, Request<'static>)> {
        let open = self.open.as_ref().filter(|open| open.answer.is_none())?;
        Some((open.transaction, open.unit, open.request))
    }

    pub(super) fn answered(&mut self, answer: Result<Answer, Fault>) {
        if let Some(open) = &mut self.open {
            open.answer = Some(answer);
        }
    }

    /// The answer, where this is the question, and when that left. One that nobody has asked for in the time that an answer
    /// is waited for is forgotten.
    pub(super) fn take(
        &mut self,
        unit: u8,
        request: Request<'_>,
        departure: &mut Departure,
        was_waited_for: bool,
    ) -> Option<(Result<Answer, Fault>, Moment)> {
        let is_it = |open: &mut Open| (open.unit, open.request) == (unit, request);
        let open = self.open.take_if(is_it)?;
        let is_young = was_waited_for || departure.is_patient_since(open.asked);
        Some((open.answer.filter(|_| is_young)?, open.asked))
    }
}
