//! Deadline for sending a request, and the last check of the clock before its first byte is sent.

use std::time::Duration;

use super::error::{CallerFault, Fault};
use super::request::Request;
use crate::clock::{Clock, StallDetector};
use isotherm_core::quantity::Moment;

/// Limit on the sending of a request: none, a latest time, or a latest time on the present connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendDeadline {
    /// The request has no deadline, because it depends on no value that can become too old.
    None,
    /// The request must not be sent after this moment.
    By(Moment),
    /// The request must not be sent after this moment, and not on another connection. It depends on a value that was
    /// read on the present connection.
    OnConnection(Moment),
}

/// Clock samples of a line, and the deadline for sending its present request. A wire (open connection) calls
/// [`SendGuard::leave`] after any wait, immediately before the first byte of a request.
#[derive(Debug)]
pub struct SendGuard {
    clock: Clock,
    stall_detector: StallDetector,
    /// Whether a gap between clock samples counts as a stop of the computer. This is false under a virtual clock.
    is_watched: bool,
    /// Last clock sample before the computer was stopped; `None` if there was no stop, or the owner of the line has
    /// read this value.
    stalled_at: Option<Moment>,
    is_read: bool,
    not_after: Moment,
    asked: Option<Moment>,
    /// Timeout of the answer to the present request.
    timeout: Duration,
    /// Whether two rules are switched off, for tests that show their purpose. The age of a value then counts from the
    /// answer, and no answer is late.
    is_unchecked: bool,
}

impl SendGuard {
    /// Returns a send guard without a send deadline, which permits every request.
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

    /// Prepares the send guard for the next request, which counts as not sent. `leave` is the deadline for sending the
    /// request.
    pub(super) fn next(&mut self, request: Request<'_>, leave: SendDeadline) {
        let not_after = match leave {
            SendDeadline::None => Moment::END,
            SendDeadline::By(moment) | SendDeadline::OnConnection(moment) => moment,
        };
        (self.is_read, self.not_after, self.asked) = (request.is_read(), not_after, None);
    }

    /// Checks the deadline immediately before the request is sent. Returns the time of sending.
    ///
    /// # Errors
    /// The deadline has passed, or the computer was stopped after a write was decided. The request must not be sent.
    pub fn leave(&mut self) -> Result<Moment, Fault> {
        let now = self.sample();
        self.stall_detector.away_for(self.timeout);
        if now > self.not_after || (self.stalled_at.is_some() && !self.is_read) {
            return Err(Fault::Caller(CallerFault::TooLate));
        }
        self.asked = Some(now);
        Ok(now)
    }

    /// Records that the request was already sent at `asked`, together with the request before it.
    pub(super) fn left(&mut self, asked: Moment) {
        self.asked = Some(asked);
    }

    /// Returns whether the timeout has not expired yet for a request that was sent at `asked`.
    pub(super) fn is_within_timeout(&mut self, asked: Moment) -> bool {
        self.sample().since(asked) <= self.timeout
    }

    /// Announces that the request is about to be sent, and that its answer may take `timeout`.
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

    /// Returns whether the clock is virtual: its time passes only while all tasks sleep.
    pub(super) fn is_virtual(&self) -> bool {
        self.clock.is_virtual()
    }

    /// Returns whether many tasks wait for the clock, see [`Clock::is_busy`].
    pub(super) fn is_busy(&self) -> bool {
        self.clock.is_busy()
    }

    /// Announces that no clock sample follows for the time `span`, so that the gap between two samples does not count
    /// as a stop of the computer.
    pub fn away_for(&mut self, span: Duration) {
        self.stall_detector.away_for(span);
    }

    /// Reads the clock, and returns the present moment.
    pub(super) fn sample(&mut self) -> Moment {
        let now = self.clock.now();
        self.record_sample(now);
        now
    }

    /// Returns the present moment during the wait for an answer. This call does not count as a clock sample: the
    /// announced time of the wait still applies.
    pub(super) fn now(&self) -> Moment {
        self.clock.now()
    }

    /// Records a clock sample that was taken at `now`, and detects a stop of the computer before it.
    pub fn record_sample(&mut self, now: Moment) {
        let gap = self.stall_detector.sample(now);
        if self.is_watched && !self.is_unchecked {
            self.stalled_at = self.stalled_at.or(gap);
        }
    }

    /// Returns the time of the last clock sample.
    pub(super) fn last_sample(&self) -> Moment {
        self.stall_detector.last()
    }

    /// Returns whether the computer was stopped, and the owner of the line has not read that yet.
    pub fn has_stalled(&self) -> bool {
        self.stalled_at.is_some()
    }

    /// Returns the last clock sample before the computer was stopped, and resets this value. `None` if there was no
    /// stop since the last call.
    pub fn stalled_at(&mut self) -> Option<Moment> {
        self.stalled_at.take()
    }
}
