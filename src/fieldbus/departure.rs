//! Send deadline of a request: the last check of the clock before its first byte.

use std::time::Duration;

use super::error::{CallerFault, Fault};
use super::request::Request;
use crate::clock::{Clock, Looks};
use isotherm_core::quantity::Moment;

/// Send deadline of a request, and the connection that it requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leave {
    /// No deadline: the request depends on no value that grows old.
    Whenever,
    /// Until this moment. After it, the request is not sent.
    By(Moment),
    /// Until this moment, and only on the present connection: the request depends on a value that was read there.
    Here(Moment),
}

/// Clock samples of a line, and the send deadline of its present request. A wire calls [`Departure::leave`] immediately
/// before the first byte of a request, after any wait.
#[derive(Debug)]
pub struct Departure {
    clock: Clock,
    looks: Looks,
    /// Whether gaps between clock samples are recorded.
    is_watched: bool,
    /// Last clock sample before the computer was stopped, until the owner of the line has read it.
    stood_still: Option<Moment>,
    is_read: bool,
    not_after: Moment,
    asked: Option<Moment>,
    /// Timeout of the answer.
    patience: Duration,
    /// Switches off two rules, for tests that show their purpose: age then counts from the answer, and no answer is
    /// late.
    is_credulous: bool,
}

impl Departure {
    /// Returns a departure for requests without a deadline.
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
        // Virtual time passes only while all sleepers sleep. It never stops by itself, but it may be moved.
        let is_watched = !self.clock.is_virtual();
        Departure { looks: Looks::begin(self.clock.now(), max_age), is_watched, ..self }
    }

    /// Begins the next request.
    pub(super) fn next(&mut self, request: Request<'_>, leave: Leave) {
        let not_after = match leave {
            Leave::Whenever => Moment::END,
            Leave::By(moment) | Leave::Here(moment) => moment,
        };
        (self.is_read, self.not_after, self.asked) = (request.is_read(), not_after, None);
    }

    /// Checks the clock immediately before the request is sent. Returns the time of sending.
    ///
    /// # Errors
    /// The deadline has passed, or a write was decided before the computer was stopped. The request must not be sent.
    pub fn leave(&mut self) -> Result<Moment, Fault> {
        let now = self.look();
        self.looks.away_for(self.patience);
        if now > self.not_after || (self.stood_still.is_some() && !self.is_read) {
            return Err(Fault::Caller(CallerFault::TooLate));
        }
        self.asked = Some(now);
        Ok(now)
    }

    /// Records that the request was already sent at `asked`, together with another one.
    pub(super) fn left(&mut self, asked: Moment) {
        self.asked = Some(asked);
    }

    /// Returns whether the timeout of a request that was sent at `asked` has not expired yet.
    pub(super) fn is_patient_since(&mut self, asked: Moment) -> bool {
        self.look().since(asked) <= self.patience
    }

    /// Announces that the request is about to be sent. `patience` is the timeout of its answer.
    pub(super) fn begins(&mut self, patience: Duration) {
        self.patience = patience;
        self.looks.away_for(patience);
    }

    /// Returns the time at which the request was sent; `None` if it was not sent.
    pub fn asked(&self) -> Option<Moment> {
        if self.is_credulous { self.asked.map(|_| self.clock.now()) } else { self.asked }
    }

    /// Returns the time since the request was sent; zero under a virtual clock.
    pub(super) fn took(&mut self) -> Duration {
        let now = self.look();
        // Virtual time does not pass while a task waits for an answer, but it may be moved.
        if self.clock.is_virtual() || self.is_credulous {
            Duration::ZERO
        } else {
            now.since(self.asked.unwrap_or(now))
        }
    }

    /// Sets the planned time until the next clock sample.
    pub fn away_for(&mut self, span: Duration) {
        self.looks.away_for(span);
    }

    /// Takes a clock sample.
    pub(super) fn look(&mut self) -> Moment {
        let now = self.clock.now();
        self.look_at(now);
        now
    }

    /// Records a clock sample.
    pub fn look_at(&mut self, now: Moment) {
        let gap = self.looks.look(now);
        if self.is_watched && !self.is_credulous {
            self.stood_still = self.stood_still.or(gap);
        }
    }

    /// Returns the last clock sample.
    pub(super) fn looked(&self) -> Moment {
        self.looks.last()
    }

    /// Returns whether the computer was stopped, and the owner of the line has not read that yet.
    pub fn has_stood_still(&self) -> bool {
        self.stood_still.is_some()
    }

    /// Returns the last clock sample before the computer was stopped, once.
    pub fn stood_still(&mut self) -> Option<Moment> {
        self.stood_still.take()
    }
}
