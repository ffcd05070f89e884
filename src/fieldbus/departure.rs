//! When a question leaves: the last look at the clock before its first byte.

use std::time::Duration;

use super::error::{CallerFault, Fault};
use super::request::Request;
use crate::clock::{Clock, Looks};
use isotherm_core::quantity::Moment;

/// Until when a question may leave, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leave {
    /// Whenever it can: it rests on nothing that grows old.
    Whenever,
    /// By this moment.
    By(Moment),
    /// By this moment, and on the connection that there is: what it goes by was read there.
    Here(Moment),
}

/// The looks that a line has at the clock. A wire calls [`Departure::leave`] right before the first byte of a question,
/// after whatever it has waited for.
#[derive(Debug)]
pub struct Departure {
    clock: Clock,
    looks: Looks,
    /// Somebody takes note where the computer stands still.
    is_watched: bool,
    /// The computer has stood still since this look, and nobody has taken note of it.
    stood_still: Option<Moment>,
    is_read: bool,
    not_after: Moment,
    asked: Option<Moment>,
    /// How long its answer is waited for.
    patience: Duration,
    /// Age counts from the answer, and no answer comes too late: only to show what the rule is for.
    is_credulous: bool,
}

impl Departure {
    /// Questions that leave whenever the wire is ready.
    pub fn whenever(clock: &Clock) -> Departure {
        Departure {
            clock: clock.clone(),
            looks: Looks::begin(clock.now(), Duration::MAX),
            is_watched: false,
            stood_still: None,
            is_read: true,
            not_after: Moment::END,
            asked: None,
            patience: Duration::ZERO,
            is_credulous: false,
        }
    }

    pub(super) fn credulous(self) -> Departure {
        Departure { is_credulous: true, ..self }
    }

    pub(super) fn aged(self, max_age: Duration) -> Departure {
        // Virtual time passes only as everybody sleeps: it does not stand still, it may be moved.
        let is_watched = !self.clock.is_virtual();
        Departure { looks: Looks::begin(self.clock.now(), max_age), is_watched, ..self }
    }

    /// The next question.
    pub(super) fn next(&mut self, request: Request<'_>, leave: Leave) {
        let not_after = match leave {
            Leave::Whenever => Moment::END,
            Leave::By(moment) | Leave::Here(moment) => moment,
        };
        (self.is_read, self.not_after, self.asked) = (request.is_read(), not_after, None);
    }

    /// The question leaves now.
    ///
    /// # Errors
    /// It is too late for it, or it was made up before the computer stood still: nothing must be sent.
    pub fn leave(&mut self) -> Result<Moment, Fault> {
        let now = self.look();
        self.looks.away_for(self.patience);
        if now > self.not_after || (self.stood_still.is_some() && !self.is_read) {
            return Err(Fault::Caller(CallerFault::TooLate));
        }
        self.asked = Some(now);
        Ok(now)
    }

    /// The question has left already, behind another one.
    pub(super) fn left(&mut self, asked: Moment) {
        self.asked = Some(asked);
    }

    /// An answer to what left then would still be waited for.
    pub(super) fn is_patient_since(&mut self, asked: Moment) -> bool {
        self.look().since(asked) <= self.patience
    }

    /// The question is about to leave, and its answer is waited for so long.
    pub(super) fn begins(&mut self, patience: Duration) {
        self.patience = patience;
        self.looks.away_for(patience);
    }

    /// When it left; `None` where it has not.
    pub fn asked(&self) -> Option<Moment> {
        if self.is_credulous { self.asked.map(|_| self.clock.now()) } else { self.asked }
    }

    /// How long ago it left.
    pub(super) fn took(&mut self) -> Duration {
        let now = self.look();
        // Virtual time does not pass while somebody waits for an answer; it may be moved.
        if self.clock.is_virtual() || self.is_credulous {
            Duration::ZERO
        } else {
            now.since(self.asked.unwrap_or(now))
        }
    }

    /// What comes next takes this long.
    pub fn away_for(&mut self, span: Duration) {
        self.looks.away_for(span);
    }

    /// Looks at the clock.
    pub(super) fn look(&mut self) -> Moment {
        let now = self.clock.now();
        self.look_at(now);
        now
    }

    /// Takes note of a look.
    pub fn look_at(&mut self, now: Moment) {
        let gap = self.looks.look(now);
        if self.is_watched && !self.is_credulous {
            self.stood_still = self.stood_still.or(gap);
        }
    }

    /// The last look.
    pub(super) fn looked(&self) -> Moment {
        self.looks.last()
    }

    /// The computer has stood still, and nobody has taken note of it.
    pub fn has_stood_still(&self) -> bool {
        self.stood_still.is_some()
    }

    /// The last look before the computer stood still, once.
    pub fn stood_still(&mut self) -> Option<Moment> {
        self.stood_still.take()
    }
}
