//! Protocol timeout in wall-clock time, also under a virtual clock, because the answer comes through a real socket.
//!
//! A run with a virtual clock has its virtual devices in the same process. If the computer does not run that process for a while, no
//! device could answer, and the timeout would depend on the load of the computer. There the timeout is cut into [`SLICES`](Patience::SLICES): one that
//! ends late counts as one, and between two of them the runtime lets every device act.
//!
//! The timer is set once, moved when it fires too early, and put off for as long as a line rests: a request that is answered
//! in time, as nearly all are, costs no timer at all on a line that is always busy, and no wake-up on one that rests.

#![allow(clippy::disallowed_types, reason = "timeouts are wall time")]

use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

use tokio::task::coop::unconstrained;
use tokio::time::{Instant, Sleep};

use super::Clock;

/// Timer for the timeout of one answer.
#[derive(Debug)]
pub struct Patience {
    timer: Option<Pin<Box<Sleep>>>,
    slices: u32,
}

impl Patience {
    /// Slices of a timeout in a run with a virtual clock.
    pub const SLICES: u32 = 10;

    /// A timer that has not been set, in wall-clock time.
    pub fn new() -> Patience {
        Patience { timer: None, slices: 1 }
    }

    /// A timer that has not been set, for a task that acts by this clock.
    pub fn by(clock: &Clock) -> Patience {
        Patience { timer: None, slices: if clock.is_virtual() { Patience::SLICES } else { 1 } }
    }

    /// Nothing is waited for before so long: until that is over the timer wakes nobody.
    pub fn put_off(&mut self, span: Duration) {
        if let Some(timer) = &mut self.timer {
            let deadline = Instant::now() + span;
            if timer.deadline() < deadline {
                // Another one. The old one, moved, would stay on its wheel until it was due, and wake the computer to be moved
                // there.
                timer.set(tokio::time::sleep_until(deadline));
            }
        }
    }

    /// Waits for the future, at most for `span`. Returns its output, or `None` on a timeout. A future that is ready at once costs
    /// nothing.
    pub async fn within<F: Future>(&mut self, span: Duration, future: F) -> Option<F::Output> {
        let mut future = pin!(future);
        let mut left = if span.is_zero() { 1 } else { self.slices };
        let slice = span / left;
        let mut limit = None;
        poll_fn(|context| {
            if let Poll::Ready(output) = future.as_mut().poll(context) {
                return Poll::Ready(Some(output));
            }
            let limit = limit.get_or_insert_with(|| Instant::now() + slice);
            let timer = self.timer.get_or_insert_with(|| Box::pin(tokio::time::sleep_until(*limit)));
            if timer.deadline() > *limit {
                timer.as_mut().reset(*limit);
            }
            // Also where the future has used up the task's turn, as one does whose bytes never end.
            while pin!(unconstrained(timer.as_mut())).poll(context).is_ready() {
                let now = Instant::now();
                if now >= *limit {
                    left -= 1;
                    if left == 0 {
                        return Poll::Ready(None);
                    }
                    *limit = now + slice;
                }
                timer.as_mut().reset(*limit);
            }
            Poll::Pending
        })
        .await
    }
}

impl Default for Patience {
    fn default() -> Patience {
        Patience::new()
    }
}
