//! A timer of the kernel's, for what is far away. Those of tokio lie on wheels: one that is further away than the first wheel
//! reaches wakes the computer once more, to be moved from the next, and all are rounded to milliseconds. A computer that
//! was idle pays more for waking up than for what it then does.

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create, timerfd_settime,
};
use tokio::net::unix::pipe::Receiver;

/// As far as the first wheel of tokio's reaches.
pub(super) const FAR: Duration = Duration::from_millis(64);

/// So many of a clock's sleepers have one. Where more are busy the computer hardly rests, one timer of tokio's wakes many of them at
/// once, and each of these would cost two calls of the system a sleep, and a file of the thousand that a process may have.
const MOST: usize = 8;

/// Those of a clock that there are.
#[derive(Clone, Debug, Default)]
pub(super) struct Given(Arc<()>);

/// Rings once, when it was set to. It counts as [`super::Passing`] does, a computer's suspension included.
///
/// The system gives it as a file, which becomes readable.
#[derive(Debug)]
pub(super) struct Alarm {
    timer: Receiver,
    _is_counted_by_this: Given,
}

impl Alarm {
    /// None where there are as many as there may be, or the system has no more of them: tokio's timers ring as well.
    pub(super) fn new(given: &Given) -> Option<Alarm> {
        if Arc::strong_count(&given.0) > MOST {
            return None;
        }
        let timer = timerfd_create(TimerfdClockId::Boottime, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC);
        let timer = Receiver::from_owned_fd_unchecked(timer.ok()?).ok()?;
        Some(Alarm { timer, _is_counted_by_this: given.clone() })
    }

    /// Rings after so long; whatever it was set to before is forgotten. What cannot be set rings at once: whoever waits looks
    /// at the clock, and waits again.
    pub(super) async fn after(&self, span: Duration) {
        let seconds = i64::try_from(span.as_secs()).unwrap_or(i64::MAX);
        let value = Timespec { tv_sec: seconds, tv_nsec: span.subsec_nanos().into() };
        let once = Itimerspec { it_interval: Timespec::default(), it_value: value };
        if timerfd_settime(&self.timer, TimerfdTimerFlags::empty(), &once).is_err() {
            return;
        }
        let mut expirations = [0; 8];
        while self.timer.readable().await.is_ok() {
            match self.timer.try_read(&mut expirations) {
                // An earlier time's.
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                _ => return,
            }
        }
    }
}
