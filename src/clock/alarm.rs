//! Kernel timers for distant deadlines.
//!
//! tokio stores its timers in several wheels (lists of timers by deadline), and rounds them to milliseconds.
//! A timer beyond the range of the first wheel wakes the computer once more, only to be moved to another
//! wheel. On an idle computer, this additional wake-up costs more than the work of the task. Distant
//! deadlines therefore use kernel timers.

use std::sync::Arc;
use std::time::Duration;

use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create, timerfd_settime,
};
use tokio::io::AsyncReadExt;
use tokio::net::unix::pipe::Receiver;

/// Range of the first timer wheel of tokio. Deadlines beyond it use a kernel timer.
pub(super) const FAR: Duration = Duration::from_millis(64);

/// Maximum number of alarms of one clock. With more sleepers the computer is rarely idle, and one timer of tokio wakes
/// many of them at once. Each further alarm would cost two system calls per sleep, and one of the thousand file
/// descriptors that a process may have.
const MOST: usize = 8;

/// Counter of the alarms of one clock. Each alarm owns a clone, so that the reference count of the `Arc` shows the
/// number of alarms.
#[derive(Clone, Debug, Default)]
pub(super) struct AlarmCount(Arc<()>);

impl AlarmCount {
    /// Returns whether the clock has [`MOST`] alarms.
    pub(super) fn is_used_up(&self) -> bool {
        Arc::strong_count(&self.0) > MOST
    }
}

/// One-shot timer of the kernel. It counts time like [`super::BootClock`], including suspension of the computer.
///
/// The kernel provides the timer as a file descriptor that becomes readable.
#[derive(Debug)]
pub(super) struct Alarm {
    timer: Receiver,
    _is_counted_by_this: AlarmCount,
}

impl Alarm {
    /// Returns a new alarm. Returns `None` if the clock already has [`MOST`] alarms, or if the kernel provides no
    /// further timer. The caller then uses a timer of tokio.
    pub(super) fn new(given: &AlarmCount) -> Option<Alarm> {
        if given.is_used_up() {
            return None;
        }
        let timer = timerfd_create(TimerfdClockId::Boottime, TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC);
        let timer = Receiver::from_owned_fd_unchecked(timer.ok()?).ok()?;
        Some(Alarm { timer, _is_counted_by_this: given.clone() })
    }

    /// Waits for `span`, and replaces any earlier setting. Returns at once if the timer cannot be set. The caller must
    /// therefore check the clock, and wait again if necessary.
    pub(super) async fn after(&mut self, span: Duration) {
        let seconds = i64::try_from(span.as_secs()).unwrap_or(i64::MAX);
        let value = Timespec { tv_sec: seconds, tv_nsec: span.subsec_nanos().into() };
        let once = Itimerspec { it_interval: Timespec::default(), it_value: value };
        if timerfd_settime(&self.timer, TimerfdTimerFlags::empty(), &once).is_err() {
            return;
        }
        // The kernel fills eight bytes. If more fit, tokio knows without another call that nothing is left to read.
        let mut expirations = [0; 16];
        let _ = self.timer.read(&mut expirations).await;
    }
}
