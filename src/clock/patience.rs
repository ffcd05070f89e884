//! A protocol timeout: wall time always, also under a virtual clock, because a real socket is waited for.
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

/// How long one answer is waited for.
#[derive(Debug, Default)]
pub struct Patience {
    timer: Option<Pin<Box<Sleep>>>,
}

impl Patience {
    /// A timer that has not been set.
    pub fn new() -> Patience {
        Patience::default()
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

    /// What the future gives, or `None` where it takes longer than `span`. One that is ready at once costs nothing.
    pub async fn within<F: Future>(&mut self, span: Duration, future: F) -> Option<F::Output> {
        let mut future = pin!(future);
        let mut limit = None;
        poll_fn(|context| {
            if let Poll::Ready(output) = future.as_mut().poll(context) {
                return Poll::Ready(Some(output));
            }
            let limit = *limit.get_or_insert_with(|| Instant::now() + span);
            let timer = self.timer.get_or_insert_with(|| Box::pin(tokio::time::sleep_until(limit)));
            if timer.deadline() > limit {
                timer.as_mut().reset(limit);
            }
            // Also where the future has used up the task's turn, as one does whose bytes never end.
            while pin!(unconstrained(timer.as_mut())).poll(context).is_ready() {
                if Instant::now() >= limit {
                    return Poll::Ready(None);
                }
                timer.as_mut().reset(limit);
            }
            Poll::Pending
        })
        .await
    }
}
