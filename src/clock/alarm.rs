//! A timer of the kernel's, for what is far away. Those of tokio lie on wheels: one that is further away than the first wheel
//! reaches wakes the computer once more, to be moved from the next, and all are rounded to milliseconds. A computer that
//! was idle pays more for waking up than for what it then does.

use std::io::ErrorKind;
use std::time::Duration;

use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create, timerfd_settime,
};
use tokio::net::unix::pipe::Receiver;

/// As far as the first wheel of tokio's reaches.
pub(super) const FAR: Duration = Duration::from_millis(64);

/// Rings once, when it was set to. It counts as [`super::Passing`] does, a computer's suspension included.
///
/// The system gives it as a file, which becomes readable.
#[derive(Debug)]
pub(super) struct Alarm(Receiver);

impl Alarm {
    /// None where the system has no more of them: tokio's timers ring as well.
    pub(super) fn new() -> Option<Alarm> {
        let timer = timerfd_create(TimerfdClockId::Boottime, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC);
        Receiver::from_owned_fd_unchecked(timer.ok()?).ok().map(Alarm)
    }

    /// Rings after so long; whatever it was set to before is forgotten. What cannot be set rings at once: whoever waits looks
    /// at the clock, and waits again.
    pub(super) async fn after(&self, span: Duration) {
        let seconds = i64::try_from(span.as_secs()).unwrap_or(i64::MAX);
        let value = Timespec { tv_sec: seconds, tv_nsec: span.subsec_nanos().into() };
        let once = Itimerspec { it_interval: Timespec::default(), it_value: value };
        if timerfd_settime(&self.0, TimerfdTimerFlags::empty(), &once).is_err() {
            return;
        }
        let mut expirations = [0; 8];
        while self.0.readable().await.is_ok() {
            match self.0.try_read(&mut expirations) {
                // An earlier time's.
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                _ => return,
            }
        }
    }
}
