//! Timeout of a protocol, in wall-clock time. Under a virtual clock the timeout is in wall-clock time too, because the
//! answer comes through a real socket.
//!
//! A run with a virtual clock has its virtual devices in the same process. If the computer does not run that process
//! for a while, no device can answer. The timeout would then depend on the load of the computer. Such a run therefore
//! divides the timeout into [`SLICES`](WallTimeout::SLICES). A slice that ends late counts as only one slice, and the
//! runtime lets every device act between two slices.
//!
//! The timer of an earlier request stays set for the next requests. If it fires before the timeout of the
//! present request, it is moved to this timeout. While a line is idle, the timer is postponed. A request that
//! is answered in time, as nearly all are, therefore sets no timer on a busy line. On an idle line, it causes
//! no wake-up of the computer.

#![allow(clippy::disallowed_types, reason = "timeouts are wall time")]

use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

use tokio::task::coop::unconstrained;
use tokio::time::{Instant, Sleep};

use super::Clock;

/// Timer for the timeout of one answer from a device.
#[derive(Debug)]
pub struct WallTimeout {
    timer: Option<Pin<Box<Sleep>>>,
    slices: u32,
}

impl WallTimeout {
    /// Number of slices into which a timeout is divided in a run with a virtual clock.
    pub const SLICES: u32 = 10;

    /// Returns a timer in wall-clock time that is not set yet.
    pub fn new() -> WallTimeout {
        WallTimeout { timer: None, slices: 1 }
    }

    /// Returns a timer that is not set yet, for a task with this clock. Under a virtual clock, its timeouts are divided
    /// into slices.
    pub fn by(clock: &Clock) -> WallTimeout {
        WallTimeout { timer: None, slices: if clock.is_virtual() { WallTimeout::SLICES } else { 1 } }
    }

    /// Postpones the timer by `span`. The caller knows that no timeout is due within this time. Until then, the timer
    /// wakes no task.
    pub fn put_off(&mut self, span: Duration) {
        if let Some(timer) = &mut self.timer {
            let deadline = Instant::now() + span;
            if timer.deadline() < deadline {
                // Replace the timer. A timer that is moved stays on its wheel until its old deadline, and then wakes
                // the computer once more.
                timer.set(tokio::time::sleep_until(deadline));
            }
        }
    }

    /// Postpones the timer by `span`, like [`WallTimeout::put_off`], but moves it instead of replacing it. This takes
    /// less processor time. The old deadline may wake the computer once more.
    pub fn move_by(&mut self, span: Duration) {
        let deadline = Instant::now() + span;
        if let Some(timer) = self.timer.as_mut().filter(|timer| timer.deadline() < deadline) {
            timer.as_mut().reset(deadline);
        }
    }

    /// Waits for the future for at most `span`. Returns its output, or `None` on a timeout. If the future is ready at
    /// once, no timer is used.
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
            // Poll without the task's budget: a future that receives an endless stream of bytes may have used it up.
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

impl Default for WallTimeout {
    fn default() -> WallTimeout {
        WallTimeout::new()
    }
}
