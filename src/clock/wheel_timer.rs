//! Timer of tokio for one sleeper. tokio stores its timers in wheels (lists of timers by deadline). One timer that is
//! set again for each sleep costs less than a new timer for each sleep.

#![allow(clippy::disallowed_types, reason = "this is where time comes from")]

use std::pin::Pin;
use std::time::Duration;

use tokio::time::{Instant, Sleep, sleep_until};

/// Timer of tokio for the sleeps of one task. For a distant deadline, a kernel timer is used instead. The tokio timer
/// is created at the first sleep that uses it.
#[derive(Debug, Default)]
pub(super) struct WheelTimer(Option<Pin<Box<Sleep>>>);

impl WheelTimer {
    /// Sets the timer, and returns it as a future that is ready after `span`.
    pub(super) fn after(&mut self, span: Duration) -> Pin<&mut Sleep> {
        let deadline = Instant::now() + span;
        let timer = self.0.get_or_insert_with(|| Box::pin(sleep_until(deadline)));
        timer.as_mut().reset(deadline);
        timer.as_mut()
    }
}
