//! Send deadline of a request: the last check of the clock before its first byte.

use std::time::Duration;

use super::error::{CallerFault, Fault};
use super::request::Request;
use crate::clock::{Clock, StallDetector};
use isotherm_core::quantity::Moment;

/// Send deadline of a request, and the connection that it requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendDeadline {
    /// No deadline: the request depends on no value that grows old.
    None,
    /// Until this moment. After it, the request is not sent.
    By(Moment),
    /// Until this moment, and only on the present connection: the request depends on a value that was read there.
    OnConnection(Moment),
}

/// Clock samples of a line, and the send deadline of its present request. A wire calls [`SendGuard::leave`] immediately
/// before the first byte of a request, after any wait.
#[derive(Debug)]
pub struct SendGuard {
    clock: Clock,
    stall_detector: StallDetector,
    /// Whether gaps between clock samples are recorded.
    is_watched: bool,
    /// Last clock sample before the computer was stopped, until the owner of the line has read it.
    stalled_at: Option<Moment>,
    is_read: bool,
    not_after: Moment,
    asked: Option<Moment>,
    /// Timeout of the answer.
    timeout: Duration,
    /// Switches off two rules, for tests that show their purpose: age then counts from the answer, and no answer is
    /// late.
    is_unchecked: bool,
}

impl SendGuard {
    /// Returns a guard for requests without a deadline.
    pub fn without_deadline(clock: &Clock) -> SendGuard {
        SendGuard {
            clock: clock.clone(),
            stall_detector: StallDetector::begin(clock.now(), Duration::MAX),
            is_watched: false,
            stalled_at: None,
            is_read: true,
            not_after: Moment::END,
            asked: None,
            timeout: Duration::ZERO,
            is_unchecked: false,
        }
    }

    pub(super) fn unchecked(self) -> SendGuard {
        SendGuard { is_unchecked: true, ..self }
    }

    pub(super) fn aged(self, max_age: Duration) -> SendGuard {
        // Virtual time passes only while all sleepers sleep. It never stops by itself, but it may be moved.
        let is_watched = !self.clock.is_virtual();
        SendGuard { stall_detector: StallDetector::begin(self.clock.now(), max_age), is_watched, ..self }
    }

    /// Begins the next request.
    pub(super) fn next(&mut self, request: Request<'_>, leave: SendDeadline) {
        let not_after = match leave {
            SendDeadline::None => Moment::END,
            SendDeadline::By(moment) | SendDeadline::OnConnection(moment) => moment,
        };
        (self.is_read, self.not_after, self.asked) = (request.is_read(), not_after, None);
    }

    /// Checks the clock immediately before the request is sent. Returns the time of sending.
    ///
    /// # Errors
    /// The deadline has passed, or a write was decided before the computer was stopped. The request must not be sent.
    pub fn leave(&mut self) -> Result<Moment, Fault> {
        let now = self.sample();
        self.stall_detector.away_for(self.timeout);
        if now > self.not_after || (self.stalled_at.is_some() && !self.is_read) {
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
    pub(super) fn is_within_timeout(&mut self, asked: Moment) -> bool {
        self.sample().since(asked) <= self.timeout
    }

    /// Announces that the request is about to be sent. `timeout` is the timeout of its answer.
    pub(super) fn begins(&mut self, timeout: Duration) {
        self.timeout = timeout;
        self.stall_detector.away_for(timeout);
    }

    /// Returns the time at which the request was sent; `None` if it was not sent.
    pub fn asked(&self) -> Option<Moment> {
        if self.is_unchecked { self.asked.map(|_| self.clock.now()) } else { self.asked }
    }

    /// Returns the time since the request was sent; zero under a virtual clock.
    pub(super) fn took(&mut self) -> Duration {
        let now = self.sample();
        // Virtual time does not pass while a task waits for an answer, but it may be moved.
        if self.clock.is_virtual() || self.is_unchecked {
            Duration::ZERO
        } else {
            now.since(self.asked.unwrap_or(now))
        }
    }

    /// Sets the planned time until the next clock sample.
    pub fn away_for(&mut self, span: Duration) {
        self.stall_detector.away_for(span);
    }

    /// Takes a clock sample.
    pub(super) fn sample(&mut self) -> Moment {
        let now = self.clock.now();
        self.record_sample(now);
        now
    }

    /// Records a clock sample.
    pub fn record_sample(&mut self, now: Moment) {
        let gap = self.stall_detector.sample(now);
        if self.is_watched && !self.is_unchecked {
            self.stalled_at = self.stalled_at.or(gap);
        }
    }

    /// Returns the last clock sample.
    pub(super) fn last_sample(&self) -> Moment {
        self.stall_detector.last()
    }

    /// Returns whether the computer was stopped, and the owner of the line has not read that yet.
    pub fn has_stalled(&self) -> bool {
        self.stalled_at.is_some()
    }

    /// Returns the last clock sample before the computer was stopped, once.
    pub fn stalled_at(&mut self) -> Option<Moment> {
        self.stalled_at.take()
    }
}
